"""history.csv: one row per accepted step, complete up to the last line at any moment."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError, shown
from .files import on_root, write_text

if TYPE_CHECKING:
    from mpi4py import MPI

NAME = "history.csv"
ADVICE = "delete that line where it is damaged, or write to another directory with --output"


class History:
    """The growing file; every method is collective, rank 0 writes.

    last : time of the last row of an earlier run that was kept [s], None without one
    """

    def __init__(
        self, directory: str | os.PathLike[str], columns: Sequence[str], comm: MPI.Comm
    ) -> None:
        """Start an empty history with the header t, columns, coupling_iterations."""
        self.comm = comm
        self.columns = list(columns)
        self.last = None
        self.path = Path(directory) / NAME
        on_root(comm, write_text, self.path, _header(self.columns))
        self._open()

    @classmethod
    def resume(
        cls, directory: str | os.PathLike[str], columns: Sequence[str], comm: MPI.Comm, time: float
    ) -> History:
        """Continue the history of a directory: rows later than the time [s] and a torn last line
        are cut atomically.

        Without a history.csv in the directory an empty one is started.  Raises InputError when its
        columns are others, or a row is damaged; then the file stays as it is.
        """
        path = Path(directory) / NAME
        if not on_root(comm, path.exists):
            return cls(directory, columns, comm)
        history = object.__new__(cls)
        history.comm = comm
        history.columns = list(columns)
        history.path = path
        history.last = on_root(comm, _cut, path, history.columns, time)
        history._open()
        return history

    def append(self, time: float, values: Sequence[float], coupling_iterations: int) -> None:
        """Add a row: time [s], one value per column, number of coupling iterations; flushed at
        once.
        """
        on_root(self.comm, self._write_row, time, values, coupling_iterations)

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()

    def _open(self):
        self._file = None
        on_root(self.comm, self._open_on_root)

    def _open_on_root(self):
        self._file = open(self.path, "a", encoding="utf-8", newline="")

    def _write_row(self, time, values, coupling_iterations):
        numbers = [f"{float(value):.17g}" for value in (time, *values)]
        if len(numbers) != len(self.columns) + 1:
            raise ValueError(f"received {len(numbers) - 1} values, expected {len(self.columns)}")
        self._file.write(",".join([*numbers, str(int(coupling_iterations))]) + "\n")
        self._file.flush()


def _header(columns):
    return ",".join(["t", *columns, "coupling_iterations"]) + "\n"


def _complete_lines(path):
    """Return the lines that end with a line break: a torn last line is not among them."""
    try:
        text = Path(path).read_bytes().decode("utf-8", errors="replace")
    except OSError as failure:
        raise InputError(
            f"{path}: could not be read ({failure.strerror}); check the file and its permissions"
        ) from failure
    return text.split("\n")[:-1] or [""]


def _numbers(path, header, rows):
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


def _cut(path, columns, time):
    """Cut the rows later than a time, and return the time of the last one that is kept, None
    without one.
    """
    header, *rows = _complete_lines(path)
    expected = _header(columns).strip()
    if header != expected:
        raise InputError(
            f"{path}: received the columns '{header}', expected '{expected}' of the scene; "
            "restart with the probes of the first run, or write to another directory with --output"
        )
    times = _numbers(path, header, rows)[:, 0]
    kept = np.flatnonzero(times <= time)
    write_text(path, "\n".join([header, *(rows[i] for i in kept)]) + "\n")
    return float(times[kept[-1]]) if len(kept) else None


def read_history(path: str | os.PathLike[str]) -> dict[str, np.ndarray]:
    """Return dict column -> (rows,) float array of a history.csv, or of that in the directory of a
    run; a torn last line is left out.

    Raises InputError when there is no such file or it is not a history.
    """
    path = Path(path)
    path = path / NAME if path.is_dir() else path
    if not path.is_file():
        raise InputError(
            f"{path}: no such file, expected the history.csv of a run; give the result directory of"
            " a run"
        )
    header, *rows = _complete_lines(path)
    names = header.split(",")
    if names[0] != "t":
        raise InputError(
            f"{path}: not a history: expected a header t,… and rows of as many numbers; run the"
            " scene again"
        )
    return dict(zip(names, _numbers(path, header, rows).T, strict=True))
