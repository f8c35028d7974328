"""The null space of a singular matrix: taken out of the iterates, or of the matrix before it is
factored.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from petsc4py import PETSc


@dataclass(frozen=True)
class NullVector:
    """A vector x with A x = 0 and Aᵀ x = 0, 1 on some rows and 0 on the others.

    values : (owned rows,); row : owned row with x = 1 which a factorization fixes, None where it is
    another rank's
    """

    values: np.ndarray
    row: int | None


class NullSpace:
    """What a solver does with the null space of its matrix, whose values change.

    An iterative solver takes it out of every iterate and out of the right side (MatSetNullSpace).
    A factorization needs a regular matrix: a_rr is doubled in one row r of each vector.  With A x =
    b that has a solution follows xᵀ(A + a_rr e_r e_rᵀ) y = a_rr y_r = xᵀ b = 0: the solution is
    that one of A with y_r = 0.
    """

    def __init__(self, matrix: PETSc.Mat, vectors: Sequence[NullVector], direct: bool) -> None:
        self._matrix = matrix
        self._vectors = vectors
        self._direct = direct
        self._state = None
        self._space = None

    def use(self, matrix: PETSc.Mat) -> None:
        """Go on with another matrix of the same layout and null space."""
        self._matrix = matrix
        self._state = None

    def prepare(self, scaling: PETSc.Vec | None = None) -> None:
        """Make new values of the matrix ready; scaling : D^-½ where it has been scaled to D^-½ A
        D^-½ (collective).
        """
        if self._matrix.stateGet() == self._state:
            return
        if self._direct:
            self._fix()
        else:
            self._attach(scaling)
        self._state = self._matrix.stateGet()

    def project(self, right: PETSc.Vec) -> None:
        """Take what no solution can reach out of a right-hand side of an iterative solver
        (collective).
        """
        if self._space:
            self._space.remove(right)

    def _fix(self):
        diagonal = self._matrix.getDiagonal()
        with diagonal as entries:
            for vector in self._vectors:
                if vector.row is not None:
                    entries[vector.row] = 2 * entries[vector.row] or 1.0
        self._matrix.setDiagonal(diagonal)
        diagonal.destroy()

    def _attach(self, scaling):
        basis = []
        for vector in self._vectors:
            basis.append(self._matrix.createVecRight())
            basis[-1].setArray(vector.values)
            if scaling is not None:
                basis[-1].pointwiseDivide(basis[-1], scaling)
            basis[-1].normalize()
        self.destroy()
        self._space = PETSc.NullSpace().create(vectors=basis, comm=self._matrix.comm)
        self._matrix.setNullSpace(self._space)
        for vector in basis:
            vector.destroy()

    def destroy(self) -> None:
        """Free the PETSc objects (collective)."""
        if self._space:
            self._space.destroy()
            self._space = None
