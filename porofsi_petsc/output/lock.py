"""The lock of a result directory: one run writes there at a time, and a killed one leaves nothing that is in the way."""

import fcntl
import os
import socket
from contextlib import suppress
from pathlib import Path

from ..errors import InputError

NAME = ".lock"


class Lock:
    """A lock on a file of a directory, which the system takes back when the process ends, however it does.

    Linux carries it over NFS too.  A file system without locks gives none: there nobody is refused.
    """

    def __init__(self, directory: Path):
        """Take the lock; raise InputError that names the process which holds it."""
        self._path = directory / NAME
        self._file = _locked(self._path)
        self._file.truncate(0)
        self._file.write(f"process {os.getpid()} on {socket.gethostname()}\n")
        self._file.flush()

    def release(self) -> None:
        """Remove the file while it is held, and let go."""
        with suppress(OSError):
            self._path.unlink()
        self._file.close()


def _locked(path):
    """Return the open file at a path, locked; the one opened may have been removed by its holder before it was locked."""
    while True:
        file = open(path, "a+", encoding="utf-8")
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as taken:
            raise InputError(_refusal(path, file)) from taken
        except OSError:  # no locks here
            return file
        with suppress(FileNotFoundError):
            if os.path.samestat(path.stat(), os.fstat(file.fileno())):
                return file
        file.close()


def _refusal(path, file):
    with file:
        file.seek(0)
        holder = file.read(200).strip() or "another process"
    return (
        f"{path.parent}: a run is writing there ({holder}), expected a directory of its own for each; "
        "wait for its end, or give another directory with --output"
    )
