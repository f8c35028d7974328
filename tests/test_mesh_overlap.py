"""Mesh files whose cells overlap: tangled by a moved node, hung on the boundary, folded over
themselves.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from grids import grid
from test_mesh_read import MESHES, blocks, refused_groups, write22

from porofsi_petsc.elements import ELEMENTS
from porofsi_petsc.mesh import read_mesh, rectangle

AXIS = SimpleNamespace(points=[0.0, 3.0], cells=[3], ratios=None)
GRIDS = {name: grid(name, [AXIS] * element.dim) for name, element in ELEMENTS.items()}
SIMPLICES = ["T3", "T6", "T4", "T10"]
FLIP = {
    "T3": [0, 2, 1],
    "T6": [0, 2, 1, 5, 4, 3],
    "T4": [0, 2, 1, 3],
    "T10": [0, 2, 1, 3, 6, 5, 4, 7, 9, 8],
    **{name: ELEMENTS[name].mirror for name in ELEMENTS if name not in SIMPLICES},
}
TRIANGLE = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
TETRAHEDRON = np.vstack([np.zeros(3), np.eye(3)])


def moved(mesh, shift):
    """Return the points with the first inner vertex shifted along x, mid-edge nodes in the
    middle.
    """
    points = mesh.points.copy()
    points[np.abs(points - 1.0).sum(axis=1) < 1e-12, 0] += shift
    for i, around in enumerate(mesh.element.supports, start=mesh.element.n_vertices):
        points[mesh.cells[:, i]] = points[mesh.cells[:, list(around)]].mean(axis=1)
    return points


def half_clockwise(mesh):
    """Return the groups of a mesh with every second cell turned over."""
    cells = mesh.cells.copy()
    cells[::2] = cells[::2, FLIP[mesh.element.name]]
    return [(k, d, n, cells if d == mesh.dim else nodes) for k, d, n, nodes in blocks(mesh)]


def with_cells(mesh, corners, nodes):
    """Return points and groups with one more linear cell: known nodes, then new ones at corners (n,
    d).
    """
    new = len(mesh.points) + np.arange(len(corners))
    cell = np.array([[*nodes, *new]])
    group = (mesh.element.meshio_name, mesh.dim, "body", cell)
    return np.vstack([mesh.points, corners]), [*blocks(mesh), group]


@pytest.mark.parametrize("shift", [1.2, 1.5, 1.9, -1.3])
@pytest.mark.parametrize("name", SIMPLICES)
def test_a_node_moved_across_its_neighbours_is_refused(tmp_path, name, shift):
    mesh = GRIDS[name]
    message = (
        r"the mesh is tangled at \d+ facets, the first at \(.*\): its cells \d+ at \(.* same side"
    )
    refused_groups(tmp_path, moved(mesh, shift), half_clockwise(mesh), message, dim=mesh.dim)


@pytest.mark.parametrize("shift", [0.3, -0.4, 0.6])
@pytest.mark.parametrize("name", GRIDS)
def test_a_distorted_mesh_of_either_orientation_is_accepted(tmp_path, name, shift):
    mesh = GRIDS[name]
    write22(tmp_path / "a.msh", moved(mesh, shift), half_clockwise(mesh))
    assert len(read_mesh(tmp_path / "a.msh", mesh.dim).cells) == len(mesh.cells)


def test_a_cell_that_is_hung_on_a_node_of_the_boundary_is_refused(tmp_path):
    at = (
        r"cells overlap: \d+ at \(.*\) and \d+ at \(.*\) \(counted from 0\), the first .*;"
        r" remove one"
    )
    plane = GRIDS["T3"]
    space = GRIDS["T4"]
    refused_groups(tmp_path, *with_cells(plane, [[0.9, 0.2], [0.8, 0.8]], [0]), at)
    refused_groups(
        tmp_path,
        *with_cells(space, [[0.9, 0.2, 0.2], [0.8, 0.8, 0.1], [0.3, 0.3, 0.9]], [0]),
        at,
        dim=3,
    )
    tip = [[1.5, 1.4]]
    refused_groups(
        tmp_path,
        *with_cells(plane, tip, [0, 1]),
        r"the mesh is tangled at 1 facets, the first at \(0.5, 0\)",
    )


@pytest.mark.parametrize("name, corners", [("T3", TRIANGLE), ("T4", TETRAHEDRON)])
def test_a_part_without_common_nodes_may_touch_but_not_overlap(tmp_path, name, corners):
    """Sides of an interface lie within a tenth of a facet of each other, which both sides may
    curve; without names facets that lie on each other are those of a split body.
    """
    mesh = GRIDS[name]
    for offset, fine in ((0.5, False), (1.3, False), (2.6, False), (2.95, True), (3.0, True)):
        shift = np.array([offset, *np.full(mesh.dim - 1, 0.7)])
        points, groups = with_cells(mesh, corners + shift, [])
        if not fine:
            refused_groups(tmp_path, points, groups, "cells overlap: ", dim=mesh.dim)
        else:
            _read_apart(tmp_path, points, groups, mesh, touching=offset == 3.0)


def _read_apart(folder, points, groups, mesh, touching):
    if touching:
        refused_groups(folder, points, groups, "the body is split", dim=mesh.dim)
        return
    write22(folder / "a.msh", points, groups)
    assert len(read_mesh(folder / "a.msh", mesh.dim).cells) > len(mesh.cells)


@pytest.mark.parametrize("cell_type", ["triangle", "quadrilateral"])
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("turn", [1.2, 1.21, 1.0])
def test_a_strip_may_meet_itself_after_a_turn_but_not_go_on(tmp_path, order, turn, cell_type):
    """Its cells are upright and neighbours agree; after 1.2 turns whole cells lie on each other."""
    long, wide = (SimpleNamespace(points=[0.0, 1.0], cells=[n], ratios=None) for n in (24, 2))
    strip = rectangle(long, wide, order, cell_type=cell_type)
    angle = 2 * np.pi * turn * strip.points[:, 0]
    r = 2.0 - strip.points[:, 1]
    points = r[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    if turn > 1:
        refused_groups(tmp_path, points, blocks(strip), "cells overlap: ")
    else:
        write22(tmp_path / "a.msh", points, blocks(strip))
        assert len(read_mesh(tmp_path / "a.msh", 2).cells) == len(strip.cells)


@pytest.mark.parametrize("name", ["Q9", "Q8", "H8", "H27", "H20"])
def test_a_cell_that_lies_on_the_same_side_of_a_facet_as_its_neighbour_is_refused(tmp_path, name):
    """Two cells of a tensor product, the second of which is turned back over the first."""
    axes = [AXIS] * GRIDS[name].dim
    two = [SimpleNamespace(points=[0.0, 2.0], cells=[2], ratios=None), *axes[1:]]
    mesh = grid(name, two)
    points = mesh.points.copy()
    points[:, 0] = np.where(points[:, 0] > 1, 1 - 0.8 * (points[:, 0] - 1), points[:, 0])
    right = mesh.points[mesh.cells].mean(axis=1)[:, 0] > 1
    cells = np.where(right[:, None], mesh.cells[:, mesh.element.mirror], mesh.cells)
    groups = [(k, d, n, cells if d == mesh.dim else nodes) for k, d, n, nodes in blocks(mesh)]
    refused_groups(tmp_path, points, groups, "the mesh is tangled at .* same side", dim=mesh.dim)


@pytest.mark.parametrize("name", ["T4", "Q4", "H8"])
def test_a_body_that_is_in_the_file_twice_is_refused(tmp_path, name):
    mesh = GRIDS[name]
    groups = blocks(mesh)
    copies = [(k, d, n, nodes + len(mesh.points)) for k, d, n, nodes in groups]
    refused_groups(
        tmp_path, np.vstack([mesh.points] * 2), [*groups, *copies], "cells overlap: ", dim=mesh.dim
    )


@pytest.mark.parametrize("name", MESHES)
def test_digits_of_a_file_are_no_overlap(tmp_path, name):
    mesh = MESHES[name]
    rounded = np.round(mesh.points + 1e-4 * np.sin(7 * mesh.points), 4)
    write22(tmp_path / "a.msh", rounded, blocks(mesh))
    assert len(read_mesh(tmp_path / "a.msh", mesh.dim).cells) == len(mesh.cells)
