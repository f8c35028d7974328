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
KINDS = {  # of panels: what it is, SI unit, that per metre of thickness
    "displacement": ("displacement", "m", "m"),
    "solid velocity": ("solid velocity", "m/s", "m/s"),
    "fluid velocity": ("fluid velocity", "m/s", "m/s"),
    "pressure": ("pressure", "Pa", "Pa"),
    "porosity": ("porosity", "", ""),
    "stress": ("stress", "Pa", "Pa"),
    "strain": ("strain", "", ""),
    "plastic strain": ("plastic strain", "", ""),
    "force": ("force", "N", "N/m"),
    "flow rate": ("flow rate", "m³/s", "m²/s"),
    "volume": ("volume", "m³", "m²"),
    "area": ("area", "m²", "m"),
    "wall shear": ("wall shear", "Pa", "Pa"),
}
ON_SURFACES = {"force", "flow rate", "volume", "area", "wall shear"}
# quantity: kind, symbol
SCALARS = {
    "p": ("pressure", "p"),
    "n_f": ("porosity", "n_f"),
    "pressure": ("pressure", r"\bar{p}"),  # the mean over a surface
    "mean_effective_stress": ("stress", "p'"),
    "plastic_strain": ("plastic strain", r"\bar{\varepsilon}"),
    "von_mises": ("stress", "q"),
    "flow_rate": ("flow rate", "Q"),
    "volume": ("volume", "V"),
    "area": ("area", "A"),
    "wall_shear": ("wall shear", r"\bar{\tau}"),
    "wall_shear_max": ("wall shear", r"\tau_{\max}"),
}
# what a quantity with components begins with: kind, symbol, what stands before the component
COMPONENTS = {
    "u": ("displacement", "u", ""),
    "v": ("solid velocity", "v", "s,"),
    "vf": ("fluid velocity", "v", "f,"),
    "f": ("force", "f", ""),
    "fs": ("force", "f", "s,"),
    "fp": ("force", "f", "p,"),
    "stress": ("stress", r"\sigma'", ""),
    "total": ("stress", r"\sigma", ""),
    "principal": ("stress", r"\sigma'", ""),
    "strain": ("strain", r"\varepsilon", ""),
}


def _kind(name):
    """Return the kind of a quantity and its symbol, ("", "") of one that is not drawn."""
    if name in SCALARS:
        return SCALARS[name]
    first, _, component = name.partition("_")
    if first not in COMPONENTS or not component.isalnum():
        return "", ""
    kind, symbol, index = COMPONENTS[first]
    return kind, f"{symbol}_{{{index}{component}}}"


def kind_of(name: str) -> tuple[str, str, str]:
    """Return what a quantity is, its symbol and its SI unit, ("", "", "") of one that is not
    drawn.
    """
    kind, symbol = _kind(name)
    return (KINDS[kind][0], symbol, KINDS[kind][1]) if kind else ("", "", "")


def kinds_of(history: Iterable[str]) -> dict[str, list[str]]:
    """Return dict kind -> list of its columns, in the order of KINDS; columns are named
    <probe>.<quantity>.
    """
    columns = [name for name in history if "." in name]
    grouped = {kind: [c for c in columns if _kind(quantity(c))[0] == kind] for kind in KINDS}
    return {kind: members for kind, members in grouped.items() if members}


def probe(column: str) -> str:
    """Return the name of the probe of a column."""
    return column.rpartition(".")[0]


def quantity(column: str) -> str:
    """Return the name of the quantity of a column."""
    return column.rpartition(".")[2]


def draw_histories(figure: Figure, history: dict[str, np.ndarray], plane: bool = False) -> None:
    """Draw one panel per kind of quantity over time and a small one with the coupling
    iterations; plane : integrals over surfaces are those of one metre of thickness.
    """
    kinds = kinds_of(history)
    heights = [1.0] * len(kinds) + [0.45]
    figure.set_size_inches(WIDTH, 2.1 * sum(heights) + 0.5)
    axes = figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
    for ax, (kind, columns) in zip(axes, kinds.items(), strict=False):
        _draw_kind(ax, history, kind, columns, plane)
    _draw_iterations(axes[-1], history)
    axes[-1].set_xlabel("$t$ [s]")
    axes[-1].set_xlim(history["t"][0], history["t"][-1])


def _draw_kind(ax, history, kind, columns, plane):
    text, unit, per_thickness = KINDS[kind]
    factor, unit = _unit(history, columns, per_thickness if plane else unit)
    for column, style in zip(columns, cycle(["-", "--", "-.", ":"]), strict=False):
        on = kind in ON_SURFACES or quantity(column) == "pressure"
        ax.plot(
            history["t"],
            factor * history[column],
            style,
            label=f"${_kind(quantity(column))[1]}$ {'on' if on else 'at'} {probe(column)}",
        )
    if kind not in ("porosity", "area"):
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
