"""Cells that no element has are cut into cells that one has, facets alike on both sides.

Where a facet is cut, its own node numbers decide how, so that both cells do it alike: a polygon
into the triangles at its smallest vertex, a cell into the simplices between its smallest vertex and
the facets opposite to it (Dompierre, Labbe, Vallet & Camarero 1999).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from ..elements import ELEMENTS
from ..errors import InputError
from .check import place
from .source import Block, Source
from .topology import group_rows

POLYGONS = {"penta_prism": 5, "hexa_prism": 6}


def cut_prisms(source: Source, where: Path) -> tuple[Source, str]:
    """Return the source with prisms over pentagons and hexagons cut into wedges, and a sentence on
    it, "" where there are none.

    A polygon is cut into the triangles at its smallest node number.  Raises InputError where that
    is another one at the bottom than at the top.
    """
    counts = [len(block.data) * (block.type in POLYGONS) for block in source.blocks]
    if not any(counts):
        return source, ""
    for index, block in enumerate(source.blocks):
        if counts[index]:
            wedges = _wedges(block, source.points, where)
            owner = np.repeat(np.arange(counts[index]), POLYGONS[block.type] - 2)
            source = replaced(source, index, Block("wedge", 3, wedges), owner)
    return source, f"{sum(counts)} prisms over pentagons or hexagons are cut into wedges"


def _wedges(block, points, where):
    n = POLYGONS[block.type]
    bottom, top = block.data[:, :n], block.data[:, n:]
    first = bottom.argmin(axis=1)
    other = np.flatnonzero(first != top.argmin(axis=1))
    if len(other):
        at = place(points[block.data[other[0]]].mean(axis=0))
        raise InputError(
            f"{where}: {len(other)} prisms, the first at {at}, have their smallest node number at"
            " another corner at the bottom than at the top, so that they cannot be cut alike on"
            " both sides; number the nodes layer by layer, or mesh with wedges or hexahedra"
        )
    corner = (first[:, None, None] + _fan(n)) % n
    cells = np.arange(len(block.data))[:, None, None]
    return np.concatenate([bottom[cells, corner], top[cells, corner]], axis=2).reshape(-1, 6)


def _fan(n):
    """Return the triangles at corner 0 of a polygon of n corners, (n - 2, 3)."""
    return np.array([[0, i, i + 1] for i in range(1, n - 1)])


def replaced(source: Source, index: int, block: Block, owner: np.ndarray) -> Source:
    """Return the source with parts in place of the cells of a block; owner : (n,) cell of each
    part.
    """
    blocks = [block if i == index else old for i, old in enumerate(source.blocks)]
    sets = {
        name: [
            np.flatnonzero(np.isin(owner, part)) if i == index else part
            for i, part in enumerate(parts)
        ]
        for name, parts in source.sets.items()
    }
    arrays, values = (
        {
            name: [part[owner] if i == index else part for i, part in enumerate(parts)]
            for name, parts in named.items()
        }
        for named in (source.arrays, source.values)
    )
    return replace(source, blocks=blocks, sets=sets, arrays=arrays, values=values)


@dataclass(frozen=True)
class Shape:
    """A quadratic cell: vertices, the ends of its edges and the vertices of its facets; first the
    nodes at the vertices, then in the middle of edges, of quadrilaterals if there are, and of the
    cell.

    The facets that are quadrilaterals are in the order of the nodes in their middle.
    """

    vertices: int
    edges: Sequence[Sequence[int]]
    facets: Sequence[Sequence[int]]
    dim: int = 3

    @property
    def quadrilaterals(self) -> list[Sequence[int]]:
        """Return the quadrilaterals, of a plane cell itself."""
        plane = [range(self.vertices)] if self.dim == 2 else self.facets
        return [face for face in plane if len(face) == 4]

    @cached_property
    def middle(self) -> np.ndarray:
        """Return the number of the node between two vertices, (V, V)."""
        table = np.full((self.vertices,) * 2, -1)
        first = self.vertices
        for edge in self.edges:
            table[edge[0], edge[1]] = table[edge[1], edge[0]] = first
            first += 1
        for a, b, c, d in self.quadrilaterals:
            table[[a, c, b, d], [c, a, d, b]] = first
            first += 1
        table[(table < 0) & ~np.eye(self.vertices, dtype=bool)] = first
        return table

    def around(self, face: Sequence[int]) -> list[int]:
        """Return the nodes of the edges of a quadrilateral."""
        ends = zip(face, [*face[1:], face[0]], strict=True)
        return [int(self.middle[a, b]) for a, b in ends]


def _of_element(name):
    element = ELEMENTS[name]
    corners = [element.facets[i][: element.cell.facet_vertices] for i in range(len(element.facets))]
    return Shape(element.n_vertices, element.cell.edges, corners, element.dim)


_WEDGE = Shape(
    6,
    ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)),
    ((0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5), (0, 1, 2), (3, 4, 5)),
)
_PYRAMID = Shape(
    5,
    ((0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4)),
    ((0, 1, 2, 3), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)),
)
# Name in meshio: the shape, and how many of the nodes after those of the edges it has.
QUADRATIC = {
    "triangle6": (_of_element("T6"), 0),
    "quad8": (_of_element("Q8"), 0),
    "quad9": (_of_element("Q9"), 1),
    "tetra10": (_of_element("T10"), 0),
    "pyramid13": (_PYRAMID, 0),
    "pyramid14": (_PYRAMID, 1),
    "wedge15": (_WEDGE, 0),
    "wedge18": (_WEDGE, 3),
    "hexahedron20": (_of_element("H20"), 0),
    "hexahedron27": (_of_element("H27"), 7),
}
SIMPLEX = {2: "triangle6", 3: "tetra10"}


def cut_quadratic(source: Source, dim: int) -> tuple[Source, str]:
    """Return the source with its quadratic cells cut into quadratic triangles or tetrahedra, and a
    sentence on it; unchanged and "" where an element has them all, or cells are of other kinds.

    What is cut is between the nodes of the file and, in the middle of the quadrilaterals and of the
    hexahedra that have no node there, new ones after them: where the shape functions of the cell
    have this point.
    """
    chosen = [i for i, b in enumerate(source.blocks) if b.dim == dim and len(b.data)]
    kinds = sorted({source.blocks[i].type for i in chosen})
    supported = {element.meshio_name for element in ELEMENTS.values()}
    if not set(kinds) <= QUADRATIC.keys() or (len(kinds) == 1 and kinds[0] in supported):
        return source, ""
    before = len(source.points)
    complete, points = _with_middle_nodes([source.blocks[i] for i in chosen], source.points)
    cut = replace(source, points=points)
    count = 0
    for i, nodes in zip(chosen, complete, strict=True):
        shape = QUADRATIC[source.blocks[i].type][0]
        simplices, owner = _simplices(shape, nodes)
        cut = replaced(cut, i, Block(SIMPLEX[dim], dim, simplices), owner)
        count += len(simplices)
    if dim == 3:
        cut = _with_triangles(cut)
    what = f"{sum(len(source.blocks[i].data) for i in chosen)} cells of kinds {', '.join(kinds)}"
    where = {2: "triangles", 3: "tetrahedra"}[dim]
    return cut, (
        f"{what} are cut into {count} quadratic {where}, with {len(points) - before} nodes more,"
        " numbered after those of the file"
    )


def _with_middle_nodes(blocks, points):
    """Return the cells of all blocks with the nodes in the middle of quadrilaterals and of the
    cell, and the points with those added.
    """
    shapes = [QUADRATIC[block.type] for block in blocks]
    faces = [
        block.data[:, list(face)]
        for block, (s, _) in zip(blocks, shapes, strict=True)
        for face in s.quadrilaterals
    ]
    if not faces:
        return [block.data for block in blocks], points
    group = group_rows(np.concatenate(faces))
    middle = np.full(group.max(initial=-1) + 1, -1, dtype=np.int64)
    centres = np.empty((len(middle), points.shape[1]))
    at = 0
    for block, (shape, own) in zip(blocks, shapes, strict=True):
        first = shape.vertices + len(shape.edges)
        for number, face in enumerate(shape.quadrilaterals):
            groups = group[at : at + len(block.data)]
            at += len(block.data)
            corners, edges = (points[block.data[:, list(n)]] for n in (face, shape.around(face)))
            centres[groups] = edges.sum(axis=1) / 2 - corners.sum(axis=1) / 4
            if own:
                middle[groups] = block.data[:, first + number]
    new = middle < 0
    middle[new] = len(points) + np.arange(new.sum())
    points = np.vstack([points, centres[new]])
    complete = []
    at = 0
    for block, (shape, own) in zip(blocks, shapes, strict=True):
        columns = [block.data[:, : shape.vertices + len(shape.edges)]]
        for _ in shape.quadrilaterals:
            columns.append(middle[group[at : at + len(block.data)], None])
            at += len(block.data)
        if own == len(shape.quadrilaterals) + 1:
            columns.append(block.data[:, -1:])
        elif shape.vertices == 8:
            corners, edges = (points[part] for part in np.split(columns[0], [8], axis=1))
            columns.append(len(points) + np.arange(len(block.data))[:, None])
            points = np.vstack([points, (edges.sum(axis=1) - corners.sum(axis=1)) / 4])
        complete.append(np.hstack(columns))
    return complete, points


def _simplices(shape, cells):
    """Return the nodes of quadratic simplices, (n, A), that cells with all middle nodes are cut
    into, and the cell of each, (n,) ascending.
    """
    least = cells[:, : shape.vertices].argmin(axis=1)
    parts, owners = [], []
    for vertex in range(shape.vertices):
        here = np.flatnonzero(least == vertex)
        for facet in shape.facets:
            if vertex not in facet and len(here):
                for corners in _cut_facet(cells[here], np.array(facet)):
                    parts.append(np.column_stack([np.full(len(here), vertex), corners]))
                    owners.append(here)
    local, owner = np.concatenate(parts), np.concatenate(owners)
    order = np.argsort(owner, kind="stable")
    local, owner = local[order], owner[order]
    edges = ELEMENTS["T6" if shape.dim == 2 else "T10"].cell.edges
    between = [shape.middle[local[:, a], local[:, b]] for a, b in edges]
    return cells[owner[:, None], np.column_stack([local, *between])], owner


def _cut_facet(cells, facet):
    """Return the vertices of a facet, a quadrilateral as two triangles, as local numbers (n, k)."""
    if len(facet) < 4:
        return [np.broadcast_to(facet, (len(cells), len(facet)))]
    first = cells[:, facet].argmin(axis=1)[:, None]
    return [facet[(first + corners) % 4] for corners in _fan(4)]


def _with_triangles(source):
    """Return the source with the vertices of quadrilaterals as those of two triangles."""
    for index, block in enumerate(source.blocks):
        if block.type in ("quad", "quad8", "quad9") and len(block.data):
            corners = _cut_facet(block.data, np.arange(4))
            rows = np.arange(len(block.data))[:, None]
            triangles = np.stack([block.data[rows, part] for part in corners], axis=1)
            owner = np.repeat(np.arange(len(block.data)), 2)
            cut = Block("triangle", 2, triangles.reshape(-1, 3))
            source = replaced(source, index, cut, owner)
    return source
