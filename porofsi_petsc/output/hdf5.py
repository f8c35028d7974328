"""The one way to write and read HDF5: every rank gives or takes consecutive rows (its slab) of each
dataset.

With an MPI build of h5py every rank writes its contiguous slab; else rank 0 receives and writes one
slab at a time, so that no rank ever holds a whole dataset.
"""

import errno
import io
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import h5py
import numpy as np
from mpi4py import MPI

from ..errors import InputError
from .files import complete, on_root, raise_everywhere, temporary_name, writing_error

CHUNK_ROWS = 1 << 14  # rows of a dataset that are compressed together
STRUCTURE = 1 << 16  # [bytes] more than the structure of a file takes beside data and attributes


def write_slabs(
    path: Path,
    comm: MPI.Comm,
    slabs: Mapping[str, np.ndarray],
    attributes: Mapping[str, Any] | None = None,
    front: int | None = None,
    compression: int = 0,
) -> None:
    """Write one dataset per name from the rows of all ranks, in the order of the ranks; collective.

    slabs : dict name -> (rows of this rank, ...); the same names, trailing shapes and types on
    every rank.
    attributes : dict name -> number, string or list of them, equal on every rank; at the root of
    the file, or "group/name".
    front : bytes that are left free at the start of the file, a power of two from 512 on, or None.
    compression : level of gzip, 0 for none; what is compressed is written by rank 0 alone.
    The file appears under its name when it is complete, never earlier (`files.keep_names` makes the
    name last); one that cannot be completed is removed, so that its space is free again.  Raises
    PorofsiError when it cannot be written.
    """
    written = temporary_name(path)
    if h5py.get_config().mpi and comm.size > 1 and not compression:
        _write_together(written, comm, slabs, attributes or {}, front)
    else:
        fill = partial(_make, written, attributes or {}, front, compression)
        write_through_root(written, comm, slabs, fill)
    on_root(comm, complete, path)


def _contiguous(comm, slabs):
    """Return slabs in C order, and their rows on all ranks, (ranks, slabs); collective."""
    slabs = {name: np.ascontiguousarray(slab) for name, slab in slabs.items()}
    counts = comm.allgather([len(slab) for slab in slabs.values()])
    return slabs, np.array(counts, dtype=int).reshape(comm.size, -1)


def _write_together(path, comm, slabs, attributes, front):
    slabs, counts = _contiguous(comm, slabs)
    sizes = [
        column.sum() * slab[:1].nbytes
        for slab, column in zip(slabs.values(), counts.T, strict=True)
    ]
    text = sum(len(str(value)) for value in attributes.values())
    on_root(comm, require_room, path, comm.allreduce(sum(sizes), MPI.MAX) + text + STRUCTURE)
    try:
        file = h5py.File(path, "w", driver="mpio", comm=comm, userblock_size=front)
    except OSError as failure:  # on every rank alike: opening is collective
        raise writing_error(failure, path) from failure
    starts = counts[: comm.rank].sum(axis=0)
    with file:
        _describe(file, attributes)
        for (name, slab), start, column in zip(slabs.items(), starts, counts.T, strict=True):
            dataset = file.create_dataset(name, (column.sum(), *slab.shape[1:]), slab.dtype)
            if column.min():
                with dataset.collective:
                    dataset[start : start + len(slab)] = slab
            elif len(
                slab
            ):  # an empty selection would leave the collective write; ranks without rows are rare
                dataset[start : start + len(slab)] = slab


def require_room(path: Path, size: int) -> None:
    """Raise OSError where the file system has less than a size [bytes] left: HDF5 crashes when it
    meets a full disk.
    """
    status = os.statvfs(path.parent)
    if status.f_bavail * status.f_frsize < size:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))


def _describe(file, attributes):
    for name, value in attributes.items():
        group, _, key = name.rpartition("/")
        (file.require_group(group) if group else file).attrs[key] = value


Pieces = Iterator[tuple[str, int, int, np.ndarray]]


def write_through_root(
    path: Path, comm: MPI.Comm, slabs: Mapping[str, np.ndarray], fill: Callable[[Pieces], None]
) -> None:
    """Let rank 0 fill a file with the rows of all ranks; collective.

    slabs : as of `write_slabs`; fill : gets an iterator of name, rows of all ranks, first of these
    rows, these rows.  Raises PorofsiError when it cannot be written.
    """
    slabs, counts = _contiguous(comm, slabs)
    pieces = _pieces(comm, slabs, counts)
    error = None
    if comm.rank == 0:
        try:
            fill(pieces)
        except OSError as failure:
            error = writing_error(failure, path)
    for _ in pieces:  # the other ranks send; after an error rank 0 still takes what they send
        pass
    raise_everywhere(comm, error)


