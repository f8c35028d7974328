"""A given seepage."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..registry import parameter
from .condition import State
from .traction import DeadLoad


@dataclass
class Flux(DeadLoad):
    """Outward seepage flux n_f w·n per reference area; where nothing is given the surface is
    impermeable.
    """

    balance = "volume"
    behind = ("porous",)
    excludes = {"porous": ("pressure", "no_slip")}
    otherwise = "prescribe a velocity"

    value: Any = parameter("m/s", "outward", kind="formula", example=1e-6)

    def residual(self, state: State) -> np.ndarray:
        """Return ∮ N_a q dA, (F, Af, 1) [m³/s]."""
        return self.load_of(self.value, state.t)[..., None]
