"""Graded rectangles and boxes with named sides, patches and regions."""

from collections.abc import Sequence
from itertools import permutations, product
from math import prod
from typing import Protocol

import numpy as np

from ..elements import FAMILIES
from ..errors import InputError, digits
from .check import DEGENERATE
from .memory import require_memory
from .mesh import Mesh
from .topology import add_midside_nodes, boundary_facets, cell_facets

AXES = "xyz"
# name of a side -> (axis, end), end 0 the lower and -1 the upper limit of the axis
SIDES = {
    2: {"left": (0, 0), "right": (0, -1), "bottom": (1, 0), "top": (1, -1)},
    3: {
        "left": (0, 0),
        "right": (0, -1),
        "front": (1, 0),
        "back": (1, -1),
        "bottom": (2, 0),
        "top": (2, -1),
    },
}
DEFAULT_REGION = "body"
FINEST = 1e-9  # smallest cell over the largest coordinate: its size has six digits or more


class Axis(Protocol):
    """Breakpoints [m], cells per segment, and the ratio of the last to the first cell of each
    segment, all 1 when empty or None.
    """

    @property
    def points(self) -> Sequence[float]:
        """Return the breakpoints [m]."""

    @property
    def cells(self) -> Sequence[int]:
        """Return the numbers of cells."""

    @property
    def ratios(self) -> Sequence[float] | None:
        """Return the ratios."""


class Part(Protocol):
    """A named part of a mesh, with an interval [m] as x, y or z where it does not have the whole
    axis.
    """

    @property
    def name(self) -> str:
        """Return the name."""


class Patch(Part, Protocol):
    """A named part of a side."""

    @property
    def side(self) -> str:
        """Return the name of the side."""


def rectangle(
    x: Axis,
    y: Axis,
    order: int = 1,
    diagonal: str = "right",
    patches: Sequence[Patch] = (),
    regions: Sequence[Part] = (),
    cell_type: str = "triangle",
) -> Mesh:
    """Return a mesh of triangles, T3 or T6, or of quadrilaterals, Q4, Q9 or Q8, on a graded grid.

    cell_type : "triangle", "quadrilateral", or "serendipity" for Q8, which has no node inside.
    diagonal : of triangles, "right" (lower left to upper right), "left" or "alternating".  Sides:
    left, right, bottom, top.
    patches : name, side, x, y (intervals or None) carved out of a side; regions : name, x, y.
    Raises InputError for limits off the mesh lines, for overlaps, for flat cells, and for more of
    them than fit into memory.
    """
    lines = _grid((x, y))
    element = FAMILIES[2][cell_type][order - 1]
    cells = (
        _cubes(lines, element) if element.cell.count_in_cube == 1 else _triangles(lines, diagonal)
    )
    return _tagged(lines, cells, element, patches, regions)


def box(
    x: Axis,
    y: Axis,
    z: Axis,
    order: int = 1,
    patches: Sequence[Patch] = (),
    regions: Sequence[Part] = (),
    cell_type: str = "tetrahedron",
) -> Mesh:
    """Return a mesh of tetrahedra, T4 or T10, six to a grid cell (Kuhn's subdivision), or of
    hexahedra, H8 or H27, without nodes inside H20; arguments as in `rectangle`.

    Sides: left, right (x), front, back (y), bottom, top (z).  Raises InputError as `rectangle`
    does.
    """
    lines = _grid((x, y, z))
    element = FAMILIES[3][cell_type][order - 1]
    cells = _cubes(lines, element) if element.cell.count_in_cube == 1 else _tetrahedra(lines)
    return _tagged(lines, cells, element, patches, regions)


