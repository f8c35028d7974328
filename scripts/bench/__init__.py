"""Times and counts of the package, beside other programs or beside what was tried against it."""
