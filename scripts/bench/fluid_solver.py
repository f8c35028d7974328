"""Iterations of the free fluid's FGMRES in a channel with an obstacle: steps, Reynolds numbers,
elements, three meshes.

The channel is 1 high and 3 long, flow 1 at most, density 1; the obstacle, a stiff solid, stands on
its floor.  Transient: first step from the inflow profile everywhere but on the obstacle, Courant
number U Δt/h and diffusion number ν Δt/h², h the node spacing.  Steady: by the Reynolds number U
H/ν.  A Newton iteration each until 1e-6; numbers are FGMRES iterations, mean/largest, of solves to
1e-5.  More ranks: mpirun -n 2 scripts/run bench fluid_solver
"""

from contextlib import ExitStack
from dataclasses import dataclass
from unittest import mock

import command_line
import numpy as np

from porofsi_petsc.linalg import options

ELEMENTS = {"T3": (2, 1), "T6": (2, 2), "T4": (3, 1), "T10": (3, 2)}
MESHES = {"T3": (16, 32, 64), "T6": (8, 16, 32), "T4": (4, 8, 12), "T10": (2, 4, 6)}
TRANSIENT = ((0.5, 0.1), (0.5, 10.0), (5.0, 1.0), (5.0, 100.0), (50.0, 10.0), (50.0, 100.0))
STEADY = (1.0, 20.0, 200.0)
TO_FIVE_DIGITS = "-fluid_ksp_rtol 1e-5 "  # steady flows too, whose default is less
OBSTACLE_SOLVER = (
    "-solid_ksp_type preonly -solid_pc_type cholesky -solid_pc_factor_mat_solver_type mumps"
)


