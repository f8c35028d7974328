"""The law of Saint-Venant and Kirchhoff: linear in the strain of Green and Lagrange."""

from typing import Any

import numpy as np

from ..tensors import scaled_identity, trace, transpose
from .elastic import ElasticLaw
from .points import kirchhoff_stress, kirchhoff_tangent
from .strain import deformation, green_strain, linear_strain


class SaintVenantKirchhoff(ElasticLaw):
    """Ψ = λ/2 (tr E)² + μ E:E."""

    lowest_ratio = 1 / np.sqrt(3)  # the confined stress has its extremum there

    def confined(self, J: float | np.ndarray) -> Any:
        """Return E_c J (J² - 1)/2."""
        return self.oedometer_modulus * J * (J**2 - 1) / 2

    def energy(self, H: np.ndarray) -> np.ndarray:
        """Return Psi, (...)."""
        E = green_strain(H)
        return self.lam / 2 * trace(E) ** 2 + self.mu * np.einsum("...ij,...ij->...", E, E)

    def stress(self, H: np.ndarray) -> np.ndarray:
        """Return P = F S, S = lambda tr(E) I + 2 mu E, (..., d, d)."""
        return kirchhoff_stress(H, self._second_piola(green_strain(H)))

    def tangent(self, H: np.ndarray) -> np.ndarray:
        """Return dP_iJ/dF_kL = delta_ik S_JL + F_iM C_MJNL F_kN, (..., d, d, d, d), C that of
        linear elasticity.
        """
        return kirchhoff_tangent(H, self._second_piola(green_strain(H)), self.lam, self.mu)

    def mixed_tangent(self, H: np.ndarray, before: np.ndarray) -> np.ndarray:
        """Do what `ElasticLaw.mixed_tangent` says, E = E_b + sym F_b^T (H - H_b)."""
        F = deformation(before)
        change = H - before
        S = self._second_piola(green_strain(before) + linear_strain(transpose(F) @ change))
        return kirchhoff_tangent(H, S, self.lam, self.mu)

    def _second_piola(self, E):
        return scaled_identity(self.lam * trace(E), E.shape[-1]) + 2 * self.mu * E