def _make(path, attributes, front, compression, pieces):
    """Make a file of the pieces of its datasets; remove it where that fails."""
    try:
        with patiently(PatientFile(path)) as patient:
            _fill(patient, pieces, attributes, front, compression)
    except OSError:
        with suppress(OSError):
            path.unlink()
        raise


class PatientFile(io.FileIO):
    """A file in which nothing fails: HDF5 ends with a segmentation fault after a write that did, on
    a full disk, say.

    error : the first OSError, after which the content is worthless, or None
    """

    error = None

    def __init__(self, path: Path, mode: str = "w+") -> None:
        """Open the file, by default anew."""
        super().__init__(path, mode)

    def write(self, data: Any) -> int:
        """Write all bytes."""
        rest = memoryview(data).cast("B")
        with self._keeping_errors():
            while rest:  # a system call takes 2 GiB at most
                rest = rest[super().write(rest) :]
        return len(data)

    def readinto(self, buffer: Any) -> int:
        """Give back what was written, and zeros for what was not."""
        rest = memoryview(buffer).cast("B")
        with self._keeping_errors():
            while rest and (found := super().readinto(rest)):
                rest = rest[found:]
        rest[:] = bytes(len(rest))
        return len(buffer)

    def truncate(self, size: int | None = None) -> int:
        """Set the size of the file."""
        with self._keeping_errors():
            super().truncate(size)
        return self.tell() if size is None else size

    @contextmanager
    def _keeping_errors(self):
        try:
            yield
        except OSError as failure:
            self.error = self.error or failure


Patient = TypeVar("Patient", bound=PatientFile)


@contextmanager
def patiently(patient: Patient) -> Iterator[Patient]:
    """Close a `PatientFile` and raise its first error, from which all others follow."""
    with patient:
        try:
            yield patient
        finally:
            if patient.error is not None:
                raise patient.error


def _fill(patient, pieces, attributes, front, compression):
    with h5py.File(patient, "w", userblock_size=front) as file:
        _describe(file, attributes)
        for name, n_rows, start, rows in pieces:
            shape = (n_rows, *rows.shape[1:])
            how = filters(shape, compression)
            dataset = file.require_dataset(name, shape, rows.dtype, **how)
            dataset[start : start + len(rows)] = rows


def filters(shape: tuple[int, ...], compression: int) -> dict[str, Any]:
    """Return the options of a dataset of a shape that make it compressed, none for level 0."""
    if not compression:
        return {}
    chunks = (min(max(shape[0], 1), CHUNK_ROWS), *shape[1:])
    return {
        "chunks": chunks,
        "shuffle": True,
        "compression": "gzip",
        "compression_opts": compression,
    }


def _pieces(comm, slabs, counts):
    """Yield (name, rows of the dataset, first row, rows) on rank 0, rank after rank; send the own
    rows on the others.
    """
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


@contextmanager
def reading(path: str | os.PathLike[str]) -> Iterator[h5py.File]:
    """Open an HDF5 file for reading; raise InputError where it, or what is done with it, fails."""
    try:
        with h5py.File(path, "r") as file:
            yield file
    except (OSError, RuntimeError, LookupError, TypeError, ValueError, AttributeError) as failure:
        raise InputError(
            f"{path}: could not be read, expected a complete HDF5 file written by porofsi; move it"
            " away"
        ) from failure


def read_slab(
    path: str | os.PathLike[str], name: str, start: int = 0, stop: int | None = None
) -> np.ndarray:
    """Return the rows start … stop - 1 (all by default) of a dataset; each rank reads for itself.
    Raises InputError.
    """
    with reading(path) as file:
        return file[name][start:stop]


class Layout(NamedTuple):
    """What a dataset holds: its shape and the bytes of a number."""

    shape: tuple[int, ...]
    precision: int


def read_attributes(path: str | os.PathLike[str]) -> tuple[dict[str, Any], dict[str, Layout]]:
    """Return the attributes at the root of the file and the `Layout` of every dataset.  Raises
    InputError.
    """
    with reading(path) as file:
        layouts = {name: Layout(item.shape, item.dtype.itemsize) for name, item in file.items()}
        return dict(file.attrs), layouts
