"""A saturated block under a load strip or patch for the tests of the solvers, and runs of its
coupling without output.
"""

from dataclasses import dataclass, field

import numpy as np
from mpi4py import MPI

from porofsi_petsc.config.schema import Scene
from porofsi_petsc.linalg import options
from porofsi_petsc.simulation.build import local_mesh
from porofsi_petsc.simulation.loop import Clock
from porofsi_petsc.simulation.simulation import Simulation

UNLIMITED = {name: "report" for name in ("strain", "mesh_displacement", "reynolds", "inertia")}


@dataclass
class Case:
    """One block: n cells along an edge; dynamic or quasi-static, Darcy or Brinkman, small strain
    unless finite.
    """

    dim: int = 2
    order: int = 1
    n: int = 8
    k: float = 1e-2
    dt: float = 1e-3
    dynamic: bool = True
    viscous: bool = False
    finite: bool = False
    coupling: dict = field(default_factory=dict)

    def scene(self, steps):
        """Return the `Scene`."""
        return Scene.model_validate(
            {
                "title": "block",
                "mesh": self._mesh(),
                "model": {
                    "solid_inertia": self.dynamic,
                    "fluid_inertia": self.dynamic,
                    "viscosity": self.viscous,
                    "moving_mesh": self.finite,
                    "convection": self.finite and self.dynamic,
                },
                "limits": UNLIMITED,
                "time": (
                    {"end": steps * self.dt, "step": self.dt, "rho_inf": 0.3}
                    | ({} if self.dynamic else {"scheme": "backward_euler"})
                ),
                "material": [self._material()],
                "boundary": self._boundary(),
                "coupling": self.coupling,
            }
        )

    def _mesh(self):
        axis = {"points": [0.0, 5.0, 10.0], "cells": [(self.n + 1) // 2, self.n // 2]}
        up = {"points": [0.0, 10.0], "cells": [self.n]}
        patch = {"name": "load", "side": "top", "x": [0.0, 5.0]}
        if self.dim == 2:
            shape = {
                "kind": "rectangle",
                "x": axis,
                "y": up,
                "diagonal": "alternating",
                "patches": [patch],
            }
        else:
            shape = {
                "kind": "box",
                "x": axis,
                "y": axis,
                "z": up,
                "patches": [patch | {"y": [0.0, 5.0]}],
            }
        return shape | {"order": self.order}

    def _material(self):
        law = "neo_hookean" if self.finite else "linear_elastic"
        return {
            "region": "body",
            "porosity": 0.33,
            "solid": {"law": law, "lambda": 8.375e6, "mu": 5.583e6, "density": 2000.0},
            "fluid": {"density": 1000.0, "specific_weight": 1e4, "viscosity": 1e-3},
            "permeability": {"law": "constant", "k": self.k},
        }

    def _boundary(self):
        up = "xyz"[self.dim - 1]
        walls = [("x", ["left", "right"]), (up, ["bottom"])] + (
            [("y", ["front", "back"])] if self.dim == 3 else []
        )
        fluid = [
            {"no_slip": True} if self.viscous else {"velocity": {axis: 0.0}} for axis, _ in walls
        ]
        held = [
            {"on": on, "displacement": {axis: 0.0}} | slip
            for (axis, on), slip in zip(walls, fluid, strict=True)
        ]
        load = {"on": "load", "traction": {up: "-1e4*sin(25*pi*t)"}}
        return [*held, {"on": ["top", "load"], "pressure": 0.0}, load]


@dataclass
class Outcome:
    """What a run of the coupling gives: iterations of the coupling and of the solvers, and the
    fields in natural order.
    """

    coupling: list
    fluid: int
    solid: int
    u: np.ndarray
    v: np.ndarray
    p: np.ndarray
    mesh: object
    tolerance: float


def solve(case, direct, petsc="", steps=2):
    """Advance the coupling of a case and return its `Outcome`; direct : the default solvers are
    factorizations.
    """
    options.start(petsc)
    from porofsi_petsc.simulation import builder

    scene = case.scene(steps)
    mesh = local_mesh(scene, MPI.COMM_WORLD)
    chosen = builder.is_direct
    builder.is_direct = lambda mesh: direct
    try:
        coupling = Simulation(scene, mesh=mesh).coupling
    finally:
        builder.is_direct = chosen
    clock = Clock(scene.time)
    iterations = []
    for step in range(steps):
        schemes, rates = clock.schemes(scene.model, case.dt)
        coupling.step(schemes, rates, step * case.dt, step + 1)
        coupling.accept()
        iterations.append(coupling.iterations)
    n = mesh.n_owned
    solid = coupling.solid
    fluid = coupling.fluid
    fields = [_natural(mesh, array[:n]) for array in (solid.u, fluid.v, fluid.p)]
    counts = [phase.block.solver.iterations_max for phase in (fluid, solid)]
    outcome = Outcome(iterations, *counts, *fields, mesh, fluid.block.solver.ksp.getTolerances()[0])
    for phase in (solid, fluid):
        phase.block.solver.destroy()
    return outcome


def _natural(mesh, owned):
    numbers = np.concatenate(mesh.comm.allgather(mesh.natural[: mesh.n_owned]))
    return np.concatenate(mesh.comm.allgather(owned))[np.argsort(numbers)]
