"""fields.vtkhdf: the structure that the format asks for, what VTK reads of it, kills, restarts."""

import os
import resource
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest
from mpi4py import MPI
from running import ROOT, Job, run_here, state
from test_output_fields import BLOCK, COUNTS, Killed, fields_of, small_mesh, written_by
from test_output_mesh import ELEMENTS, local_mesh, serial_mesh

from porofsi_petsc import load_scene, read_fields
from porofsi_petsc.errors import InputError, PorofsiError
from porofsi_petsc.output import appending, figures
from porofsi_petsc.output.fields import FieldWriter, Storage
from porofsi_petsc.output.files import parse_toml
from porofsi_petsc.output.info import describe
from porofsi_petsc.output.snapshots import read_snapshots
from porofsi_petsc.output.vtkhdf import VtkhdfWriter

COMM = MPI.COMM_SELF
SHIPPED = ROOT / "configs"
# VTK's number of each cell: vtkCellType.h
NUMBER = {"T3": 5, "T6": 22, "Q4": 9, "Q8": 23, "Q9": 28}
NUMBER |= {"T4": 10, "T10": 24, "H8": 12, "H20": 25, "H27": 29}
VTK_ORDER = [0, 3, 5, 1, 4, 2]  # XX YY ZZ XY YZ XZ in xx xy xz yy yz zz


def write(directory, mesh, steps, storage=None):
    writer = VtkhdfWriter(directory, mesh, *([storage] if storage else []))
    for step in steps:
        writer.write(step, 0.1 * step, fields_of(mesh, step))
    return writer


def require_fields(directory, mesh, steps):
    """Look at every value of every time."""
    snapshots = read_snapshots(directory)
    assert [snapshot.step for snapshot in snapshots] == list(steps)
    for snapshot in snapshots:
        assert snapshot.time == 0.1 * snapshot.step
        for name, values in fields_of(mesh, snapshot.step).items():
            values = values.reshape(mesh.n_global, -1)
            read = snapshot.read(name).reshape(mesh.n_global, -1)
            assert np.array_equal(read[:, : values.shape[1]], values)


@pytest.mark.parametrize("name", ELEMENTS)
def test_the_structure_is_that_of_the_format(name, tmp_path):
    """VTKHDF 2.0, unstructured grid with times whose mesh does not change."""
    mesh = local_mesh(name)
    write(tmp_path, mesh, range(3))
    N, (E, A) = mesh.n_global, mesh.cells.shape
    with h5py.File(tmp_path / "fields.vtkhdf") as file:
        group = file["VTKHDF"]
        assert list(group.attrs["Version"]) == [2, 0]
        assert group.attrs["Type"] == b"UnstructuredGrid"
        kind = group.attrs.get_id("Type").get_type()
        assert not kind.is_variable_str() and kind.get_size() == len("UnstructuredGrid")
        sizes = {"Points": N, "Cells": E, "ConnectivityIds": E * A}
        assert {n: list(group[f"NumberOf{n}"]) for n in sizes} == {n: [sizes[n]] for n in sizes}
        assert group["Points"].shape == (N, 3)
        assert np.array_equal(group["Connectivity"], serial_mesh(name).cells.ravel())
        assert np.array_equal(group["Offsets"], np.arange(E + 1) * A)
        assert set(group["Types"]) == {NUMBER[name]} and group["Types"].dtype == np.uint8
        steps = group["Steps"]
        assert steps.attrs["NSteps"] == 3 and np.array_equal(steps["Values"], [0.0, 0.1, 0.2])
        assert list(steps["NumberOfParts"]) == [1, 1, 1]
        for key in ("PartOffsets", "PointOffsets", "CellDataOffsets/region"):
            assert list(steps[key]) == [0, 0, 0]
        for key in ("CellOffsets", "ConnectivityIdOffsets"):
            assert steps[key].shape == (3, 1) and not steps[key][()].any()
        for step, first in enumerate(steps["PointDataOffsets/stress"]):
            stress = group["PointData/stress"][first : first + N]
            assert np.array_equal(stress, fields_of(mesh, step)["stress"][:, VTK_ORDER])
    require_fields(tmp_path, mesh, range(3))


