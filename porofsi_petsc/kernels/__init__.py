"""Element routines: pure functions on batches of elements, element axis first."""
