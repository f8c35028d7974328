"""Distributed matrix of a nodal field: element matrices are added where they belong, in PETSc's own
arrays of values.
"""

import numpy as np
import scipy.sparse
from mpi4py import MPI
from petsc4py import PETSc

from ..compiled import inlined, plain, specialized, stack
from ..errors import InputError
from .compat import local_values
from .options import reason_of


class ElementMatrix:
    """An AIJ matrix whose pattern is fixed once by the elements, and to whose values element
    matrices are added.

    comm        : MPI communicator (mpi4py)
    cells       : (E, A) int, local node numbers of the elements of this rank
    numbering   : (n_local,) int, PETSc's number of every local node, -1 where it is not in the
    matrix
    n_owned     : number of nodes of this rank, which PETSc numbers consecutively
    constrained : (n_local, m) bool, unknowns with a prescribed value; component k of node b has the
    number m b + k

    Rows of other ranks are dropped (their owner computes them from its overlapped elements), so
    assembly needs no communication and is bitwise reproducible.  Rows and columns of constrained
    unknowns are dropped too, which keeps symmetry; their diagonal is the mean |diagonal| of the
    free unknowns of the same component (1 where there is none), so that their residual does not set
    the tolerance of an iterative solver.

    mat : the PETSc matrix, options prefix `prefix`.

    All free rows of a node have the same columns, so an entry lies at the start of its row plus the
    place of its block of columns in a row: one int32 for each pair of nodes of an element.  Element
    matrices are added chunk by chunk, while they are in cache, and kept nowhere.
    """

    def __init__(
        self,
        comm: MPI.Intracomm,
        cells: np.ndarray,
        numbering: np.ndarray,
        n_owned: int,
        constrained: np.ndarray,
        prefix: str = "",
    ) -> None:
        self.block_size = constrained.shape[1]
        self.mat = _empty_matrix(comm, n_owned * self.block_size, self.block_size, prefix)
        first = comm.exscan(n_owned) or 0
        used = np.flatnonzero(numbering >= 0)
        used = used[np.argsort(numbering[used])]
        numbers = numbering[used].astype(PETSc.IntType)
        self._free = ~constrained[used]
        position = np.full(len(numbering), -1, dtype=np.int32)
        position[used] = np.arange(len(used))
        self._cells = position[cells]  # nodes in the order of PETSc
        self._own = slice(*np.searchsorted(numbers, (first, first + n_owned)).tolist())
        simple = np.zeros(len(numbers), dtype=bool)
        simple[self._own] = self._owned_free.all(axis=1)
        self._simple = simple[self._cells].all(axis=1)
        self._set_pattern(numbers)
        self._is_constrained = comm.allreduce(not self._owned_free.all(), MPI.LOR)
        self.clear()
        self.finish()

    @property
    def _owned_free(self):
        return self._free[self._own]

    def _set_pattern(self, numbers):
        """Allocate the matrix and find the places in it; numbers (n,) of the nodes in PETSc,
        ascending (collective).
        """
        own = self._own
        A = self._cells.shape[1]
        indptr, indices = _graph(self._cells, own, len(numbers))
        inside = (indices >= own.start) & (indices < own.stop)
        size = self._free.sum(axis=1)[indices]
        # PETSc keeps the columns of this rank, diagonals included, and those of others in two
        # matrices.
        in_row, lengths = zip(
            *(_places_in_rows(indptr, size * there) for there in (inside, ~inside)), strict=True
        )
        lengths = [
            np.where(self._owned_free, kept[:, None], alone).ravel()
            for kept, alone in zip(lengths, (1, 0), strict=True)
        ]
        self._starts = [self._row_starts(length) for length in lengths]
        self._sizes = [int(length.sum()) for length in lengths]
        rows = np.append(0, np.cumsum(lengths[0] + lengths[1])).astype(PETSc.IntType)
        columns = np.empty(rows[-1], dtype=PETSc.IntType)
        _columns_loop(self.block_size)(
            indptr, indices, numbers, self._free, own.start, rows, columns
        )
        self.mat.setPreallocationCSR((rows, columns))
        self._places = np.zeros((*self._cells.shape, A), dtype=np.uint32)
        place = np.where(inside, *in_row).astype(np.uint32)
        _places_loop(A)(self._cells, own.start, indptr, indices, place, self._places)

    def _row_starts(self, lengths):
        """Return where the rows of the nodes start, (n, m), from the lengths of all rows of this
        rank, one after the other.
        """
        starts = np.zeros(self._free.shape, dtype=np.uint64)
        starts[self._own] = (np.cumsum(lengths) - lengths).reshape(self._owned_free.shape)
        return starts

    def assemble(self, values: np.ndarray) -> None:
        """Replace the matrix by the sum of the element matrices (E, A, m, A, m) (collective)."""
        self.clear()
        self.add(slice(None), values)
        self.finish()

    def clear(self) -> None:
        """Set all entries to zero; `add` and `finish` follow (collective)."""
        self.mat.zeroEntries()

    def add(self, chunk: slice, values: np.ndarray) -> None:
        """Add the matrices (e, A, m, A, m) of a slice of the elements."""
        elements = plain(values), self._cells[chunk], self._simple[chunk], self._places[chunk]
        with local_values(self.mat, self._sizes) as arrays:
            loop = _add_loop(self._cells.shape[1], self.block_size)
            loop(*elements, self._free, self._own.start, self._own.stop, *self._starts, *arrays)

    def finish(self) -> None:
        """Complete the assembly (collective)."""
        self.mat.assemble()
        if self._is_constrained:
            self._set_constrained_diagonal()

    def _set_constrained_diagonal(self):
        """Set the diagonal of constrained rows to the mean |diagonal| of the free rows of the same
        component (collective).
        """
        diagonal = self.mat.getDiagonal()
        entries = diagonal.array.reshape(-1, self.block_size)
        free = self._owned_free
        sums = np.array([(np.abs(entries) * free).sum(axis=0), free.sum(axis=0)])
        total, count = self.mat.comm.tompi4py().allreduce(sums)
        mean = np.divide(
            total, count, out=np.ones(self.block_size), where=(count > 0) & (total > 0)
        )
        entries[...] = np.where(free, entries, mean)
        self.mat.setDiagonal(diagonal)
        diagonal.destroy()

    def declare_symmetric(self, positive_definite: bool = False) -> None:
        """Tell PETSc that the matrix is and stays symmetric: LDL^T instead of LU, or Cholesky when
        positive definite.
        """
        self.mat.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        self.mat.setOption(PETSc.Mat.Option.SYMMETRY_ETERNAL, True)
        if positive_definite:
            self.mat.setOption(PETSc.Mat.Option.SPD, True)

    def destroy(self) -> None:
        """Free the PETSc matrix (collective)."""
        self.mat.destroy()


