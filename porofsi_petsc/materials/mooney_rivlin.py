"""The law of Mooney and Rivlin for rubber and soft tissue, compressible."""

from dataclasses import dataclass

import numpy as np

from ..registry import parameter
from ..tensors import transpose
from .elastic import ElasticLaw
from .from_energy import invariants
from .strain import deformation


@dataclass(frozen=True)
class MooneyRivlin(ElasticLaw):
    """Ψ = c1 (I1 - 3) + c2 (I2 - 3) - (2 c1 + 4 c2) ln J + (λ - 4 c2)/2 (ln J)², c2 = share μ/2.

    c1 = (1 - share) μ/2, so that λ and μ are those of small strain; without a share it would be
    `neo_hookean` (Holzapfel, Nonlinear Solid Mechanics, 6.147, with U = (ln J)²).
    """

    share: float = parameter(
        "-", "part of μ that the second invariant has", above=0.0, at_most=1.0, example=0.3
    )

    @property
    def _constants(self):
        """Return c1, c2, and 2 c1 + 4 c2 and λ - 4 c2 [Pa]."""
        c1 = (1 - self.share) * self.mu / 2
        c2 = self.share * self.mu / 2
        return c1, c2, 2 * c1 + 4 * c2, self.lam - 4 * c2

    def energy(self, H: np.ndarray) -> np.ndarray:
        """Return Ψ, (...)."""
        c1, c2, d, lam = self._constants
        first, second, J_1 = invariants(H)
        log = _logarithm(J_1)
        return c1 * first + c2 * second - d * log + lam / 2 * log**2

    def stress(self, H: np.ndarray) -> np.ndarray:
        """Return P = F S, S = 2 c1 I + 2 c2 (I1 I - C) + ((λ - 4 c2) ln J - d) C⁻¹, (..., d, d)."""
        return deformation(H) @ self._second_piola(H, self._volumetric(H))[0]

    def tangent(self, H: np.ndarray) -> np.ndarray:
        """Return dP_iJ/dF_kL = δ_ik S_JL + F_iM C_MJNL F_kN, (..., d, d, d, d).

        C = 4 c2 (I ⊗ I - 1) + (λ - 4 c2) C⁻¹ ⊗ C⁻¹ + 2 (d - (λ - 4 c2) ln J) C⁻¹ ⊙ C⁻¹.
        """
        return self._tangent(H, self._volumetric(H))

    def mixed_tangent(self, H: np.ndarray, before: np.ndarray) -> np.ndarray:
        """Do what `ElasticLaw.mixed_tangent` says, ln J = ln J_b + F_b⁻ᵀ:(H - H_b)."""
        inverse = np.linalg.inv(deformation(before))
        change = np.einsum("...Ji,...iJ->...", inverse, H - before)
        return self._tangent(H, self._volumetric(before) + self._constants[3] * change)

    def _tangent(self, H, volumetric):
        _, c2, d, lam = self._constants
        S, inverse = self._second_piola(H, volumetric)
        F = deformation(H)
        identity = np.eye(H.shape[-1])
        material = lam * np.einsum("...MJ,...NL->...MJNL", inverse, inverse)
        material -= (volumetric - d)[..., None, None, None, None] * _symmetric(inverse)
        material += 4 * c2 * np.einsum("MJ,NL->MJNL", identity, identity)
        material -= 2 * c2 * _symmetric(identity)
        A = np.einsum("...iM,...MJNL,...kN->...iJkL", F, material, F, optimize=True)
        return A + np.einsum("ik,...JL->...iJkL", identity, S)

    def _volumetric(self, H):
        """Return (λ - 4 c2) ln J, (...) [Pa]."""
        return self._constants[3] * _logarithm(invariants(H)[2])

    def _second_piola(self, H, volumetric):
        """Return S [Pa] and C⁻¹, both (..., d, d); volumetric : of `_volumetric`."""
        _, c2, d, _ = self._constants
        E2 = H + transpose(H) + transpose(H) @ H
        identity = np.eye(H.shape[-1])
        inverse = np.linalg.inv(identity + E2)
        first = np.trace(E2, axis1=-2, axis2=-1)
        # What cancels at rest is taken together, so that a small strain keeps its digits:
        # 2 c1 I + 2 c2 (I1 I - C) - d C⁻¹ = d C⁻¹ (C - I) - 2 c2 (C - I) + 2 c2 (I1 - 3) I.
        S = d * (inverse @ E2) - 2 * c2 * E2 + 2 * c2 * first[..., None, None] * identity
        return S + volumetric[..., None, None] * inverse, inverse


def _logarithm(J_1):
    """Return ln J, by intention NaN at J <= 0, which marks the state."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.log1p(J_1)


def _symmetric(A):
    """Return A_MN A_JL + A_ML A_JN, (..., d, d, d, d) with indices MJNL."""
    straight = np.einsum("...MN,...JL->...MJNL", A, A)
    return straight + np.einsum("...ML,...JN->...MJNL", A, A)
