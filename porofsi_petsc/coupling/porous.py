"""The saturated porous medium: block Gauss-Seidel over fluid and skeleton on coincident meshes."""

import itertools

import numpy as np

from .medium import PorousMedium

# Guards of Aitken's factor by split.  The corrected split's error factors lie between 0 and 0.5 (measured 0.45 at low
# permeability: at grid scale the fixed-stress Laplacian is up to twice the discrete answer of the skeleton), so the best
# factor is near 1.2; the plain split's go far below -1 and want a small one.
GUARDS = {"corrected": (0.9, 1.3), "plain": (0.05, 1.6)}
PATIENCE = 2  # sweeps between two renewals of lagged tangents within a step


class PorousCoupling(PorousMedium):
    """Skeleton with frozen pressure and drag, then fluid on the new skeleton, one Newton step each, to true residuals of zero.

    The fluid comes last, so that a sweep ends, and is judged, with a drag that fits the pressure.

    The accelerated vector holds all that the next sweep remembers, v_f, p and u of every node, (n_owned, 2 d + 1); its inner
    product divides each of them by the norm of an increment.  The first sweep of a step is taken as it is: it
    answers the new load, the others the coupling (measured: else IQN-ILS, which reuses old answers, takes one sweep more).
    """

    advice = 'try a smaller step, another coupling.accelerator ("anderson", "iqn_ils") or more coupling.max_iterations'

    def __init__(self, solid, fluid, comm, tolerance, max_iterations, accelerator, full_newton):
        """Take the medium, an accelerator made with `dot`, and whether tangents are new in every sweep or lagged."""
        super().__init__(solid, fluid, comm, tolerance, max_iterations)
        self._accelerator, self._full_newton = accelerator(self._weighted_dot), full_newton
        self._linear = solid.is_linear and fluid.is_linear

    def _begin(self, rates, accepted):
        self._accelerator.begin_step()
        self._weights, self._renewed_at = None, 0
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
        before = self._unknowns
        velocity = solid.velocity
        solid.correct(solid_residual.total + fluid.unbalanced(fluid_residuals[0]))
        skeleton = solid.skeleton()
        fluid.drag_along(skeleton.velocity - velocity)
        fluid.follow(skeleton)
        fluid.correct(fluid.residual(skeleton))
        if iteration == 0:
            return
        after = self._unknowns
        if self._weights is None:
            self._weights = self._inverse_squares(after - before)
        self._unknowns = self._accelerator.next(before, after)

    @property
    def _unknowns(self):
        """Return v_f, p and u of the trial state on the owned nodes, (n_owned, 2 d + 1)."""
        return np.column_stack([self.fluid.unknowns, self.solid.unknowns])

    @_unknowns.setter
    def _unknowns(self, values):
        d = self.solid.mesh.dim
        self.fluid.unknowns, self.solid.unknowns = values[:, : d + 1], values[:, d + 1 :]

    def _inverse_squares(self, increment):
        """Return 1/|increment of the field|² of every component, (2 d + 1,); 1 for a field that does not change."""
        d = self.solid.mesh.dim
        fields = (increment[:, :d], increment[:, d], increment[:, d + 1 :])
        return np.repeat([1 / (self.dot(field, field) or 1.0) for field in fields], [d, 1, d])

    def _weighted_dot(self, a, b):
        return self.dot(a * self._weights, b)

    # -- what a step leaves to the next ------------------------------------------------------------------------------------

    def reset(self):
        """Forget the trial states and what the accelerator has learnt, and ask for new tangents."""
        super().reset()
        self._accelerator.restart()

    def state(self):
        """Return the arrays a restart needs, name -> (n_owned, ...), with the vectors that the accelerator reuses."""
        pairs = [pair for step in self._accelerator.columns() for pair in step]
        names = ("residual", "image")
        return super().state() | {
            f"accelerator.{i}.{name}": a for i, pair in enumerate(pairs) for name, a in zip(names, pair, strict=True)
        }

    def memory(self):
        """Return the numbers a restart needs beside the arrays."""
        return super().memory() | {"columns": [len(step) for step in self._accelerator.columns()]}

    def load_state(self, arrays, memory, schemes, rates):
        """Continue from `state` and `memory`; schemes and rates are those of the next step."""
        super().load_state(arrays, memory, schemes, rates)
        names, number = ("residual", "image"), itertools.count()
        counts = memory.get("columns", ())
        steps = [
            [tuple(arrays[f"accelerator.{i}.{name}"] for name in names) for i in itertools.islice(number, n)] for n in counts
        ]
        self._accelerator.load(steps)
