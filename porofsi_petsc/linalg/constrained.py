"""The matrix of unknowns under linear constraints u = T q: T^T K T."""

import numpy as np
from petsc4py import PETSc
from scipy.sparse import csr_matrix

from .matrix import ElementMatrix


class ConstrainedMatrix:
    """T^T K T + s P of an `ElementMatrix` K, P the projection onto what the columns of T leave out,
    which keeps rows, columns and blocks of K.

    s is the mean |diagonal| of K on the rows of P, so that these do not set the tolerance of an
    iterative solver.  mat : the PETSc matrix; solutions are those of q, see `free` and `expand`.
    """

    def __init__(self, matrix: ElementMatrix, T: csr_matrix, P: csr_matrix) -> None:
        """Take K before its first assembly, and the rows of this rank of T and P (collective)."""
        self._matrix = matrix
        self._T = _petsc(matrix.mat, T)
        self._P = _petsc(matrix.mat, P)
        self._rows = np.flatnonzero(np.diff(P.indptr))
        self._product: PETSc.Mat | None = None
        self.mat: PETSc.Mat
        self.block_size = matrix.block_size
        self.clear = matrix.clear
        self.add = matrix.add

    def finish(self) -> None:
        """Complete the assembly (collective)."""
        self._matrix.finish()
        K = self._matrix.mat
        scale = self._mean_diagonal(K)
        if self._product is None:
            self._product = K.ptap(self._T)
            self.mat = self._product.copy()
            self.mat.setOptionsPrefix(K.getOptionsPrefix())
            different = PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN
            self.mat.axpy(scale, self._P, different)
            return
        K.ptap(self._T, result=self._product)
        self.mat.zeroEntries()
        for factor, part in ((1.0, self._product), (scale, self._P)):
            self.mat.axpy(factor, part, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)

    def _mean_diagonal(self, K):
        """Return s (collective)."""
        diagonal = K.getDiagonal()
        entries = np.abs(diagonal.array[self._rows])
        total, count = K.comm.tompi4py().allreduce(np.array([entries.sum(), len(entries)]))
        diagonal.destroy()
        return float(total / count) if total else 1.0

    def declare_symmetric(self, positive_definite: bool = False) -> None:
        """Tell PETSc that the matrix is and stays symmetric."""
        self.mat.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        self.mat.setOption(PETSc.Mat.Option.SYMMETRY_ETERNAL, True)
        if positive_definite:
            self.mat.setOption(PETSc.Mat.Option.SPD, True)

    def free(self, rhs: np.ndarray) -> np.ndarray:
        """Return T^T r, both (rows of this rank,) (collective)."""
        return self._times(self._T.multTranspose, rhs)

    def expand(self, q: np.ndarray) -> np.ndarray:
        """Return T q, both (rows of this rank,) (collective)."""
        return self._times(self._T.mult, q)

    def _times(self, product, values):
        x, y = self._T.createVecs()
        x.setArray(values)
        product(x, y)
        result = y.array.copy()
        x.destroy()
        y.destroy()
        return result

    def destroy(self) -> None:
        """Free the PETSc matrices (collective)."""
        for matrix in (self._T, self._P, self._product):
            if matrix is not None:
                matrix.destroy()
        if self._product is not None:
            self.mat.destroy()
        self._matrix.destroy()


BlockMatrix = ElementMatrix | ConstrainedMatrix


def _petsc(like: PETSc.Mat, rows: csr_matrix) -> PETSc.Mat:
    """Return the matrix with the rows of this rank and the layout of another (collective)."""
    indices = rows.indptr.astype(PETSc.IntType), rows.indices.astype(PETSc.IntType)
    sizes = like.getSizes()
    matrix = PETSc.Mat().createAIJ(
        sizes, bsize=like.getBlockSize(), csr=(*indices, rows.data), comm=like.comm
    )
    matrix.assemble()
    return matrix