@pytest.mark.parametrize("name", ELEMENTS)
def test_vtk_reads_every_time(name, tmp_path):
    vtk = pytest.importorskip("vtk")
    to_numpy = pytest.importorskip("vtk.util.numpy_support").vtk_to_numpy
    mesh = local_mesh(name)
    write(tmp_path, mesh, range(4), Storage("float64", 1))
    reader = vtk.vtkHDFReader()
    reader.SetFileName(str(tmp_path / "fields.vtkhdf"))
    reader.UpdateInformation()
    pipeline = vtk.vtkStreamingDemandDrivenPipeline
    times = reader.GetOutputInformation(0).Get(pipeline.TIME_STEPS())
    assert np.array_equal(times, [0.1 * step for step in range(4)])
    for step in (2, 0, 3):
        reader.UpdateTimeStep(times[step])
        grid = reader.GetOutput()
        assert grid.GetNumberOfCells() == len(mesh.cells)
        assert grid.GetCellType(0) == NUMBER[name]
        points = to_numpy(grid.GetPoints().GetData())
        assert np.array_equal(points[:, : mesh.dim], serial_mesh(name).points)
        cells = to_numpy(grid.GetCells().GetConnectivityArray())
        assert np.array_equal(cells, serial_mesh(name).cells.ravel())
        for key, values in fields_of(mesh, step).items():
            values = values.reshape(mesh.n_global, -1)
            read = to_numpy(grid.GetPointData().GetArray(key)).reshape(mesh.n_global, -1)
            expected = values[:, VTK_ORDER] if key == "stress" else values
            assert np.array_equal(read[:, : values.shape[1]], expected)
        region = to_numpy(grid.GetCellData().GetArray("region"))
        assert np.array_equal(region, serial_mesh(name).cell_region)


@pytest.mark.skipif(not COUNTS.exists(), reason="the system does not count bytes")
def test_a_time_costs_the_same_however_many_there_are(tmp_path):
    mesh = small_mesh()
    writer = write(tmp_path, mesh, range(2))

    def further(steps):
        for step in steps:
            writer.write(step, 0.1 * step, fields_of(mesh, step))

    first = written_by(lambda: further(range(2, 12)))
    later = written_by(lambda: further(range(12, 112)))
    # Nodes of HDF5's trees of chunks are split now and then, and the trees grow a level.
    assert later / 100 == pytest.approx(first / 10, rel=0.15)


def test_a_kill_at_any_moment_leaves_the_times_before_or_one_more(tmp_path, monkeypatch):
    """Before each system call with which a time is added or the file is cut."""
    mesh = small_mesh()
    (tmp_path / "before").mkdir()
    write(tmp_path / "before", mesh, range(3))
    for action, after in {"added": 4, "cut": 2}.items():
        for call in range(200):
            folder = tmp_path / f"{action}-{call}"
            shutil.copytree(tmp_path / "before", folder)
            if not killed(monkeypatch, VtkhdfWriter(folder, mesh), action, mesh, call):
                break
            if not (folder / "fields.vtkhdf.journal").is_file():
                assert len(read_snapshots(folder)) in (3, after)
            number = len(VtkhdfWriter(folder, mesh).snapshots)
            assert number in (3, after)
            require_fields(folder, mesh, range(number))
            left = {"fields.vtkhdf", "fields.vtkhdf.journal.tmp"}  # the next journal replaces it
            assert {path.name for path in folder.iterdir()} <= left
        assert call > 5  # data, journal, its name, the changes, the end of the journal
    again = VtkhdfWriter(folder, mesh)
    again.truncate(0.1)
    again.write(2, 0.2, fields_of(mesh, 2))
    require_fields(folder, mesh, range(3))


def killed(monkeypatch, writer, action, mesh, call):
    """Return whether an action ends before a system call of some number."""
    calls = []

    def dying(original):
        def counted(*arguments, **options):
            calls.append(1)
            if len(calls) > call:
                raise Killed
            return original(*arguments, **options)

        return counted

    class DyingFile:
        """A file of the changes, each of which is a call."""

        def __init__(self, *arguments):
            self._file = open(*arguments)
            self.seek = self._file.seek
            self.write = dying(self._file.write)
            self.truncate = dying(self._file.truncate)

        def __enter__(self):
            return self

        def __exit__(self, *_):
            self._file.close()

    try:
        with monkeypatch.context() as patched:
            patched.setattr(appending, "open", DyingFile, raising=False)
            for name in ("fsync", "replace", "unlink"):
                patched.setattr(os, name, dying(getattr(os, name)))
            if action == "cut":
                writer.truncate(0.1)
            else:
                writer.write(3, 0.1 * 3, fields_of(mesh, 3))
    except Killed:
        return True
    return False


def test_a_full_disk_leaves_the_file_as_it_was(tmp_path):
    mesh = small_mesh(20)
    writer = write(tmp_path, mesh, range(2))
    path = tmp_path / "fields.vtkhdf"
    before = path.read_bytes()
    _, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(before) + 2000, hard))
    try:
        with pytest.raises(PorofsiError, match="fields.vtkhdf: could not be written"):
            writer.write(2, 0.2, fields_of(mesh, 2))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))
    assert path.read_bytes() == before
    writer.write(2, 0.2, fields_of(mesh, 2))
    require_fields(tmp_path, mesh, range(3))


def test_space_that_was_cut_off_is_free_again(tmp_path):
    mesh = small_mesh(20)
    writer = write(tmp_path, mesh, range(15))
    path = tmp_path / "fields.vtkhdf"
    whole = path.stat().st_size
    for _ in range(2):
        writer.truncate(0.35)
        assert path.stat().st_size < whole / 2
        for step in range(4, 15):
            writer.write(step, 0.1 * step, fields_of(mesh, step))
    assert path.stat().st_size < 1.05 * whole
    require_fields(tmp_path, mesh, range(15))


