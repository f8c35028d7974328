"""The one place that knows the differences between petsc4py 3.18 and the newest: C functions without a wrapper, renamed calls."""

import ctypes

import numpy as np
from petsc4py import PETSc

_library = ctypes.CDLL(PETSc.__file__)
_library.MatSetPreallocationCOO.argtypes = [ctypes.c_void_p, ctypes.c_ssize_t, ctypes.c_void_p, ctypes.c_void_p]
_library.MatSetValuesCOO.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int]
_library.PetscOptionsUsed.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p]
_library.PetscOptionsInsert.argtypes = [ctypes.c_void_p] * 4


def _check(code):
    if code:
        raise PETSc.Error(code)


def option_used(name: str) -> bool:
    """Return whether this rank has asked for an option of the database (`PetscOptionsUsed`, not wrapped by petsc4py)."""
    used = ctypes.c_int(0)
    _check(_library.PetscOptionsUsed(None, name.encode(), ctypes.byref(used)))
    return bool(used.value & 0xFF)


def insert_environment_options() -> None:
    """Read PETSC_OPTIONS and the rc files into the database again (collective)."""
    _check(_library.PetscOptionsInsert(None, None, None, None))


def set_coo_pattern(matrix: PETSc.Mat, rows: np.ndarray, columns: np.ndarray) -> None:
    """Declare the entries of `set_coo_values`; entries with a negative index are dropped.

    rows, columns : (nnz,) PETSc.IntType, overwritten by PETSc.  Wrapped by petsc4py from 3.23.5.
    """
    if hasattr(matrix, "setPreallocationCOO"):
        matrix.setPreallocationCOO(rows, columns)
    else:
        _check(_library.MatSetPreallocationCOO(matrix.handle, rows.size, rows.ctypes.data, columns.ctypes.data))


def set_coo_values(matrix: PETSc.Mat, values: np.ndarray) -> None:
    """Replace the matrix by the sums of the repeated entries; values : (nnz,) float64 in the order of the pattern."""
    if hasattr(matrix, "setValuesCOO"):
        matrix.setValuesCOO(values, PETSc.InsertMode.INSERT_VALUES)
    else:
        _check(_library.MatSetValuesCOO(matrix.handle, values.ctypes.data, int(PETSc.InsertMode.INSERT_VALUES)))
