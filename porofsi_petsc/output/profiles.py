"""profiles.csv: displacement and pressure along a line, computed and exact, at the times of a
scene's [reference].
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .files import write_text
from .units import scaled_unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NAME = "profiles.csv"
COLUMNS = ("t", "s", "u", "u_exact", "p", "p_exact")
WIDTH = 7.2  # [inch]


def write_profiles(directory: str | os.PathLike[str], records: Iterable[dict[str, Any]]) -> None:
    """Write one row per time and point: t [s], s from the start of the line [m], u [m], p [Pa];
    records of a comparison.
    """
    rows = [",".join(COLUMNS)]
    for record in records:
        columns = [record["profile"][name] for name in COLUMNS[1:]]
        rows += [
            ",".join(f"{value:.17g}" for value in (record["t"], *row))
            for row in zip(*columns, strict=True)
        ]
    write_text(Path(directory) / NAME, "\n".join(rows) + "\n")


def read_profiles(path: str | os.PathLike[str]) -> dict[str, np.ndarray]:
    """Return dict column -> (times, points) array of a profiles.csv."""
    values = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)
    times = len(np.unique(values[:, 0]))
    return dict(zip(COLUMNS, values.T.reshape(len(COLUMNS), times, -1), strict=True))


def draw_profiles(figure: Figure, profiles: dict[str, np.ndarray]) -> None:
    """Draw u and p over s, computed as lines and exact as points, one colour per time."""
    kinds = [
        (name, label)
        for name, label in (("u", ("displacement", "m")), ("p", ("pore pressure", "Pa")))
        if _drawn(profiles, name)
    ]
    figure.set_size_inches(WIDTH, 3.2)
    for ax, (name, label) in zip(
        figure.subplots(1, len(kinds), squeeze=False)[0], kinds, strict=True
    ):
        _draw_kind(ax, profiles, name, label)
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))


def _drawn(profiles, name):
    return np.isfinite(profiles[f"{name}_exact"]).all()


def _draw_kind(ax, profiles, name, label):
    largest = max(np.abs(profiles[key]).max(initial=0.0) for key in (name, f"{name}_exact"))
    factor, unit = scaled_unit(largest, label[1])
    for i, t in enumerate(profiles["t"][:, 0]):
        ax.plot(
            profiles["s"][i], factor * profiles[name][i], f"C{i % 10}-", label=f"$t$ = {t:.4g} s"
        )
        exact = factor * profiles[f"{name}_exact"][i]
        ax.plot(profiles["s"][i][::2], exact[::2], f"C{i % 10}o", markersize=3)
    ax.plot([], [], "ko", markersize=3, label="exact")
    ax.set_xlabel("distance $s$ [m]")
    ax.set_ylabel(f"{label[0]} [{unit}]")
