"""Files of fields: what a written time costs, what a kill leaves of them."""

import os
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import meshio
import numpy as np
import pytest
from mpi4py import MPI
from running import Job, run_here

from porofsi_petsc import load_scene, read_fields
from porofsi_petsc.errors import InputError
from porofsi_petsc.fem.distribute import distribute
from porofsi_petsc.mesh.generate import rectangle
from porofsi_petsc.output import xdmf
from porofsi_petsc.output.fields import FieldWriter, Storage, read_snapshots

COMM = MPI.COMM_SELF
COUNTS = Path("/proc/self/io")
BLOCK = ("mesh.order=1", "mesh.x.cells=[2, 2, 2]", "mesh.y.cells=[3]", "time.end=0.01")


class Killed(BaseException):
    """What stands for SIGKILL."""


def small_mesh(cells=4):
    x, y = (SimpleNamespace(points=[0.0, 1.0], cells=[cells], ratios=[1.0]) for _ in range(2))
    mesh = rectangle(x, y, order=1, diagonal="alternating")
    return distribute(COMM, mesh, np.zeros(len(mesh.points), dtype=int))


def fields_of(mesh, time):
    X = mesh.X[: mesh.n_owned]
    stress = np.stack([time + i * X[:, 0] for i in range(6)], axis=1)
    return {"displacement": time * X, "pressure": time * X[:, 0] / 3, "stress": stress}


def written_by(action):
    """Return the bytes that an action hands to the system for writing."""

    def count():
        return int(COUNTS.read_text().partition("wchar:")[2].split()[0])

    before = count()
    action()
    return count() - before


def times_of(path):
    """Return the times of an XDMF file, which must be complete."""
    return [float(entry.get("Value")) for entry in ElementTree.parse(path).iter("Time")]


@pytest.mark.skipif(not COUNTS.exists(), reason="the system does not count bytes")
def test_a_written_time_costs_the_same_however_many_there_are(tmp_path):
    mesh = small_mesh()
    writer = FieldWriter(tmp_path, mesh)

    def write(steps):
        for step in steps:
            writer.write(step, 0.1 * step, fields_of(mesh, step))

    write(range(2))  # with the first time there is nothing to take over
    first = written_by(lambda: write(range(2, 12)))
    later = written_by(lambda: write(range(12, 112)))
    # Digits of steps and times are what grows.
    assert later / 100 == pytest.approx(first / 10, rel=0.01)
    writer.close()
    assert times_of(tmp_path / "fields.xdmf") == [0.1 * step for step in range(112)]


@pytest.mark.parametrize("call", range(6))
def test_the_collection_is_complete_at_any_moment(tmp_path, monkeypatch, call):
    """A kill before a system call of the second of two further times."""
    path = tmp_path / "fields.xdmf"
    grids = [f'<Grid><Time Value="{time}"/></Grid>\n' for time in range(5)]
    collection = xdmf.Collection(path)
    collection.rewrite(grids[:3])
    collection.append(grids[3])
    calls = []

    def killed(action):
        def counted(*arguments, **options):
            calls.append(action)
            if len(calls) > call:
                raise Killed
            return action(*arguments, **options)

        return counted

    for name in ("link", "replace", "unlink"):
        monkeypatch.setattr(os, name, killed(getattr(os, name)))
    monkeypatch.setattr("builtins.open", killed(open))
    try:
        collection.append(grids[4])
    except Killed:
        monkeypatch.undo()
        assert times_of(path) in ([0, 1, 2, 3], [0, 1, 2, 3, 4])
    else:
        assert call >= 4  # of them there are open, unlink, link and twice replace
    monkeypatch.undo()
    again = xdmf.Collection(path)
    again.rewrite(grids)
    again.close()
    assert times_of(path) == [0, 1, 2, 3, 4] and list(tmp_path.iterdir()) == [path]


def test_a_collection_without_hard_links_or_with_files_removed(tmp_path, monkeypatch):
    def refused(*_):
        raise PermissionError

    monkeypatch.setattr(os, "link", refused)
    path = tmp_path / "fields.xdmf"
    grids = [f'<Grid><Time Value="{time}"/></Grid>\n' for time in range(6)]
    collection = xdmf.Collection(path)
    collection.rewrite([])
    for time, grid in enumerate(grids):
        collection.append(grid)
        assert times_of(path) == list(range(time + 1))
        if time == 3:
            (tmp_path / "fields.xdmf.tmp").unlink()


def test_a_time_that_is_written_twice_is_listed_once(tmp_path):
    mesh = small_mesh()
    writer = FieldWriter(tmp_path, mesh)
    for step in (0, 1, 2, 2, 3):
        writer.write(step, 0.5 * step, fields_of(mesh, step))
    assert times_of(tmp_path / "fields.xdmf") == [0.0, 0.5, 1.0, 1.5]
    assert [s.step for s in writer.snapshots] == [s.step for s in read_snapshots(tmp_path)]


def sizes_of(directory):
    return sum(path.stat().st_size for path in (directory / "fields").glob("0*.h5"))


