"""The partitioned iteration in which the fluid knows the whole answer of the solid to a motion of
the interface.
"""

from typing import Any

import numpy as np

from ..accelerators import Plain
from ..phases.condensed import CondensedSolid
from ..phases.coupling_data import Rates
from ..phases.residual import Residual
from .interface import InterfaceMedium, InterfaceSweep
from .protocols import InterfaceFluid

# Part of the residual that a sweep leaves with tangents that fit: 0.1 to 0.2, that of the motion of
# the mesh.
SLOW = 0.3


class _CondensedSweep(InterfaceSweep):
    """Robin-Neumann with the solid's stiffness S as the operator: one sweep is a Newton step of
    solid and fluid together.

        fluid  R_f + R_s + S (v_f - v_s)/c_v = 0        solid  R_s + R_f = S (u_f - u_s)

    with R the residuals on the interface after the interior of the solid is in equilibrium (block
    elimination): a solid solve under the present force, û; a fluid solve with S/c_v in its matrix,
    right side -S û on the interface; a solid solve with the force S (δv_f/c_v - û) there, which
    makes its velocity that of the fluid.  Each phase keeps its own matrix and solver. With the same
    tangent in all three no added mass and no stiffness ratio is left, so nothing is accelerated:
    what remains is the motion of the mesh, and what makes tangents old.
    """

    fluid: InterfaceFluid

    def __init__(self, *medium: Any, answer: CondensedSolid) -> None:
        """Take what `Medium` takes, whether tangents are new in every sweep, and the
        `phases.condensed.CondensedSolid`.
        """
        solid, fluid, comm, tolerance, max_iterations, full_newton = medium
        super().__init__(
            solid,
            fluid,
            comm,
            tolerance,
            max_iterations,
            lambda dot, name=None: Plain(dot),
            full_newton,
        )
        self._answer = answer
        self._made: tuple[int, int] | None = None

    @property
    def remedies(self) -> tuple[str, ...]:
        """Return what a step that failed is tried with, in turn: there is nothing to accelerate."""
        return tuple(name for name in super().remedies if name != "accelerator")

    def _alternatives(self) -> dict[str, str]:
        """Return name -> what to try."""
        return {
            name: text for name, text in super()._alternatives().items() if name != "accelerator"
        }

    def _dot(self, a: np.ndarray, b: np.ndarray) -> float:
        return self.dot(a, b)

    def _slow(self, iteration: int) -> bool:
        """Return whether a sweep has left more than SLOW of the residual: with fitting tangents it
        is a Newton step.
        """
        return iteration > self._renewed_at + 1 and self.convergence.contraction > SLOW

    def _condense(self, rates: Rates) -> None:
        """Put the answer of the solid into the matrix of the fluid where one of the tangents is
        new.
        """
        made = self.solid.block.assemblies, self.fluid.block.assemblies
        if made == self._made:
            return
        if self._made is None or made[0] != self._made[0]:
            self._answer.renew()
        self.fluid.carry(self._answer.stiffness / rates.c_v)
        self._made = made

    def _iterate(
        self,
        iteration: int,
        solid_residual: Residual,
        fluid_residuals: tuple[Residual, Residual],
        rates: Rates,
    ) -> None:
        self._renew_tangents(iteration, rates)
        self._condense(rates)
        alone = self.solid.solve(-solid_residual.total)
        before = self.fluid.flow().velocity
        self.fluid.correct(fluid_residuals, self._answer.force(-alone))
        moved = (self.fluid.flow().velocity - before)[: len(alone)] / rates.c_v
        self.solid.add(alone + self.solid.solve(self._answer.force(moved - alone)))


class CondensedCoupling(InterfaceMedium, _CondensedSweep):
    """The partitioned iteration of conforming sides in two dimensions, strong."""
