"""history.csv: one row per accepted step, complete up to the last line at any moment."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError
from .table import Table, complete_lines, numbers

if TYPE_CHECKING:
    from mpi4py import MPI

NAME = "history.csv"


class History:
    """The growing file; every method is collective, rank 0 writes."""

    def __init__(
        self,
        directory: str | os.PathLike[str],
        columns: Sequence[str],
        comm: MPI.Comm,
        resumed_at: float | None = None,
    ) -> None:
        """Start an empty history with the header t, columns, coupling_iterations, or continue that
        of a directory at a time [s]; see `Table`.
        """
        self.columns = list(columns)
        self.path = Path(directory) / NAME
        header = ["t", *self.columns, "coupling_iterations"]
        self._table = Table(self.path, header, comm, resumed_at)

    @classmethod
    def resume(
        cls, directory: str | os.PathLike[str], columns: Sequence[str], comm: MPI.Comm, time: float
    ) -> History:
        """Continue the history of a directory at a time [s]; see `Table`."""
        return cls(directory, columns, comm, time)

    @property
    def last(self) -> float | None:
        """Return the time of the last row of an earlier run that was kept [s], None without one."""
        return self._table.last

    def append(self, time: float, values: Sequence[float], coupling_iterations: int) -> None:
        """Add a row: time [s], one value per column, number of coupling iterations; flushed at
        once.
        """
        if len(values) != len(self.columns):
            raise ValueError(f"received {len(values)} values, expected {len(self.columns)}")
        self._table.append([(time, *values, int(coupling_iterations))])

    def close(self) -> None:
        """Close the file."""
        self._table.close()


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
    header, *rows = complete_lines(path)
    names = header.split(",")
    if names[0] != "t":
        raise InputError(
            f"{path}: not a history: expected a header t,… and rows of as many numbers; run the"
            " scene again"
        )
    return dict(zip(names, numbers(path, header, rows).T, strict=True))
