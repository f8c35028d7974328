"""The saturated porous medium: block Gauss-Seidel over fluid and skeleton on coincident meshes."""

import numpy as np

from .medium import PorousMedium

# Guards of Aitken's factor by split.  The corrected split's error factors lie between 0 and 0.5 (measured 0.45 at low
# permeability: at grid scale the fixed-stress Laplacian is up to twice the discrete answer of the skeleton), so the best
# factor is near 1.2; the plain split's go far below -1 and want a small one.
GUARDS = {"corrected": (0.9, 1.3), "plain": (0.05, 1.6)}
PATIENCE = 3  # sweeps between two renewals of lagged tangents within a step


class PorousCoupling(PorousMedium):
    """Fluid with frozen skeleton, then skeleton with new pressure and drag, one Newton step each, to true residuals of zero.

    The accelerated vector holds all that the next sweep remembers, v_f, p and u, each scaled by the norm of an increment.  The
    first sweep of a step is taken as it is: it only brings the fluid to the predicted skeleton (measured: accelerating it
    doubles the iterations).
    """

    advice = 'try a smaller step, coupling.accelerator = "anderson" or more coupling.max_iterations'

    def __init__(self, solid, fluid, comm, tolerance, max_iterations, accelerator, full_newton):
        """Take the medium, an accelerator made with `dot`, and whether tangents are new in every sweep or lagged."""
        super().__init__(solid, fluid, comm, tolerance, max_iterations)
        self._accelerator, self._full_newton = accelerator(self.dot), full_newton
        self._linear = solid.is_linear and fluid.is_linear

    def _begin(self, rates, accepted):
        self._accelerator.restart()
        self._scale, self._renewed_at = None, 0
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

    def _iterate(self, iteration, solid_residual, fluid_residuals, rates):
        """Do one Gauss-Seidel sweep and, from the second on, replace the trial state by the accelerated one."""
        self._renew_tangents(iteration, rates)
        fluid, solid = self.fluid, self.solid
        before = fluid.unknowns, solid.unknowns
        fluid.correct(fluid_residuals)
        solid.correct(solid.residual(fluid.flow()))
        if iteration == 0:
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
