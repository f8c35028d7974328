"""Files of fields: what a written time costs, what a kill leaves of them."""

import os
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest
from mpi4py import MPI

from porofsi_petsc.fem.distribute import distribute
from porofsi_petsc.mesh.generate import rectangle
from porofsi_petsc.output import xdmf
from porofsi_petsc.output.fields import FieldWriter, read_snapshots

COMM = MPI.COMM_SELF
COUNTS = Path("/proc/self/io")


class Killed(BaseException):
    """What stands for SIGKILL."""


def small_mesh():
    x, y = (SimpleNamespace(points=[0.0, 1.0], cells=[4], ratios=[1.0]) for _ in range(2))
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
