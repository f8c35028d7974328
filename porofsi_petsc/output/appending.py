"""An HDF5 file to which is added, and which a kill at any moment leaves as it was or as it is to
be.

HDF5 adds data at the end of a file and changes what says where they are: a few hundred bytes here
and there. Data go to the disk at once, behind the end, where nobody looks; the changes are kept
until all is there, then written to a journal and from that to the file. A journal that is found
was complete: `finish` does what it says again.
"""

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py

from .files import keep_content, write_text
from .hdf5 import PatientFile, patiently


@contextmanager
def appending(path: Path) -> Iterator[h5py.File]:
    """Open a file for additions; what is done is done with the end of the context, or not at all.
    On the calling rank only; raises OSError.
    """
    with patiently(_Unchanged(path)) as raw:
        try:
            with h5py.File(raw, "r+") as file:
                yield file
        except BaseException:
            raw.forget()
            raise
        if raw.error is not None:
            raw.forget()
            return
        os.fsync(raw.fileno())
        write_text(_journal(path), json.dumps(raw.changes()))
    finish(path)


def finish(path: Path) -> None:
    """Do what the journal of a file says, where there is one."""
    journal = _journal(path)
    if not journal.is_file():
        return
    changes = json.loads(journal.read_text(encoding="utf-8"))
    with open(path, "r+b") as file:
        for start, content in changes["bytes"]:
            file.seek(start)
            file.write(bytes.fromhex(content))
        file.truncate(changes["size"])
    keep_content(path)
    journal.unlink()  # one that a loss of power brings back says what has been done already


def shorten(path: Path) -> None:
    """Take off what a killed run has added behind the end that HDF5 knows."""
    with h5py.File(path, "r+"):
        pass


def _journal(path):
    return path.with_name(path.name + ".journal")


class _Unchanged(PatientFile):
    """A file that grows at once, while the bytes it had stay until `changes` are made."""

    def __init__(self, path: Path) -> None:
        """Open the file."""
        super().__init__(path, "r+")
        self._had = os.path.getsize(path)
        self._size = self._had
        self._changes: dict[tuple[int, int], bytes] = {}  # by place and length, the last one last

    def changes(self) -> dict[str, Any]:
        """Return the changes that are left, as JSON has them."""
        pairs = [(start, content.hex()) for (start, _), content in self._changes.items()]
        return {"size": self._size, "bytes": pairs}

    def forget(self) -> None:
        """Give back the space that was added."""
        os.truncate(self.fileno(), self._had)

    def write(self, data: Any) -> int:
        """Write what is behind the end of old, keep the rest."""
        start = self.tell()
        content = bytes(memoryview(data).cast("B"))
        old = content[: max(self._had - start, 0)]
        if old:
            self._changes.pop((start, len(old)), None)
            self._changes[start, len(old)] = old
        if len(content) > len(old):
            self.seek(start + len(old))
            super().write(content[len(old) :])
        self._size = max(self._size, start + len(content))
        self.seek(start + len(content))
        return len(content)

    def readinto(self, buffer: Any) -> int:
        """Give back what was written or kept."""
        start = self.tell()
        found = super().readinto(buffer)
        view = memoryview(buffer).cast("B")
        for (place, _), content in self._changes.items():
            first = max(place, start)
            last = min(place + len(content), start + len(view))
            if first < last:
                view[first - start : last - start] = content[first - place : last - place]
        return found

    def truncate(self, size: int | None = None) -> int:
        """Set the size; that of old is kept until the changes are made."""
        self._size = self.tell() if size is None else size
        super().truncate(max(self._size, self._had))
        return self._size
