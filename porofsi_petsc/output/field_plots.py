"""Pictures of a field on the deformed domain at several times, with one colour scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from .snapshots import Snapshot
from .surface import Surface
from .units import plain, scaled_unit, significant

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DRAWN_SHARE = 0.05  # the largest displacement is drawn as this share of the domain
LARGEST_ASPECT = 8.0  # a domain more slender than this is drawn with unequal scales
WIDTH = 7.2  # [inch], the text width of a journal page
MESH_LINES_UP_TO = 6000  # polygons; beyond, the lines would cover the colours
LABEL_SHARE = 0.95  # of the height of the figure that a label along it may take
# A panel whose largest value is below this share of the figure's is hardly seen on a linear colour
# scale.
FAINT = 0.4


@dataclass(frozen=True)
class Scale:
    """The shared colour scale: unit, factor from SI to it, limits in the unit, colour map; root:
    colours follow sqrt|value|.
    """

    unit: str
    factor: float
    low: float
    high: float
    colours: str
    root: bool

    @property
    def mapping(self) -> dict[str, Any]:
        """Return the arguments that make matplotlib colour values given in the unit."""
        from matplotlib.colors import FuncNorm, Normalize

        limits: dict[str, Any] = {"vmin": self.low, "vmax": self.high}
        norm = (
            FuncNorm((_signed_root, _signed_square), **limits) if self.root else Normalize(**limits)
        )
        return {"cmap": self.colours, "norm": norm}

    def label(self, text: str) -> str:
        """Return the label of the colour bar."""
        return f"{text} [{self.unit}]" + (",\ncolours by its square root" if self.root else "")


def _signed_root(values):
    return np.sign(values) * np.sqrt(np.abs(values))


def _signed_square(values):
    return np.sign(values) * np.square(values)


def deformation_scale(snapshots: Sequence[Snapshot], surface: Surface) -> float:
    """Return the factor, rounded to one digit, that draws the largest displacement as 5 % of the
    domain; never less than 1.
    """
    largest = max(
        np.linalg.norm(displacement(s, surface)[surface.nodes], axis=1).max() for s in snapshots
    )
    return max(1.0, significant(DRAWN_SHARE * surface.size / largest)) if largest > 0 else 1.0


def displacement(snapshot: Snapshot, surface: Surface) -> np.ndarray:
    """Return u, (N, d) [m], of a snapshot; zero where it was not written."""
    if "displacement" not in snapshot.shapes:
        return np.zeros_like(surface.points)
    return snapshot.read("displacement")[:, : surface.dim]


def colour_scale(values: Sequence[np.ndarray], unit: str) -> Scale:
    """Return the Scale of fields (list of (N,) in SI): symmetric about zero when both signs matter,
    by root when one is faint.
    """
    low = min(v.min() for v in values)
    high = max(v.max() for v in values)
    sizes = [np.abs(v).max() for v in values]
    root = 0 < min(sizes) < FAINT * max(sizes)
    factor, name = scaled_unit(max(abs(low), abs(high)), unit)
    low = low * factor
    high = high * factor
    if low < -0.1 * high and high > -0.1 * low:
        bound = max(-low, high)
        return Scale(name, factor, -bound, bound, "RdBu_r", root)
    low, high = (min(low, 0.0), high) if high > 0 else (low, max(high, 0.0))
    return Scale(
        name,
        factor,
        low,
        high if high > low else low + 1.0,
        "YlGnBu" if high > 0 else "YlGnBu_r",
        root,
    )


def draw_field(
    figure: Figure,
    snapshots: Sequence[Snapshot],
    values: Sequence[np.ndarray],
    surface: Surface,
    label: tuple[str, str],
    magnification: float,
    backdrop: Surface | None = None,
) -> None:
    """Draw the field at the snapshots in one panel each.

    figure : empty matplotlib Figure.  values : list of (N,) in SI.  label : (text, SI unit).
    backdrop : the Surface of what has no such field, grey in a plane picture.
    """
    scale = colour_scale([v[surface.nodes] for v in values], label[1])
    deformed = [surface.points + magnification * displacement(s, surface) for s in snapshots]
    rows, columns, equal = _arrange(figure, surface, deformed)
    axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    for ax, snapshot, value, points in zip(axes.flat, snapshots, values, deformed, strict=False):
        artist = _draw_panel(ax, surface, points, value * scale.factor, scale)
        if backdrop is not None and backdrop.dim == 2:
            _draw_backdrop(ax, backdrop, points)
        ax.set_title(f"$t$ = {snapshot.time:.4g} s")
        ax.set_aspect("equal" if equal else "auto")
    for ax in axes.flat[len(snapshots) :]:
        ax.set_visible(False)
    _label_axes(axes, surface, len(snapshots))
    bar = figure.colorbar(artist, ax=axes, label=scale.label(label[0]), aspect=30, pad=0.02)
    _fit(bar.ax.yaxis.label, figure)
    figure.suptitle(_caption(magnification, equal, surface), fontsize=8)


def _fit(label, figure):
    """Make a label along the height of the figure smaller where it is longer than that."""
    length = label.get_window_extent().height
    room = LABEL_SHARE * figure.bbox.height
    if length > room:
        label.set_fontsize(label.get_fontsize() * room / length)


def _caption(magnification, equal, surface):
    size = (
        "true to size" if magnification == 1 else f"drawn {plain(magnification)} times their size"
    )
    text = f"displacements {size}; outline: undeformed"
    if surface.dim == 3:
        text += (
            ", "
            + r" $\times$ ".join(f"{extent:.4g}" for extent in np.ptp(surface.points, axis=0))
            + " m"
        )
        if surface.cut > surface.points[:, 1].min():
            text += f"\nonly the part behind $y$ = {surface.cut:.4g} m is drawn"
    return text if equal else text + "; axes not to the same scale"


def _arrange(figure, surface, deformed):
    """Set the size of the figure of n panels; return rows, columns and whether both axes have the
    same scale.
    """
    n = len(deformed)
    seen = np.concatenate(
        [surface.project(points[surface.nodes])[0] for points in (surface.points, *deformed)]
    )
    width, height = np.ptp(seen, axis=0)
    aspect = height / width
    equal = 1 / LARGEST_ASPECT <= aspect <= LARGEST_ASPECT
    if not equal:
        aspect = np.clip(aspect, 0.3, 2.0)
    columns = 1 if n == 1 or aspect < 0.2 else n if aspect > 1.5 and n <= 4 else 2 if n <= 4 else 3
    rows = -(-n // columns)
    width = WIDTH if columns > 1 or aspect < 0.5 else 0.65 * WIDTH
    panel = (width - 1.3) / columns
    labels = (
        0.65 if n == rows * columns else 1.05
    )  # a panel above an empty place has its own x label
    figure.set_size_inches(width, min(rows * (panel * aspect + 0.27) + labels, 9.5))
    return rows, columns, equal


def _draw_panel(ax, surface, deformed, values, scale):
    from matplotlib.collections import LineCollection

    outline = surface.project(surface.points)[0][surface.outline]
    behind = surface.dim == 3
    ax.add_collection(
        LineCollection(outline, colors="0.35", linewidths=0.7, zorder=0 if behind else 3)
    )
    draw = _draw_plane if surface.dim == 2 else _draw_solid
    artist = draw(ax, surface, deformed, values, scale.mapping)
    ax.autoscale_view()
    return artist


def _draw_plane(ax, surface, deformed, values, colours):
    from matplotlib.collections import LineCollection

    x, y = deformed[surface.nodes].T
    triangles = np.searchsorted(
        surface.nodes, surface.triangles
    )  # other nodes would count in the limits of the axes
    if len(surface.polygons) <= MESH_LINES_UP_TO:
        lines = LineCollection(
            deformed[surface.lines], colors="k", linewidths=0.15, alpha=0.35, zorder=2
        )
        ax.add_collection(lines)
    return ax.tripcolor(
        x, y, triangles, values[surface.nodes], shading="gouraud", rasterized=True, **colours
    )


def _draw_backdrop(ax, backdrop, deformed):
    from matplotlib.collections import PolyCollection

    ax.add_collection(
        PolyCollection(
            deformed[backdrop.polygons],
            facecolors="0.6",
            edgecolors="0.6",
            linewidths=0.2,
            zorder=2,
        )
    )


def _draw_solid(ax, surface, deformed, values, colours):
    """Paint the polygons of the surface from the farthest to the nearest."""
    from matplotlib.collections import PolyCollection

    seen, depth = surface.project(deformed)
    order = np.argsort(depth[surface.polygons].mean(axis=1))
    polygons = surface.polygons[order]
    lines = {"edgecolors": (0, 0, 0, 0.25), "linewidths": 0.15}
    if len(polygons) > MESH_LINES_UP_TO:
        lines = {"edgecolors": "face", "linewidths": 0.2}
    faces = PolyCollection(
        seen[polygons],
        array=values[polygons].mean(axis=1),
        rasterized=True,
        zorder=1,
        **lines,
        **colours,
    )
    ax.add_collection(faces)
    return faces


def _label_axes(axes, surface, n):
    if surface.dim == 3:
        for ax in axes.flat:
            ax.set_axis_off()
        return
    for index, ax in enumerate(axes.flat[:n]):
        last_of_column = index + axes.shape[1] >= n
        ax.tick_params(labelbottom=last_of_column)
        if last_of_column:
            ax.set_xlabel("$x$ [m]")
        if index % axes.shape[1] == 0:
            ax.set_ylabel("$y$ [m]")
