"""The lock of a result directory: one run writes there at a time, and a killed one leaves nothing
that is in the way.
"""

import errno
import fcntl
import os
import re
import socket
import stat
from contextlib import suppress
from pathlib import Path

from ..errors import InputError

NAME = ".lock"
_OURS = re.compile(
    rb"(process \d+ on \S*\n)?"
)  # all that a lock file holds, also that of a killed run
_LONGEST = 400  # bytes read of it, more than a name of a machine has
_FLAGS = os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
_NO_FILE = (
    errno.ELOOP,
    errno.EMLINK,
    errno.EISDIR,
    errno.ENXIO,
)  # a link (two spellings), a folder, a socket


class Lock:
    """A lock on a file of a directory, which the system takes back when the process ends, however
    it does.

    Linux carries it over NFS too.  A file system without locks gives none: there nobody is refused.
    """

    def __init__(self, directory: Path) -> None:
        """Take the lock; raise InputError that names the process which holds it, or a file that is
        no lock.
        """
        self._path = directory / NAME
        self._file = _locked(self._path)
        self._file.truncate(0)
        self._file.write(f"process {os.getpid()} on {socket.gethostname()}\n".encode())

    def release(self) -> None:
        """Remove the file while it is held, and let go."""
        with suppress(OSError):
            self._path.unlink()
        self._file.close()


def _locked(path):
    """Return the open file at a path, locked; the one opened may have been removed by its holder
    before it was locked.
    """
    while True:
        file = _opened(path)
        try:
            _acquire(path, file)
            with suppress(FileNotFoundError):
                if os.path.samestat(path.lstat(), os.fstat(file.fileno())):
                    _require_ours(path, file)
                    return file
        except BaseException:
            file.close()
            raise
        file.close()


def _opened(path):
    """Return the file at a path, made where there is none; a link is not followed."""
    try:
        descriptor = os.open(path, _FLAGS, 0o666)
    except OSError as failure:
        if failure.errno in _NO_FILE:
            raise _foreign(path) from failure
        raise
    return open(descriptor, "r+b", buffering=0)


def _acquire(path, file):
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as taken:
        raise InputError(_refusal(path, file)) from taken
    except OSError:  # no locks here
        pass


def _require_ours(path, file):
    """Raise InputError where a file is not what a run leaves: the user's own is neither overwritten
    nor removed.
    """
    if not stat.S_ISREG(os.fstat(file.fileno()).st_mode) or not _OURS.fullmatch(_content(file)):
        raise _foreign(path)


def _content(file):
    file.seek(0)
    return file.read(_LONGEST)


def _foreign(path):
    return InputError(
        f"{path}: received a link or a file that no run has written, expected none, since a run"
        " keeps its lock there; move it, or give another directory with --output"
    )


def _refusal(path, file):
    holder = _content(file).decode(errors="replace").strip() or "another process"
    return (
        f"{path.parent}: a run is writing there ({holder}), expected a directory of its own for"
        " each; wait for its end, or give another directory with --output"
    )
