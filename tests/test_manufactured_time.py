"""Orders of convergence in time: fields affine in space, which quadratic elements represent, so
that only time errs.
"""

import numpy as np
import pytest
import sympy as sp
from manufactured import (
    SCENE,
    Fields,
    Manufactured,
    errors,
    fluid_alone,
    l2_error,
    medium,
    orders,
    t,
    x,
    y,
)

from porofsi_petsc import load_scene

FIELDS = Fields(
    u=(
        (sp.sin(3 * t) + t) * x / 10 + sp.sin(2 * t) * y / 12,
        sp.cos(2 * t) * x / 15 - (sp.sin(2 * t) + t) * y / 8,
    ),
    psi=(sp.cos(3 * t) * x * y + sp.sin(2 * t) * (x**2 - y**2) / 4) / 3,
    p=(1 + sp.sin(4 * t)) * (1 + x / 2 - y / 3),
)
# One element and fields that it holds exactly; the undrained term is an error in space, which does
# not fade with the step.
ELEMENT = ("mesh.order=2", "mesh.x.cells=[1]", "mesh.y.cells=[1]", "stabilization.undrained=false")
COMMON = (*ELEMENT, "time.end=0.5")
COUPLING = ("coupling.scheme=direct", "coupling.tolerance=1e-9")
QUASI_STATIC = ("model.solid_inertia=false", "model.fluid_inertia=false")
STEPS = (0.025, 0.0125)
# between these steps, at least 30 to the shortest period, the leading term is not alone yet
SLACK = 0.25


def scenes(*options, steps=STEPS):
    """Return the scenes of a sequence of steps."""
    return [
        load_scene(SCENE, (*COMMON, *COUPLING, f"time.step={step}", *options)) for step in steps
    ]


def of_medium(sequence, as_scene=False):
    """Return the errors and orders of the coupled phases."""
    truth = Manufactured(FIELDS, sequence[0])
    found = []
    for scene in sequence:
        coupling = medium(truth, scene, as_scene)
        found.append(errors(truth, scene.time.end, coupling.solid, coupling.fluid))
    return orders(found)


def report(case, found, theory):
    """Print what was measured beside the theory."""
    for name, order in theory.items():
        error, rate = found[name]
        print(f"{case}: {name} errors {error}, order {rate[-1]:.2f}, theory {order}")


@pytest.mark.parametrize("rho_inf", [0.0, 0.3, 0.5, 1.0])
def test_generalized_alpha_is_of_second_order(rho_inf):
    """With ρ∞ = 1 nothing damps the v_f that alternates, by O(Δt²), and p takes its rate: see the
    test of its mean.
    """
    found = of_medium(scenes(f"time.rho_inf={rho_inf}"))
    theory = {"u": 2, "v_s": 2, "v_f": 2, "p": 2 if rho_inf < 1 else 1}
    report(f"rho_inf = {rho_inf}", found, theory)
    assert all(found[name][1][-1] > order - SLACK for name, order in theory.items())


def test_generalized_alpha_without_inertia_is_of_second_order():
    """The rate v_s of the first-order scheme belongs to another time than the end of the step: of
    first order there.
    """
    found = of_medium(scenes(*QUASI_STATIC, "time.rho_inf=0.5", steps=(0.05, 0.025)))
    theory = {"u": 2, "v_f": 2, "p": 2, "v_s": 1}
    report("quasi-static", found, theory)
    assert all(found[name][1][-1] > order - SLACK for name, order in theory.items())


def test_backward_euler_is_of_first_order():
    found = of_medium(scenes(*QUASI_STATIC, "time.scheme=backward_euler", steps=(0.05, 0.025)))
    theory = dict.fromkeys(("u", "v_s", "v_f", "p"), 1)
    report("backward Euler", found, theory)
    assert all(1 - SLACK < found[name][1][-1] < 1 + SLACK for name in theory)


def test_the_fluid_alone_is_of_second_order():
    sequence = scenes("time.rho_inf=0.5")
    truth = Manufactured(FIELDS, sequence[0])
    found = orders(
        [errors(truth, scene.time.end, fluid=fluid_alone(truth, scene)) for scene in sequence]
    )
    report("fluid alone", found, {"v_f": 2, "p": 2})
    assert all(rate[-1] > 2 - SLACK for _, rate in found.values())


def test_the_trapezoidal_pressure_is_of_second_order_in_its_mean():
    """With ρ∞ = 1 the volume balance holds at the middle of a step, so that v_f at its ends
    alternates by O(Δt²) and p by O(Δt).

    The mean with weights 1/4, 1/2, 1/4 takes a sawtooth out.
    """
    found = []
    sequence = scenes("time.rho_inf=1.0")
    truth = Manufactured(FIELDS, sequence[0])
    for scene in sequence:
        history = []
        fluid = medium(
            truth, scene, watch=lambda coupling, history=history: history.append(coupling.fluid.p)
        ).fluid
        mean = np.array([0.25, 0.5, 0.25]) @ history[-3:]
        middle = scene.time.end - scene.time.step
        found.append({"p": l2_error(truth, fluid.domain, "p", mean[:, None], middle)})
    table = orders(found)
    report("rho_inf = 1, mean", table, {"p": 2})
    assert table["p"][1][-1] > 2 - SLACK


def test_a_consistent_start_restores_second_order_under_a_sudden_load():
    """With accelerations of zero at t = 0 the velocities are of first order at most
    (docs/manufactured.md).
    """
    sudden = of_medium(scenes("time.rho_inf=0.5"), as_scene=True)
    found = of_medium(scenes("time.rho_inf=0.5", "time.consistent_start=true"), as_scene=True)
    report("sudden load", sudden, dict.fromkeys(sudden, 1))
    report("consistent start", found, dict.fromkeys(found, 2))
    assert all(rate[-1] > 2 - SLACK for _, rate in found.values())
    assert all(found[name][0][-1] < sudden[name][0][-1] / 5 for name in ("v_s", "v_f"))
