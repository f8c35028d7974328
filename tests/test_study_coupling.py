"""The study of the coupling: what it writes, that it goes on, what its bars say, and the load of
its large-strain cases.
"""

import csv
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from porofsi_petsc.commands import cli
from porofsi_petsc.errors import InputError
from porofsi_petsc.fem.geometry import Rule, geometry
from porofsi_petsc.studies import coupling, soil
from porofsi_petsc.studies.bodies import RADIUS, sector
from porofsi_petsc.studies.trial import attempt

CASE = coupling.Case("uniform", "confined", 2, 4, 1, 0.3, "small", "aitken", 1e-2, 1e-3)


def rows_of(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_quick_study_writes_table_summary_and_picture_and_goes_on(tmp_path):
    result = CliRunner().invoke(cli, ["study", "coupling", "--quick", "--output", str(tmp_path)])
    assert result.exit_code == 0, result.output
    rows = rows_of(tmp_path / "coupling.csv")
    assert len(rows) == 4 and all(not row["failure"] and 1 <= int(row["max"]) <= 15 for row in rows)
    assert (
        "| uniform | confined | 2 | small | aitken | 4 | 0 |"
        in (tmp_path / "coupling.md").read_text()
    )
    assert (tmp_path / "coupling.png").stat().st_size > 0
    kept = (tmp_path / "coupling.csv").read_text().splitlines()[:3] + [
        "uniform,confined,2,8"
    ]  # stopped within the third case
    (tmp_path / "coupling.csv").write_text("\n".join(kept))
    again = CliRunner().invoke(cli, ["study", "coupling", "--quick", "--output", str(tmp_path)])
    assert "2 of 4 cases are in" in again.output and len(rows_of(tmp_path / "coupling.csv")) == 4


def test_a_place_that_cannot_hold_the_table_is_refused(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="coupling.csv: could not be written .* --output"):
        coupling.study(tmp_path / "file" / "below", quick=True)


def test_a_file_that_is_no_table_is_refused_and_kept(tmp_path):
    other = b"\x89PNG\xff\x00"
    (tmp_path / "coupling.csv").write_bytes(other)
    with pytest.raises(InputError, match="coupling.csv: .* --force"):
        coupling.study(tmp_path, quick=True)
    assert (tmp_path / "coupling.csv").read_bytes() == other


def test_a_case_that_fails_says_so_and_breaks_its_bar():
    scene = CASE.scene()
    capped = scene.model_copy(
        update={"coupling": scene.coupling.model_copy(update={"max_iterations": 1})}
    )
    outcome = attempt(capped)
    assert (
        outcome.failure.startswith("coupling did not converge")
        and outcome.largest == 0
        and np.isnan(outcome.mean)
    )
    row = {key: str(value) for key, value in CASE.keys.items()} | {
        "mean": "nan",
        "max": "0",
        "failure": outcome.failure,
    }
    report = coupling.report([row])
    assert "| 1 | 1 | nan | 0 | -, 15 | NO |" in report and outcome.failure in report


@pytest.mark.parametrize(("largest", "kept"), [(15, "yes"), (16, "NO")])
def test_the_bar_of_aitken(largest, kept):
    row = {key: str(value) for key, value in CASE.keys.items()} | {
        "mean": "9",
        "max": str(largest),
        "failure": "",
    }
    assert f"| {largest} | -, 15 | {kept} |" in coupling.report([row])


def test_every_case_of_the_study_is_a_scene_of_its_own():
    cases = coupling.all_cases()
    assert len(set(cases)) == len(cases)
    for name, values in (
        ("body", 4),
        ("poisson", 6),
        ("medium", 4),
        ("dim", 2),
        ("order", 2),
        ("strain", 2),
        ("dt", 7),
    ):
        assert len({getattr(case, name) for case in cases}) >= values, name
    for case in cases[:: len(cases) // 40]:
        assert case.scene().time.end == pytest.approx(
            coupling.NUMBER * (case.dt if case.dt != coupling.STATIC else 1.0)
        )


def test_large_strain_cases_end_at_twenty_percent_compression():
    """Loaded on all of its top and drained, the block rests at J = 0.8: the study's load is what it
    says.
    """
    scene = replace(CASE, strain="large", dt=coupling.STATIC, k=1.0).scene()
    load = soil.confined_load("neo_hookean", 0.8)
    whole = [b.model_dump(by_alias=True, exclude_none=True) for b in scene.boundary[:2]]
    whole += [{"on": ["top", "load"], "pressure": 0.0, "traction": {"y": f"-{load!r}*t/6"}}]
    tops = []
    loaded = soil.scene(
        "all of the top",
        soil.mesh(4),
        soil.model(False, True),
        scene.time.model_dump(exclude_none=True),
        [soil.material(1e4, "neo_hookean")],
        whole,
    )
    outcome = attempt(
        loaded,
        lambda coupling: lambda clock, coupling, energy: tops.append(coupling.solid.u[:, 1].min()),
    )
    assert outcome.failure == "" and len(tops) == coupling.NUMBER
    # k = 1e4 m/s: a step is 2e5 times the consolidation time, a step of backward Euler leaves 1/5e5
    # of its pressure
    assert tops[-1] == pytest.approx(-2.0, rel=1e-5)


# -- Poisson's ratio and the body ------------------------------------------------------------------


@pytest.mark.parametrize("dim, cells", [(2, 8), (3, 4)])
@pytest.mark.parametrize("body", coupling.BODIES)
@pytest.mark.parametrize("accelerator, most", [("none", 24), ("aitken", 15), ("iqn_ils", 12)])
def test_the_split_converges_at_a_poisson_ratio_of_zero(body, dim, cells, accelerator, most):
    """Nearly undrained, where the spectrum is widest: the error falls by 1/2 in 3-D, 1/3 in 2-D
    (0.5^20 = 1e-6), or better.
    """
    case = coupling.Case(
        "uniform", body, dim, cells, 1, 0.0, "small", accelerator, 1e-9, coupling.STATIC
    )
    row = coupling.run_case(case)
    assert not row["failure"] and row["max"] <= most, row


def test_a_curved_nearly_incompressible_body_contracts():
    """Volume change in stiffness and in the volume balance at the same points: else the error grows
    by 5.5 in a sweep.
    """
    row = coupling.run_case(
        coupling.Case("uniform", "sphere", 2, 4, 2, 0.4999, "small", "none", 1e-9, coupling.STATIC)
    )
    assert not row["failure"] and row["max"] <= 8, row


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("dim, volume", [(2, np.pi / 4), (3, np.pi / 6)])
def test_the_sector_is_round(dim, volume, order):
    """Chords miss O(h²) of the volume, quadratic arcs less."""
    mesh = sector(6, order, dim)
    surface = np.linalg.norm(mesh.points[np.unique(mesh.facets["surface"])], axis=1)
    assert np.allclose(surface, RADIUS)
    assert set(mesh.facets) == {*"x0 y0 z0".split()[:dim], "surface"}
    rule = Rule.of(mesh.element, 2 * order)
    assert geometry(rule, mesh.points[mesh.cells]).dV.sum() == pytest.approx(
        volume * RADIUS**dim, rel=0.05 if order == 1 else 5e-4
    )
