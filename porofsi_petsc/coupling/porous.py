"""The saturated porous medium: block Gauss-Seidel over fluid and skeleton on coincident meshes."""

import numpy as np

from .convergence import Convergence

# Guards of Aitken's factor by split.  The corrected split's error factors lie between 0 and 0.5 (measured 0.45 at low
# permeability: at grid scale the fixed-stress Laplacian is up to twice the discrete answer of the skeleton), so the best
# factor is near 1.2; the plain split's go far below -1 and want a small one.
PATIENCE = 3  # sweeps between two renewals of lagged tangents within a step
GUARDS = {"corrected": (0.9, 1.3), "plain": (0.05, 1.6)}


class PorousCoupling:
    """Fluid with frozen skeleton, then skeleton with new pressure and drag, one Newton step each, to true residuals of zero.

    The accelerated vector holds all that the next sweep remembers, v_f, p and u, each scaled by the norm of an increment.  The
    first sweep of a step is taken as it is: it only brings the fluid to the predicted skeleton (measured: accelerating it
    doubles the iterations).
    """

    def __init__(self, solid, fluid, comm, accelerator, tolerance, max_iterations, full_newton):
        """Take the phases, an accelerator made with `dot`, what ends the iteration; full_newton: new tangents in every sweep."""
        self.solid, self.fluid, self._comm = solid, fluid, comm
        self._accelerator = accelerator(self.dot)
        self._cap, self._full_newton = max_iterations, full_newton
        self.convergence = Convergence(tolerance)
        self._linear = solid.is_linear and fluid.is_linear
        self.iterations, self.residuals = 0, None

    def dot(self, a, b):
        """Return the inner product of two distributed vectors (collective)."""
        return float(self._comm.allreduce(np.vdot(a, b)))

    def step(self, schemes, rates, t, step):
        """Solve one step from time t (nothing is accepted); raise ConvergenceError at the cap.

        schemes : (solid, fluid) time schemes; rates : `phases.transfer.Rates`.
        """
        self._begin(schemes, rates, t)
        self._accelerator.restart()
        self.convergence.start_step()
        self._scale, self._renewed_at = None, 0
        for iteration in range(self._cap + 1):
            self.fluid.follow(self.solid.skeleton())
            fluid_residuals = self.fluid.residual(self.solid.skeleton())
            solid_residual = self.solid.residual(self.fluid.flow())
            if self.convergence.reached(_norms(fluid_residuals, solid_residual)):
                self.iterations, self.residuals = iteration, (solid_residual, fluid_residuals)
                return
            if iteration < self._cap:
                self._renew_tangents(iteration, rates)
                self._sweep(fluid_residuals, rates, iteration == 0)
        self._fail(t, step)

    def _begin(self, schemes, rates, t):
        solid_scheme, fluid_scheme = schemes
        accepted = self.solid.accepted_skeleton()
        self.fluid.begin_step(fluid_scheme, rates, t, accepted)
        self.solid.begin_step(solid_scheme, t)
        if not self._full_newton:
            self.fluid.prepare_tangent(rates, self.iterations, accepted)
            self.solid.prepare_tangent(rates, self.iterations)

    def _renew_tangents(self, iteration, rates):
        """Renew both tangents at the trial state: in every sweep of full Newton, else where lagged ones are slow or far away."""
        worn = not (self._linear or self._full_newton) and (self.fluid.strayed(self.solid.skeleton()) or self._slow(iteration))
        if self._full_newton or worn:
            self.fluid.renew_tangent(rates, self.solid.skeleton())
            self.solid.renew_tangent(rates)
            self._renewed_at = iteration
        if worn:
            self._accelerator.restart()

    def _slow(self, iteration):
        return iteration - self._renewed_at >= PATIENCE and self.convergence.slow

    def _sweep(self, fluid_residuals, rates, first):
        """Do one Gauss-Seidel sweep and, from the second on, replace the trial state by the accelerated one."""
        fluid, solid = self.fluid, self.solid
        before = fluid.unknowns, solid.unknowns
        fluid.correct(fluid_residuals)
        solid.correct(solid.residual(fluid.flow()))
        if first:
            return
        after = fluid.unknowns, solid.unknowns
        if self._scale is None:
            self._scale = self._increment_norms(before, after)
        x, F = self._pack(*before), self._pack(*after)
        self._unpack(self._accelerator.next(x, F))

    def _increment_norms(self, before, after):
        """Return the norms of the increments of v_f, p and u; 1 for a field that does not change."""
        d = self.solid.mesh.dim
        fluid, solid = after[0] - before[0], after[1] - before[1]
        norms = [np.sqrt(self.dot(part, part)) for part in (fluid[:, :d].copy(), fluid[:, d].copy(), solid)]
        return [norm or 1.0 for norm in norms]

    def _pack(self, fluid, solid):
        velocity, pressure, displacement = self._scale
        d = self.solid.mesh.dim
        return np.concatenate([(fluid[:, :d] / velocity).ravel(), fluid[:, d] / pressure, (solid / displacement).ravel()])

    def _unpack(self, x):
        velocity, pressure, displacement = self._scale
        n, d = self.solid.mesh.n_owned, self.solid.mesh.dim
        v, p, u = np.split(x, [n * d, n * (d + 1)])
        self.fluid.unknowns = np.column_stack([v.reshape(n, d) * velocity, p * pressure])
        self.solid.unknowns = u.reshape(n, d) * displacement

    def _fail(self, t, step):
        self.reset()
        raise self.convergence.failure(
            t, step, 'try a smaller step, coupling.accelerator = "anderson" or more coupling.max_iterations'
        )

    def accept(self):
        """Make the trial states the accepted ones."""
        self.fluid.accept()
        self.solid.accept()

    def reset(self):
        """Forget the trial states and ask for new tangents."""
        for phase in (self.fluid, self.solid):
            phase.reset()
            phase.expire_tangent()

    # -- what the run looks at --------------------------------------------------------------------------------------------

    def collocated(self):
        """Return v_s, v_f (n_owned, d) and p (n_owned, 1) of the trial state on the collocation level."""
        n, flow = self.solid.mesh.n_owned, self.fluid.flow()
        return self.solid.velocity[:n], flow.velocity[:n], flow.pressure[:n, None]

    def energies(self):
        """Return kinetic and elastic energy of the accepted state [J] (collective)."""
        kinetic, elastic = self.solid.energies()
        return kinetic + self.fluid.kinetic_energy(self.solid.accepted_skeleton()), elastic

    def state(self):
        """Return the arrays a restart needs, name -> (n_owned, ...)."""
        phases = {"solid": self.solid, "fluid": self.fluid}
        return {f"{name}.{key}": array for name, phase in phases.items() for key, array in phase.state().items()}

    def memory(self):
        """Return the numbers a restart needs beside the arrays."""
        return {
            "solid": self.solid.memory(),
            "fluid": self.fluid.memory(),
            "iterations": self.iterations,
            "largest": self.convergence.largest,
        }

    def load_state(self, arrays, memory, schemes, rates):
        """Continue from `state` and `memory`; schemes and rates are those of the next step."""
        parts = {name: {} for name in ("solid", "fluid")}
        for key, array in arrays.items():
            name, _, field = key.partition(".")
            parts[name][field] = array
        self.solid.load_state(parts["solid"], memory["solid"], rates)
        self.fluid.load_state(parts["fluid"], memory["fluid"], schemes[1], rates, self.solid.skeleton_at)
        self.iterations, self.convergence.largest = memory["iterations"], memory["largest"]


def _norms(fluid_residuals, solid_residual):
    momentum, volume = fluid_residuals
    return {"fluid momentum": momentum.norms(), "volume": volume.norms(), "solid momentum": solid_residual.norms()}
