"""Steps that follow the local error: the estimate against the exact one, and what a tolerance buys
in a run.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI
from running import Job, history, run_here

from porofsi_petsc import load_scene
from porofsi_petsc.errors import ConvergenceError
from porofsi_petsc.simulation.loop import Clock, TimeLoop
from porofsi_petsc.simulation.step_control import StepControl, StepTooLarge

QUICK = (
    "mesh.y.cells=[12]",
    "time.growth=1.0",
    "output.fields_every=1000",
    "output.checkpoint_every=1000",
)


def control(tolerance, scheme="generalized_alpha", max_step=None, min_step=None, step=0.01):
    section = SimpleNamespace(
        error_tolerance=tolerance, scheme=scheme, max_step=max_step, min_step=min_step, step=step
    )
    return StepControl(section, MPI.COMM_SELF)


def sizes(law, value, dt, end):
    """Return the accepted (end of step, size) of a control that sees value(t)."""
    t = 0.0
    accepted = []
    while t < end:
        try:
            following = law.next_size(
                dt, {"u": (t + dt, value(t + dt)), "p": (t + dt, value(t + dt))}
            )
        except StepTooLarge as rejected:
            dt = rejected.size
            continue
        t = t + dt
        dt = following
        accepted.append((t, dt))
    return np.array(accepted)


@pytest.mark.parametrize(
    "scheme, constant, power", [("backward_euler", 1 / 2, 2), ("generalized_alpha", 1 / 12, 3)]
)
def test_the_step_of_an_exponential_is_the_one_of_its_local_error(scheme, constant, power):
    """y = e^-t: the error C Δt^(k+1) |y| of a step is the tolerance of the largest y = 1, so Δt
    grows like e^(t/(k+1)).
    """
    tolerance = 1e-5
    taken = sizes(control(tolerance, scheme), lambda t: np.array([np.exp(-t)]), 1e-3, 6.0)
    late = taken[taken[:, 0] > 0.5]
    ideal = (tolerance / (constant * np.exp(-late[:, 0]))) ** (1 / power)
    # a step is kept until 1.3 times as large a one would do, is 0.8 of the ideal at first, and the
    # difference looks back
    assert np.all(late[:, 1] < 1.15 * ideal) and np.all(late[:, 1] > 0.4 * ideal)


def test_a_jump_is_passed_with_the_smallest_step():
    law = control(1e-3, min_step=1e-4)
    taken = sizes(law, lambda t: np.array([1.0 + t + (t > 0.5)]), 0.01, 1.0)
    assert law.rejections > 0
    assert taken[:, 1].min() == pytest.approx(1e-4)
    assert taken[-1, 1] > 0.01  # and forgotten afterwards


def test_no_step_is_longer_than_the_largest():
    assert (
        sizes(control(1e-3, max_step=0.02), lambda t: np.array([1.0 + t]), 0.01, 1.0)[:, 1].max()
        == 0.02
    )


def test_no_step_is_lost_in_the_digits_of_the_time():
    """At t = 1e6 s a jump asks for 1e-8 s, which the time cannot count: 1e6 + 1e-8 has the one
    digit that a double leaves.
    """
    clock = Clock(SimpleNamespace(step=0.01, end=2e6))
    clock.t = 1e6
    assert clock.smallest_step == 1e-6
    law = control(1e-3, min_step=1e-8)
    t = clock.t
    dt = 0.01
    taken = []
    while t < clock.t + 0.2:
        try:
            value = np.array([1.0 + (t + dt > clock.t + 0.1)])
            following = law.next_size(
                dt, {"u": (t + dt, value), "p": (t + dt, value)}, clock.smallest_step
            )
        except StepTooLarge as rejected:
            dt = rejected.size
            continue
        taken.append(dt)
        t = t + dt
        dt = following
    assert min(taken) == pytest.approx(1e-6)
    assert abs(1e6 + min(taken) - 1e6 - min(taken)) < 1e-3 * min(taken)


def test_cuts_end_where_the_time_has_no_digits_left():
    """Steps that never converge are halved less often than max_cuts allows: at t = 10 s a step has
    1e-11 s at least.
    """
    scene = load_scene(
        "terzaghi", ("coupling.on_failure='cut_step'", "coupling.max_cuts=30", "expect=[]")
    )
    sizes = []

    def fail(schemes, rates, t, step):
        sizes.append(schemes[1].dt)
        raise ConvergenceError("never")

    coupling = SimpleNamespace(
        step=fail, reset=lambda: None, remedies=(), tried=("step",), load_factor=None
    )
    loop = TimeLoop(scene, coupling, energy=None, measures=None)
    loop.clock.t = 10.0
    loop.clock.nominal = 1e-6
    loop.clock.end = 10.0 + 1e-6
    with pytest.raises(ConvergenceError, match="never"):
        loop.step()
    assert len(sizes) == 17  # 1e-6/2^16 is 1.5e-11, half of it is below
    assert loop.clock.smallest_step <= min(sizes) < 2 * loop.clock.smallest_step


def test_a_tighter_tolerance_gives_a_smaller_error_with_more_steps(tmp_path):
    """The consolidation of a column: the error in time of the second-order scheme falls at least
    like the tolerance^(1/2).
    """
    found = []
    for tolerance in (1e-2, 1e-3, 1e-4):
        directory = tmp_path / str(tolerance)
        summary = run_here(
            Job("terzaghi", str(directory), (*QUICK, f"time.error_tolerance={tolerance}"))
        )
        found.append((summary["steps"], history(directory)["base.p"][-1]))
    reference = run_here(
        Job("terzaghi", str(tmp_path / "fine"), (*QUICK, "time.error_tolerance=1e-6"))
    )["steps"]
    exact = history(tmp_path / "fine")["base.p"][-1]
    errors = [abs(p - exact) / exact for _, p in found]
    print("steps", [steps for steps, _ in found], reference, "errors", errors)
    assert found[0][0] < found[1][0] < found[2][0] < reference
    assert errors[1] < 10**-0.5 * errors[0] and errors[2] < 10**-0.5 * errors[1]


def test_the_smallest_steps_of_a_block_have_no_checkerboard(tmp_path):
    """Where the step shrinks the fluid becomes free and inertia dominates; what stabilizes the
    pressure must not fade with it.
    """
    block = (
        "mesh.order=1",
        "mesh.x.cells=[4, 2, 4]",
        "mesh.y.cells=[6]",
        "time.end=0.01",
        "coupling.tolerance=1e-8",
    )
    summary = run_here(
        Job(
            "pulse2d",
            str(tmp_path / "run"),
            (*block, "time.error_tolerance=1e-3", "time.rho_inf=0.5"),
        )
    )
    steps = np.diff(history(tmp_path / "run")["t"])
    print(
        "steps",
        summary["steps"],
        "smallest",
        steps.min(),
        "oscillation",
        summary["oscillation_indicator"],
    )
    assert steps.min() > 1e-6 and summary["steps"] < 100


def test_rejected_steps_are_counted(tmp_path):
    """A load that comes suddenly in the middle of a quiet run."""
    late = (
        'boundary.2.traction.y="where(t > 5, -1e4, 0)"',
        "reference.times=[6.0]",
        "time.end=6",
        "time.step=0.5",
        "time.error_tolerance=1e-2",
    )
    summary = run_here(Job("terzaghi", str(tmp_path / "run"), (*QUICK, *late)))
    assert summary["steps_rejected"] > 0 and summary["step_cuts"] == 0
    steps = np.diff(history(tmp_path / "run")["t"])
    assert steps.min() < 0.1 * steps.max()
