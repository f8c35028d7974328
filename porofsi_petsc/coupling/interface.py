"""Fluid-structure interaction over an interface: the medium, and its partitioned and monolithic
iterations.
"""

from dataclasses import replace
from functools import cached_property
from typing import Any, Literal

import numpy as np

from ..clock import Scheme
from ..errors import ConvergenceError
from ..fem.boundary import InterfacePressure
from ..fem.transfer import InterfaceTransfer
from ..phases.block import LinearBlock
from ..phases.coupling_data import Flow, MeshState, Rates
from ..phases.residual import Residual
from .medium import Medium
from .monolithic import MonolithicCoupling
from .partitioned import PartitionedMedium
from .protocols import Arrays, InterfaceFluid, InterfaceSolid, Memory, Motion
from .robin import InterfaceConditions

# Guard of Aitken's factor: under a large added mass the error factors of Dirichlet and Neumann lie
# anywhere below 0.
GUARD = (0.02, 1.2)


class InterfaceMedium(Medium):
    """The fluid on a mesh that follows the solid, with its velocity on the interface; the solid
    under the fluid's force.

    The force is the fluid's residual on the nodes of the interface, unconstrained there: no stress
    is recovered, and what the fluid loses the solid gains to round-off, on its own nodes where the
    two have none in common.

    What the fluid sees of the solid: its trial displacement (strong: the converged step is that of
    the monolithic system), its predicted one (weak: staggered, the force comes once), one that is
    given for the whole step (by another program) or nothing (one-way).  Each step ends when all
    residuals are small.
    """

    solid: InterfaceSolid
    fluid: InterfaceFluid

    def __init__(
        self,
        *medium: Any,
        motion: Motion,
        transfer: InterfaceTransfer,
        sees: Literal["trial", "given", "predicted", "nothing"] = "trial",
        pressure: InterfacePressure | None = None,
        **scheme: Any,
    ) -> None:
        """Take what the scheme takes; the `phases.MeshMotion`, the
        `fem.transfer.InterfaceTransfer`, and what the fluid sees.

        sees : "trial", "given", "predicted" or "nothing"; pressure :
        `fem.boundary.InterfacePressure`, by which the pressure follows a solid that the fluid does
        not see
        """
        self.motion = motion
        self._transfer = transfer
        self._sees = sees
        self._pressure = pressure
        super().__init__(*medium, **scheme)
        sides = transfer.fluid_nodes, transfer.solid_nodes
        self._on_fluid, self._on_solid = (nodes[: self.solid.mesh.n_owned, None] for nodes in sides)
        self._of_solid = self.solid.domain.holds[:, None]

    @property
    def blocks(self) -> dict[str, LinearBlock]:
        """Return the linear blocks by name."""
        return super().blocks | {"mesh": self.motion.block}

    def mesh_state(self) -> MeshState:
        """Return the trial state of the mesh; raises ConvergenceError where pores that it carries
        are closed.
        """
        self.solid.require_admissible()
        return self.motion.mesh_state()

    def accepted_mesh_state(self) -> MeshState:
        """Return the accepted state of the mesh."""
        return self.motion.accepted_mesh_state()

    def mesh_state_at(self, u: np.ndarray, v: np.ndarray) -> MeshState:
        """Return the mesh at a displacement and a velocity, both (n_local, d)."""
        return self.motion.mesh_state_at(u, v)

    def flow(self, fluid_residuals: tuple[Residual, Residual]) -> Flow:
        """Return the fluid's force on the interface, (n_owned, d) [N]."""
        return self._with_force(np.where(self._on_fluid, -fluid_residuals[0].unconstrained, 0.0))

    def _with_force(self, force: np.ndarray) -> Flow:
        flow = self.fluid.flow()
        if self._pressure is not None:
            moved = self._transfer.to_fluid(self.solid.mesh_state().displacement)
            force = force + self._pressure.turned(flow.pressure, moved)
        return replace(flow, force=self._transfer.to_solid(force))

    def to_solid(self, force: np.ndarray) -> np.ndarray:
        """Return forces of the fluid, (n_owned, d) [N], on the nodes of the solid's side of the
        interface (collective).
        """
        return self._transfer.to_solid(np.where(self._on_fluid, force, 0.0))

    def displacement(self) -> np.ndarray:
        """Return the accepted displacement of solid and mesh, (n_local, d) [m]."""
        return np.where(self._of_solid, self.solid.u, self.motion.u)

    def velocity(self) -> np.ndarray:
        """Return the accepted velocity of solid and mesh, (n_local, d) [m/s]."""
        return np.where(self._of_solid, self.solid.v, self.motion.v)

    def begin_phases(self, schemes: tuple[Scheme, Scheme], rates: Rates, t: float) -> MeshState:
        """Do what `Medium.begin_phases` does, and start the step of the mesh."""
        accepted = super().begin_phases(schemes, rates, t)
        self.motion.begin_step(schemes[0], t)
        return accepted

    def _begin(self, t: float, rates: Rates, accepted: MeshState) -> None:
        self.motion.follow(self.solid.end_displacement)
        super()._begin(t, rates, accepted)

    def _iterate(
        self,
        iteration: int,
        solid_residual: Residual,
        fluid_residuals: tuple[Residual, Residual],
        rates: Rates,
    ) -> None:
        super()._iterate(iteration, solid_residual, fluid_residuals, rates)
        if self._sees == "trial":
            self.motion.follow(self.solid.end_displacement)

    def start(self, schemes: tuple[Scheme, Scheme], rates: Rates) -> None:
        """Do what `Medium.start` does, and take the mesh back too; its acceleration stays."""
        u = self.solid.u
        v = self.solid.v
        super().start(schemes, rates)
        self.motion.set_initial(u, v)

    def accept(self) -> None:
        """Make the trial states the accepted ones, the mesh where the solid is."""
        if self._sees in ("predicted", "nothing"):
            self.motion.follow(self.solid.end_displacement)
        self.motion.accept()
        super().accept()

    def reset(self) -> None:
        """Forget the trial states."""
        super().reset()
        self.motion.reset()

    def state(self) -> Arrays:
        """Return the arrays a restart needs, name -> (n_owned, ...)."""
        return super().state() | {
            f"mesh.{name}": array for name, array in self.motion.state().items()
        }

    def memory(self) -> Memory:
        """Return the numbers a restart needs beside the arrays."""
        return super().memory() | {"mesh": self.motion.memory()}

    def load_state(
        self, arrays: Arrays, memory: Memory, schemes: tuple[Scheme, Scheme], rates: Rates
    ) -> None:
        """Continue from `state` and `memory`; schemes and rates are those of the next step."""
        mesh = {
            name.removeprefix("mesh."): a for name, a in arrays.items() if name.startswith("mesh.")
        }
        self.motion.load_state(mesh, memory.get("mesh", self.motion.memory()))
        super().load_state(arrays, memory, schemes, rates)


