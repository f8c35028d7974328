"""What a step that does not converge is tried with by default: what is counted and said, and that a
restart goes on alike.
"""

import numpy as np
import pytest
from running import SCENES, Job, run_here, state, summary

from porofsi_petsc.coupling.convergence import Convergence
from porofsi_petsc.coupling.porous import PorousCoupling
from porofsi_petsc.errors import ConvergenceError

COLUMN = (
    "time.end=0.005",
    "time.step=1e-3",
    "time.growth=1.0",
    "coupling.split=plain",
    "coupling.accelerator=none",
)
DN = "coupling.interface=dirichlet_neumann"
CAPPED = (*COLUMN, "coupling.max_iterations=30")  # the plain split diverges without an accelerator


def fall_backs(directory, scene, *overrides):
    """Run a scene and return its summary."""
    return run_here(Job(scene, str(directory), overrides))


def test_another_accelerator_saves_a_step_said_once_and_counted(tmp_path):
    found = fall_backs(tmp_path / "run", "column_harmonic", *CAPPED)
    assert found["fall_backs"] == {"accelerator": 5, "tangents": 0, "gmres": 0}
    assert found["step_cuts"] == 0 and found["steps"] == 5
    assert found["coupling_iterations"]["failed"] == 5 * 30 > found["coupling_iterations"]["total"]
    text = (tmp_path / "run/run.log").read_text()
    assert text.count("solved with another accelerator (said once, counted in summary.json)") == 1


def test_a_restart_after_a_fall_back_goes_on_alike(tmp_path):
    whole, first, second = (str(tmp_path / name) for name in ("whole", "first", "second"))
    run_here(Job("column_harmonic", whole, (*CAPPED, "output.checkpoint_every=5")))
    run_here(
        Job("column_harmonic", first, (*CAPPED, "output.checkpoint_every=3", "time.end=0.003"))
    )
    run_here(
        Job(
            "column_harmonic",
            second,
            (*CAPPED, "output.checkpoint_every=5"),
            restart=f"{first}/checkpoint.h5",
        )
    )
    ends = [state(tmp_path / name / "checkpoint.h5") for name in ("whole", "second")]
    assert ends[0].keys() == ends[1].keys()
    assert all(np.array_equal(ends[0][name], ends[1][name]) for name in ends[0])
    assert summary(tmp_path / "second")["coupling_iterations"]["failed"] == 5 * 30
    assert summary(tmp_path / "second")["fall_backs"] == {
        "accelerator": 5,
        "tangents": 0,
        "gmres": 0,
    }


def test_new_tangents_save_a_step_that_no_accelerator_does(tmp_path, monkeypatch):
    """Lagged tangents are made to fail in one step; it ends where a run with full Newton does."""
    step = PorousCoupling.step

    def failing(self, schemes, rates, t, number):
        if number == 3 and self._travel is None:
            raise ConvergenceError("made to fail")
        step(self, schemes, rates, t, number)

    scene = (
        "time.end=0.05",
        "reference.times=[]",
        "output.checkpoint_every=100",
        "coupling.tolerance=1e-9",
    )
    run_here(Job("xie_leo", str(tmp_path / "newton"), (*scene, "coupling.tangent=newton")))
    monkeypatch.setattr(PorousCoupling, "step", failing)
    found = fall_backs(tmp_path / "run", "xie_leo", *scene)
    assert (
        found["fall_backs"] == {"accelerator": 0, "tangents": 1, "gmres": 0}
        and found["step_cuts"] == 0
    )
    ends = [state(tmp_path / name / "checkpoint.h5")["solid.u"] for name in ("run", "newton")]
    assert (
        np.abs(ends[0] - ends[1]).max() < 1e-6 * np.abs(ends[1]).max()
    )  # the tolerance times the condition of a step


@pytest.mark.parametrize(
    "given, expected",
    [
        (
            ("coupling.on_failure=stop",),
            'try a smaller step, coupling.accelerator = "iqn_ils" or coupling.scheme = "direct"',
        ),
        (
            ("coupling.on_failure=cut_step",),
            'coupling.accelerator = "iqn_ils" or coupling.scheme = "direct"',
        ),
        ((), 'try coupling.scheme = "direct"'),
    ],
)
def test_the_advice_names_neither_what_is_set_nor_what_was_tried(tmp_path, given, expected):
    """Two sweeps are too few for any accelerator."""
    never = (*COLUMN, "coupling.max_iterations=2", "coupling.max_cuts=1", *given)
    with pytest.raises(ConvergenceError) as error:
        fall_backs(tmp_path / "run", "column_harmonic", *never)
    assert error.value.advice.endswith(expected), error.value.advice
    assert summary(tmp_path / "run")["step_cuts"] == (
        0 if "coupling.on_failure=stop" in given else 1
    )


def test_iterates_that_diverge_do_not_let_the_next_attempt_pass():
    """Their forces, 1e15 times the load, are no scale of round-off."""
    convergence = Convergence(1e-6)
    quiet = (0.0, 0.0)

    def reached(force, residual):
        norms = {"fluid momentum": quiet, "volume": quiet, "solid momentum": (residual, force)}
        return convergence.reached(norms, 0.0, {})

    convergence.start_step()
    assert not reached(1.0, 1.0) and not reached(1e15, 1e15)
    convergence.start_step()
    assert not reached(1.0, 1.0) and not reached(1.0, 1e-3) and reached(1.0, 1e-7)


def test_sweeps_over_an_interface_fall_back_too(tmp_path):
    """Dirichlet-Neumann without relaxation under a fluid as heavy as the flap inverts elements of
    the mesh.
    """
    found = fall_backs(
        tmp_path / "run",
        str(SCENES / "flap.toml"),
        "coupling.accelerator=none",
        "time.end=0.02",
        DN,
    )
    assert (
        found["fall_backs"]["accelerator"] == found["steps"]
        and found["step_cuts"] == 0
        and found["exit_code"] == 0
    )
