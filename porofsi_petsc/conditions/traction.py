"""A given traction."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..kernels.surface import surface_load
from ..registry import parameter
from .condition import State, Surface, SurfaceCondition


@dataclass
class DeadLoad(SurfaceCondition):
    """A load ∮ N_a g dA of formulas per reference area: of time and reference position
    alone.
    """

    dead = True

    def bind(self, surface: Surface) -> None:
        """Prepare the quadrature."""
        super().bind(surface)
        self._rule = surface.rule(2 * surface.order + 1)
        self._dA = np.linalg.norm(surface.normal(self._rule), axis=-1)
        self._points = (self._rule.N @ surface.X).reshape(-1, surface.X.shape[-1])

    def load_of(self, formula: Callable[[float, np.ndarray], np.ndarray], t: float) -> np.ndarray:
        """Return ∮ N_a g dA of one formula g(t, X), (F, Af)."""
        values = formula(t, self._points).reshape(self._dA.shape)
        return surface_load(self._rule.N, self._dA, values[..., None])[..., 0]


@dataclass
class Traction(DeadLoad):
    """Traction per reference area that keeps its direction: of the mixture on a porous medium, σ n
    on a free fluid.
    """

    behind = ("porous", "solid", "fluid")
    excludes = {"porous": ("displacement",), "solid": ("displacement",), "fluid": ("velocity",)}

    value: Any = parameter("Pa", "components", kind="vector", example={"y": -1.0})

    def residual(self, state: State) -> np.ndarray:
        """Return -∮ N_a t dA, (F, Af, d) [N]."""
        loads = np.zeros(self.surface.X.shape)
        for component, formula in self.value.items():
            loads[..., component] = -self.load_of(formula, state.t)
        return loads