def _empty_matrix(comm, n_owned_rows, block_size, prefix):
    matrix = PETSc.Mat().create(comm)
    size = (n_owned_rows, PETSc.DETERMINE)
    matrix.setSizes((size, size), bsize=block_size)
    matrix.setOptionsPrefix(prefix)
    matrix.setType(PETSc.Mat.Type.AIJ)
    try:
        matrix.setFromOptions()
    except PETSc.Error as error:
        what = (
            f"matrix '{prefix}': received an option that this PETSc does not have,"
            f" {reason_of(error)}"
        )
        raise InputError(f"{what}; remove the option -{prefix}mat_type") from error
    if not matrix.getType().startswith(("seqaij", "mpiaij")):
        what = (
            f"matrix '{prefix}': received type '{matrix.getType()}', expected aij or a type derived"
            " from it"
        )
        raise InputError(f"{what}; remove the option -{prefix}mat_type")
    return matrix


def _graph(cells, own, n):
    """Return, as rows of a CSR pattern, the nodes (of n, ascending) that share an element with each
    of this rank's.
    """
    E, A = cells.shape
    ones = np.ones(E * A, dtype=bool)
    ends = np.arange(0, E * A + 1, A)
    incidence = scipy.sparse.csr_matrix((ones, cells.ravel(), ends), shape=(E, n))
    graph = (incidence[:, own].T @ incidence).tocsr()
    graph.sort_indices()
    return graph.indptr.astype(np.int64), graph.indices.astype(np.int32)


