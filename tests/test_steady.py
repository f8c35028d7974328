"""Steady flows: tangents and steps that nobody chose, stabilization of the flow itself,
continuation along the load.
"""

import json

import numpy as np
import pytest
from free_flow import Flow, solved
from manufactured import x, y
from running import SCENES, Job, run_here
from scipy.optimize import brentq

from porofsi_petsc.errors import ConvergenceError
from porofsi_petsc.output.history import read_history

SCENE = str(SCENES / "free_fluid.toml")
STEADY = (
    "time.scheme=steady",
    "model.fluid_inertia=false",
    "model.solid_inertia=false",
    "time.end=1.0",
    "time.step=1.0",
)
STEADY += (
    "model.moving_mesh=false",
    "coupling.tangent=auto",
    "mesh.order=2",
    "mesh.x.cells=[6]",
    "mesh.y.cells=[6]",
)
LID = (
    "boundary=[{on=['left','right','bottom'], velocity={x=0, y=0}}, {on='top',"
    " velocity={x='16*(x*(1-x))**2', y=0}}]"
)
# a mesh on which the stabilization takes half of the work, which is told elsewhere
COARSE = "limits.stabilization=report"
PROBE = "probe=[{name='a', at=[0.5, 0.5], quantities=['vf_x', 'p']}]"


def driven(folder, viscosity, *options):
    """Run a lid-driven cavity of density 2 and return its summary and history."""
    changes = (*STEADY, LID, PROBE, f"material.0.fluid.viscosity={viscosity}", *options)
    summary = run_here(Job(SCENE, str(folder / "run"), changes, force=True))
    return summary, read_history(folder / "run" / "history.csv")


def test_a_steady_flow_does_not_know_in_how_many_steps_it_was_reached(tmp_path):
    _, once = driven(tmp_path, 0.02, "coupling.tolerance=1e-9")
    summary, thrice = driven(tmp_path, 0.02, "coupling.tolerance=1e-9", "time.step=0.34")
    assert summary["steps"] == 3
    assert (
        thrice["coupling_iterations"][-1] == 0
    )  # the stabilization of the flow is that of the first step already
    assert thrice["a.vf_x"][-1] == pytest.approx(once["a.vf_x"][-1], rel=1e-8)


def test_newton_takes_a_few_iterations_from_rest_to_a_manufactured_flow():
    """Without a word of tangents; the derivative of the stabilization parameters is left out, which
    a few iterations tell.
    """
    flow = Flow(2 * y**2 * (3 - 2 * y) + x * y / 5, 1 - x)
    assert solved(flow, *STEADY, "coupling.max_iterations=8").iterations <= 8


def test_where_newton_fails_from_rest_a_part_of_the_load_leads_to_the_flow(tmp_path):
    """Re = 2000 on a mesh of 6 x 6: the iteration from rest diverges to 1e100, through a part of
    the lid's speed it does not.

    What diverged may leave no mark: neither on the factorization nor on the forces whose round-off
    passes for a balance.
    """
    summary, history = driven(tmp_path, 1e-3, COARSE)
    assert summary["load_parts"] >= 2
    text = (tmp_path / "run" / "run.log").read_text()
    assert text.count("load continuation in") == 1
    # slowly on the known path: a ramp of the lid over ten steps
    ramp = LID.replace("(1-x))**2", "(1-x))**2*t")
    _, slow = driven(tmp_path, 1e-3, COARSE, ramp, "time.step=0.1")
    assert history["a.vf_x"][-1] == pytest.approx(slow["a.vf_x"][-1], rel=1e-4)


def test_where_no_path_leads_to_a_flow_the_run_says_how_far_it_came(tmp_path):
    with pytest.raises(
        ConvergenceError, match=r"; nor does load continuation, beyond 0\.\d+ of the load; "
    ):
        driven(tmp_path, 1e-3, "coupling.max_iterations=7")
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["load_parts"] == 0
    assert read_history(tmp_path / "run" / "history.csv")["t"].tolist() == [
        0.0
    ]  # parts of a load are no results


BLOCK = """
title = "A square pressed together in steps"
mesh.kind = "rectangle"
mesh.order = 2
mesh.x = { points = [0.0, 1.0], cells = [4] }
mesh.y = { points = [0.0, 1.0], cells = [4] }
time = { scheme = "steady", end = 3.0, step = 1.0 }
boundary = [
    { on = "left", displacement = { x = 0.0 } },
    { on = "bottom", displacement = { y = 0.0 } },
    { on = "top", displacement = { y = "-0.05*minimum(t, 2) - 0.06*where(t > 2.5, 1, 0)" } },
    { on = "right" },
]
probe = [{ name = "corner", at = [1.0, 1.0], quantities = ["u_x"] }]

[[material]]
region = "body"
solid = { law = "neo_hookean", young = 1e6, poisson = 0.49, density = 1000.0 }
"""


def test_a_later_step_is_continued_from_the_data_of_the_one_before(tmp_path):
    """Not from none of them: to half of the load would be further from the state before than the
    whole step.

    The homogeneous state in plane strain, l the stretch s along x under 0.84 along y: mu (s - 1/s)
    + lambda ln(0.84 s)/s = 0.
    """
    (tmp_path / "block.toml").write_text(BLOCK)
    summary = run_here(Job(str(tmp_path / "block.toml"), str(tmp_path / "run")))
    assert summary["load_parts"] >= 2
    mu = 1e6 / (2 * 1.49)
    lam = 1e6 * 0.49 / (1.49 * 0.02)
    stretch = brentq(lambda s: mu * (s - 1 / s) + lam * np.log(0.84 * s) / s, 1.0, 1.5)
    assert read_history(tmp_path / "run" / "history.csv")["corner.u_x"][-1] == pytest.approx(
        stretch - 1, rel=1e-6
    )


def test_a_slow_flow_under_a_large_pressure_follows_its_inflow(tmp_path):
    """Air at 1e5 Pa: its flow was within the round-off of such a pressure, and stayed as it was."""
    air = "material.0.fluid={density=1.2, viscosity=1.8e-5}"
    changes = (
        air,
        "model.viscosity=true",
        "model.fluid_inertia=false",
        "time.scheme=steady",
        "time.end=0.1",
        "time.step=0.01",
        "boundary.0.velocity={x='0.001*t', y=0.0}",
        "boundary.1.windkessel={distal=1e3, distal_pressure=101325.0}",
    )
    run_here(Job(str(SCENES / "outlet.toml"), str(tmp_path), changes))
    found = read_history(tmp_path)
    inflow = 0.2 * 0.001 * found["t"][1:]
    # the round-off of 1e5 Pa in the momentum is a flow of 1e-7 m³/s
    assert np.abs(found["right.flow_rate"][1:] - inflow).max() < 2e-7
