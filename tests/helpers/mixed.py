"""Meshes of cells of several shapes, and files of them."""

from types import SimpleNamespace

import meshio
import numpy as np
from grids import grid

from porofsi_petsc.elements import ELEMENTS
from porofsi_petsc.mesh import Mesh
from porofsi_petsc.mesh.topology import boundary_facets, cell_facets

SIDES = {
    2: ("left", "right", "bottom", "top"),
    3: ("left", "right", "front", "back", "bottom", "top"),
}
# Faces of a hexahedron as the bases of pyramids, seen from inside.
BASES = np.array(ELEMENTS["H8"].facets)[:, ::-1]


def cut(mesh):
    """Return points and kind -> cells of a grid of Q4 or H8 whose columns along the last axis are
    of several shapes: squares and triangles; hexahedra, prisms, and pyramids of which those on the
    top are cut in tetrahedra.
    """
    column = np.round(2 * mesh.points[mesh.cells].mean(axis=1)[:, :-1]).astype(int).sum(axis=1)
    if mesh.dim == 2:
        whole, split = mesh.cells[column % 2 == 0], mesh.cells[column % 2 == 1]
        return mesh.points, {
            "quad": whole,
            "triangle": split[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3),
        }
    prisms = mesh.cells[column % 3 == 1][:, [[0, 1, 2, 4, 5, 6], [0, 2, 3, 4, 6, 7]]].reshape(-1, 6)
    split = mesh.cells[column % 3 == 2]
    apex = len(mesh.points) + np.arange(len(split))
    points = np.vstack([mesh.points, mesh.points[split].mean(axis=1)])
    pyramids = np.concatenate([np.column_stack([split[:, base], apex]) for base in BASES])
    on_top = (points[pyramids[:, :4], 2] == points[:, 2].max()).all(axis=1)
    tetrahedra = pyramids[on_top][:, [[0, 1, 2, 4], [0, 2, 3, 4]]].reshape(-1, 4)
    return points, {
        "hexahedron": mesh.cells[column % 3 == 0],
        "wedge": prisms,
        "pyramid": pyramids[~on_top],
        "tetra": tetrahedra,
    }


def unit_grid(dim, cells):
    """Return the grid of Q4 or H8 on a unit square or cube."""
    axis = SimpleNamespace(points=[0.0, 1.0], cells=[cells], ratios=None)
    return grid({2: "Q4", 3: "H8"}[dim], [axis] * dim)


def as_one(cells, element):
    """Return all cells in the collapsed form of the element, (E, A)."""
    forms = {element.meshio_name: range(element.nodes), **element.collapsed}
    return np.vstack([nodes[:, list(forms[kind])] for kind, nodes in cells.items()])


def one_mesh(points, cells):
    """Return the mesh of all cells in collapsed form, region body, and the boundary in sides."""
    element = ELEMENTS[{2: "Q4", 3: "H8"}[points.shape[1]]]
    together = as_one(cells, element)
    cell, local = boundary_facets(together, element)
    facets = cell_facets(together, element)[cell, local]
    ends = points.min(axis=0), points.max(axis=0)
    sides = {
        side: facets[
            (points[facets][..., number // 2] == ends[number % 2][number // 2]).all(axis=1)
        ]
        for number, side in enumerate(SIDES[element.dim])
    }
    region = np.zeros(len(together), dtype=np.int64)
    return Mesh(points, together, element, ("body",), region, sides)


def write_mixed(path, points, cells, upright=None):
    """Write a file with all kinds of cells in the region body and the boundary in sides.

    upright : the cells in their positive orientation, where some are not
    """
    dim = points.shape[1]
    groups = [(kind, dim, "body", nodes) for kind, nodes in cells.items()]
    for side, facets in one_mesh(points, upright or cells).facets.items():
        groups += [(kind, dim - 1, side, nodes) for kind, nodes in _by_shape(facets) if len(nodes)]
    names = {name: i for i, (name, _) in enumerate({(n, d): 0 for _, d, n, _ in groups}, start=1)}
    numbers = [np.full(len(nodes), names[name]) for _, _, name, nodes in groups]
    meshio.Mesh(
        np.pad(points, ((0, 0), (0, 3 - dim))),
        [(kind, nodes) for kind, _, _, nodes in groups],
        cell_data={"gmsh:physical": numbers, "gmsh:geometrical": numbers},
        field_data={name: np.array([names[name], d]) for _, d, name, _ in groups},
    ).write(path, file_format="gmsh22", binary=False)


def _by_shape(facets):
    """Return meshio's kind and the nodes of lines, or of triangles and quadrilaterals."""
    if facets.shape[1] == 2:
        return [("line", facets)]
    distinct = [list(dict.fromkeys(row)) for row in facets.tolist()]
    kinds = {3: "triangle", 4: "quad"}
    return [
        (kind, np.array([row for row in distinct if len(row) == size], dtype=int).reshape(-1, size))
        for size, kind in kinds.items()
    ]
