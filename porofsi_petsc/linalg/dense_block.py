"""A matrix with a dense block in some of its rows and columns, as the answer of a body condensed to
a surface is one.
"""

import numpy as np
from petsc4py import PETSc


class DenselyCoupled:
    """A + E B Eᵀ, A a PETSc.Mat whose values change and B a dense matrix on some of its unknowns;
    `mat` has the union pattern.
    """

    def __init__(self, matrix: PETSc.Mat, unknowns: np.ndarray) -> None:
        """Take A and the numbers of the unknowns in it, (n,), the same on every rank."""
        self._matrix = matrix
        self._order = np.argsort(unknowns)
        first, end = matrix.getOwnershipRange()
        self._columns = np.sort(unknowns).astype(PETSc.IntType)
        self._mine = (self._columns >= first) & (self._columns < end)
        own = np.zeros(end - first, dtype=PETSc.IntType)
        own[self._columns[self._mine] - first] = len(unknowns)
        self._starts = np.append(0, np.cumsum(own)).astype(PETSc.IntType)
        self.mat: PETSc.Mat | None = None

    def assemble(self, block: np.ndarray) -> None:
        """Set the matrix to the present A and B = block (n, n), the same on every rank
        (collective).
        """
        values = block[np.ix_(self._order, self._order)][self._mine]
        columns = np.tile(self._columns, len(values))
        added = PETSc.Mat().createAIJ(
            self._matrix.getSizes(),
            csr=(self._starts, columns, values.ravel()),
            comm=self._matrix.comm,
        )
        if self.mat is None:
            self.mat = self._matrix.copy()
            self.mat.axpy(1.0, added, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        else:
            self.mat.zeroEntries()
            for part in (self._matrix, added):
                self.mat.axpy(1.0, part, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        added.destroy()
