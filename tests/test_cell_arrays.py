"""Coefficients of a material from arrays over the cells of a mesh file."""

import re
from pathlib import Path

import meshio
import numpy as np
import pytest
from mpi4py import MPI
from running import Job, history, run_here
from test_material_fields import column

from porofsi_petsc import Simulation, load_scene
from porofsi_petsc.config import scene_to_toml
from porofsi_petsc.errors import InputError
from porofsi_petsc.mesh.cut import cut_prisms
from porofsi_petsc.mesh.source import Block, Source
from porofsi_petsc.simulation.build import serial_mesh

HEIGHT = 8
ARRAYS = {"E": lambda y: 10 * (1 + y), "k": lambda y: 1 + y, "n": lambda y: 0.4 + 0.1 * y}
FROM_FILE = {
    "solid": {"young": {"cell": "E", "factor": 1e6}, "poisson": 0.2},
    "k": {"cell": "k", "factor": 1e-3},
    "material": {"porosity": {"cell": "n"}},
}
BY_FORMULA = {
    "solid": {"young": "1e7*(1 + y)", "poisson": 0.2},
    "k": "1e-3*(1 + y)",
    "material": {"porosity": "0.4 + 0.1*y"},
}


def write(path, arrays=ARRAYS):
    """Write a column of quadrilaterals, the upper half before the lower one, with arrays."""
    rows = np.arange(HEIGHT)
    rows = np.concatenate([rows[HEIGHT // 2 :], rows[: HEIGHT // 2]])
    y = np.linspace(0.0, 1.0, HEIGHT + 1)
    points = np.column_stack([np.tile([0.0, 0.1], HEIGHT + 1), np.repeat(y, 2)])
    cells = 2 * rows[:, None] + [0, 1, 3, 2]
    centres = (y[rows] + y[rows + 1]) / 2
    data = {name: [f(centres)] for name, f in arrays.items()}
    points = np.pad(points, ((0, 0), (0, 1)))
    meshio.Mesh(points, [("quad", cells)], cell_data=data).write(path)
    return {"kind": "file", "path": str(path), "dim": 2}


def final(scene):
    """Return the last values of the history of a scene."""
    with Simulation.from_scene(scene) as simulation:
        simulation.run()
        return {name: values[-1] for name, values in simulation.history.items()}


@pytest.mark.mpi
@pytest.mark.parametrize("suffix", [".vtu", ".xdmf", ".vtk"])
def test_an_array_of_the_file_is_the_formula_at_the_centres(suffix, tmp_path):
    comm = MPI.COMM_WORLD
    folder = comm.bcast(tmp_path)
    if comm.rank == 0:
        write(folder / f"column{suffix}")
    comm.barrier()
    mesh = {"kind": "file", "path": str(folder / f"column{suffix}"), "dim": 2}
    found, wanted = (final(column(mesh=mesh, **given)) for given in (FROM_FILE, BY_FORMULA))
    assert found["top.u_y"] != 0.0
    for name, value in wanted.items():
        assert found[name] == pytest.approx(value, rel=1e-9, abs=1e-15), name


def test_arrays_that_no_material_asks_for_are_left_in_the_file(tmp_path):
    mesh = write(tmp_path / "column.vtu")
    assert serial_mesh(load_scene(column(mesh=mesh))).values == {}
    given = load_scene(column(mesh=mesh, **FROM_FILE))
    assert sorted(serial_mesh(given).values) == ["E", "k", "n"]
    assert load_scene(_parsed(scene_to_toml(given))) == given


def _parsed(text):
    from porofsi_petsc.output.files import parse_toml

    return parse_toml(text)


def test_a_restart_wants_the_same_values(tmp_path):
    mesh = write(tmp_path / "column.vtu")
    scene = tmp_path / "scene.toml"
    text = scene_to_toml(load_scene(column(mesh=mesh, **FROM_FILE)))
    scene.write_text(text)
    options = ("time.end=2e6", "output.checkpoint_every=1")
    run_here(Job(str(scene), str(tmp_path / "run"), options))
    checkpoint = str(tmp_path / "run" / "checkpoint.h5")
    run_here(Job(str(scene), str(tmp_path / "on"), ("time.end=3e6",), restart=checkpoint))
    assert history(tmp_path / "on")["t"][-1] == 3e6
    write(tmp_path / "column.vtu", ARRAYS | {"k": lambda y: 2 + y})
    with pytest.raises(InputError, match="mesh"):
        run_here(Job(str(scene), str(tmp_path / "other"), ("time.end=3e6",), restart=checkpoint))


def test_what_is_no_array_or_no_coefficient_is_refused(tmp_path):
    mesh = write(tmp_path / "column.vtu", ARRAYS | {"k": lambda y: y - 0.5})
    with pytest.raises(
        InputError, match=re.escape("asks for the array 'K' over the cells, the file has E, k, n")
    ):
        final(column(mesh=mesh, k={"cell": "K"}))
    text = r"\[material.0.permeability.k\]: received -0.4375 at the point \(0.05, 0.0625\)"
    with pytest.raises(InputError, match=text):
        final(column(mesh=mesh, k={"cell": "k"}))
    with pytest.raises(InputError, match="an array of a mesh file with mesh.kind = 'rectangle'"):
        load_scene(column(k={"cell": "k"}))
    with pytest.raises(InputError, match="unknown key 'times'"):
        load_scene(column(mesh=mesh, k={"cell": "k", "times": 2.0}))


def test_the_parts_of_a_cut_cell_have_its_value():
    """A hexagonal prism becomes four wedges."""
    angle = np.arange(6) * np.pi / 3
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    points = np.vstack([np.column_stack([ring, np.full(6, z)]) for z in (0.0, 1.0, 2.0)])
    block = Block("hexa_prism", 3, np.arange(12) + np.array([[0], [6]]))
    source = Source(points, [block], values={"k": [np.array([3.0, 5.0])]})
    cut, _ = cut_prisms(source, Path("prisms"))
    upper = points[cut.blocks[0].data].mean(axis=1)[:, 2] > 1
    assert len(upper) == 8
    assert np.array_equal(cut.values["k"][0], np.where(upper, 5.0, 3.0))