def _places_in_rows(indptr, sizes):
    """Return the sum of the sizes before every block of its row, and of all of a row, for blocks
    (nnz,) in rows of `indptr`.
    """
    before = np.append(0, np.cumsum(sizes))
    return before[:-1] - np.repeat(before[indptr[:-1]], np.diff(indptr)), np.diff(before[indptr])


@specialized
def _columns_loop(m):
    """Return the loop that writes the columns of all scalar rows; a constrained row has its
    diagonal alone.
    """

    def loop(indptr, indices, numbers, free, first, rows, columns):
        for r in range(len(indptr) - 1):
            for i in range(m):
                z = rows[m * r + i]
                if not free[first + r, i]:
                    columns[z] = m * numbers[first + r] + i
                    continue
                for block in range(indptr[r], indptr[r + 1]):
                    for k in range(m):
                        if free[indices[block], k]:
                            columns[z] = m * numbers[indices[block]] + k
                            z += 1

    return loop


@specialized
def _places_loop(A):
    """Return the loop that finds, by bisection, the block of every pair of nodes of an element in
    the row of the first.
    """

    def loop(cells, first, indptr, indices, place, places):
        for e in range(len(cells)):
            for a in range(A):
                r = cells[e, a] - first
                if r < 0 or r >= len(indptr) - 1:
                    continue
                for b in range(A):
                    low = indptr[r]
                    high = indptr[r + 1] - 1
                    while low < high:
                        middle = (low + high) // 2
                        if indices[middle] < cells[e, b]:
                            low = middle + 1
                        else:
                            high = middle
                    places[e, a, b] = place[low]

    return loop


@specialized
def _add_loop(A, m):
    """Return the loop that adds element matrices K (e, A, m, A, m) to the values in the columns of
    this rank and of others.

    In a simple element all unknowns are this rank's and free.  Places are unsigned: a signed one
    could count from the end.
    """

    def loop(
        K, cells, simple, places, free, first, end, starts_inside, starts_outside, inside, outside
    ):
        row = stack((m,))
        for e in range(len(K)):
            for a in range(A):
                r = cells[e, a]
                if simple[e]:
                    for b in range(A):
                        for i in range(m):
                            _add_row(
                                m, K[e, a, i, b], starts_inside[r, i] + places[e, a, b], row, inside
                            )
                elif first <= r < end:
                    for b in range(A):
                        c = cells[e, b]
                        if first <= c < end:
                            _add_block(
                                m,
                                K[e, a, :, b],
                                starts_inside[r],
                                places[e, a, b],
                                free[r],
                                free[c],
                                inside,
                            )
                        else:
                            _add_block(
                                m,
                                K[e, a, :, b],
                                starts_outside[r],
                                places[e, a, b],
                                free[r],
                                free[c],
                                outside,
                            )

    return loop


@inlined
def _add_row(m, entries, start, row, values):
    """Add entries (m,); sums come first because the compiler does not know that the arrays do not
    overlap.
    """
    for k in range(m):
        row[k] = values[start + np.uint64(k)] + entries[k]
    for k in range(m):
        values[start + np.uint64(k)] = row[k]


@inlined
def _add_block(m, block, starts, place, free_rows, free_columns, values):
    """Add a block (m, m) to the free rows, which start at `starts`, in the free columns from a
    place on.
    """
    for i in range(m):
        if free_rows[i]:
            z = starts[i] + place
            for k in range(m):
                if free_columns[k]:
                    values[z] += block[i, k]
                    z += np.uint64(1)
