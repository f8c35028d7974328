"""The one way to write and read HDF5: every rank gives or takes consecutive rows (its slab) of each dataset.

With an MPI build of h5py every rank writes its contiguous slab; else rank 0 receives and writes one slab at a time,
so that no rank ever holds a whole dataset.
"""

import h5py
import numpy as np

from .files import on_root, publish, raise_everywhere, temporary_name, writing_error


def write_slabs(path, comm, slabs, attributes=None):
    """Write one dataset per name from the rows of all ranks, in the order of the ranks; collective.

    slabs : dict name -> (rows of this rank, ...); the same names, trailing shapes and types on every rank.
    attributes : dict name -> number, string or list of strings, stored at the root of the file (equal on every rank).
    The file appears under its name when it is complete, never earlier.  Raises PorofsiError when it cannot be written.
    """
    slabs = {name: np.ascontiguousarray(slab) for name, slab in slabs.items()}
    counts = np.array(comm.allgather([len(slab) for slab in slabs.values()]), dtype=int).reshape(comm.size, -1)
    parallel = h5py.get_config().mpi and comm.size > 1
    write = _write_together if parallel else _write_through_root
    write(temporary_name(path), comm, slabs, counts, attributes or {})
    on_root(comm, publish, path)


def _write_together(path, comm, slabs, counts, attributes):
    try:
        file = h5py.File(path, "w", driver="mpio", comm=comm)
    except OSError as failure:  # on every rank alike: opening is collective
        raise writing_error(failure, path) from failure
    starts = counts[: comm.rank].sum(axis=0)
    with file:
        file.attrs.update(attributes)
        for (name, slab), start, column in zip(slabs.items(), starts, counts.T, strict=True):
            dataset = file.create_dataset(name, (column.sum(), *slab.shape[1:]), slab.dtype)
            if column.min():
                with dataset.collective:
                    dataset[start : start + len(slab)] = slab
            elif len(slab):  # an empty selection would leave the collective write; ranks without rows are rare
                dataset[start : start + len(slab)] = slab


def _write_through_root(path, comm, slabs, counts, attributes):
    pieces, error = _pieces(comm, slabs, counts), None
    if comm.rank == 0:
        try:
            _write_pieces(path, pieces, attributes)
        except OSError as failure:
            error = writing_error(failure, path)
    for _ in pieces:  # the other ranks send; after an error rank 0 still takes what they send
        pass
    raise_everywhere(comm, error)


def _write_pieces(path, pieces, attributes):
    with h5py.File(path, "w") as file:
        file.attrs.update(attributes)
        for name, n_rows, start, rows in pieces:
            dataset = file.require_dataset(name, (n_rows, *rows.shape[1:]), rows.dtype)
            dataset[start : start + len(rows)] = rows


def _pieces(comm, slabs, counts):
    """Yield (name, rows of the dataset, first row, rows) on rank 0, rank after rank; send the own rows on the others."""
    for (name, slab), column in zip(slabs.items(), counts.T, strict=True):
        if comm.rank:
            comm.Send(slab, dest=0)
            continue
        starts = np.concatenate([[0], np.cumsum(column)])
        yield name, starts[-1], 0, slab
        for rank in range(1, comm.size):
            rows = np.empty((column[rank], *slab.shape[1:]), slab.dtype)
            comm.Recv(rows, source=rank)
            yield name, starts[-1], starts[rank], rows


def read_slab(path, name, start=0, stop=None):
    """Return the rows start … stop - 1 (all by default) of a dataset; each rank reads for itself."""
    with h5py.File(path, "r") as file:
        return file[name][start:stop]


def read_attributes(path):
    """Return the attributes at the root of the file and the shape of every dataset."""
    with h5py.File(path, "r") as file:
        return dict(file.attrs), {name: dataset.shape for name, dataset in file.items()}
