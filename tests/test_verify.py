"""`porofsi verify`: short cases pass, a wrong reference is found, the command line tells."""

import json
import sys

import pytest
from running import complete

from porofsi_petsc.errors import InputError
from porofsi_petsc.simulation import verify
from porofsi_petsc.simulation.verify import CASES, OrderCase, SceneCase

SHORT = ("drained_neo_hookean", "drained_ehlers_eipper", "drained_linear_elastic")


def test_the_short_drained_cases_pass(tmp_path):
    checks = verify(SHORT, tmp_path)
    assert {check.case for check in checks} == set(SHORT) and all(
        check.passed for check in checks
    ), checks
    assert (tmp_path / SHORT[0] / "reference.png").stat().st_size > 0


def test_a_wrong_reference_fails(tmp_path, monkeypatch):
    wrong = SceneCase("drained_column", ("reference.load=2.9e6", "mesh.y.cells=[2]"))
    monkeypatch.setitem(CASES, "wrong", wrong)
    displacement, pressure = verify(("wrong",), tmp_path)
    assert not displacement.passed and 0.01 < displacement.error < 0.05  # 3 % less load
    assert pressure.passed


def test_an_order_that_is_missed_fails(tmp_path, monkeypatch):
    """Terzaghi by backward Euler is of first order, not of second."""
    case = CASES["terzaghi_order_dt_euler"]
    levels = tuple((*level, "mesh.y.cells=[8]") for level in case.levels[:2])
    monkeypatch.setitem(
        CASES, "wrong", OrderCase("terzaghi", levels, {"u": (2.0, 1.8), "p": (1.0, 0.8)})
    )
    u, p = verify(("wrong",), tmp_path)
    assert not u.passed and 0.8 < u.computed < 1.1
    assert p.passed


def test_a_case_that_cannot_run_is_a_failed_check(tmp_path, monkeypatch):
    monkeypatch.setitem(CASES, "wrong", SceneCase("drained_column", ("coupling.max_iterations=1",)))
    (check,) = verify(("wrong",), tmp_path)
    assert not check.passed and check.computed is None and "did not converge" in check.note


def test_an_unknown_case_is_refused(tmp_path):
    with pytest.raises(InputError, match="'mandle': .* mandel"):
        verify(("mandle",), tmp_path)


@pytest.mark.parametrize("arguments, code", [(("drained_xie_leo", "--json"), 0), (("mandle",), 2)])
def test_the_command_prints_checks_and_ends_with_their_verdict(tmp_path, arguments, code):
    words = [sys.executable, "-m", "porofsi_petsc", "verify", *arguments, "--output", str(tmp_path)]
    result = complete(words)
    assert result.returncode == code, result.stderr
    if code == 0:
        assert [check["quantity"] for check in json.loads(result.stdout)] == [
            "error.u final",
            "error.p final",
        ]
    else:
        assert "terzaghi" in result.stderr