def run_block(directory, keys, *overrides, **changes):
    output = f"output={{ {keys}, checkpoint_every = 4 }}"
    run_here(Job("pulse2d", str(directory), (*BLOCK, output, *overrides), **changes))


VTKHDF = 'fields_every = 2, format = "vtkhdf"'


@pytest.fixture(scope="module")
def whole(tmp_path_factory, petsc):
    """Return the directory of a run that wrote a VTKHDF file."""
    directory = tmp_path_factory.mktemp("whole") / "run"
    run_block(directory, VTKHDF)
    return directory


def test_both_formats_have_the_same_fields(whole, tmp_path):
    run_block(tmp_path, "fields_every = 2")
    one, other = (read_snapshots(directory) for directory in (whole, tmp_path))
    assert [s.step for s in one] == [s.step for s in other] == [0, 2, 4, 6, 8, 10]
    for time in (0.004, None):
        found, expected = (read_fields(directory, time) for directory in (whole, tmp_path))
        assert found.keys() == expected.keys()
        assert all(np.array_equal(found[name], expected[name]) for name in found)


def test_figures_and_info_are_made_of_it(whole, monkeypatch):
    monkeypatch.setattr(figures, "DPI", 10)
    assert {"pressure.png", "displacement.png"} <= {p.name for p in figures.make_figures(whole)}
    assert f"fields {whole / 'fields.vtkhdf'}" in describe(whole) and "times  6," in describe(whole)


def test_a_restart_continues_the_file_identically(whole, tmp_path):
    run_block(tmp_path, VTKHDF, "time.end=0.006")
    run_block(tmp_path, VTKHDF, restart=str(Path(tmp_path) / "checkpoint.previous.h5"))
    one, other = (datasets(directory / "fields.vtkhdf") for directory in (tmp_path, whole))
    assert one.keys() == other.keys()
    assert [name for name in other if not np.array_equal(one[name], other[name])] == []
    found, expected = (state(directory / "checkpoint.h5") for directory in (tmp_path, whole))
    assert all(np.array_equal(found[name], expected[name]) for name in expected)


def datasets(path):
    found = {}
    with h5py.File(path) as file:
        file.visititems(
            lambda name, item: (
                found.update({name: item[()]}) if isinstance(item, h5py.Dataset) else None
            )
        )
    return found


@pytest.mark.parametrize(
    "keys, sentence",
    [
        (
            "fields_every = 2",
            "fields.vtkhdf: the run has written its fields there",
        ),
        (f'{VTKHDF}, fields = ["pressure"]', "received pressure of 8 bytes; a VTKHDF file has the"),
        (f'{VTKHDF}, precision = "float32"', "porosity of 4 bytes; a VTKHDF file has the same"),
    ],
)
def test_a_restart_with_another_file_is_refused(tmp_path, petsc, keys, sentence):
    run_block(tmp_path, VTKHDF, "time.end=0.004")
    with pytest.raises(InputError, match=sentence):
        run_block(tmp_path, keys, restart=str(tmp_path / "checkpoint.h5"))


def test_xdmf_is_not_continued_by_it(tmp_path):
    mesh = small_mesh()
    FieldWriter(tmp_path, mesh).close()
    with pytest.raises(InputError, match="fields.xdmf: the run has written its fields there"):
        VtkhdfWriter(tmp_path, mesh)


def test_a_file_of_another_mesh_is_refused(tmp_path):
    write(tmp_path, small_mesh(), range(2))
    with pytest.raises(InputError, match="fields.vtkhdf: belongs to another mesh"):
        VtkhdfWriter(tmp_path, small_mesh(5))


def test_a_field_of_some_stages_only_is_refused():
    """With the top layer the one plastic law is taken away."""
    scene = parse_toml((SHIPPED / "dry_fill.toml").read_text(encoding="utf-8"))
    clay, fill = scene["material"]
    fill |= {name: clay[name] for name in ("porosity", "fluid", "permeability")}
    plastic = {"law": "drucker_prager", "friction_angle": 20.0, "cohesion": 2e4}
    fill["solid"] = clay["solid"] | plastic | {"dilatancy_angle": 0.0, "match": "plane_strain"}
    scene["stage"] = [{"name": "dig", "time": {"end": 30.0}, "inactive": ["fill"]}]
    scene["probe"], scene["expect"] = [], []
    scene["output"] = {"fields_every": 50}
    load_scene(scene)
    scene["output"]["format"] = "vtkhdf"
    with pytest.raises(InputError, match=r"\[output.format\]: received 'vtkhdf', whose fields are"):
        load_scene(scene)
    scene["output"]["fields"] = ["displacement", "pressure"]
    load_scene(scene)
