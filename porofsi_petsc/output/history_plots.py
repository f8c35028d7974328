"""Curves: the histories of the probes and their paths."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np

from .units import scaled_unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WIDTH = 7.2  # [inch]
KINDS = {  # symbol in front of the component: what it is, SI unit
    "u": ("displacement", "m"),
    "v": ("solid velocity", "m/s"),
    "vf": ("fluid velocity", "m/s"),
    "p": ("pressure", "Pa"),
    "n": ("porosity", ""),
    "f": ("force", "N"),
}
SYMBOLS = (
    {"p": "p", "n_f": "n_f"}
    | {f"f_{axis}": f"f_{axis}" for axis in "xyz"}
    | {
        f"{kind}_{axis}": f"{symbol}_{{{index}{axis}}}"
        for kind, symbol, index in (("u", "u", ""), ("v", "v", "s,"), ("vf", "v", "f,"))
        for axis in "xyz"
    }
)


def kinds_of(history: Iterable[str]) -> dict[str, list[str]]:
    """Return dict kind -> list of its columns, in the order of KINDS; columns are named
    <probe>.<quantity>.
    """
    columns = [name for name in history if "." in name]
    grouped = {kind: [c for c in columns if quantity(c).split("_")[0] == kind] for kind in KINDS}
    return {kind: members for kind, members in grouped.items() if members}


def probe(column: str) -> str:
    """Return the name of the probe of a column."""
    return column.rpartition(".")[0]


def quantity(column: str) -> str:
    """Return the name of the quantity of a column."""
    return column.rpartition(".")[2]


def draw_histories(figure: Figure, history: dict[str, np.ndarray]) -> None:
    """Draw one panel per kind of quantity over time and a small one with the coupling
    iterations.
    """
    kinds = kinds_of(history)
    heights = [1.0] * len(kinds) + [0.45]
    figure.set_size_inches(WIDTH, 2.1 * sum(heights) + 0.5)
    axes = figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
    for ax, (kind, columns) in zip(axes, kinds.items(), strict=False):
        _draw_kind(ax, history, kind, columns)
    _draw_iterations(axes[-1], history)
    axes[-1].set_xlabel("$t$ [s]")
    axes[-1].set_xlim(history["t"][0], history["t"][-1])


def _draw_kind(ax, history, kind, columns):
    text, unit = KINDS[kind]
    per_thickness = kind == "f" and not any(quantity(column) == "f_z" for column in columns)
    factor, unit = _unit(history, columns, f"{unit}/m" if per_thickness else unit)
    where = "on" if kind == "f" else "at"
    for column, style in zip(columns, cycle(["-", "--", "-.", ":"]), strict=False):
        ax.plot(
            history["t"],
            factor * history[column],
            style,
            label=f"${SYMBOLS[quantity(column)]}$ {where} {probe(column)}",
        )
    if kind != "n":
        ax.axhline(0.0, color="0.6", linewidth=0.5, zorder=0)
    ax.set_ylabel(f"{text} [{unit}]" if unit else text)
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))


def _unit(history, columns, unit):
    largest = max(np.abs(history[c]).max(initial=0.0) for c in columns)
    return scaled_unit(largest, unit) if unit else (1.0, "")


def _draw_iterations(ax, history):
    from matplotlib.ticker import MaxNLocator

    ax.step(history["t"], history["coupling_iterations"], where="pre", color="0.3", linewidth=0.8)
    ax.set_ylabel("coupling\niterations")
    ax.set_ylim(0, 1.15 * max(history["coupling_iterations"].max(initial=1.0), 1.0))
    ax.yaxis.set_major_locator(MaxNLocator(4, integer=True))


def draw_paths(figure: Figure, history: dict[str, np.ndarray], probes: Sequence[str]) -> None:
    """Draw the path of each probe, u_y over u_x, with its start and end marked."""
    columns = min(len(probes), 2)
    rows = -(-len(probes) // columns)
    figure.set_size_inches(WIDTH / 2 * columns, 3.2 * rows)
    axes = figure.subplots(rows, columns, squeeze=False)
    for ax, name in zip(axes.flat, probes, strict=False):
        _draw_path(ax, history, name)
    for ax in axes.flat[len(probes) :]:
        ax.set_visible(False)


def _draw_path(ax, history, name):
    across = f"{name}.u_x"
    up = f"{name}.u_y"
    factor, unit = _unit(history, [across, up], "m")
    x = factor * history[across]
    y = factor * history[up]
    ax.plot(x, y, color="C0")
    ax.plot(x[:1], y[:1], "o", color="C2", label=f"$t$ = {history['t'][0]:.4g} s")
    ax.plot(x[-1:], y[-1:], "s", color="C3", label=f"$t$ = {history['t'][-1]:.4g} s")
    ax.set_title(f"path of {name}")
    ax.set_xlabel(f"$u_x$ [{unit}]")
    ax.set_ylabel(f"$u_y$ [{unit}]")
    ax.set_aspect("equal", adjustable="datalim")
    ax.legend()
