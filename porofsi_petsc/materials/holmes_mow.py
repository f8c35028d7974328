"""The exponential law of Holmes and Mow for cartilage and other hydrated soft tissue."""

from dataclasses import dataclass

import numpy as np

from ..registry import parameter
from .mooney_rivlin import TwoInvariants
from .points import add_dyads


@dataclass(frozen=True)
class HolmesMow(TwoInvariants):
    """Ψ = E_c/(4β) (e^Q - 1), Q = β/E_c [(2μ - λ) (I1 - 3) + λ (I2 - 3) - 2 E_c ln J], E_c = λ +
    2μ; for λ <= 2μ (Holmes & Mow, J. Biomech. 23 (1990) 1145).

    Q = 4β/E_c Ψ_2 with the Ψ_2 of `TwoInvariants` whose c2 = λ/4.
    """

    most_lame_ratio = 2.0

    stiffening: float = parameter("-", "β", above=0.0, at_most=100.0, example=0.5)

    @property
    def second_constant(self) -> float:
        """Return c2 [Pa]."""
        return self.lam / 4

    @property
    def _rate(self):
        """Return 4β/E_c [1/Pa]."""
        return 4 * self.stiffening / self.oedometer_modulus

    def energy(self, H: np.ndarray) -> np.ndarray:
        """Return Ψ, (...)."""
        return np.expm1(self._rate * super().energy(H)) / self._rate

    def stress(self, H: np.ndarray) -> np.ndarray:
        """Return P = e^Q P_2, (..., d, d)."""
        return self._growth(H)[..., None, None] * super().stress(H)

    def tangent(self, H: np.ndarray) -> np.ndarray:
        """Return dP/dF = e^Q (dP_2/dF + 4β/E_c P_2 ⊗ P_2), (..., d, d, d, d)."""
        A = super().tangent(H)
        growth = self._growth(H)
        add_dyads(A, super().stress(H), self._rate * growth, growth)
        return A

    def mixed_tangent(self, H: np.ndarray, before: np.ndarray) -> np.ndarray:
        """Return the tangent: such a material is not nearly incompressible."""
        return self.tangent(H)

    def _growth(self, H):
        """Return e^Q, (...)."""
        return np.exp(self._rate * super().energy(H))
