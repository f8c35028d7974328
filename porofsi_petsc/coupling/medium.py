"""A solid and a fluid with a common step, whatever solves it: a saturated porous medium, or two
that share an interface.
"""

import collections
import itertools
from collections.abc import Collection, Sequence
from contextlib import AbstractContextManager
from typing import Any

import numpy as np
from mpi4py import MPI

from ..clock import Scheme
from ..errors import ConvergenceError
from ..linalg.solver import LinearSolver
from ..phases.block import LinearBlock
from ..phases.coupling_data import Flow, MeshState, Rates
from ..phases.residual import Residual, euclidean_norms
from .convergence import Convergence
from .protocols import Arrays, Fluid, Memory, Solid

FIELDS = ("fluid momentum", "volume", "solid momentum")


class Medium:
    """The two phases, their convergence and their state; a scheme adds how an iteration changes the
    trial states.

    Here the skeleton carries the fluid: a porous medium.
    load_factor : of all data of a steady scene, None of others; notices : what a run says of the
    scheme
    """

    # what the run tries by itself before it gives up: remedies and "step", a smaller one
    tried: Collection[str] = frozenset()
    load_factor: Any = None  # of `simulation.continuation`
    notices: Sequence[str] = ()

    def __init__(
        self, solid: Solid, fluid: Fluid, comm: MPI.Comm, tolerance: float, max_iterations: int
    ) -> None:
        """Take the phases and what ends the iteration of a step."""
        self.solid = solid
        self.fluid = fluid
        self._comm = comm
        self._cap = max_iterations
        self.convergence = Convergence(tolerance)
        self.iterations = 0
        self.residuals: tuple[Residual, tuple[Residual, Residual]]  # where the last step converged
        self.failed = 0
        self._swept = 0

    @property
    def remedies(self) -> tuple[str, ...]:
        """Return what a step that failed is tried with, in turn: names that `remedied` takes."""
        return ()

    @property
    def advice(self) -> str:
        """Return what to try where a step does not converge, but for what is set already and what
        the run tries by itself.
        """
        texts = [text for name, text in self._alternatives().items() if name not in self.tried]
        if self.convergence.falling:
            texts.append(f"more than coupling.max_iterations = {self._cap}")
        if not texts:
            return ""
        return f"try {' or '.join([', '.join(texts[:-1]), texts[-1]] if texts[1:] else texts)}"

    def remedied(self, remedy: str) -> AbstractContextManager[None]:
        """Return the context in which a step is tried with a remedy."""
        raise NotImplementedError

    def _alternatives(self) -> dict[str, str]:
        """Return name -> what to try."""
        return {"step": "a smaller step"}

    def dot(self, a: np.ndarray, b: np.ndarray) -> float:
        """Return the inner product of two distributed vectors (collective)."""
        return float(self._comm.allreduce(np.vdot(a, b)))

    def step(self, schemes: tuple[Scheme, Scheme], rates: Rates, t: float, step: int) -> None:
        """Solve one step from time t (nothing is accepted); raise ConvergenceError at the cap.

        The iterations of a step that fails are added to `failed`.
        schemes : (solid, fluid) time schemes; rates : `phases.coupling_data.Rates`.
        """
        accepted = self.begin_phases(schemes, rates, t)
        self.convergence.start_step()
        self.convergence.flow_force_per_rate = self.fluid.force_per_rate(rates)
        self._begin(t, rates, accepted)
        try:
            self._converge(rates, t, step)
        except ConvergenceError:
            self.failed += self._swept
            raise

    def begin_phases(self, schemes: tuple[Scheme, Scheme], rates: Rates, t: float) -> MeshState:
        """Start a step of the phases from time t: predictors, essential values and loads; return
        the accepted state of the mesh (collective).
        """
        accepted = self.accepted_mesh_state()
        self.solid.begin_step(schemes[0], t)
        self.fluid.begin_step(schemes[1], rates, t, accepted)
        return accepted

    def _converge(self, rates: Rates, t: float, step: int) -> None:
        self._swept = 0
        for iteration in range(self._cap + 1):
            self.fluid.follow(self.mesh_state())
            fluid_residuals = self.fluid.residual(self.mesh_state())
            solid_residual = self.solid.residual(self.flow(fluid_residuals))
            if self.convergence.reached(*self._sizes(fluid_residuals, solid_residual, rates)):
                self.solid.require_orientation()
                self.solid.require_stable()
                self.iterations = iteration
                self.residuals = (solid_residual, fluid_residuals)
                return
            if iteration < self._cap:
                self._swept += 1
                if self.solid.is_plastic and not iteration:
                    solid_residual = self.solid.elastic_residual(self.flow(fluid_residuals))
                self._iterate(iteration, solid_residual, fluid_residuals, rates)
        self.reset()
        raise self.convergence.failure(t, step, self.advice)

    def _begin(self, t: float, rates: Rates, accepted: MeshState) -> None:
        """Make the scheme ready for the iterations of a step."""
        raise NotImplementedError

    def _iterate(
        self,
        iteration: int,
        solid_residual: Residual,
        fluid_residuals: tuple[Residual, Residual],
        rates: Rates,
    ) -> None:
        """Change the trial states, which have these residuals."""
        raise NotImplementedError

    def _sizes(
        self, fluid_residuals: tuple[Residual, Residual], solid_residual: Residual, rates: Rates
    ) -> tuple[dict[str, tuple[float, float]], float, dict[str, float]]:
        """Return what `Convergence.reached` takes, its norms by one reduction (collective)."""
        residuals = dict(zip(FIELDS, (*fluid_residuals, solid_residual), strict=True))
        groups = {field: residual.vectors() for field, residual in residuals.items()}
        cancelling = self.fluid.cancelling(self.mesh_state(), rates)
        for field, vector in self.solid.cancelling().items():
            cancelling[field] = vector + cancelling.get(field, 0.0)
        vectors = [
            *itertools.chain(*groups.values()),
            self.fluid.drag_scale(self.mesh_state(), rates),
            *cancelling.values(),
        ]
        found = iter(euclidean_norms(self._comm, vectors).tolist())
        norms = {
            field: (next(found), max(next(found) for _ in group[1:]))
            for field, group in groups.items()
        }
        return norms, next(found), dict(zip(cancelling, found, strict=True))

    def mesh_state(self) -> MeshState:
        """Return what carries the fluid in the trial state."""
        return self.solid.mesh_state()

    def accepted_mesh_state(self) -> MeshState:
        """Return what carries the fluid in the accepted state."""
        return self.solid.accepted_mesh_state()

    def mesh_state_at(self, u: np.ndarray, v: np.ndarray) -> MeshState:
        """Return what carries the fluid at a displacement and a velocity, both (n_local, d)."""
        return self.solid.mesh_state_at(u, v)

    def flow(self, fluid_residuals: tuple[Residual, Residual]) -> Flow:
        """Return what the solid feels of the fluid in the trial state, which has these
        residuals.
        """
        return self.fluid.flow()

    def start(self, schemes: tuple[Scheme, Scheme], rates: Rates) -> None:
        """Give the phases the accelerations and the pressure that the balances ask for at t = 0 (0+
        where a load is sudden).

        They are those of one small implicit step, whose positions, velocities and states of
        surfaces are forgotten; v_f is kept where it has inertia (without it, Darcy's law gives it
        with the pressure).  The velocities at t = 0 must satisfy the volume balance.
        """
        u = self.solid.u
        v = self.solid.v
        v_f = self.fluid.v
        surfaces = self.solid.surfaces, self.fluid.surfaces
        kept = [terms.memory() for terms in surfaces]
        self.step(schemes, rates, 0.0, 0)
        self.accept()
        for terms, memory in zip(surfaces, kept, strict=True):
            terms.load(memory)
        self.solid.set_initial(u, v)
        self.fluid.set_initial(v_f if rates.c_f else self.fluid.v, self.fluid.p, balanced=True)
        self.reset()

    def accept(self) -> None:
        """Make the trial states the accepted ones; raise ConvergenceError, changing nothing, when
        the end is not admissible.
        """
        self.solid.accept()
        self.fluid.accept()

    def reset(self) -> None:
        """Forget the trial states and ask for new tangents."""
        for phase in (self.fluid, self.solid):
            phase.reset()
            phase.expire_tangent()

    @property
    def blocks(self) -> dict[str, LinearBlock]:
        """Return the linear blocks by name."""
        return {"solid": self.solid.block, "fluid": self.fluid.block}

    @property
    def solvers(self) -> list[LinearSolver]:
        """Return the `LinearSolver`s whose times add up to that of all solves."""
        return [block.solver for block in self.blocks.values() if block.solver]

    # -- what the run looks at ---------------------------------------------------------------------

    def collocated(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return v_s, v_f (n_owned, d) and p (n_owned, 1) of the trial state on the collocation
        level.
        """
        n = self.solid.mesh.n_owned
        flow = self.fluid.flow()
        return self.solid.velocity[:n], flow.velocity[:n], flow.pressure[:n, None]

    def displacement(self) -> np.ndarray:
        """Return the accepted displacement of solid and mesh, (n_local, d) [m]."""
        return self.solid.u

    def velocity(self) -> np.ndarray:
        """Return the accepted velocity of solid and mesh, (n_local, d) [m/s]."""
        return self.solid.v

    def energies(self) -> tuple[float, float]:
        """Return kinetic and elastic energy of the accepted state [J] (collective)."""
        kinetic, elastic = self.solid.energies()
        mesh_state = self.accepted_mesh_state()
        kinetic += self.fluid.kinetic_energy(mesh_state)
        return kinetic, elastic + self.fluid.stored_energy(mesh_state)

    def state(self) -> Arrays:
        """Return the arrays a restart needs, name -> (n_owned, ...)."""
        phases = {"solid": self.solid, "fluid": self.fluid}
        return {
            f"{name}.{key}": array
            for name, phase in phases.items()
            for key, array in phase.state().items()
        }

    def memory(self) -> Memory:
        """Return the numbers a restart needs beside the arrays."""
        return {
            "solid": self.solid.memory(),
            "fluid": self.fluid.memory(),
            "iterations": self.iterations,
            "failed": self.failed,
            "largest": self.convergence.largest,
        }

    def load_state(
        self, arrays: Arrays, memory: Memory, schemes: tuple[Scheme, Scheme], rates: Rates
    ) -> None:
        """Continue from `state` and `memory`; schemes and rates are those of the next step."""
        parts: dict[str, Arrays] = collections.defaultdict(dict)
        for key, array in arrays.items():
            name, _, field = key.partition(".")
            parts[name][field] = array
        self.solid.load_state(parts["solid"], memory["solid"], rates)
        self.fluid.load_state(
            parts["fluid"], memory["fluid"], schemes[1], rates, self.mesh_state_at
        )
        self.iterations = memory["iterations"]
        self.convergence.largest = memory["largest"]
        # going back after a failure forgets none
        self.failed = max(self.failed, memory.get("failed", 0))
