"""An open boundary where the flow may come back in."""

from dataclasses import dataclass

import numpy as np

from ..kernels.surface import backflow_residual, backflow_tangent
from ..registry import parameter
from .condition import Slope, State, Surface, SurfaceCondition


@dataclass
class Backflow(SurfaceCondition):
    """Part β of the kinetic energy that convection carries in through an open boundary which a
    traction (β/2) ρ (c·n)_- v takes away again (Bertoglio et al. 2018); zero where the fluid
    leaves.
    """

    behind = ("fluid",)

    value: float = parameter("-", "β, 1: all of it", at_least=0.0, default=0.0, example=0.5)

    def bind(self, surface: Surface) -> None:
        """Take a rule that is exact on flat facets while all of one flows in."""
        super().bind(surface)
        self._rule = surface.rule(3 * surface.order)
        self._density = surface.of_material("rho_fR")

    def residual(self, state: State) -> np.ndarray:
        """Return `kernels.surface.backflow_residual`, (F, Af, d) [N]."""
        return backflow_residual(*self._arguments(state))

    def tangent(self, state: State, slope: Slope) -> np.ndarray:
        """Return its derivative by v, (F, Af, d, Af, d) [N s/m]."""
        return slope.v * backflow_tangent(*self._arguments(state))

    def _arguments(self, state):
        gather = self.surface.gather
        normal = self.surface.normal(self._rule, state.u)
        return (
            self._rule.N,
            normal,
            self._density,
            self.value,
            gather(state.v),
            gather(state.c),
        )
