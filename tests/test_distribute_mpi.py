"""The distributed mesh: the same on any number of ranks (run under mpirun with -m mpi; passes on
one rank too).
"""

from types import SimpleNamespace

import numpy as np
import pytest
from mixed import cut, one_mesh, unit_grid
from mpi4py import MPI

from porofsi_petsc.fem import distribute
from porofsi_petsc.linalg.partition import coordinate_bisection, partition
from porofsi_petsc.mesh import box, node_graph, rectangle

pytestmark = pytest.mark.mpi
COMM = MPI.COMM_WORLD


def axis(points, cells):
    return SimpleNamespace(points=points, cells=cells, ratios=None)


def serial_mesh(name):
    if name == "T6":
        patch = SimpleNamespace(name="strip", side="top", x=[1.0, 2.0])
        region = SimpleNamespace(name="core", x=[1.0, 2.0], y=None)
        return rectangle(
            axis([0.0, 1.0, 2.0], [5, 4]),
            axis([0.0, 1.0], [4]),
            2,
            "alternating",
            [patch],
            [region],
        )
    if name == "T4":
        return box(axis([0.0, 1.0], [3]), axis([0.0, 1.0], [2]), axis([0.0, 2.0], [4]))
    if name == "mixed":
        points, cells = cut(unit_grid(3, 2))
        return one_mesh(points, cells)
    return rectangle(
        axis([0.0, 1.0], [1]), axis([0.0, 1.0], [1])
    )  # "tiny": four nodes, empty ranks on five


@pytest.fixture(scope="module", params=["T6", "T4", "mixed", "tiny"])
def meshes(request):
    """Return the serial mesh (on every rank, for comparison) and the local one."""
    serial = serial_mesh(request.param)
    root = serial if COMM.rank == 0 else None
    graph = node_graph(serial.cells, len(serial.points)) if COMM.rank == 0 else (None, None)
    owner = partition(COMM, *graph, root.points if COMM.rank == 0 else None)
    return serial, distribute(COMM, root, owner)


def test_every_node_is_owned_once_and_numbered_consecutively(meshes):
    serial, local = meshes
    owned = COMM.allgather(local.natural[: local.n_owned])
    assert sorted(np.concatenate(owned)) == list(range(len(serial.points)))
    assert all(np.all(np.diff(natural) > 0) for natural in owned)
    assert local.first == sum(len(natural) for natural in owned[: COMM.rank])
    assert np.array_equal(local.numbering, np.argsort(np.concatenate(owned))[local.natural])
    assert np.all(np.diff(local.numbering[local.n_owned :]) > 0)
    assert local.n_global == len(serial.points)


def test_coordinates_cells_and_regions_are_those_of_the_serial_mesh(meshes):
    serial, local = meshes
    assert np.array_equal(local.X, serial.points[local.natural])
    assert np.array_equal(local.natural[local.cells], serial.cells[local.cell_natural])
    assert np.array_equal(local.cell_region, serial.cell_region[local.cell_natural])
    assert (local.regions, local.hash, local.n_cells_global) == (
        serial.regions,
        serial.hash,
        len(serial.cells),
    )
    assert (local.dim, local.element) == (serial.dim, serial.element)


def test_every_cell_is_owned_once_and_present_where_it_touches_an_owned_node(meshes):
    serial, local = meshes
    owned = np.concatenate(COMM.allgather(local.cell_natural[local.cell_owned]))
    assert sorted(owned) == list(range(len(serial.cells)))
    mine = np.isin(serial.cells, local.natural[: local.n_owned]).any(axis=1)
    assert np.array_equal(local.cell_natural, np.flatnonzero(mine))
    assert np.array_equal(np.unique(local.cells), np.arange(local.n_local))


def test_every_facet_is_owned_once_and_present_with_its_cell(meshes):
    serial, local = meshes
    assert list(local.facets) == list(serial.facets)
    for tag, nodes in serial.facets.items():
        facets = local.facets[tag]
        assert np.array_equal(
            facets.nodes,
            local.cells[facets.cells[:, None], np.array(local.element.facets)[facets.local]],
        )
        owned = np.concatenate(COMM.allgather(local.natural[facets.nodes[facets.owned]]))
        assert sorted(map(tuple, owned)) == sorted(map(tuple, nodes))
        touching = np.isin(nodes, local.natural[: local.n_owned]).any(axis=1)
        here = {tuple(row) for row in local.natural[facets.nodes]}
        assert {tuple(row) for row in nodes[touching]} <= here


