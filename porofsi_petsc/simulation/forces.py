"""The forces on surfaces of a scene: of a fluid, of a solid where no fluid is behind them, or of a
porous medium.
"""

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from mpi4py import MPI

from ..conditions import State as OnSurfaces
from ..coupling.interface import InterfaceMedium
from ..fem.boundary import has_facets
from ..phases.surface_force import FluidForce, SolidForce, State
from ..phases.surface_porous import MixtureForce, SeepageFlow


class Forces(Protocol):
    """The forces on some surfaces."""

    def at(self, t: float) -> np.ndarray:
        """Return the forces of this rank at the present time t, (surfaces, d) [N] (collective).

        They are zero before the first step, which leaves no residual to be split.
        """


class InterfaceForces:
    """Those of a scene with free fluids and solids."""

    def __init__(self, coupling: InterfaceMedium, surfaces: Sequence[Sequence[str]]) -> None:
        """Find the surfaces, each some tags (collective)."""
        self._coupling = coupling
        self._comm = coupling.solid.mesh.comm
        self._surfaces = [self._surface(tags) for tags in surfaces]
        self._interface = FluidForce.on_interface(coupling.fluid.setup)

    def _surface(self, tags):
        solid = self._coupling.solid
        fluid = self._coupling.fluid
        if has_facets(fluid.domain, tags):
            return FluidForce.on(fluid.setup, tags)
        return SolidForce.on(solid.setup, tags)

    def at(self, t: float) -> np.ndarray:
        """Return the forces; see `Forces.at`."""
        flow = self._flow(t)
        states = {FluidForce: flow, SolidForce: self._solid(t, flow)}
        known = self._are_known()
        return known * np.array(
            [surface.on_rank(states[type(surface)]) for surface in self._surfaces]
        )

    def _are_known(self):
        mine = self._coupling.solid.force.any() or self._coupling.fluid.force.any()
        return self._comm.allreduce(bool(mine), MPI.LOR)

    def _flow(self, t):
        fluid = self._coupling.fluid
        mesh_state = self._coupling.accepted_mesh_state()
        through = fluid.v - mesh_state.mesh_velocity
        u = mesh_state.displacement
        given = fluid.surfaces.given(OnSurfaces(t, u, fluid.v, through, fluid.p))
        return State(fluid.force, t, u, fluid.v, through, fluid.p, given)

    def _solid(self, t, flow):
        """Return the state of the solid; what holds a fluid on other boundaries at the rim of the
        interface is not its load.
        """
        solid = self._coupling.solid
        others = self._coupling.to_solid(self._interface.of_others(flow))
        given = solid.surfaces.given(OnSurfaces(t, solid.u, solid.v))
        return State(solid.force - others, t, solid.u, given=given, internal=solid.internal)


class _OfPorousMedia:
    """What is known of surfaces of porous media."""

    def __init__(self, coupling: Any, surfaces: Sequence[Sequence[str]]) -> None:
        """Take the coupling, a `Medium` or one with "auto" terms, and the surfaces, each some
        tags.
        """
        self._coupling = coupling
        self._tags = surfaces
        self._find()

    def _find(self) -> None:
        """Find the surfaces in the present setup of the phases (collective)."""
        raise NotImplementedError


class PorousForces(_OfPorousMedia):
    """Those of porous media: of skeleton and pore fluid together."""

    def _find(self):
        self._setup = self._coupling.solid.setup
        no_slip = self._coupling.fluid.setup.no_slip
        self._surfaces = [MixtureForce.on(self._setup, tags, no_slip) for tags in self._tags]

    def at(self, t: float) -> np.ndarray:
        """Return the forces; see `Forces.at`."""
        solid = self._coupling.solid
        fluid = self._coupling.fluid
        if self._setup is not solid.setup:  # an "auto" term was switched on
            self._find()
        state = porous_state(self._coupling, solid.force + fluid.force, t)
        given = solid.surfaces.given(OnSurfaces(t, solid.u, solid.v, p=fluid.p))
        if not self._are_known(state.residual):
            return np.zeros((len(self._surfaces), solid.mesh.dim))
        state = state._replace(given=given)
        return np.array([surface.on_rank(state) for surface in self._surfaces])

    def _are_known(self, residual):
        comm = self._coupling.solid.mesh.comm
        return comm.allreduce(bool(residual.any()), MPI.LOR)


class PorousFlows(_OfPorousMedia):
    """The volume rates at which pore fluid leaves through surfaces of porous media."""

    def _find(self):
        self._setup = self._coupling.fluid.setup
        self._surfaces = [SeepageFlow.on(self._setup, tags) for tags in self._tags]

    def at(self, t: float, collocated: bool = False) -> np.ndarray:
        """Return the rates of this rank at the present time t, (surfaces,) [m³/s], zero before the
        first step; collocated : those at which the volume balance of the last step holds
        (collective).
        """
        fluid = self._coupling.fluid
        solid = self._coupling.solid
        if self._setup is not fluid.setup:  # an "auto" term was switched on
            self._find()
        outflow = fluid.collocated_outflow if collocated else fluid.outflow
        known = solid.mesh.comm.allreduce(bool(outflow.any()), MPI.LOR)
        given = fluid.fluxes.given(
            OnSurfaces(t, solid.u, fluid.v, p=fluid.collocated_pressure, v_s=solid.v)
        )
        if not known:
            return np.zeros(len(self._surfaces))
        state = porous_state(self._coupling, outflow, t)._replace(given=given)
        return np.array([surface.on_rank(state)[0] for surface in self._surfaces])


def porous_state(coupling: Any, residual: np.ndarray, t: float) -> State:
    """Return what a residual on the nodes of a porous medium is split by, c relative to the
    skeleton and p the part of the pressure that it bears.
    """
    solid = coupling.solid
    fluid = coupling.fluid
    of_fluid = fluid.v, fluid.v - solid.v, fluid.borne_pressure
    return State(residual, t, solid.u, *of_fluid, internal=solid.internal)
