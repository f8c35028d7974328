"""Ghost rows of nodal fields: the owners' values, fetched from the neighbouring ranks."""

import numpy as np
from mpi4py import MPI

TAG = 71


class Halo:
    """The neighbours of a rank, the owned rows each of them needs and the ghost rows each of them
    sends.
    """

    def __init__(
        self, comm: MPI.Intracomm, n_owned: int, ghosts: np.ndarray, first: np.ndarray
    ) -> None:
        """Exchange the lists of neighbours; collective.

        ghosts : (G,) ascending PETSc node numbers of the ghost rows.  first : (size + 1,) first
        number of every rank.
        """
        self._comm = comm
        self._n_owned = n_owned
        self._n_local = n_owned + len(ghosts)
        limits = np.searchsorted(ghosts, first)
        received = np.diff(limits)
        sent = np.empty_like(received)
        comm.Alltoall(received, sent)
        offsets = np.concatenate([[0], np.cumsum(sent)])
        asked = np.empty(offsets[-1], dtype=np.int64)
        ghosts = np.ascontiguousarray(ghosts, dtype=np.int64)
        comm.Alltoallv((ghosts, (received, limits[:-1])), (asked, (sent, offsets[:-1])))
        self._rows = asked - first[comm.rank]
        self._to = [(r, slice(offsets[r], offsets[r + 1])) for r in np.flatnonzero(sent).tolist()]
        self._from = [
            (r, slice(limits[r], limits[r + 1])) for r in np.flatnonzero(received).tolist()
        ]

    def extend(self, owned: np.ndarray) -> np.ndarray:
        """Return a field (n_local, ...) with ghosts from its owned rows (n_owned, ...);
        collective.
        """
        field = np.empty((self._n_local, *owned.shape[1:]), dtype=owned.dtype)
        field[: self._n_owned] = owned
        self.update(field)
        return field

    def update(self, array: np.ndarray) -> None:
        """Overwrite the ghost rows of an array (n_local, ...) of any dtype by the owners' values,
        in place; collective.
        """
        if len(array) != self._n_local:
            raise ValueError(
                f"halo update of {len(array)} rows; this rank has {self._n_local} nodes"
            )
        outgoing = np.ascontiguousarray(array[self._rows])
        incoming = np.empty((self._n_local - self._n_owned, *array.shape[1:]), dtype=array.dtype)
        requests = [
            self._comm.Irecv((incoming[rows].view(np.uint8), MPI.BYTE), rank, TAG)
            for rank, rows in self._from
        ]
        requests += [
            self._comm.Isend((outgoing[rows].view(np.uint8), MPI.BYTE), rank, TAG)
            for rank, rows in self._to
        ]
        MPI.Request.Waitall(requests)
        array[self._n_owned :] = incoming
