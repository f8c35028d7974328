"""The one place that knows the differences between petsc4py 3.18 and the newest: C functions
without a wrapper, renamed calls.
"""

import ctypes
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np
from petsc4py import PETSc

_library = ctypes.CDLL(PETSc.__file__)
_library.MatMPIAIJGetSeqAIJ.argtypes = [ctypes.c_void_p] * 4
_library.MatSeqAIJGetArray.argtypes = [ctypes.c_void_p] * 2
_library.MatSeqAIJRestoreArray.argtypes = [ctypes.c_void_p] * 2
_library.PetscOptionsUsed.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p]
_library.PetscOptionsInsert.argtypes = [ctypes.c_void_p] * 4


def _check(code):
    if code:
        raise PETSc.Error(code)


def option_used(name: str) -> bool:
    """Return whether this rank has asked for an option of the database (`PetscOptionsUsed`, not
    wrapped by petsc4py).
    """
    used = ctypes.c_int(0)
    _check(_library.PetscOptionsUsed(None, name.encode(), ctypes.byref(used)))
    return bool(used.value & 0xFF)


def insert_environment_options() -> None:
    """Read PETSC_OPTIONS and the rc files into the database again (collective)."""
    _check(_library.PetscOptionsInsert(None, None, None, None))


@contextmanager
def local_values(matrix: PETSc.Mat, sizes: Sequence[int]) -> Iterator[list[np.ndarray]]:
    """Lend the values of an AIJ matrix, row by row: those in the columns of this rank and those in
    the others', of known sizes.

    PETSc keeps them in two matrices, of which petsc4py shows neither; on one process all is in the
    first.
    """
    parts = [ctypes.c_void_p(matrix.handle), None]
    if matrix.comm.size > 1:
        own, others = ctypes.c_void_p(), ctypes.c_void_p()
        _check(
            _library.MatMPIAIJGetSeqAIJ(
                matrix.handle, ctypes.byref(own), ctypes.byref(others), None
            )
        )
        parts = [own, others]
    pointers = [ctypes.c_void_p() for _ in parts]
    for part, pointer in zip(parts, pointers, strict=True):
        if part is not None:
            _check(_library.MatSeqAIJGetArray(part, ctypes.byref(pointer)))
    try:
        yield [_view(pointer, size) for pointer, size in zip(pointers, sizes, strict=True)]
    finally:
        for part, pointer in zip(parts, pointers, strict=True):
            if part is not None:
                _check(_library.MatSeqAIJRestoreArray(part, ctypes.byref(pointer)))


def _view(pointer, size):
    return (
        np.ctypeslib.as_array((ctypes.c_double * size).from_address(pointer.value))
        if size
        else np.empty(0)
    )