@dataclass(frozen=True)
class Channel:
    """A case: element, n cells along the height; transient by courant and diffusion, or steady by
    reynolds.

    coupling : keys of [coupling] beside tolerance and tangent; steps : of a transient case
    """

    element: str
    n: int
    courant: float = 0.0
    diffusion: float = 0.0
    reynolds: float = 0.0
    coupling: tuple = (("scheme", "one_way"),)
    tolerance: float = 1e-6
    steps: int = 1

    def tables(self):
        """Return the tables of the scene."""
        dim, order = ELEMENTS[self.element]
        h = 1 / (self.n * order)
        steady = bool(self.reynolds)
        step = 1.0 if steady else self.courant * h
        viscosity = 1 / self.reynolds if steady else self.diffusion * h**2 / step
        coupling = dict(self.coupling)
        speed = "4*y*(1 - y)" + ("*(1 - z**2)" if dim == 3 else "")
        obstacle = "(x > 0.999) & (x < 1.501) & (y < 0.501)" + (
            " & (z < 0.501)" if dim == 3 else ""
        )
        profile = self._vector(x=speed)
        return {
            "title": "channel with an obstacle",
            "mesh": self._mesh(),
            "model": (
                {
                    "convection": True,
                    "viscosity": True,
                    "moving_mesh": coupling["scheme"] != "one_way",
                }
                | dict.fromkeys(("solid_inertia", "fluid_inertia"), not steady)
            ),
            "time": (
                {"step": step, "end": self.steps * step} | ({"scheme": "steady"} if steady else {})
            ),
            "initial": {"fluid_velocity": self._vector(x=f"where({obstacle}, 0, {speed})")},
            "material": [
                {"region": "body", "fluid": {"density": 1.0, "viscosity": viscosity}},
                {
                    "region": "obstacle",
                    "solid": {"law": "neo_hookean", "young": 1e4, "poisson": 0.3, "density": 10.0},
                },
            ],
            "boundary": self._boundary(profile),
            "coupling": {"tolerance": self.tolerance, "tangent": "newton", **coupling},
        }

    def _vector(self, **given):
        return {axis: given.get(axis, 0.0) for axis in "xyz"[: ELEMENTS[self.element][0]]}

    def _mesh(self):
        dim, order = ELEMENTS[self.element]
        n = self.n
        half = [0.0, 0.5, 1.0]
        side = {"points": half, "cells": [n // 2, n - n // 2]}
        along = {"points": [0.0, 1.0, 1.5, 3.0], "cells": [n, n // 2, n + n // 2]}
        obstacle = {"name": "obstacle", "x": [1.0, 1.5], "y": half[:2]}
        if dim == 2:
            return {
                "kind": "rectangle",
                "order": order,
                "x": along,
                "y": side,
                "diagonal": "alternating",
                "regions": [obstacle],
            }
        return {
            "kind": "box",
            "order": order,
            "x": along,
            "y": side,
            "z": side,
            "regions": [obstacle | {"z": half[:2]}],
        }

    def _boundary(self, profile):
        """Return walls and inflow; in 3-D z = 0 is the floor, a plane of symmetry that holds the
        obstacle.
        """
        walls = ["bottom", "top"]
        rest = self._vector()
        held = {"velocity": rest, "displacement": rest}
        floor = []
        if ELEMENTS[self.element][0] == 3:
            walls = ["top", "front", "back"]
            floor = [{"on": "bottom", "velocity": {"z": 0.0}, "displacement": rest}]
        return [{"on": "left", "velocity": profile}, {"on": walls} | held, *floor, {"on": "right"}]


def solve(case, direct=False, petsc=OBSTACLE_SOLVER):
    """Advance a case; return its coupling, with its solver still alive; direct : the default
    solvers are factorizations.
    """
    options.start(petsc)
    from mpi4py import MPI

    from porofsi_petsc.config import Scene
    from porofsi_petsc.simulation import builder, interface
    from porofsi_petsc.simulation.loop import Clock
    from porofsi_petsc.simulation.simulation import Simulation

    scene = Scene.model_validate(case.tables())
    with ExitStack() as stack:
        for module in (builder, interface):
            stack.enter_context(mock.patch.object(module, "is_direct", lambda mesh: direct))
        coupling = Simulation(scene, MPI.COMM_WORLD).coupling
    clock = Clock(scene.time)
    dt = scene.time.step
    for step in range(case.steps):
        schemes, rates = clock.schemes(scene.model, dt)
        coupling.step(schemes, rates, step * dt, step + 1)
        coupling.accept()
    return coupling


def count(case):
    """Return the nodes of the fluid, and mean and largest number of iterations of a solve
    (collective).
    """
    fluid = solve(case, petsc=TO_FIVE_DIGITS + OBSTACLE_SOLVER).fluid
    iterations = fluid.block.solver.iterations
    nodes = fluid.domain.n_nodes
    fluid.block.solver.destroy()
    return nodes, float(np.mean(iterations)), max(iterations)


def line(element, label, **flow):
    """Return a line of the table: iterations on the three meshes (collective)."""
    counts = [count(Channel(element, n, **flow)) for n in MESHES[element]]
    cells = [f"{mean:.0f}/{most}" for _, mean, most in counts]
    return (
        f"| {element} | {', '.join(str(nodes) for nodes, _, _ in counts)} | {label} |"
        f" {' | '.join(cells)} |"
    )


def main(elements):
    """Print the table."""
    flows = {f"CFL {c:g}, ν Δt/h² {d:g}": {"courant": c, "diffusion": d} for c, d in TRANSIENT}
    flows |= {f"steady, Re {r:g}": {"reynolds": r} for r in STEADY}
    options.start()
    from mpi4py import MPI

    for element in elements:
        for label, flow in flows.items():
            text = line(element, label, **flow)
            if MPI.COMM_WORLD.rank == 0:
                print(text, flush=True)


if __name__ == "__main__":
    parser = command_line.parser("bench fluid_solver", __doc__)
    parser.add_argument("elements", nargs="*", metavar="ELEMENT", help=", ".join(ELEMENTS))
    main(parser.parse_args().elements or ELEMENTS)
