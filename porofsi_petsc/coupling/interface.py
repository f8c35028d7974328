"""Fluid-structure interaction over an interface: Dirichlet-Neumann sweeps, strong, weak or in one direction."""

import numpy as np

from .partitioned import PartitionedMedium

# Guard of Aitken's factor: the error factors of Dirichlet and Neumann lie anywhere below 0 under a large added mass.
GUARD = (0.02, 1.2)


class InterfaceCoupling(PartitionedMedium):
    """The fluid on a mesh that follows the solid, with its velocity on the interface; the solid under the fluid's force.

    What the fluid sees of the solid makes the scheme: its trial displacement (strong: the converged step is that of the
    monolithic system), its predicted displacement (weak: staggered, the force comes once) or nothing (one-way).  In each case the
    step ends when all residuals are small.

    The force is the fluid's residual on the nodes of the interface, unconstrained there: no stress is recovered, and what the
    fluid loses the solid gains to round-off.  The accelerated vector is the displacement of the solid, (n_owned, d); its inner
    product counts the interface alone, of which all else is a function.
    """

    def __init__(self, *medium, motion, interface, sees):
        """Take what `PartitionedMedium` takes; the `phases.MeshMotion`, the interface's nodes (n_local,) bool, and the scheme.

        sees : "trial", "predicted" or "nothing"
        """
        self.motion, self._sees = motion, sees
        super().__init__(*medium)
        self._interface = interface[: self.solid.mesh.n_owned, None]
        self._of_solid = self.solid.domain.holds[:, None]
        self._both = bool(self.solid.domain.n_nodes and self.fluid.domain.n_nodes)

    @property
    def blocks(self):
        """Return what assembles and solves, name -> object with `solver` and `assemblies`."""
        return super().blocks | {"mesh": self.motion}

    def carrier(self):
        """Return the trial state of the mesh."""
        return self.motion.skeleton()

    def accepted_carrier(self):
        """Return the accepted state of the mesh."""
        return self.motion.accepted_skeleton()

    def skeleton_at(self, u, v):
        """Return the mesh at a displacement and a velocity, both (n_local, d)."""
        return self.motion.skeleton_at(u, v)

    def flow(self, fluid_residuals):
        """Return the fluid's force on the interface, (n_owned, d) [N]."""
        flow = self.fluid.flow()
        force = np.where(self._interface, self.fluid.boundary_force(fluid_residuals[0]), 0.0)
        return type(flow)(flow.velocity, flow.pressure, force)

    def displacement(self):
        """Return the accepted displacement of solid and mesh, (n_local, d) [m]."""
        return np.where(self._of_solid, self.solid.u, self.motion.u)

    def velocity(self):
        """Return the accepted velocity of solid and mesh, (n_local, d) [m/s]."""
        return np.where(self._of_solid, self.solid.v, self.motion.v)

    # -- one step ---------------------------------------------------------------------------------------------------------

    def _begin(self, t, rates, accepted):
        self.motion.begin_step(self.solid.scheme, t)
        self.motion.follow(self.solid.end_displacement)
        super()._begin(t, rates, accepted)

    def _iterate(self, iteration, solid_residual, fluid_residuals, rates):
        """Do one Newton step of the fluid, one of the solid under the new force, and accelerate the solid's displacement."""
        self._renew_tangents(iteration, rates)
        before = self.solid.unknowns.copy()
        self.fluid.correct(fluid_residuals)
        solid_residual = self.solid.residual(self.flow(self.fluid.residual(self.carrier())))
        self.solid.correct(solid_residual.total)
        if self._sees == "trial" and self._both:
            self.solid.unknowns = self._accelerator.next(before, self.solid.unknowns.copy())
            self.motion.follow(self.solid.end_displacement)

    def _dot(self, a, b):
        return self.dot(a * self._interface, b)

    def accept(self):
        """Make the trial states the accepted ones, the mesh where the solid is."""
        if self._sees != "trial":
            self.motion.follow(self.solid.end_displacement)
        self.motion.accept()
        super().accept()

    def reset(self):
        """Forget the trial states."""
        super().reset()
        self.motion.reset()

    def state(self):
        """Return the arrays a restart needs, name -> (n_owned, ...)."""
        return super().state() | {f"mesh.{name}": array for name, array in self.motion.state().items()}

    def load_state(self, arrays, memory, schemes, rates):
        """Continue from `state` and `memory`; schemes and rates are those of the next step."""
        self.motion.load_state({name.removeprefix("mesh."): a for name, a in arrays.items() if name.startswith("mesh.")})
        super().load_state(arrays, memory, schemes, rates)