@pytest.mark.parametrize("shape", [(), (3,), (2, 2)])
@pytest.mark.parametrize("dtype", [float, np.int32, bool, complex])
def test_halo_brings_the_values_of_the_owners(meshes, shape, dtype):
    serial, local = meshes
    values = np.random.default_rng(1).integers(0, 3, (len(serial.points), *shape))
    expected = values.astype(dtype)[local.natural]
    for array in (expected.copy(), np.asfortranarray(expected)):
        array[local.n_owned :] = 0
        local.halo.update(array)
        assert np.array_equal(array, expected)


def test_halo_refuses_a_field_of_another_size(meshes):
    with pytest.raises(ValueError, match="rows"):
        meshes[1].halo.update(np.zeros(meshes[1].n_local + 1))


@pytest.mark.parametrize("shape", [(), (3,), (2, 2)])
@pytest.mark.parametrize("dtype", [float, np.int32, bool])
def test_natural_order_round_trip(meshes, shape, dtype):
    serial, local = meshes
    values = (
        (10 * np.random.default_rng(2).random((len(serial.points), *shape)))
        .astype(int)
        .astype(dtype)
    )
    low, high = local.order.bounds[COMM.rank : COMM.rank + 2]
    owned = values[local.natural[: local.n_owned]]
    slab = local.order.to_slab(owned)
    assert np.array_equal(slab, values[low:high]) and slab.dtype == values.dtype
    assert np.array_equal(local.order.from_slab(slab), owned)


def test_natural_order_takes_a_strided_view(meshes):
    _, local = meshes
    field = np.random.default_rng(COMM.rank).random((local.n_local, 3))
    owned = field[: local.n_owned, 1]
    assert np.array_equal(local.order.from_slab(local.order.to_slab(owned)), owned)


def test_sums_over_owned_cells_and_facets_equal_the_serial_ones(meshes):
    serial, local = meshes

    def volumes(points, cells):
        return np.linalg.det(points[cells[:, 1 : serial.dim + 1]] - points[cells[:, :1]])

    total = COMM.allreduce(volumes(local.X, local.cells[local.cell_owned]).sum())
    assert total == pytest.approx(
        volumes(serial.points, serial.cells).sum(), rel=1e-13
    )  # the order of the sum differs
    for tag, nodes in serial.facets.items():
        facets = local.facets[tag]
        total = COMM.allreduce(local.X[facets.nodes[facets.owned]].sum(axis=(0, 1)))
        assert total == pytest.approx(serial.points[nodes].sum(axis=(0, 1)), rel=1e-13)


def test_rows_of_owned_nodes_need_no_communication(meshes):
    """Sums over all local cells are complete on the owned nodes: the number of cells at each
    node.
    """
    serial, local = meshes
    counted = np.bincount(local.cells.ravel(), minlength=local.n_local)[: local.n_owned]
    assert np.array_equal(
        counted, np.bincount(serial.cells.ravel())[local.natural[: local.n_owned]]
    )


def test_partition_is_repeatable_and_balanced():
    serial = serial_mesh("T6")
    graph = node_graph(serial.cells, len(serial.points))
    first, second = (partition(COMM, *graph, serial.points) for _ in range(2))
    if COMM.rank == 0:
        assert np.array_equal(first, second)
        assert np.bincount(first, minlength=COMM.size).max() <= 1.5 * len(serial.points) / COMM.size
    else:
        assert first is None


@pytest.mark.parametrize("parts", [1, 2, 3, 5, 8, 200])
def test_bisection_is_balanced_to_one_node_per_cut(parts):
    points = serial_mesh("T4").points
    counts = np.bincount(coordinate_bisection(points, parts), minlength=parts)
    assert len(counts) == parts and counts.sum() == len(points)
    assert abs(counts - len(points) / parts).max() <= 2
    assert np.array_equal(
        coordinate_bisection(points, parts), coordinate_bisection(points.copy(), parts)
    )
