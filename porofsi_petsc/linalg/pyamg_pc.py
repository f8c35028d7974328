"""PETSc Python preconditioner: one V-cycle of pyamg's smoothed aggregation on the rows of this
rank.

Alone in serial (`-solid_pc_type python -solid_pc_python_type porofsi_petsc.linalg.pyamg_pc.PyAMG`)
or on the subdomains (`-solid_pc_type bjacobi -solid_sub_pc_type python -solid_sub_pc_python_type
porofsi_petsc.linalg.pyamg_pc.PyAMG`).
"""

from contextlib import contextmanager

import numpy as np
from petsc4py import PETSc
from scipy.sparse import csr_matrix

from ..errors import InputError


class PyAMG:
    """Symmetric V-cycle with the near-null space of the matrix; good on subdomains, not scalable
    alone.
    """

    def setUp(self, pc: PETSc.PC) -> None:
        """Build the hierarchy; raise InputError when pyamg is missing or the matrix is
        distributed.
        """
        matrix = pc.getOperators()[1]
        if matrix.comm.size > 1:
            raise InputError(
                "the preconditioner PyAMG works on one rank; use it on subdomains: -pc_type bjacobi"
                " -sub_pc_type python"
            )
        self._cycle = _hierarchy(matrix) if matrix.getSize()[0] else None

    def apply(self, pc: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Set y to one V-cycle on x."""
        y.setArray(
            self._cycle @ x.getArray(readonly=True) if self._cycle is not None else np.zeros(0)
        )


def _hierarchy(matrix):
    try:
        from pyamg import smoothed_aggregation_solver
    except ImportError as error:
        raise InputError(
            "the preconditioner PyAMG needs the package pyamg: pip install pyamg"
        ) from error
    indptr, indices, values = matrix.getValuesCSR()
    A = csr_matrix((values, indices, indptr), shape=matrix.getSize())
    size = matrix.getBlockSize()
    space = matrix.getNearNullSpace()
    columns = [v.getArray(readonly=True).copy() for v in space.getVecs()] if space.handle else []
    B = (
        np.column_stack(columns)
        if columns
        else np.kron(np.ones((A.shape[0] // size, 1)), np.eye(size))
    )
    with _fixed_seed():
        return smoothed_aggregation_solver(A.tobsr((size, size)), B=B).aspreconditioner()


@contextmanager
def _fixed_seed():
    """Let pyamg make the same of the same matrix: it starts its power iterations with NumPy's old
    global generator (NPY002).
    """
    state = np.random.get_state()  # noqa: NPY002
    np.random.seed(0)  # noqa: NPY002
    try:
        yield
    finally:
        np.random.set_state(state)  # noqa: NPY002
