"""Sweeps of a step by the order of the extrapolation that it starts from: displacement, fluid
velocity and pressure.

A line per choice: orders of u, v_f and p; mean and largest number of sweeps of the steps from the
fourth on; CPU seconds of all steps.  The package starts from u of order 2 (1 without inertia), v_f
of order 1 and p of order 0.  The others replace what `begin_step` has set: order k is the
polynomial through the last k + 1 levels.

    scripts/run bench start pulse2d --steps 12
"""

from collections import deque
from unittest import mock

import command_line
import numpy as np

from bench.some_steps import some_steps
from porofsi_petsc import load_scene
from porofsi_petsc.phases.fluid import FluidPhase
from porofsi_petsc.phases.solid import SolidPhase

KEEP = "shipped"
CHOICES = (
    (KEEP, KEEP, KEEP),
    (0, 0, 0),
    (1, 1, 0),
    (1, 1, 1),
    (2, 2, 1),
    (2, 2, 2),
    (KEEP, KEEP, 1),
    (KEEP, KEEP, 2),
)
WEIGHTS = {0: (1,), 1: (2, -1), 2: (3, -3, 1)}
FIRST = 3  # steps before enough levels are there


def extrapolated(levels, order):
    """Return the value at the next level of the polynomial through the last `order` + 1, fewer at
    the start; newest first.
    """
    weights = WEIGHTS[min(order, len(levels) - 1)]
    return sum(weight * level for weight, level in zip(weights, levels, strict=False))


def start_of_fluid(v_order, p_order):
    """Return a `begin_step` that starts from extrapolated v_f and p."""
    original = FluidPhase.begin_step
    v_levels = deque(maxlen=3)
    p_levels = deque(maxlen=3)

    def begin_step(fluid, scheme, rates, t, mesh_state):
        original(fluid, scheme, rates, t, mesh_state)
        v_levels.appendleft(fluid.v.copy())
        p_levels.appendleft(fluid.p.copy())
        first = fluid.unknowns
        if v_order != KEEP:
            v = extrapolated(v_levels, v_order)
            fluid.setup.velocity.apply(v, t + scheme.dt)
            first[:, :-1] = v[: len(first)]
        if p_order != KEEP:
            p = extrapolated(p_levels, p_order)
            fluid.setup.pressure.apply(p[:, None], t + scheme.alpha_f * scheme.dt)
            first[:, -1] = p[: len(first)]
        fluid.unknowns = first

    return begin_step


def start_of_solid(order):
    """Return a `begin_step` that starts from an extrapolated displacement."""
    original = SolidPhase.begin_step
    levels = deque(maxlen=3)

    def begin_step(solid, scheme, t):
        original(solid, scheme, t)
        levels.appendleft(solid.u.copy())
        if order != KEEP:
            u = extrapolated(levels, order)
            solid.setup.dirichlet.apply(u, t + scheme.dt)
            solid.unknowns = u[: solid.mesh.n_owned]

    return begin_step


def main():
    """Measure every choice of orders."""
    parser = command_line.parser("bench start", __doc__)
    parser.add_argument("scene")
    parser.add_argument("--steps", type=int, default=12)
    parser.add_argument("--set", dest="changes", action="append", default=[], metavar="KEY=VALUE")
    given = parser.parse_args()
    scene = load_scene(given.scene, given.changes)
    for u, v, p in CHOICES:
        fluid = mock.patch.object(FluidPhase, "begin_step", start_of_fluid(v, p))
        solid = mock.patch.object(SolidPhase, "begin_step", start_of_solid(u))
        with fluid, solid, some_steps(scene, given.steps) as done:
            counted = done.sweeps[FIRST:]
        print(
            f"{u!s:8}{v!s:8}{p!s:8} {np.mean(counted):5.2f} {max(counted):3d} {done.seconds:7.2f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
