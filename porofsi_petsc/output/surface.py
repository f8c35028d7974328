"""What is drawn of a mesh: the cells of a plane mesh, or the surface of the rear half of a
solid one, and the outline.
"""

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from ..elements import ELEMENTS, Element
from ..mesh.topology import boundary_facets, group_rows
from .snapshots import read_written_mesh

AZIMUTH = np.radians(-60.0)
ELEVATION = np.radians(25.0)
SHARP_EDGE = np.cos(np.radians(30.0))


@dataclass(frozen=True)
class Surface:
    """Polygons and outline in the numbering of the points, with their projection to the plane of
    the picture.

    points : (N, d) [m].  polygons : (P, vertices of one).
    outline : (L, 2) edges of a plane domain, sharp edges of a solid one.
    cut : y [m] in front of which the elements of a solid domain are left out, so that its inside is
    seen; None in the plane.
    """

    points: np.ndarray
    polygons: np.ndarray
    outline: np.ndarray
    cut: float | None = None

    @property
    def dim(self) -> int:
        """Return the space dimension."""
        return self.points.shape[1]

    @cached_property
    def triangles(self) -> np.ndarray:
        """Return the polygons, cut from their first vertex, (T, 3)."""
        return triangles_of(self.polygons)

    @cached_property
    def lines(self) -> np.ndarray:
        """Return the sides of the polygons, each once, (L, 2)."""
        sides = np.stack([self.polygons, np.roll(self.polygons, -1, axis=1)], axis=2)
        ends = np.unique(np.sort(sides.reshape(-1, 2), axis=1), axis=0)
        return ends[ends[:, 0] != ends[:, 1]]

    @cached_property
    def nodes(self) -> np.ndarray:
        """Return the numbers of the nodes on the polygons."""
        return np.unique(self.polygons)

    @property
    def size(self) -> float:
        """Return the largest extent of what is drawn [m]."""
        return np.ptp(self.points[self.nodes], axis=0).max()

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return picture coordinates (N, 2) [m] and depth toward the eye (N,) of points (N, d);
        parallel projection in 3-D.
        """
        if self.dim == 2:
            return points, np.zeros(len(points))
        (ca, sa), (ce, se) = (
            (np.cos(AZIMUTH), np.sin(AZIMUTH)),
            (
                np.cos(ELEVATION),
                np.sin(ELEVATION),
            ),
        )
        frame = np.array([[-sa, ca, 0.0], [-se * ca, -se * sa, ce], [ce * ca, ce * sa, se]])
        seen = points @ frame.T
        return seen[:, :2], seen[:, 2]


def read_regions(directory: Path) -> list[str]:
    """Return the names of the regions of the mesh written in a result directory."""
    return read_written_mesh(directory).regions


def read_surface(
    directory: Path,
    cut: float | None = None,
    regions: Collection[str] | None = None,
) -> Surface:
    """Return the Surface of the mesh written in a result directory, of some of its regions or all;
    cut as in `surface_of`.
    """
    mesh = read_written_mesh(directory)
    element = ELEMENTS[mesh.element]
    cells = mesh.cells
    if regions is not None:
        chosen = [i for i, name in enumerate(mesh.regions) if name in regions]
        cells = cells[np.isin(mesh.region, chosen)]
    return surface_of(mesh.points[:, : element.dim], cells, element, cut)


def surface_of(
    points: np.ndarray, cells: np.ndarray, element: Element, cut: float | None = None
) -> Surface:
    """Return the Surface of a mesh; elements of order 2 are split at their mid-edge nodes.

    cut : y [m] in front of which a solid domain is left out, None for its middle; all is kept where
    nothing would be left.
    """
    boundary = _boundary(cells, element)
    if element.dim == 2:
        return Surface(points, split(cells, element), split(boundary, element.facet))
    depth = points[:, 1]
    cut = (depth.min() + depth.max()) / 2 if cut is None else cut
    centres = depth[cells].mean(axis=1)
    if cut >= centres.max():
        cut = depth.min()
    behind = cells[centres > cut]
    outline = _sharp_edges(points, triangles_of(split(boundary, element.facet)))
    return Surface(points, split(_boundary(behind, element), element.facet), outline, cut)


def _boundary(cells, element):
    cell, local = boundary_facets(cells, element)
    return cells[cell[:, None], np.array(element.facets)[local]]


def triangles_of(polygons: np.ndarray) -> np.ndarray:
    """Return the triangles (n, 3) of polygons (F, V), without those that are but a line."""
    fan = [(0, i, i + 1) for i in range(1, polygons.shape[1] - 1)]
    triangles = polygons[:, np.array(fan)].reshape(-1, 3)
    a, b, c = triangles.T
    return triangles[(a != b) & (b != c) & (c != a)]  # a side of a collapsed cell is a point


def split(cells: np.ndarray, element: Element) -> np.ndarray:
    """Return the `Element.polygons` of plane cells, or the segments of lines, (F, A) -> (F', V)."""
    return cells[:, np.array(element.polygons)].reshape(-1, len(element.polygons[0]))


def _sharp_edges(points, triangles):
    """Return the edges, (L, 2), whose two triangles enclose more than 30 degrees."""
    a, b, c = (points[triangles[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    edges = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    group = group_rows(edges)
    order = np.argsort(group, kind="stable")
    pairs = order.reshape(-1, 2)  # a closed surface: every edge belongs to two triangles
    cosine = np.einsum("ei,ei->e", normal[pairs[:, 0] // 3], normal[pairs[:, 1] // 3])
    return edges[pairs[cosine < SHARP_EDGE, 0]]
