"""The study of the hard cases: what counts as kept, the meshes and watches that it makes, and a
sample of it.
"""

import csv
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

from porofsi_petsc.commands import cli
from porofsi_petsc.mesh import read_mesh
from porofsi_petsc.mesh.write import write_mesh
from porofsi_petsc.simulation.build import serial_mesh
from porofsi_petsc.studies import hard_cases, soil, stability
from porofsi_petsc.studies.distortion import angles, distort


def test_quick_study_finishes_one_case_and_sees_one_refused(tmp_path):
    result = CliRunner().invoke(cli, ["study", "stability", "--quick", "--output", str(tmp_path)])
    assert result.exit_code == 0, result.output
    with (tmp_path / "stability.csv").open(newline="") as file:
        finished, refused = csv.DictReader(file)
    assert (finished["kept"], finished["message"], finished["steps"]) == ("yes", "", "50")
    assert refused["kept"] == "yes" and refused["message"].startswith(
        "the pores of the skeleton are closed"
    )
    assert refused["message"] in (tmp_path / "stability.md").read_text()


def test_a_step_that_fails_is_cut_and_counted():
    case = next(case for case in hard_cases.CASES if case.wanted == "cut")
    row = stability.run_case(case, Path("unused"))
    assert row["kept"] == "yes" and row["cuts"] > 0 and row["steps"] > 1


@pytest.mark.parametrize(
    ("wanted", "failure", "cuts", "kept"),
    [
        ("finished", "", 0, "yes"),
        ("finished", "it broke", 0, "NO"),
        ("refused", "", 0, "NO"),
        ("cut", "", 0, "NO"),
        ("cut", "", 1, "yes"),
    ],
)
def test_kept_means_what_is_wanted(monkeypatch, wanted, failure, cuts, kept):
    monkeypatch.setattr(
        stability, "attempt", lambda scene, watcher: stability.Outcome(failure, [3], cuts)
    )
    assert (
        stability.run_case(
            hard_cases.HardCase("a", "b", lambda folder: None, wanted), Path("unused")
        )["kept"]
        == kept
    )


def test_energy_that_is_lost_is_not_kept(monkeypatch):
    monkeypatch.setattr(
        stability,
        "attempt",
        lambda scene, watcher: stability.Outcome(iterations=[3], energy_error=1e-3),
    )
    assert (
        stability.run_case(hard_cases.HardCase("a", "b", lambda folder: None), Path("unused"))[
            "kept"
        ]
        == "NO"
    )


def test_names_of_cases_differ():
    keys = [tuple(case.keys.values()) for case in hard_cases.CASES]
    assert len(set(keys)) == len(keys)


@pytest.mark.parametrize(
    ("growth", "drift", "fine"), [(0, 0, True), (0.01, 0, False), (0, 0.01, False)]
)
def test_endurance_sees_growth_and_drift(growth, drift, fine):
    watch = hard_cases.Endurance()
    look = watch.begin(None)
    for t in np.arange(4000) * 1e-3:
        energy = SimpleNamespace(kinetic=1 + growth * t, elastic=0.0)
        # 10.4 periods to a quarter of the run: their plain mean alone would be a drift of 0.03
        u = np.array([[0.0, np.sin(20.8 * np.pi * t) + drift * t]])
        look(
            None,
            SimpleNamespace(solid=SimpleNamespace(u=u, mesh=SimpleNamespace(n_owned=1))),
            energy,
        )
    assert watch.fine == fine


def test_a_distorted_mesh_keeps_its_boundary_and_angles(tmp_path):
    mesh = serial_mesh(hard_cases.block(mesh=soil.mesh(8))(tmp_path))
    moved = distort(mesh, 5.0)
    found = angles(moved.points, moved.cells)
    # a node stops within a halved step of its limit: of the smallest angle of all that is some
    # hundredths of a degree
    assert 5.0 <= found.min() < 5.1 and np.median(found.min(axis=1)) < 30
    assert np.allclose(found.sum(axis=1), 180.0)
    rim = np.unique(np.concatenate([nodes.ravel() for nodes in mesh.facets.values()]))
    assert np.array_equal(moved.points[rim], mesh.points[rim])


@pytest.mark.parametrize("order", [1, 2])
def test_a_written_mesh_is_read_again(tmp_path, order):
    regions = soil.layers(2)
    materials = [soil.material(1e-2, region=region["name"]) for region in regions]
    mesh = serial_mesh(
        hard_cases.block(mesh=soil.mesh(4, order, regions=regions), materials=materials)(tmp_path)
    )
    write_mesh(tmp_path / "a.msh", mesh)
    again = read_mesh(tmp_path / "a.msh", 2)
    assert np.array_equal(again.points, mesh.points) and again.element == mesh.element
    assert sorted(again.facets) == sorted(mesh.facets)
    for cells, other in (
        (
            a.cells[a.cell_region == a.regions.index(name)],
            b.cells[b.cell_region == b.regions.index(name)],
        )
        for a, b in [(mesh, again)]
        for name in mesh.regions
    ):
        assert np.array_equal(cells, other)