def _grid(axes):
    """Return the mesh lines of all axes; raise InputError where no mesh can be made of them."""
    require_memory(prod(sum(axis.cells) for axis in axes), len(axes), "[mesh]")
    lines = [grid_lines(axis) for axis in axes]
    sizes = [np.diff(line) for line in lines]
    for name, line, size in zip(AXES, lines, sizes, strict=False):
        reach = np.abs(line).max()
        if size.min() < FINEST * reach:
            text = (
                f"the smallest cell, {size.min():.3g} m, is lost beside coordinates of"
                f" {reach:.3g} m"
            )
            raise InputError(
                f"[mesh.{name}]: {text}; expected {FINEST:g} of them at least: change points, cells"
                " or ratios"
            )
    smallest, largest = ([reduce(size) for size in sizes] for reduce in (np.min, np.max))
    for i, longest in enumerate(largest):
        flat = prod(short / longest for j, short in enumerate(smallest) if j != i)
        if flat <= DEGENERATE:
            text = (
                f"cells of {longest:.3g} m along {AXES[i]} and {min(smallest):.3g} m across are"
                " degenerate"
            )
            raise InputError(f"[mesh]: {text}; change points, cells or ratios")
    return lines


def grid_lines(axis: Axis) -> np.ndarray:
    """Return the mesh lines of an axis, (n + 1,) [m], geometric in each segment: h_i = h_0 r^(i /
    (n - 1)), r = h_(n-1) / h_0.
    """
    ratios = axis.ratios or [1.0] * len(axis.cells)
    segments = zip(axis.points[:-1], axis.points[1:], axis.cells, ratios, strict=True)
    return np.concatenate([[axis.points[0]]] + [_segment(*segment) for segment in segments])


def _segment(start, end, n, ratio):
    sizes = ratio ** (np.arange(n) / max(n - 1, 1))
    lines = start + (end - start) * np.cumsum(sizes) / sizes.sum()
    lines[-1] = end
    return lines


def _corners(lines):
    """Return the nodes at the corners of the grid cells: dict (i, j[, k]) in {0, 1}^d -> (cells,),
    x running fastest.
    """
    shape = [len(line) for line in lines[::-1]]
    nodes = np.arange(np.prod(shape)).reshape(shape)
    window = {0: slice(None, -1), 1: slice(1, None)}
    return {
        c: nodes[tuple(window[i] for i in c[::-1])].ravel()
        for c in product((0, 1), repeat=len(lines))
    }


def _triangles(lines, diagonal):
    corner = _corners(lines)
    a, b, c, d = (corner[key] for key in ((0, 0), (1, 0), (1, 1), (0, 1)))
    right = np.stack([a, b, c, a, c, d], axis=1)
    left = np.stack([a, b, d, b, c, d], axis=1)
    j, i = np.divmod(np.arange(len(a)), len(lines[0]) - 1)
    to_the_left = {"right": np.zeros_like(i), "left": np.ones_like(i), "alternating": (i + j) % 2}[
        diagonal
    ]
    return np.where(to_the_left[:, None] == 1, left, right).reshape(-1, 3)


def _tetrahedra(lines):
    corner = _corners(lines)
    unit = np.eye(3, dtype=int)
    tetrahedra = []
    for path in permutations(range(3)):
        vertices = np.vstack([np.zeros(3, dtype=int), np.cumsum(unit[list(path)], axis=0)])
        if np.linalg.det(unit[list(path)]) < 0:
            vertices = vertices[[0, 2, 1, 3]]
        tetrahedra.append(np.stack([corner[tuple(v)] for v in vertices.tolist()], axis=1))
    return np.stack(tetrahedra, axis=1).reshape(-1, 4)


def _cubes(lines, element):
    """Return the grid cells themselves, the vertices in the order of the element."""
    corner = _corners(lines)
    vertices = element.cell.vertices.astype(int).tolist()
    return np.stack([corner[tuple(vertex)] for vertex in vertices], axis=1)


