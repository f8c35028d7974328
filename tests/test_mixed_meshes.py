"""Meshes of cells of several shapes: all are collapsed quadrilaterals or hexahedra."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from grids import grid
from mixed import cut, unit_grid, write_mixed
from mpi4py import MPI
from running import SCENES, Job, run_here
from small_media import PLANE

from porofsi_petsc import Simulation, load_scene
from porofsi_petsc.elements import ELEMENTS
from porofsi_petsc.errors import InputError
from porofsi_petsc.fem.distribute import distribute
from porofsi_petsc.fem.domain import Domain
from porofsi_petsc.fem.geometry import shape_quality
from porofsi_petsc.fem.projection import SurfaceProjection
from porofsi_petsc.mesh import check, node_graph, read_mesh
from porofsi_petsc.mesh.write import write_mesh
from porofsi_petsc.output.probes import Probes
from porofsi_petsc.output.surface import surface_of
from porofsi_petsc.simulation.build import serial_mesh

pytestmark = pytest.mark.usefixtures("petsc")
EXACT = "coupling.tolerance=1e-10"
MIRRORED = {
    "triangle": [0, 2, 1],
    "quad": [0, 3, 2, 1],
    "tetra": [0, 2, 1, 3],
    "pyramid": [0, 3, 2, 1, 4],
    "wedge": [0, 2, 1, 3, 5, 4],
    "hexahedron": [0, 3, 2, 1, 4, 7, 6, 5],
}
FLAP = ("mesh.x.cells=[2, 1, 3]", "mesh.y.cells=[2, 2]")
SAME = {  # scene, changes of the mesh, other changes
    "porous": ("pulse2d", PLANE, (EXACT,)),
    "interface": (str(SCENES / "flap.toml"), FLAP, (EXACT, "model.convection=false")),
}


def mixed(tmp_path, dim, cells=3):
    """Return the mesh of a unit square or cube as it is read from its file."""
    write_mixed(tmp_path / "mixed.msh", *cut(unit_grid(dim, cells)))
    return read_mesh(tmp_path / "mixed.msh", dim)


def local(mesh):
    return distribute(MPI.COMM_SELF, mesh, np.zeros(len(mesh.points), dtype=int))


@pytest.mark.parametrize("dim, name, count", [(2, "Q4", 12), (3, "H8", 84)])
def test_cells_of_all_shapes_are_read(tmp_path, dim, name, count):
    """Their sizes are those that each shape has by itself: V/V_0, a half, a third or a sixth."""
    mesh = mixed(tmp_path, dim)
    assert mesh.element.name == name and len(mesh.cells) == count
    domain = Domain(local(mesh))
    volume = domain.reference.dV.sum(axis=1)
    assert volume.sum() == pytest.approx(1, rel=1e-14)
    vertices = np.array([len(set(cell)) for cell in mesh.cells.tolist()])
    part = {2: {3: 1 / 2, 4: 1}, 3: {4: 1 / 6, 5: 1 / 3, 6: 1 / 2, 8: 1}}[dim]
    expected = (volume / [part[v] for v in vertices.tolist()]) ** (1 / dim)
    assert np.allclose(domain.h, expected, rtol=1e-13)
    assert shape_quality(mesh.element.cell, mesh.points[mesh.cells]).min() > 0.3


@pytest.mark.parametrize("dim", [2, 3])
def test_cells_of_either_orientation_are_accepted(tmp_path, dim):
    points, cells = cut(unit_grid(dim, 3))
    turned = {kind: nodes.copy() for kind, nodes in cells.items()}
    for kind, nodes in turned.items():
        nodes[::2] = nodes[::2, MIRRORED[kind]]
    write_mixed(tmp_path / "turned.msh", points, turned, cells)
    mesh = read_mesh(tmp_path / "turned.msh", dim)
    domain = Domain(local(mesh))
    assert domain.reference.dV.min() > 0 and domain.reference.dV.sum() == pytest.approx(1)


@pytest.mark.parametrize("dim", [2, 3])
def test_a_node_moved_across_its_neighbours_is_refused(tmp_path, dim):
    points, cells = cut(unit_grid(dim, 3))
    moved = points.copy()
    moved[np.abs(points - 1 / 3).max(axis=1) < 1e-12, 0] += 0.6
    write_mixed(tmp_path / "moved.msh", moved, cells)
    with pytest.raises(InputError, match="tangled|folded"):
        read_mesh(tmp_path / "moved.msh", dim)


@pytest.mark.parametrize("dim", [2, 3])
def test_a_node_of_a_collapsed_cell_is_no_neighbour_of_itself(tmp_path, dim):
    mesh = mixed(tmp_path, dim)
    indptr, indices = node_graph(mesh.cells, len(mesh.points))
    rows = np.repeat(np.arange(len(mesh.points)), np.diff(indptr))
    assert np.all(rows != indices) and np.array_equal(np.unique(rows), np.arange(len(mesh.points)))


@pytest.mark.parametrize("dim", [2, 3])
def test_probes_find_points_and_nodes(tmp_path, dim):
    mesh = local(mixed(tmp_path, dim))
    points = np.vstack([np.random.default_rng(1).random((20, dim)), mesh.X])
    probes = Probes(mesh, [(str(i), x) for i, x in enumerate(points)])
    assert np.allclose(probes.evaluate(mesh.X), points, rtol=0, atol=1e-12)


@pytest.mark.parametrize("dim", [2, 3])
def test_figures_have_the_sides_of_all_cells(tmp_path, dim):
    mesh = mixed(tmp_path, dim, 2)
    surface = surface_of(mesh.points, mesh.cells, mesh.element, 0.0)
    a, b, c = (surface.points[surface.triangles[:, i]] for i in range(3))
    sides = [np.pad(x - a, ((0, 0), (0, 3 - dim))) for x in (b, c)]
    area = np.linalg.norm(np.cross(*sides), axis=1) / 2
    assert area.min() > 0 and area.sum() == pytest.approx({2: 1, 3: 6}[dim])


def test_linear_fields_cross_between_triangles_and_quadrilaterals(tmp_path):
    """The top of a cube of all shapes and that of hexahedra; forces keep their sum and moment."""
    sides = []
    for mesh in (mixed(tmp_path, 3), unit_grid(3, 4)):
        nodes, facets = np.unique(mesh.facets["top"], return_inverse=True)
        sides.append((facets.reshape(-1, 4), mesh.points[nodes]))
    (target, X), (source, X_source) = sides
    for facets, points in (((target, source), (X, X_source)), ((source, target), (X_source, X))):
        to, of = points
        coordinates = [x[f] for x, f in zip(points, facets, strict=True)]
        projection = SurfaceProjection(ELEMENTS["H8"], facets, coordinates)
        assert np.abs(projection.project(of) - to).max() < 1e-12
        force = np.random.default_rng(51).standard_normal(to.shape)
        spread = projection.transposed(force)
        assert np.allclose(spread.sum(axis=0), force.sum(axis=0), rtol=0, atol=1e-11)
        moments = (np.cross(x, f).sum(axis=0) for x, f in ((of, spread), (to, force)))
        assert np.allclose(*moments, rtol=0, atol=1e-11)


def collapsed(mesh):
    """Return a mesh of T3 as one of quadrilaterals of which a side is a point."""
    return replace(mesh, element=ELEMENTS["Q4"], cells=mesh.cells[:, [0, 1, 2, 2]])


@pytest.mark.parametrize("case", SAME)
def test_collapsed_quadrilaterals_are_linear_triangles(tmp_path, case):
    """All fields of three steps, to the tolerance of the coupling."""
    scene, cells, options = SAME[case]
    mesh = serial_mesh(load_scene(scene, (*cells, "mesh.order=1")))
    fields = []
    for form in (mesh, collapsed(mesh)):
        write_mesh(tmp_path / "mesh.msh", form)
        change = f"mesh={{kind='file', path='{tmp_path / 'mesh.msh'}', dim=2}}"
        with Simulation.from_scene(scene, overrides=(change, *options)) as simulation:
            for _ in range(3):
                simulation.step()
            fields.append({name: simulation.fields[name] for name in simulation.fields})
    for name, of_triangles in fields[0].items():
        scale = np.abs(of_triangles).max()
        assert np.abs(fields[1][name] - of_triangles).max() < 1e-6 * scale, name


def test_terzaghi_on_squares_and_triangles(tmp_path):
    """As on quadrilaterals alone: second order in a cell of 1/24 to 1/2 m, 2 % of u at 0.1 s."""
    x = SimpleNamespace(points=[0.0, 1.0], cells=[2], ratios=None)
    y = SimpleNamespace(points=[0.0, 10.0], cells=[24], ratios=[0.05])
    write_mixed(tmp_path / "mixed.msh", *cut(grid("Q4", [x, y])))
    change = f"mesh={{kind='file', path='{tmp_path / 'mixed.msh'}', dim=2}}"
    overrides = (change, "reference.times=[]", "time.end=0.1", "probe=[]")
    (error,) = run_here(Job("terzaghi", str(tmp_path / "run"), overrides))["errors"]
    print(error)
    assert error["u"] < 0.02 and error["p"] < 0.005


WEDGE = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1]]
PYRAMID = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0.5, 1]]


@pytest.mark.parametrize(
    ("points", "cell"),
    [(WEDGE, [0, 1, 2, 2, 3, 4, 5, 5]), (PYRAMID, [0, 1, 2, 3, 4, 4, 4, 4])],
    ids=["prism", "pyramid"],
)
def test_a_folded_cell_is_refused(points, cell):
    """A corner beyond the opposite side of its face; the cell as it should be passes."""
    element = ELEMENTS["H8"]
    cells = np.array([cell])
    X = np.array(points, dtype=float)
    check.require_positive_jacobian(X, cells, element, "mesh")
    X[0, :2] = 0.6
    with pytest.raises(InputError, match="is folded"):
        check.require_positive_jacobian(X, cells, element, "mesh")
