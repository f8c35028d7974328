"""Linear algebra on PETSc: options, distributed matrices and linear solvers; nothing here knows any
physics.

Importing this package does not start PETSc; `porofsi_petsc.linalg.options.start` does.
"""
