"""The stress of a law beside one that is there without strain."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from .strain import deformation, green_strain, linear_strain


@dataclass(frozen=True)
class Prestressed:
    """P = P°(H) + F σ_0: an initial stress σ_0 (..., 3, 3) [Pa] at the points of H, symmetric,
    tension positive, Cauchy's in the reference configuration; it turns with the body as a second
    Piola-Kirchhoff stress.  Under a law for small strain F = I.

    law : whose P° is; stress, tangent and energy of H (..., d, d)
    """

    law: Any
    initial: np.ndarray

    @property
    def small_strain(self) -> bool:
        """Return whether the law has a stress that is linear in H."""
        return self.law.small_strain

    @property
    def anisotropic(self) -> bool:
        """Return whether the law is."""
        return self.law.anisotropic

    def energy(self, H: np.ndarray) -> np.ndarray:
        """Return Ψ° + σ_0:E, (...) [J/m³], E = ε at small strain: zero at rest, negative where σ_0
        does work.
        """
        E = linear_strain(H) if self.small_strain else green_strain(H)
        return self.law.energy(H) + np.einsum("...ij,...ij->...", self._of(H), E)

    def stress(self, H: np.ndarray) -> np.ndarray:
        """Return P, (..., d, d) [Pa]."""
        S = self._of(H)
        return self.law.stress(H) + (S if self.small_strain else deformation(H) @ S)

    def tangent(self, H: np.ndarray) -> np.ndarray:
        """Return dP_iJ/dF_kL = dP°_iJ/dF_kL + δ_ik σ_0JL, (..., d, d, d, d) [Pa]."""
        return self._whole(self.law.tangent(H), H)

    def mixed_tangent(self, H: np.ndarray, before: np.ndarray) -> np.ndarray:
        """Do what `ElasticLaw.mixed_tangent` says."""
        return self._whole(self.law.mixed_tangent(H, before), H)

    def _of(self, H):
        """Return σ_0 in the directions of H, (..., d, d)."""
        d = H.shape[-1]
        return self.initial[..., :d, :d]

    def _whole(self, A, H):
        if self.small_strain:
            return A
        S, A = self._of(H), A.copy()
        for i in range(H.shape[-1]):
            A[..., i, :, i, :] += S
        return A