class InterfaceSweep(PartitionedMedium):
    """What the sweeps over an interface share: a nearly incompressible solid at large strain has
    new tangents in each.
    """

    def _renew_tangents(self, iteration: int, rates: Rates) -> bool:
        """Do what `PartitionedMedium` does, or renew both."""
        if not self.solid.is_stiff_in_volume:
            return super()._renew_tangents(iteration, rates)
        self.solid.renew_tangent(rates)
        self.fluid.renew_tangent(rates, self.mesh_state())
        return not self._travel


class _Sweep(InterfaceSweep):
    """One Newton step of the fluid, one of the solid under the new force, and an accelerated
    displacement of the solid.

    Conditions, with the mass M of the interface:  fluid  R_f + R_s + α_f M (v_f - P v_s) = 0, solid
    R_s + R_f + α_s M (P v_s - v_f) = 0.  An infinite α is a Dirichlet, a vanishing one a Neumann
    condition.  Between two sweeps v_f takes the value of v_s, so that the residuals that end the
    step are those of the monolithic system whatever the conditions are.

    The accelerated vector is the displacement of the solid's nodes; its inner product counts the
    interface alone, of which all else is a function.
    """

    solid: InterfaceSolid
    fluid: InterfaceFluid

    def __init__(self, *medium: Any, conditions: InterfaceConditions) -> None:
        """Take what `PartitionedMedium` takes and the `coupling.robin.InterfaceConditions`."""
        super().__init__(*medium)
        self._conditions, self._rows = conditions, self.solid.domain.nodes
        self._both = bool(self.solid.domain.n_nodes and self.fluid.domain.n_nodes)

    def _begin(self, t: float, rates: Rates, accepted: MeshState) -> None:
        self._conditions.prepare(self.fluid, self.solid, rates)
        super()._begin(t, rates, accepted)

    def _slow(self, iteration: int) -> bool:
        """Return whether slow sweeps call for new tangents: where the step has made some, the
        coupling is what is slow.
        """
        return self._renewed_at == 0 and super()._slow(iteration)

    def _iterate(self, iteration, solid_residual, fluid_residuals, rates):
        self._renew_tangents(iteration, rates)
        before = self.solid.unknowns[self._rows]
        self.fluid.correct(fluid_residuals, self._conditions.unbalanced(solid_residual))
        extra = self._conditions.robin_force(self.fluid, self.solid)
        solid_residual = self.solid.residual(
            self._with_force(self.fluid.interface_force(self.mesh_state()))
        )
        self.solid.correct(solid_residual.total + extra)
        if self._sees == "trial" and self._both:
            after = self.solid.unknowns.copy()
            after[self._rows] = self._accelerator.next(before, after[self._rows])
            self.solid.unknowns = after

    @cached_property
    def _of_interface(self):
        """Return which rows of an accelerated vector belong to the interface."""
        return np.flatnonzero(self._on_solid[self._rows])

    def _dot(self, a: np.ndarray, b: np.ndarray) -> float:
        return self.dot(a[self._of_interface], b[self._of_interface])

    def state(self) -> Arrays:
        """Return the arrays a restart needs, name -> (n_owned, ...)."""
        arrays = super().state()
        for name in filter(_accelerated, arrays):
            whole = np.zeros_like(self.solid.unknowns)
            whole[self._rows] = arrays[name]
            arrays[name] = whole
        return arrays

    def load_state(
        self, arrays: Arrays, memory: Memory, schemes: tuple[Scheme, Scheme], rates: Rates
    ) -> None:
        """Continue from `state` and `memory`; schemes and rates are those of the next step."""
        rows = {name: array[self._rows] for name, array in arrays.items() if _accelerated(name)}
        super().load_state(arrays | rows, memory, schemes, rates)


