"""Tables of numbers that grow during a run, CSV, complete up to the last line at any moment."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError, shown
from .files import on_root, write_text

if TYPE_CHECKING:
    from mpi4py import MPI

ADVICE = "delete that line where it is damaged, or write to another directory with --output"


class Table:
    """The growing file, whose first column is the time [s]; every method is collective, rank 0
    writes.

    last : time of the last row of an earlier run that was kept [s], None without one
    """

    def __init__(
        self, path: Path, columns: Sequence[str], comm: MPI.Comm, resumed_at: float | None = None
    ) -> None:
        """Start an empty table with a header of its columns, or continue the one that is there.

        resumed_at : rows later than this time [s] and a torn last line are cut atomically; without
        a file an empty one is started.  Raises InputError when its columns are others, or a row is
        damaged; then the file stays as it is.
        """
        self.path = path
        self._comm = comm
        self._file = None
        self.last = None
        header = ",".join(columns)
        if resumed_at is not None and on_root(comm, path.exists):
            self.last = on_root(comm, _cut, path, header, resumed_at)
        else:
            on_root(comm, write_text, path, header + "\n")
        on_root(comm, self._open)

    def _open(self):
        self._file = open(self.path, "a", encoding="utf-8", newline="")

    def append(self, rows: Iterable[Sequence[float | int]]) -> None:
        """Add rows, the time first; flushed at once."""
        on_root(self._comm, self._write, rows)

    def _write(self, rows):
        self._file.write("".join(",".join(map(_written, row)) + "\n" for row in rows))
        self._file.flush()

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()


def _written(value):
    return str(value) if isinstance(value, int) else f"{float(value):.17g}"


def complete_lines(path: Path) -> list[str]:
    """Return the lines that end with a line break: a torn last line is not among them."""
    try:
        text = Path(path).read_bytes().decode("utf-8", errors="replace")
    except OSError as failure:
        raise InputError(
            f"{path}: could not be read ({failure.strerror}); check the file and its permissions"
        ) from failure
    return text.split("\n")[:-1] or [""]


def numbers(path: Path, header: str, rows: list[str]) -> np.ndarray:
    """Return the numbers of the rows, (rows, columns); raise InputError where there is something
    else.
    """
    width = len(header.split(","))
    try:
        values = np.array([row.split(",") for row in rows], dtype=float).reshape(len(rows), width)
        if np.isfinite(values[:, 0]).all():
            return values
    except ValueError:
        pass
    i, row = next((i, row) for i, row in enumerate(rows) if not _is_row(row, width))
    raise InputError(
        f"{path}: line {i + 2} is {shown(row)}, expected {width} numbers, the time first; {ADVICE}"
    )


def _is_row(row, width):
    try:
        values = [float(word) for word in row.split(",")]
    except ValueError:
        return False
    return len(values) == width and np.isfinite(values[0])


def _cut(path, expected, time):
    """Cut the rows later than a time, and return the time of the last one that is kept, None
    without one.
    """
    header, *rows = complete_lines(path)
    if header != expected:
        raise InputError(
            f"{path}: received the columns '{header}', expected '{expected}' of the scene; "
            "restart with the probes of the first run, or write to another directory with --output"
        )
    times = numbers(path, header, rows)[:, 0]
    kept = np.flatnonzero(times <= time)
    write_text(path, "\n".join([header, *(rows[i] for i in kept)]) + "\n")
    return float(times[kept[-1]]) if len(kept) else None
