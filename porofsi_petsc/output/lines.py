"""line_<name>.csv: quantities along a line, one row for each time and point; its figure."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .history_plots import kind_of
from .table import Table, complete_lines, numbers
from .units import scaled_unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from mpi4py import MPI

WIDTH = 7.2  # [inch]
TIMES = 6  # that are drawn of a line


def file_of(name: str) -> str:
    """Return the name of the file of a line."""
    return f"line_{name}.csv"


class LineFile:
    """The growing file of a line; every method is collective, rank 0 writes."""

    def __init__(
        self,
        directory: Path,
        name: str,
        quantities: Sequence[str],
        comm: MPI.Comm,
        resumed_at: float | None = None,
    ) -> None:
        """Start an empty file with the columns t [s], s [m] and the quantities, or continue that of
        a directory at a time [s]; see `Table`.
        """
        self._table = Table(directory / file_of(name), ["t", "s", *quantities], comm, resumed_at)

    @property
    def last(self) -> float | None:
        """Return the last time of an earlier run that was kept [s], None without one."""
        return self._table.last

    def append(self, time: float, columns: Sequence[np.ndarray]) -> None:
        """Add a row for each point at a time [s]; columns : s [m] and the quantities, (n,) each."""
        self._table.append([(time, *row) for row in np.transpose(columns)])

    def close(self) -> None:
        """Close the file."""
        self._table.close()


def read_line(path: str | os.PathLike[str]) -> dict[str, np.ndarray]:
    """Return dict column -> (times, points) array of the file of a line."""
    header, *rows = complete_lines(Path(path))
    values = numbers(Path(path), header, rows)
    points = int((values[:, 0] == values[0, 0]).sum()) if len(values) else 1
    whole = values[: len(values) - len(values) % points]
    columns = header.split(",")
    return dict(zip(columns, whole.T.reshape(len(columns), -1, points), strict=True))


def draw_line(figure: Figure, line: dict[str, np.ndarray]) -> None:
    """Draw each quantity of the package over s, one colour for each of some times."""
    names = [name for name in line if name not in ("t", "s") and kind_of(name)[0]]
    figure.set_size_inches(WIDTH, 2.4 * len(names) + 0.5)
    axes = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
    last = len(line["t"]) - 1
    chosen = sorted({round(i * last / (TIMES - 1)) for i in range(TIMES)})
    for ax, name in zip(axes, names, strict=True):
        text, symbol, unit = kind_of(name)
        factor, unit = scaled_unit(np.abs(line[name]).max(), unit) if unit else (1.0, "")
        for number, i in enumerate(chosen):
            label = f"$t$ = {line['t'][i, 0]:.4g} s"
            ax.plot(line["s"][i], factor * line[name][i], f"C{number}-", label=label)
        ax.set_ylabel(f"{text} ${symbol}$" + (f" [{unit}]" if unit else ""))
    axes[0].legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    axes[-1].set_xlabel("distance $s$ [m]")
