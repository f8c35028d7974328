"""A given pressure from outside: on the reference surface, or following it."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..kernels.surface import pressure_load, pressure_load_by_normal
from ..registry import parameter
from .condition import Slope, State, Surface, SurfaceCondition


@dataclass
class Pressure(SurfaceCondition):
    """A pressure p of a formula that pushes along the outward normal, inwards where it is
    positive.
    """

    behind = ("porous", "solid", "fluid")
    excludes = {"fluid": ("windkessel",)}
    wants_normal_motion = True

    value: Any = parameter("Pa", "p, inwards", kind="formula", example=0.7)

    def bind(self, surface: Surface) -> None:
        """Prepare the quadrature: exact for a linear p on flat facets, and where they move."""
        super().bind(surface)
        self._rule = surface.rule(3 * surface.order)
        self._points = (self._rule.N @ surface.X).reshape(-1, surface.X.shape[-1])

    def _pressure(self, t):
        """Return p at the points of the rule, (F, Q) [Pa]."""
        return self.value(t, self._points).reshape(-1, len(self._rule.N))


@dataclass
class DeadPressure(Pressure):
    """Traction -p N per reference area, N the outward normal of the reference: on a porous medium
    that of the mixture; it neither turns nor grows with the surface.
    """

    dead = True

    def residual(self, state: State) -> np.ndarray:
        """Return ∮ N_a p N dA0, (F, Af, d) [N]."""
        normal = self.surface.normal(self._rule)
        return pressure_load(self._rule.N, normal, self._pressure(state.t))


@dataclass
class FollowerPressure(Pressure):
    """Traction -p n per current area, n the outward normal of the surface where it is: on a porous
    medium that of the mixture.  Its tangent is exact, and not symmetric where the surface has a
    free edge.
    """

    follows = True

    def residual(self, state: State) -> np.ndarray:
        """Return ∮ N_a p n dA, (F, Af, d) [N]."""
        normal = self.surface.normal(self._rule, state.u)
        return pressure_load(self._rule.N, normal, self._pressure(state.t))

    def tangent(self, state: State, slope: Slope) -> np.ndarray | None:
        """Return its derivative by the positions of the nodes, (F, Af, d, Af, d) [N/m]."""
        if not slope.u:
            return None
        change = self.surface.normal_by_positions(self._rule, state.u)
        return slope.u * pressure_load_by_normal(self._rule.N, change, self._pressure(state.t))