def _accelerated(name: str) -> bool:
    """Return whether an array of a state is a vector of the accelerator."""
    return name.startswith("accelerator.")


class InterfaceCoupling(InterfaceMedium, _Sweep):
    """The partitioned iteration: Dirichlet-Neumann, Robin-Neumann, Robin-Robin or
    Neumann-Dirichlet, strong, weak or one-way.
    """

    def _alternatives(self) -> dict[str, str]:
        """Return name -> what to try; against an added mass a smaller step does not help."""
        alternatives = super()._alternatives()
        if self._both:
            del alternatives["step"]
            scheme = alternatives.pop("scheme")
            if self._conditions.name == "dirichlet_neumann":
                alternatives["interface"] = 'coupling.interface = "robin_neumann"'
            return alternatives | {"scheme": scheme}
        alternatives = {
            name: alternatives[name] for name in ("step", "tangents") if name in alternatives
        }
        if self.fluid.domain.n_nodes:
            alternatives["backflow"] = (
                "backflow = 1 on a boundary through which the flow comes back in"
            )
        return alternatives

    @property
    def remedies(self) -> tuple[str, ...]:
        """Return what a step that failed is tried with, in turn; sweeps are accelerated where both
        phases see each other.
        """
        accelerated = self._sees == "trial" and self._both
        return tuple(name for name in super().remedies if accelerated or name != "accelerator")

    def step(self, schemes: tuple[Scheme, Scheme], rates: Rates, t: float, step: int) -> None:
        """Do what `Medium.step` does; where an element is inverted by sweeps that do not converge,
        say so.
        """
        try:
            super().step(schemes, rates, t, step)
        except ConvergenceError as error:
            diverging = (
                self.convergence.history
                and not self.convergence.falling
                and not self.motion.squeezed
            )
            if diverging and error.advice != self.advice:
                raise ConvergenceError(
                    f"the sweeps of step {step} do not converge: {error.what}", self.advice
                ) from None
            raise


class InterfaceMonolithic(InterfaceMedium, MonolithicCoupling):
    """Newton's iteration for solid, fluid and (direct) mesh together."""