@pytest.mark.parametrize("precision, tolerance", [("float64", 0.0), ("float32", 2.0**-24)])
@pytest.mark.parametrize("compression", [0, 1])
def test_values_are_kept_to_the_digits_asked_for(tmp_path, precision, tolerance, compression):
    """A float32 has 24 binary digits: rounded, it is off by 2^-24 of the number."""
    mesh = small_mesh()
    writer = FieldWriter(tmp_path, mesh, Storage(precision, compression))
    writer.write(3, 0.1, fields_of(mesh, 0.7))
    writer.close()
    expected = fields_of(mesh, 0.7)
    found = read_fields(tmp_path)
    assert found["t"] == 0.1 and found["points"].dtype == np.float64
    for name, values in expected.items():
        assert found[name].dtype == np.dtype(precision)
        values = values.reshape(len(values), -1)
        read = found[name].reshape(len(values), -1)[:, : values.shape[1]]
        assert (np.abs(read - values) <= tolerance * np.abs(values)).all()
    with meshio.xdmf.TimeSeriesReader(tmp_path / "fields.xdmf") as reader:
        reader.read_points_cells()
        assert np.array_equal(reader.read_data(0)[1]["pressure"], found["pressure"])


def test_float32_takes_half_the_space_and_compression_less(tmp_path):
    mesh = small_mesh(40)
    found = {}
    for storage in (Storage(), Storage("float32"), Storage("float64", 1)):
        folder = tmp_path / f"{storage.precision}-{storage.compression}"
        folder.mkdir()
        FieldWriter(folder, mesh, storage).write(0, 0.0, fields_of(mesh, 0.7))
        found[storage] = sizes_of(folder)
    structure = 4096  # [bytes] of the file beside its data
    values = 10 * mesh.n_global  # a vector with its third component, a scalar and a tensor
    assert 0 < found[Storage()] - 8 * values < structure
    assert 0 < found[Storage("float32")] - 4 * values < structure
    assert found[Storage("float64", 1)] < 0.5 * found[Storage()]


@pytest.mark.parametrize(
    "keys, expected",
    [
        # the block takes 10 steps of 1 ms; 0 and 10 ms are the start and the end
        ("fields_interval=0.003", [0, 3, 6, 9, 10]),
        ("fields_interval=0.0025", [0, 3, 5, 8, 10]),
        ("fields_interval=0.0001", list(range(11))),
        ("fields_times=[0.007, 0.0021, 0.003, 5.0]", [0, 3, 7, 10]),
        ("fields_interval=0.005, fields_every=4, fields_times=[0.006]", [0, 4, 5, 6, 8, 10]),
    ],
)
def test_steps_that_reach_a_time_are_written(tmp_path, petsc, keys, expected):
    run_block(tmp_path / "run", keys)
    assert [snapshot.step for snapshot in read_snapshots(tmp_path / "run")] == expected


def run_block(directory, keys, *overrides, **changes):
    output = f"output={{ {keys.replace('=', ' = ')} }}"
    run_here(Job("pulse2d", str(directory), (*BLOCK, output, *overrides), **changes))


def test_the_fields_asked_for_are_written(tmp_path, petsc):
    run_block(tmp_path, 'fields_every=5, fields=["pressure", "stress"], precision="float32"')
    snapshots = read_snapshots(tmp_path)
    assert [snapshot.shapes.keys() for snapshot in snapshots] == [{"pressure", "stress"}] * 3
    assert {snapshot.precision for snapshot in snapshots} == {4}


def test_a_restart_continues_at_the_times_of_the_whole_run(tmp_path, petsc):
    keys = "fields_interval=0.0025, fields_times=[0.0041], checkpoint_every=4"
    run_block(tmp_path / "whole", keys)
    run_block(tmp_path / "run", keys, "time.end=0.004")
    run_block(tmp_path / "run", keys, restart=str(tmp_path / "run/checkpoint.h5"))
    whole, again = (read_snapshots(tmp_path / name) for name in ("whole", "run"))
    # the end of the first part is a written time too, and stays
    assert [s.step for s in whole] == [0, 3, 5, 8, 10]
    assert [s.step for s in again] == [0, 3, 4, 5, 8, 10]
    for name in ("displacement", "pressure"):
        for time in (0.005, 0.008, 0.01):
            one, other = (read_fields(tmp_path / part, time) for part in ("whole", "run"))
            np.testing.assert_array_equal(one[name], other[name])


@pytest.mark.parametrize(
    "keys, sentence",
    [
        (
            'fields=["heat"], fields_every=1',
            r"\[output.fields.0\]: received .heat., expected",
        ),
        ('fields=["plastic_strain"], fields_every=1', "received 'plastic_strain', which the scene"),
        (
            'fields=["pressure"]',
            r"\[output.fields\]: received \[.pressure.\] without a time",
        ),
        ('precision="float32"', r"\[output.precision\]: received 'float32' without a time"),
        ("fields_interval=0", r"\[output.fields_interval\]: received 0"),
        ("fields_times=[-1.0], fields_every=1", r"\[output.fields_times.0\]: received -1"),
        ("compression=10, fields_every=1", r"\[output.compression\]: received 10"),
        ('fields=["pressure", "pressure"], fields_every=1', "received 'pressure' twice"),
    ],
)
def test_wrong_keys_are_refused(keys, sentence):
    with pytest.raises(InputError, match=sentence):
        load_scene("pulse2d", [f"output={{ {keys.replace('=', ' = ')} }}"])