def _tagged(lines, cells, element, patches, regions):
    points = np.stack(
        [grid.ravel() for grid in np.meshgrid(*lines[::-1], indexing="ij")[::-1]], axis=1
    )
    names, cell_region = _cell_regions(points[cells].mean(axis=1), lines, regions)
    cell, local = boundary_facets(cells, element)
    tag_of = _facet_tags(points[cells[:, element.facet_corners][cell, local]], lines, patches)
    points, cells = add_midside_nodes(points, cells, element)
    nodes = cell_facets(cells, element)[cell, local]
    facets = {tag: nodes[chosen] for tag, chosen in tag_of.items() if chosen.any()}
    return Mesh(points, cells, element, names, cell_region, facets)


def _cell_regions(centres, lines, regions):
    """Return the names of the regions that have cells and the index of each cell's region."""
    names = [DEFAULT_REGION]
    index = np.zeros(len(centres), dtype=np.int64)
    taken = np.zeros(len(centres), dtype=bool)
    for region in regions:
        where = f"mesh.regions '{region.name}'"
        inside = _inside(centres, lines, region, range(len(lines)), where)
        _refuse_overlap(inside, taken, centres, where, "cells of another region")
        if region.name not in names:
            names.append(region.name)
        index[inside] = names.index(region.name)
    used, index = np.unique(index, return_inverse=True)
    return tuple(names[i] for i in used), index


def _facet_tags(vertices, lines, patches):
    """Return for every tag which boundary facets, of the vertices (F, V, d), carry it."""
    centres = vertices.mean(axis=1)
    dim = len(lines)
    sides = {
        side: np.all(vertices[:, :, axis] == lines[axis][end], axis=1)
        for side, (axis, end) in SIDES[dim].items()
    }
    tags = {}
    taken = np.zeros(len(centres), dtype=bool)
    for patch in patches:
        where = f"mesh.patches '{patch.name}'"
        normal = SIDES[dim][patch.side][0]
        if getattr(patch, AXES[normal], None) is not None:
            raise InputError(
                f"{where}: an interval of {AXES[normal]} has no meaning on the side '{patch.side}';"
                " remove it"
            )
        tangential = [axis for axis in range(dim) if axis != normal]
        inside = sides[patch.side] & _inside(centres, lines, patch, tangential, where)
        _refuse_overlap(inside, taken, centres, where, "facets of another patch")
        tags[patch.name] = tags.get(patch.name, False) | inside
    return {**{side: chosen & ~taken for side, chosen in sides.items()}, **tags}


def _inside(centres, lines, part, axes, where):
    """Return which centres, (n, d), lie in the intervals of the part along the axes; at least one
    must.
    """
    inside = np.ones(len(centres), dtype=bool)
    for axis in axes:
        interval = getattr(part, AXES[axis], None)
        if interval is not None:
            place = f"{where}, {AXES[axis]}"
            low, high = (_on_line(limit, lines[axis], place) for limit in interval)
            if low >= high:
                raise InputError(
                    f"{place}: the interval [{digits(interval[0])}, {digits(interval[1])}] m is"
                    " empty; give [from, to]"
                )
            inside &= (centres[:, axis] > low) & (centres[:, axis] < high)
    return inside


def _on_line(limit, lines, where):
    nearest = lines[np.argmin(np.abs(lines - limit))]
    if abs(nearest - limit) > 1e-9 * (lines[-1] - lines[0]):
        advice = f"the nearest is {digits(nearest)} m; make it a breakpoint of the axis"
        raise InputError(f"{where}: {digits(limit)} m is not on a mesh line, {advice}")
    return nearest


def _refuse_overlap(inside, taken, centres, where, what):
    """Raise InputError where a part was taken before, else mark it."""
    twice = np.flatnonzero(inside & taken)
    if len(twice):
        place = ", ".join(f"{c:g}" for c in centres[twice[0]])
        raise InputError(
            f"{where}: contains {len(twice)} {what}, the first at ({place}) m; let the intervals"
            " not overlap"
        )
    taken |= inside
