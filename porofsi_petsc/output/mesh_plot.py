"""A picture of a mesh with its regions and its boundary tags, before anything is solved."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..mesh.mesh import Mesh
from ..mesh.topology import boundary_facets, cell_facets, locate_facets
from .field_plots import LARGEST_ASPECT, MESH_LINES_UP_TO, WIDTH
from .surface import Surface

if TYPE_CHECKING:
    from matplotlib.figure import Figure

REGIONS = "Pastel1"  # colour maps
TAGS = "tab20"
TALLEST = 9.0  # [inch]
LONGEST_LEGEND = 24  # entries
COLUMNS = 4


def draw_mesh(figure: Figure, mesh: Mesh) -> None:
    """Draw the cells of a plane mesh by region and its facets by tag; of a solid one the boundary
    from the front and from behind, by tag and, if there are several, by region.
    """
    (_draw_plane if mesh.dim == 2 else _draw_solid)(figure, mesh)


def _colours(names, chart):
    import matplotlib

    colours = matplotlib.colormaps[chart].colors
    return {name: colours[i % len(colours)] for i, name in enumerate(names)}


def _polygons(nodes, element):
    """Return the polygons, (P, V), of cells or facets (n, A), and the row of each."""
    parts = np.array(element.polygons)
    owner = np.repeat(np.arange(len(nodes)), len(parts))
    return nodes[:, parts].reshape(len(owner), -1), owner


def _draw_plane(figure, mesh):
    from matplotlib.collections import LineCollection, PolyCollection

    extent = np.ptp(mesh.points, axis=0)
    aspect = np.clip(extent[1] / extent[0], 1 / LARGEST_ASPECT, LARGEST_ASPECT)
    figure.set_size_inches(WIDTH, min(0.9 * WIDTH * aspect + 1.3, TALLEST))
    ax = figure.subplots()
    polygons, owner = _polygons(mesh.cells, mesh.element)
    regions, tags = _colours(mesh.regions, REGIONS), _colours(mesh.facets, TAGS)
    lines = {"edgecolors": "0.4", "linewidths": 0.3}
    if len(polygons) > MESH_LINES_UP_TO:
        lines = {"edgecolors": "face", "linewidths": 0.2}
    faces = np.array(list(regions.values()))[mesh.cell_region[owner]]
    ax.add_collection(
        PolyCollection(mesh.points[polygons], facecolors=faces, rasterized=True, **lines)
    )
    for tag, colour in tags.items():
        parts = _polygons(mesh.facets[tag], mesh.element.facet)[0]
        ax.add_collection(LineCollection(mesh.points[parts], colors=[colour], linewidths=2.0))
    ax.autoscale_view()
    ax.set_aspect("equal" if aspect == extent[1] / extent[0] else "auto")
    ax.set_xlabel("$x$ [m]")
    ax.set_ylabel("$y$ [m]")
    _legend(figure, regions, tags)


def _draw_solid(figure, mesh):
    place = boundary_facets(mesh.cells, mesh.element)
    polygons, owner = _polygons(cell_facets(mesh.cells, mesh.element)[place], mesh.element.facet)
    shape = len(mesh.cells), len(mesh.element.facets)
    own = np.ravel_multi_index(place, shape)
    tag = np.full(len(own), -1)
    for i, nodes in enumerate(mesh.facets.values()):
        here = np.ravel_multi_index(locate_facets(nodes, mesh.cells, mesh.element), shape)
        tag[np.isin(own, here)] = i
    regions, tags = _colours(mesh.regions, REGIONS), _colours(mesh.facets, TAGS)
    rows = [(tag, [*tags.values(), (0.8,) * 3])]
    if len(regions) > 1:
        rows.append((mesh.cell_region[place[0]], list(regions.values())))
    figure.set_size_inches(WIDTH, 1.0 + 2.4 * len(rows))
    axes = figure.subplots(len(rows), 2, squeeze=False)
    behind = mesh.points * [-1, -1, 1]
    for row, (index, colours) in zip(axes, rows, strict=True):
        views = zip(row, (mesh.points, behind), ("front", "behind"), strict=True)
        for ax, points, side in views:
            _paint(ax, points, polygons, np.array(colours)[index[owner]])
            ax.set_title(f"from {'the ' * (side == 'front')}{side}")
    _legend(figure, regions if len(regions) > 1 else {}, tags)


def _paint(ax, points, polygons, colours):
    """Paint the polygons that face the eye, from the farthest to the nearest."""
    from matplotlib.collections import PolyCollection

    seen, depth = Surface(points, polygons, polygons[:0, :2]).project(points)
    x, y = np.moveaxis(seen[polygons], 2, 0)
    area = (x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y).sum(axis=1)
    order = np.argsort(depth[polygons].mean(axis=1))
    order = order[area[order] > 0]  # outward facets are traversed to the left
    lines = {"edgecolors": (0, 0, 0, 0.35), "linewidths": 0.2}
    if len(polygons) > MESH_LINES_UP_TO:
        lines = {"edgecolors": "face", "linewidths": 0.2}
    ax.add_collection(
        PolyCollection(seen[polygons[order]], facecolors=colours[order], rasterized=True, **lines)
    )
    ax.autoscale_view()
    ax.set_aspect("equal")
    ax.set_axis_off()


def _legend(figure, regions, tags):
    from matplotlib.patches import Patch

    entries = [Patch(facecolor=c, label=name) for name, c in tags.items()]
    entries += [Patch(facecolor=c, edgecolor="0.4", label=name) for name, c in regions.items()]
    if len(entries) > LONGEST_LEGEND:
        more = Patch(facecolor="none", label=f"and {len(entries) - LONGEST_LEGEND} more")
        entries = [*entries[:LONGEST_LEGEND], more]
    figure.legend(handles=entries, loc="outside lower center", ncols=COLUMNS)
