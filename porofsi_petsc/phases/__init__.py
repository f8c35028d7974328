"""The phases: the one place where physics meets PETSc."""
