"""Typed errors, each mapped to one exit code of the command line."""

SMALLER_STEP = "try a smaller step"  # advice of a ConvergenceError that a cut of the step follows


class PorofsiError(Exception):
    """Root of all errors that the package raises on purpose; the message is one sentence for the user."""

    exit_code = 1


class InputError(PorofsiError):
    """Wrong input: what, where, received, expected, what to do."""

    exit_code = 2


class LimitError(InputError):
    """A term that the scene leaves out has passed its bound; raised on all ranks together, after an accepted step."""


class ConvergenceError(PorofsiError):
    """An iteration reached its cap, a linear solver failed or a trial state is inadmissible; raised on all ranks together."""

    exit_code = 3

    def __init__(self, what, advice=""):
        """Take what happened and what to try, where there is something: the message is "what; advice"."""
        super().__init__(f"{what}; {advice}" if advice else what)
        self.what, self.advice = what, advice


class Stopped(PorofsiError):
    """The run was stopped by a signal or the time limit after a checkpoint was written."""

    exit_code = 4


class ExpectationError(PorofsiError):
    """A computed quantity misses the value stated in an `[[expect]]` of the scene."""

    exit_code = 5
