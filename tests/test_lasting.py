"""Inertia that is left out counts where it lasts, not in the steps around a jump of the load."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from running import Job, run_here, summary

from porofsi_petsc.errors import LimitError
from porofsi_petsc.simulation.lasting import STEPS, Lasting

COARSE = ("mesh.x.cells=[2, 3, 4]", "mesh.y.cells=[4, 3, 2]", "limits.reynolds=report")
# A plate that jumps; one under a force that jumps rings by -ρ∞ a step, and its velocity with it.
PLATE = ("boundary.3={on='top', displacement={y=-2e-4}}",)
JUMPS = {"terzaghi": (2e-3, ()), "mandel": (1e-3, PLATE), "strip_footing": (0.01, COARSE)}


def over_the_run(sizes, dt=1.0, end=None):
    """Return what `Lasting` returns after every step of size dt, and how long its trail was at
    most.
    """
    end = end or len(sizes) * dt
    lasting, clock, found, length = Lasting(end), SimpleNamespace(t=0.0, step=0), [], 0
    for size in sizes:
        clock.t, clock.step = clock.t + dt, clock.step + 1
        clock.finished = clock.t >= end - 1e-9
        again = Lasting(end)
        again.load(json.loads(json.dumps(lasting.state())))  # as a restart between two steps has it
        lasting = again
        found.append(lasting.add(size, dt, clock))
        length = max(length, len(lasting.state()["trail"]))
    return found, length


@pytest.mark.parametrize("end, window", [(90.0, 5), (2000.0, 20)])
def test_it_is_the_least_of_the_last_steps(end, window):
    """Five of them, or twenty where these are one hundredth of the run; none falls by more than a
    fifth.
    """
    sizes = (1 + 0.2 * np.random.default_rng(1).uniform(size=90)).tolist()
    found, _ = over_the_run(sizes, end=end)
    assert found == [min(sizes[n - window : n]) if n >= window else 0.0 for n in range(1, 91)]


def test_steps_in_which_it_fades_are_passed_over():
    fading = [1e4 * 0.75**n for n in range(60)]
    assert max(over_the_run(fading)[0]) == 0.0
    assert over_the_run([*fading, *[0.5] * 4])[0][-2:] == [0.0, 0.5]  # with the first of all
    assert max(over_the_run([0.9e4, 1.1e4, 1.2e4, *fading])[0]) == 0.0  # four before it fades


def test_a_run_of_few_steps_has_the_least_of_all_unless_it_fades():
    assert over_the_run([2.0, 1.9, 3.0])[0] == [0.0, 0.0, 1.9]
    assert (
        over_the_run([2.0, 1.0, 3.0])[0] == over_the_run([2.0, 2.0])[0] + [0.0] == [0.0, 0.0, 0.0]
    )


@pytest.mark.parametrize("sizes", [np.linspace(1, 0.9, 500), np.linspace(0.9, 1, 500)])
def test_the_trail_keeps_only_what_may_still_count(sizes):
    assert over_the_run(sizes.tolist())[1] <= STEPS + 1


@pytest.mark.parametrize("scene", JUMPS)
@pytest.mark.parametrize("factor, rho_inf", [(1, 0.0), (10, 0.0), (1, 0.5), (10, 0.5)])
def test_a_sudden_load_is_answered_without_inertia_and_without_a_limit(
    tmp_path, scene, factor, rho_inf
):
    """The steps shipped and ten times shorter ones: at the jump the measure is up to 2e4,
    afterwards it falls below 0.1.
    """
    step, coarse = JUMPS[scene]
    short = (
        f"time.step={step / factor}",
        f"time.rho_inf={rho_inf}",
        f"time.end={15 * step}",
        "reference.times=[]",
    )
    done = run_here(Job(scene, str(tmp_path / "run"), (*short, *coarse)))
    assert done["exit_code"] == 0 and done["neglected"]["fluid_inertia"]["bound"] == 0.1
    assert done["neglected"]["fluid_inertia"]["value"] < 0.1


def test_a_load_that_is_too_fast_throughout_is_told_within_the_run(tmp_path):
    """Waves over the seabed in the exact solution without inertia, which the scene asks for by its
    "report".
    """
    with pytest.raises(
        LimitError,
        match=r"inertia: at t = \d+(\.\d+)? s the term left out reached 0\.\d+ > 0.1 .*it lasts",
    ):
        run_here(Job("seabed", str(tmp_path / "run"), ("limits.inertia=0.1", "reference.times=[]")))
    assert summary(tmp_path / "run")["steps"] <= 10


def test_one_fast_event_in_a_long_quiet_run_is_told(tmp_path):
    """A sudden load, then a pulse of 0.1 s in 50 steps, one twentieth of the run."""
    pulse = "where(t > 1, where(t < 1.1, sin(10*pi*(t - 1))**2, 0), 0)"
    load = f'boundary.2.traction={{ y = "-1e4*(0.1 + {pulse})" }}'
    still = (
        "model.solid_inertia=false",
        "model.fluid_inertia=false",
        "time.end=2.0",
        "time.step=2e-3",
        "time.max_step=2e-3",
    )
    with pytest.raises(LimitError, match=r"inertia: at t = 1\.0"):
        run_here(Job("column_step", str(tmp_path / "run"), (load, *still)))
