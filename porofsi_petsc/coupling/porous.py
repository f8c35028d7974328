"""The saturated porous medium: block Gauss-Seidel over fluid and skeleton on coincident meshes."""

import numpy as np

from ..phases.coupling_data import MeshState, Rates
from ..phases.residual import Residual
from .partitioned import PartitionedMedium
from .protocols import PoreFluid

# Guards of Aitken's factor by split.  The corrected split's error factors lie between -1/2 and 1/2
# for every Poisson ratio (`kernels.solid.volumetric_compliance`), for which 1/(1 + 1/2) to 1/(1 -
# 1/2) are best; the plain split's go far below -1 and want a small one.
GUARDS = {"corrected": (0.6, 2.0), "plain": (0.05, 1.6)}


class DragSweep(PartitionedMedium):
    """Skeleton with a frozen flow, then fluid on the new skeleton, one Newton step each, to true
    residuals of zero.

    The fluid comes last, so that a sweep ends, and is judged, with a drag that fits the pressure.

    The accelerated vector holds all that the next sweep remembers, v_f, p and u of every node,
    (n_owned, 2 d + 1); its inner product divides each of them by the norm of an increment.  The
    first sweep of a step is taken as it is: it answers the new load, the others the coupling
    (measured: else IQN-ILS, which reuses old answers, takes one sweep more).
    """

    def _begin(self, t: float, rates: Rates, accepted: MeshState) -> None:
        super()._begin(t, rates, accepted)
        self._weights: np.ndarray | None = None

    def _iterate(
        self,
        iteration: int,
        solid_residual: Residual,
        fluid_residuals: tuple[Residual, Residual],
        rates: Rates,
    ) -> None:
        """Do one Gauss-Seidel sweep and, from the second on, replace the trial state by the
        accelerated one.
        """
        if self._renew_tangents(iteration, rates):
            self._accelerator.restart()
        before = self._unknowns
        mesh_state = self._corrected_mesh(solid_residual, fluid_residuals[0])
        self.fluid.follow(mesh_state)
        self.fluid.correct(self.fluid.residual(mesh_state))
        if iteration == 0:
            return
        after = self._unknowns
        if self._weights is None:
            self._weights = self._inverse_squares(after - before)
        self._unknowns = self._accelerator.next(before, after)

    def _corrected_mesh(self, residual: Residual, momentum: Residual) -> MeshState:
        """Correct the skeleton, whose residual is given beside that of the fluid's momentum, and
        return what carries the fluid then.
        """
        raise NotImplementedError

    @property
    def _unknowns(self) -> np.ndarray:
        """Return v_f, p and u of the trial state on the owned nodes, (n_owned, 2 d + 1)."""
        return np.column_stack([self.fluid.unknowns, self.solid.unknowns])

    @_unknowns.setter
    def _unknowns(self, values: np.ndarray) -> None:
        d = self.solid.mesh.dim
        self.fluid.unknowns = values[:, : d + 1]
        self.solid.unknowns = values[:, d + 1 :]

    def _inverse_squares(self, increment: np.ndarray) -> np.ndarray:
        """Return 1/|increment of the field|² of every component, (2 d + 1,); 1 for a field that
        does not change.
        """
        d = self.solid.mesh.dim
        fields = (increment[:, :d], increment[:, d], increment[:, d + 1 :])
        return np.repeat([1 / (self.dot(field, field) or 1.0) for field in fields], [d, 1, d])

    def _dot(self, a: np.ndarray, b: np.ndarray) -> float:
        return self.dot(a * self._weights, b)


class PorousCoupling(DragSweep):
    """The sweeps of a porous medium, its skeleton with frozen pressure and drag."""

    fluid: PoreFluid

    def _corrected_mesh(self, residual: Residual, momentum: Residual) -> MeshState:
        solid = self.solid
        velocity = solid.velocity
        solid.correct(residual.total + self.fluid.unbalanced(momentum))
        mesh_state = self.mesh_state()
        self.fluid.drag_along(mesh_state.velocity - velocity)
        return mesh_state
