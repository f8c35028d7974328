"""A seepage face: fluid leaves at the pressure outside, and none comes in."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..registry import parameter
from .condition import Slope, State, Surface, SurfaceCondition

# Of the conductance k/(γ h) of the element behind the surface.  Where fluid leaves, the pressure
# exceeds that outside by 1e-6 of its drop across this element, below the discretization error.
PENALTY = 1e6


@dataclass
class Seepage(SurfaceCondition):
    """Seepage face: the seepage flux q = n_f w·n out of it has q ≥ 0, p ≤ p_ext, q (p - p_ext) = 0.
    Fluid leaves at the pressure p_ext outside; below it the surface is impermeable.

    q = β <p - p_ext>_+ with β = 1e6 k/(γ h), h the volume of the element behind over the area of
    the facet: a penalty whose active set, p ≥ p_ext, is that of a semi-smooth Newton iteration
    (Hintermüller, Ito & Kunisch 2002).
    """

    balance = "volume"
    behind = ("porous",)
    excludes = {"porous": ("pressure", "flux", "absorbing", "no_slip")}
    otherwise = "prescribe a traction"
    unilateral = True

    value: Any = parameter("Pa", "p_ext outside", kind="formula", example=0.1)

    def bind(self, surface: Surface) -> None:
        """Take a rule that is exact on flat facets."""
        super().bind(surface)
        self._rule = surface.rule(2 * surface.order)
        self._points = (self._rule.N @ surface.X).reshape(-1, surface.X.shape[-1])
        dA = np.linalg.norm(surface.normal(self._rule), axis=-1)
        self._weight = PENALTY * surface.of_material("mobility") / surface.depth[:, None] * dA

    def _excess(self, state):
        """Return p - p_ext at the points of the rule, (F, Q) [Pa]."""
        assert state.p is not None  # of a pore fluid
        outside = self.value(state.t, self._points).reshape(-1, len(self._rule.N))
        return self.surface.gather(state.p) @ self._rule.N.T - outside

    def active(self, state: State) -> np.ndarray:
        """Return where fluid leaves, (F, Q) bool."""
        return self._excess(state) >= 0

    def residual(self, state: State) -> np.ndarray:
        """Return ∮ N_a β <p - p_ext>_+ dA, (F, Af, 1) [m³/s]."""
        flux = self._weight * np.maximum(self._excess(state), 0.0)
        return (flux @ self._rule.N)[..., None]

    def tangent(self, state: State, slope: Slope) -> np.ndarray:
        """Return its derivative by p, (F, Af, 1, Af, 1) [m³/(s Pa)]."""
        N = self._rule.N
        weight = np.where(self.active(state), self._weight, 0.0)
        return np.einsum("qa,fq,qb->fab", N, weight, N)[:, :, None, :, None]
