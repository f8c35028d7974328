"""Quadratic cells of several shapes, cut into quadratic triangles and tetrahedra."""

import meshio
import numpy as np
import pytest
from mixed import cut, unit_grid
from mpi4py import MPI
from test_mesh_read import refused_groups, write41

from porofsi_petsc.fem.distribute import distribute
from porofsi_petsc.fem.domain import Domain
from porofsi_petsc.mesh import read_mesh
from porofsi_petsc.mesh.cut import QUADRATIC
from porofsi_petsc.mesh.formats import known_to_meshio
from porofsi_petsc.mesh.topology import group_rows

pytestmark = pytest.mark.usefixtures("petsc")
SERENDIPITY = {"triangle": "triangle6", "quad": "quad8", "tetra": "tetra10"}
SERENDIPITY |= {"wedge": "wedge15", "pyramid": "pyramid13", "hexahedron": "hexahedron20"}
LAGRANGE = SERENDIPITY | {"quad": "quad9", "wedge": "wedge18", "pyramid": "pyramid14"}
LAGRANGE |= {"hexahedron": "hexahedron27"}


def quadratic(points, cells, kinds):
    """Return points and kind -> cells with a node in the middle of edges, and of the faces and the
    cell where the kind has them; numbers mixed up.
    """
    around = []
    for kind, nodes in cells.items():
        shape, own = QUADRATIC[kinds[kind]]
        sets = [*shape.edges, *shape.quadrilaterals[:own]]
        sets += [range(8)] if own > len(shape.quadrilaterals) else []
        around += [
            (kind, np.pad(nodes[:, list(s)], ((0, 0), (0, 8 - len(s))), "edge")) for s in sets
        ]
    rows = np.vstack([row for _, row in around])
    group = group_rows(rows)
    middle = np.empty((group.max() + 1, points.shape[1]))
    for number, row in zip(group, rows, strict=True):
        middle[number] = points[list(set(row.tolist()))].mean(axis=0)
    every = np.vstack([points, middle])
    mixed = np.random.default_rng(0).permutation(len(every))
    moved = np.empty_like(every)
    moved[mixed] = every
    made, at = {}, 0
    for kind, nodes in cells.items():
        columns = [nodes]
        for _ in [k for k, _ in around if k == kind]:
            columns.append(len(points) + group[at : at + len(nodes), None])
            at += len(nodes)
        made[kinds[kind]] = mixed[np.hstack(columns)]
    return moved, made


def write(path, points, cells):
    """Write Gmsh 4.1 with quadratic cells of VTK's order in the region body, no boundary."""
    dim = points.shape[1]
    write41(path, points, [(kind, dim, "body", nodes) for kind, nodes in cells.items()])


def read(tmp_path, dim, kinds, change=lambda x: x, n=3):
    points, cells = quadratic(*cut(unit_grid(dim, n)), kinds)
    write(tmp_path / "a.msh", change(points), cells)
    return read_mesh(tmp_path / "a.msh", dim), points, cells


@pytest.mark.parametrize("kinds", [SERENDIPITY, LAGRANGE], ids=["serendipity", "lagrange"])
@pytest.mark.parametrize("dim, name", [(2, "T6"), (3, "T10")])
def test_cells_of_all_shapes_become_simplices_that_fit_together(tmp_path, dim, name, kinds):
    """A facet that did not fit would be one of the boundary, beside the sides of the cube."""
    mesh, points, cells = read(tmp_path, dim, kinds)
    assert mesh.element.name == name and set(mesh.regions) == {"body"}
    parts = {"triangle": 1, "quad": 2, "tetra": 1, "pyramid": 2, "wedge": 3, "hexahedron": 6}
    count = sum(parts[kind.rstrip("0123456789")] * len(c) for kind, c in cells.items())
    assert len(mesh.cells) == count and "are cut into" in mesh.notes[0]
    assert not [tag for tag in mesh.facets if tag.startswith("side")]
    assert np.array_equal(mesh.points[: len(points)], points)
    local = distribute(MPI.COMM_SELF, mesh, np.zeros(len(mesh.points), dtype=int))
    assert Domain(local).reference.dV.sum() == pytest.approx(1, rel=1e-13)
    edges = mesh.element.cell.edges
    middle = np.stack([mesh.points[mesh.cells[:, list(e)]].mean(axis=1) for e in edges], axis=1)
    assert np.allclose(mesh.points[mesh.cells[:, dim + 1 :]], middle, rtol=0, atol=1e-14)


@pytest.mark.parametrize("kinds", [SERENDIPITY, LAGRANGE], ids=["serendipity", "lagrange"])
def test_new_nodes_lie_where_the_cell_has_them(tmp_path, kinds):
    """On squares bent by y + x²/5 the map is quadratic, and every node of a cell is on it."""

    def bent(x):
        return np.column_stack([x[:, 0], x[:, 1] + x[:, 0] ** 2 / 5])

    mesh, *_ = read(tmp_path, 2, kinds, bent)
    x, y = mesh.points.T
    straight = np.column_stack([x, y - x**2 / 5]) * 6
    assert np.allclose(straight, np.round(straight), rtol=0, atol=1e-12)
    local = distribute(MPI.COMM_SELF, mesh, np.zeros(len(mesh.points), dtype=int))
    assert Domain(local).reference.dV.sum() == pytest.approx(1, rel=1e-12)


def test_wedges_of_vtk_and_their_named_facets(tmp_path):
    """A quadrilateral of the boundary is that of two tetrahedra."""
    points, cells = quadratic(*cut(unit_grid(3, 3)), SERENDIPITY)
    blocks = [(kind, nodes) for kind, nodes in cells.items() if kind in ("wedge15", "hexahedron20")]
    hexahedron = cells["hexahedron20"]
    low = hexahedron[(points[hexahedron[:, [0, 1, 2, 3]], 2] < 1e-9).all(axis=1)]
    blocks.append(("quad8", low[:, [0, 1, 2, 3, 8, 9, 10, 11]]))
    numbers = [np.full(len(nodes), 4 + i) for i, (_, nodes) in enumerate(blocks)]
    known_to_meshio()
    meshio.Mesh(points, blocks, cell_data={"MaterialIDs": numbers}).write(tmp_path / "a.vtu")
    mesh = read_mesh(tmp_path / "a.vtu", 3)
    assert mesh.regions == ("group_4", "group_5")
    assert len(mesh.facets["group_6"]) == 2 * len(low)
    assert (mesh.points[mesh.facets["group_6"], 2] == 0).all()


def test_cells_of_two_orders_are_refused(tmp_path):
    points = np.random.default_rng(0).random((9, 2))
    groups = [("triangle6", 2, "body", np.arange(6)[None]), ("quad", 2, "body", [[0, 6, 7, 8]])]
    groups = [(k, d, n, np.array(c)) for k, d, n, c in groups]
    refused_groups(tmp_path, points, groups, "mixed cells of kinds quad, triangle6; .* one order")
