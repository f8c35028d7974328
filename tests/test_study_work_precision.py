"""The study of work against error: its settings, its errors, the front and the recommendation."""

import csv
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner
from running import Job, run_here

from porofsi_petsc.commands import cli
from porofsi_petsc.config.catalogue import find_scene
from porofsi_petsc.errors import InputError
from porofsi_petsc.studies import samples, work_precision
from porofsi_petsc.studies.work_precision import Case, Setting, pareto, recommendation

SHORT = ("time.end=0.005", "reference.times=[0.0025]")


def test_study_of_a_scene_with_an_exact_solution(tmp_path, monkeypatch):
    monkeypatch.setattr(work_precision, "TOLERANCES", (1e-4, 1e-6))
    words = ["--cells", "0.5", "--steps", "2", "--error", "0.5", "--output", str(tmp_path)]
    words += [word for text in SHORT for word in ("--set", text)]
    result = CliRunner().invoke(cli, ["study", "work-precision", "terzaghi", *words])
    assert result.exit_code == 0, result.output
    assert "For an error of 0.5: P" in result.output
    with (tmp_path / "work_precision_terzaghi.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert {(row["order"], row["scheme"]) for row in rows} >= {
        ("1", "partitioned"),
        ("2", "partitioned"),
        ("2", "direct"),
    }
    text = (tmp_path / "work_precision_terzaghi.md").read_text()
    assert "**For an error of 0.5" in text
    assert (
        "--error 0.5 --set time.end=0.005 --set 'reference.times=[0.0025]' --cells 0.5 --steps 2\n"
        in text
    )
    assert (tmp_path / "work_precision_terzaghi.png").stat().st_size > 0


def test_errors_are_those_of_the_run(tmp_path):
    setting = Setting(2, 1.0, 1.0, 1e-6)
    row = work_precision.run_case(Case("terzaghi", SHORT, setting), samples.Errors)
    errors = run_here(Job("terzaghi", str(tmp_path / "run"), SHORT))["errors"]
    assert row["failure"] == "" and row["error_u"] == max(record["u"] for record in errors)
    assert row["error"] == max(row["error_u"], row["error_p"] or 0.0)


def test_without_exact_solution_the_finest_run_is_the_reference(tmp_path, monkeypatch):
    monkeypatch.setattr(work_precision, "TOLERANCES", (1e-6,))
    shipped = find_scene("terzaghi").read_text()
    (tmp_path / "plain.toml").write_text(shipped[: shipped.index("[reference]")])
    scene = str(tmp_path / "plain.toml")
    changes = ("time.end=1.0", "time.step=0.1")
    rows = work_precision.study(
        scene, tmp_path, changes, cells=(0.5,), steps=(2.0, 1.0), say=lambda line: None
    )
    errors = {
        row["step"]: float(row["error"])
        for row in rows
        if (row["order"], row["accelerator"]) == ("2", "iqn_ils")
    }
    # backward Euler is of first order, the reference has half the smaller step: (2 - 1/2)/(1 - 1/2)
    # = 3, as it grows less
    assert 1.5 < errors["2"] / errors["1"] < 4


def test_settings_change_cells_and_steps_but_not_the_width_of_a_column():
    scene = work_precision.base_scene("terzaghi", ())
    finer = Case("terzaghi", (), Setting(1, 2.0, 0.5, 1e-4, "direct")).load()
    assert (
        finer.mesh.x.cells == (1,)
        and finer.mesh.y.cells == (2 * scene.mesh.y.cells[0],)
        and finer.mesh.order == 1
    )
    # two steps of half the size grow by what one of the scene does
    assert (
        finer.time.growth**2 == pytest.approx(scene.time.growth)
        and finer.time.step == scene.time.step / 2
    )
    assert (finer.coupling.scheme, finer.coupling.tolerance, finer.expect) == ("direct", 1e-4, ())


def test_bounds_of_what_is_left_out_do_not_end_a_run():
    tight = ("limits.mesh_displacement=1e-12", "limits.strain=1e-12")
    row = work_precision.run_case(
        Case("terzaghi", (*SHORT, *tight), Setting(1, 0.5, 2.0, 1e-4)), samples.Errors
    )
    assert row["failure"] == ""
    limits = work_precision.base_scene("terzaghi", (*tight, "model.moving_mesh=auto")).limits
    assert (limits.strain, limits.mesh_displacement) == ("report", 1e-12)


def test_a_mesh_file_is_refused():
    with pytest.raises(InputError, match="expected a generated mesh"):
        work_precision.base_scene("pulse2d_gmsh", ())


def test_samples_are_linear_between_steps(monkeypatch):
    def state(t):
        return SimpleNamespace(
            solid=SimpleNamespace(mesh=None, u=np.array([[t, 0.0]])),
            fluid=SimpleNamespace(p=np.array([2 * t])),
        )

    monkeypatch.setattr(samples, "Probes", lambda *_: SimpleNamespace(evaluate=lambda rows: rows))
    times = [0.25, 0.5, 1.0]
    run = samples.Samples(np.zeros((1, 2)), times)
    look = run.begin(state(0.0))
    for t in (0.2, 0.6, 1.0):
        look(SimpleNamespace(t=t), state(t), None)
    assert np.allclose(np.array(run.values)[:, 0, 0], times, rtol=1e-14)


def row(error, seconds):
    return Setting(1, 1.0, 1.0, 1e-6).__dict__ | {
        "error": str(error) if error else "",
        "seconds": str(seconds),
    }


def test_front_and_recommendation():
    rows = [row(0.1, 1), row(0.2, 2), row(0.01, 3), row(0.02, 2.5), row(None, 0.1), row(0.05, 4)]
    assert [(r["error"], r["seconds"]) for r in pareto(rows)] == [
        ("0.1", "1"),
        ("0.02", "2.5"),
        ("0.01", "3"),
    ]
    assert recommendation(rows, 0.03).endswith("it reached 0.02 in 2.5 s.")
    assert recommendation(rows, 1e-3).startswith(
        "No run reached an error of 0.001; the most exact is P1"
    )
    assert recommendation([row(None, 1)], 1) == "No run finished."


@pytest.mark.parametrize(
    "option, text",
    [("--cells", "1,-2"), ("--cells", "nan"), ("--steps", "1,inf"), ("--error", "nan")],
)
def test_factors_and_error_must_be_positive(option, text):
    result = CliRunner().invoke(cli, ["study", "work-precision", "terzaghi", option, text])
    assert result.exit_code == 2 and f"received '{text}', expected" in result.output
