"""A checksum over all bytes of a file, kept in front of them, so that damage is found before
anything else is read.

bytes 0 … 511      the front: TITLE, checksum in hexadecimal digits, line break, zeros (the user
block of an HDF5 file) bytes 512 …        the content; its checksum is the SHA-256 of the SHA-256 of
every 16 MiB, in their order
"""

import hashlib
import os
from contextlib import contextmanager
from pathlib import Path

from mpi4py import MPI

from ..errors import InputError
from .files import on_all, on_root

FRONT = 512  # [bytes] the smallest that HDF5 leaves free
BLOCK = 1 << 24  # [bytes] of one hash, which are read by one rank
TITLE = b"porofsi, SHA-256 of the SHA-256 of every 16 MiB from byte 512 on: "


def seal(path: Path, comm: MPI.Comm) -> None:
    """Write the checksum of a file into its front; collective.  Raises PorofsiError when it cannot
    be written.
    """
    on_root(comm, _write_front, path, _front(path, comm))


def starts_with(path: Path, text: bytes) -> bool:
    """Return whether a file starts with a text.  Raises InputError when it cannot be read."""
    return _read_front(path).startswith(text)


def is_sealed(path: Path, comm: MPI.Comm) -> bool:
    """Return whether every byte of a file is what it was when the file was sealed; collective.

    Raises InputError when it cannot be read.
    """
    return on_root(comm, _read_front, path) == _front(path, comm)


def _front(path, comm):
    """Return the front that belongs to the content of a file; every rank reads its share of it
    (collective).
    """
    everyone = comm.allgather(on_all(comm, lambda: _digests(path, comm.rank, comm.size)))
    blocks = range(sum(map(len, everyone)))
    whole = hashlib.sha256(b"".join(everyone[i % comm.size][i // comm.size] for i in blocks))
    return (TITLE + whole.hexdigest().encode() + b"\n").ljust(FRONT, b"\0")


def _digests(path, first, step):
    """Return the SHA-256 of every step-th block of the content from the first on."""
    found = []
    with _opened(path) as file:
        for start in range(FRONT + first * BLOCK, os.fstat(file.fileno()).st_size, step * BLOCK):
            file.seek(start)
            found.append(hashlib.sha256(_read(file, BLOCK)).digest())
    return found


@contextmanager
def _opened(path):
    """Open a file for reading; raise InputError where the system cannot read it."""
    try:
        with open(path, "rb", buffering=0) as file:
            yield file
    except OSError as failure:
        reason = failure.strerror or failure
        raise InputError(
            f"{path}: could not be read ({reason}); check the file and its permissions"
        ) from failure


def _read(file, size):
    """Return the next bytes, size of them where there are so many: a system call may return
    fewer.
    """
    parts = []
    while size and (part := file.read(size)):
        parts.append(part)
        size -= len(part)
    return b"".join(parts)


def _read_front(path):
    with _opened(path) as file:
        return _read(file, FRONT)


def _write_front(path, front):
    with open(path, "r+b") as file:
        file.write(front)
        file.flush()
        os.fsync(file.fileno())
