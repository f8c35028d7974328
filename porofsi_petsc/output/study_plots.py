"""Figures of the studies: heat maps of iterations, clouds of error over cost."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PANEL = 3.2  # [inch]
STRONG = 15  # iterations at which the colour ends


def draw_heat_maps(
    figure: Figure, panels: Mapping[str, np.ndarray], columns: Sequence[str], rows: Sequence[str]
) -> None:
    """Draw one heat map per panel: title -> values (rows, columns); empty where NaN, a cross where
    infinite.
    """
    across = min(len(panels), 4)
    down = -(-len(panels) // across)
    figure.set_size_inches(PANEL * across + 0.8, PANEL * down + 0.4)
    axes = figure.subplots(down, across, squeeze=False, sharex=True, sharey=True)
    for ax, (title, values) in zip(axes.flat, panels.items(), strict=False):
        image = ax.imshow(
            np.minimum(values, STRONG), cmap="viridis_r", vmin=1, vmax=STRONG, aspect="auto"
        )
        for (i, j), value in np.ndenumerate(values):
            if not np.isnan(value):
                text = f"{value:.0f}" if np.isfinite(value) else "×"
                ax.text(
                    j,
                    i,
                    text,
                    ha="center",
                    va="center",
                    fontsize=7,
                    color="w" if value > 0.6 * STRONG else "k",
                )
        ax.set_title(title)
        ax.set_xticks(range(len(columns)), columns, rotation=60)
        ax.set_yticks(range(len(rows)), rows)
    for ax in axes.flat[len(panels) :]:
        ax.set_visible(False)
    for ax in axes[-1]:
        ax.set_xlabel("$k_f$ [m/s]")
    for ax in axes[:, 0]:
        ax.set_ylabel("$\\Delta t$ [s]")
    figure.colorbar(image, ax=axes, label="largest number of iterations of a step", shrink=0.8)


def draw_work_precision(
    figure: Figure,
    series: Mapping[str, Sequence[Mapping[str, Any]]],
    front: Sequence[Mapping[str, Any]],
) -> None:
    """Draw error over wall time, with the Pareto front, and over unknowns; series : label -> rows
    with these columns.
    """
    figure.set_size_inches(2.7 * PANEL, 1.1 * PANEL)
    axes = figure.subplots(1, 2, sharey=True)
    for ax, column, label in zip(
        axes, ("seconds", "unknowns"), ("wall time [s]", "unknowns"), strict=True
    ):
        for (name, rows), marker in zip(series.items(), "os^vD*", strict=False):
            x, error = ([float(row[key]) for row in rows] for key in (column, "error"))
            ax.loglog(x, error, marker, markersize=4, fillstyle="none", label=name)
        ax.set_xlabel(label)
        ax.grid(color="0.9", which="both", linewidth=0.5)
    line = [[float(row[key]) for row in front] for key in ("seconds", "error")]
    axes[0].loglog(*line, color="0.3", linewidth=0.8, label="Pareto front", zorder=0)
    axes[0].set_ylabel("relative error")
    for axis in (axes[0].xaxis, axes[1].xaxis, axes[0].yaxis):
        _label_logarithms(axis)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside right center")


def _label_logarithms(axis):
    """Label 1, 2 and 5 of every decade: an axis may be shorter than one, or longer than two."""
    from matplotlib.ticker import LogLocator, NullFormatter

    axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())
