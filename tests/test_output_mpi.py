"""Output does not depend on the number of ranks or on the partition."""

from types import SimpleNamespace

import h5py
import meshio
import numpy as np
import pytest
from mpi4py import MPI

from porofsi_petsc.errors import InputError, PorofsiError
from porofsi_petsc.fem.distribute import distribute
from porofsi_petsc.mesh.generate import rectangle
from porofsi_petsc.output.checkpoint import open_checkpoint, read_arrays, write_checkpoint
from porofsi_petsc.output.directory import Claim
from porofsi_petsc.output.fields import FieldWriter, Storage
from porofsi_petsc.output.files import on_root
from porofsi_petsc.output.hdf5 import read_slab, write_slabs
from porofsi_petsc.output.history import History, read_history
from porofsi_petsc.output.probes import Probes
from porofsi_petsc.output.vtkhdf import VtkhdfWriter

pytestmark = pytest.mark.mpi
COMM = MPI.COMM_WORLD


def block():
    x, y = (
        SimpleNamespace(points=[0.0, length], cells=[cells], ratios=[1.0])
        for length, cells in ((2.0, 6), (1.0, 3))
    )
    return rectangle(x, y, order=2, diagonal="alternating")


def local_mesh(seed, ranks=COMM.size):
    """Return the block in a random partition; rank 0 alone owns everything for ranks = 1."""
    mesh = block()
    owner = np.random.default_rng(seed).integers(0, ranks, len(mesh.points))
    return distribute(COMM, mesh if COMM.rank == 0 else None, owner if COMM.rank == 0 else None)


def arrays_of(mesh):
    X = mesh.X[: mesh.n_owned]
    return {
        "u": np.sqrt(X),
        "p": X[:, 0] / 3,
        "b": np.tile(X[:, :1, None], (1, 3, 3)),
        "number": mesh.natural[: mesh.n_owned],
    }


@pytest.mark.parametrize("ranks_written", [COMM.size, 1])
def test_checkpoint_is_read_in_another_partition(ranks_written, shared_path):
    write_checkpoint(
        shared_path,
        local_mesh(1, ranks_written),
        {"step": 3},
        arrays_of(local_mesh(1, ranks_written)),
    )
    mesh = local_mesh(2)
    path = shared_path / "checkpoint.h5"
    header = open_checkpoint(path, COMM)
    arrays = read_arrays(path, header, mesh)
    assert header["step"] == 3 and header["nodes"] == mesh.n_global
    for name, expected in arrays_of(mesh).items():
        assert np.array_equal(arrays[name], expected)


def test_fields_are_those_of_the_serial_mesh(shared_path):
    mesh = local_mesh(3)
    serial = block()
    writer = FieldWriter(shared_path, mesh)
    for step in range(3):
        writer.write(
            step,
            0.5 * step,
            {"displacement": step * mesh.X[: mesh.n_owned], "pressure": mesh.X[: mesh.n_owned, 0]},
        )
    writer.truncate(0.7)
    with meshio.xdmf.TimeSeriesReader(shared_path / "fields.xdmf") as reader:
        points, cells = reader.read_points_cells()
        time, point_data, cell_data = reader.read_data(1)
        assert reader.num_steps == 2
    assert (
        time == 0.5
        and np.array_equal(cells[0].data, serial.cells)
        and np.array_equal(points[:, :2], serial.points)
    )
    assert np.array_equal(point_data["displacement"][:, :2], serial.points)
    assert np.array_equal(point_data["pressure"], serial.points[:, 0])
    assert np.array_equal(cell_data["region"][0], serial.cell_region)


def test_a_vtkhdf_file_is_that_of_the_serial_mesh(shared_path):
    """The same datasets, to the last bit, as one rank alone writes them."""
    alone = shared_path / "alone"
    whole = distribute(MPI.COMM_SELF, block(), np.zeros(len(block().points), dtype=int))
    on_root(COMM, alone.mkdir)
    for mesh, folder in ((local_mesh(3), shared_path), (whole, alone)):
        if mesh.comm.size == 1 < COMM.size and COMM.rank:
            continue
        writer = VtkhdfWriter(folder, mesh, Storage("float32", 1))
        for step in range(4):
            X = mesh.X[: mesh.n_owned]
            writer.write(step, 0.5 * step, {"displacement": step * X, "pressure": X[:, 0]})
        writer.truncate(0.7)
        writer.write(2, 1.0, {"displacement": 9 * X, "pressure": X[:, 1]})
    COMM.barrier()
    one, other = (datasets(folder / "fields.vtkhdf") for folder in (shared_path, alone))
    assert one.keys() == other.keys() and len(one["VTKHDF/Steps/Values"]) == 3
    assert all(np.array_equal(one[name], other[name]) for name in one)


def datasets(path):
    """Return place -> array of an HDF5 file."""
    found = {}
    with h5py.File(path, "r") as file:
        file.visititems(
            lambda place, item: (
                found.update({place: item[()]}) if isinstance(item, h5py.Dataset) else None
            )
        )
    return found


def test_probes_do_not_depend_on_the_partition():
    serial = block()
    values = np.sin(3 * serial.points) + serial.points**2
    points = [("node", [1.0, 1.0]), ("edge", [0.5, 0.5]), ("inside", [1.37, 0.61])]
    alone = Probes(
        distribute(MPI.COMM_SELF, serial, np.zeros(len(values), dtype=int)), points
    ).evaluate(values)
    for seed in range(3):
        mesh = local_mesh(seed)
        assert np.array_equal(Probes(mesh, points).evaluate(values[mesh.natural]), alone)


def test_slabs_of_ranks_without_rows(shared_path):
    rows = np.full((2 if COMM.rank % 2 == 0 else 0, 3), float(COMM.rank))
    write_slabs(
        shared_path / "a.h5", COMM, {"rows": rows, "more": rows[:, 0]}, {"names": ["a", "b"]}
    )
    expected = np.repeat(np.arange(0.0, COMM.size, 2), 2)
    assert np.array_equal(read_slab(shared_path / "a.h5", "more"), expected)
    assert np.array_equal(
        read_slab(shared_path / "a.h5", "rows", 1, 2), np.full((1, 3), expected[1])
    )
    with h5py.File(shared_path / "a.h5", "r") as file:
        assert list(file.attrs["names"]) == ["a", "b"]


def test_every_rank_sees_an_error_of_rank_0(shared_path):
    with pytest.raises(PorofsiError, match="could not be written"):
        write_slabs(shared_path / "nowhere" / "a.h5", COMM, {"rows": np.zeros((1000, 3))})
    with pytest.raises(InputError, match="no such file"):
        open_checkpoint(shared_path / "checkpoint.h5", COMM)
    with pytest.raises(InputError, match="lies outside"):
        Probes(local_mesh(0), [("A", [3.0, 0.0])])
    on_root(COMM, (shared_path / "file").touch)
    with pytest.raises(InputError, match="already holds files"):
        Claim(shared_path, False, None, COMM)


def test_history_is_written_once(shared_path):
    history = History(shared_path, ["A.p"], COMM)
    history.append(0.5, [1 / 3], 4)
    history = History.resume(shared_path, ["A.p"], COMM, 0.5)
    history.append(1.0, [2 / 3], 5)
    columns = read_history(shared_path / "history.csv")
    assert np.array_equal(columns["A.p"], [1 / 3, 2 / 3]) and np.array_equal(
        columns["coupling_iterations"], [4, 5]
    )
