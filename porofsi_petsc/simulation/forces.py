"""The forces that a scene asks for: of the fluid on its surfaces, of the solid where no fluid is
behind them.
"""

import numpy as np
from mpi4py import MPI

from ..conditions import State as OnSurfaces
from ..config import Scene
from ..coupling.interface import InterfaceMedium
from ..fem.boundary import has_facets
from ..phases.surface_force import FluidForce, SolidForce, State


class Forces:
    """The forces on the surfaces of a scene with free fluids and solids."""

    def __init__(self, scene: Scene, coupling: InterfaceMedium) -> None:
        """Find the surfaces (collective)."""
        self._coupling = coupling
        self._comm = coupling.solid.mesh.comm
        self._surfaces = [self._surface(force.on) for force in scene.force]
        self._interface = FluidForce.on_interface(coupling.fluid.setup)

    def _surface(self, tags):
        solid = self._coupling.solid
        fluid = self._coupling.fluid
        if has_facets(fluid.domain, tags):
            return FluidForce.on(fluid.setup, tags)
        return SolidForce.on(solid.setup, tags)

    def at(self, t: float) -> list[float]:
        """Return the forces at the present time t, component by component (collective).

        They are zero before the first step, which leaves no residual to be split.
        """
        flow = self._flow(t)
        states = {FluidForce: flow, SolidForce: self._solid(t, flow)}
        mine = np.array([surface.on_rank(states[type(surface)]) for surface in self._surfaces])
        return (self._comm.allreduce(mine.ravel()) * self._are_known()).tolist()

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
        """Return the state of the solid; what a fluid does to other walls at the rim of the
        interface is not its load.
        """
        solid = self._coupling.solid
        others = self._coupling.to_solid(self._interface.of_others(flow))
        given = solid.surfaces.given(OnSurfaces(t, solid.u, solid.v))
        return State(solid.force - others, t, solid.u, given=given)
