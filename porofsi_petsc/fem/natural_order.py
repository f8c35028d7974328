"""Between the rows of a rank and its slab of rows in the natural order, the order of all output."""

import numpy as np
from mpi4py import MPI


class NaturalOrder:
    """The exchange between owned nodes and slabs; slab r holds the natural rows bounds[r] …
    bounds[r + 1] - 1.

    A row that several ranks have, as that of an overlapped element, is equal on all of them.

    bounds : (size + 1,) int64, slabs of equal size up to one row.
    """

    def __init__(self, comm: MPI.Intracomm, natural: np.ndarray, n_global: int) -> None:
        """Exchange the row lists; collective.  natural : (n_owned,) ascending natural numbers of
        the owned nodes.
        """
        self._comm = comm
        self.bounds = np.arange(comm.size + 1) * n_global // comm.size
        sent = np.diff(np.searchsorted(natural, self.bounds))
        received = np.empty_like(sent)
        comm.Alltoall(sent, received)
        self._owned = _counts_and_offsets(sent)
        self._slab = _counts_and_offsets(received)
        numbers = _exchange(
            comm, np.ascontiguousarray(natural, dtype=np.int64), self._owned, self._slab
        )
        self._rows = numbers - self.bounds[comm.rank]

    def to_slab(self, owned: np.ndarray) -> np.ndarray:
        """Return this rank's slab, (bounds[r + 1] - bounds[r], ...), from the owned rows, (n_owned,
        ...); collective.
        """
        arrived = _exchange(self._comm, owned, self._owned, self._slab)
        rows = np.diff(self.bounds)[self._comm.rank]
        slab = np.empty((rows, *arrived.shape[1:]), arrived.dtype)
        slab[self._rows] = arrived
        return slab

    def from_slab(self, slab: np.ndarray) -> np.ndarray:
        """Return the owned rows, (n_owned, ...), from this rank's slab, (bounds[r + 1] - bounds[r],
        ...); collective.
        """
        return _exchange(self._comm, slab[self._rows], self._slab, self._owned)


def _counts_and_offsets(counts):
    return counts, np.cumsum(counts) - counts


def _exchange(comm, rows, outgoing, incoming):
    """Return the rows that arrive; outgoing, incoming : counts and offsets per rank in rows of any
    shape and dtype.
    """
    if len(rows) != outgoing[0].sum():
        raise ValueError(f"an exchange of {len(rows)} rows; this rank sends {outgoing[0].sum()}")
    rows = np.ascontiguousarray(rows)
    arrived = np.empty((incoming[0].sum(), *rows.shape[1:]), dtype=rows.dtype)
    row = MPI.BYTE.Create_contiguous(rows.dtype.itemsize * int(np.prod(rows.shape[1:]))).Commit()
    comm.Alltoallv(
        (rows.reshape(-1).view(np.uint8), outgoing, row),
        (arrived.reshape(-1).view(np.uint8), incoming, row),
    )
    row.Free()
    return arrived
