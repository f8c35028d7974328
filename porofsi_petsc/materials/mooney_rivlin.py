"""The law of Mooney and Rivlin for rubber and soft tissue, compressible."""

from dataclasses import dataclass

import numpy as np

from ..registry import parameter
from ..tensors import stacked
from .elastic import ElasticLaw
from .from_energy import invariants
from .points import two_invariant_stress, two_invariant_tangent
from .strain import kinematics, logarithm


@dataclass(frozen=True)
class TwoInvariants(ElasticLaw):
    """Ψ = c1 (I1 - 3) + c2 (I2 - 3) - (2 c1 + 4 c2) ln J + (λ - 4 c2)/2 (ln J)²; a law gives c2.

    c1 = μ/2 - c2, so that λ and μ are those of small strain.
    """

    @property
    def second_constant(self) -> float:
        """Return c2 [Pa]."""
        raise NotImplementedError

    @property
    def _constants(self):
        """Return c2, d = 2 c1 + 4 c2 and λ - 4 c2 [Pa]."""
        c2 = self.second_constant
        return c2, self.mu + 2 * c2, self.lam - 4 * c2

    def energy(self, H: np.ndarray) -> np.ndarray:
        """Return Ψ, (...)."""
        c2, d, lam = self._constants
        first, second, J_1 = invariants(H)
        log = logarithm(J_1)
        return (self.mu / 2 - c2) * first + c2 * second - d * log + lam / 2 * log**2

    def stress(self, H: np.ndarray) -> np.ndarray:
        """Return P = 2 c1 F + 2 c2 F (I1 I - C) + ((λ - 4 c2) ln J - d) F⁻ᵀ, (..., d, d)."""
        c2, d, lam = self._constants
        Finv, J_1 = kinematics(H)
        return two_invariant_stress(H, Finv, lam * logarithm(J_1), c2, d)

    def tangent(self, H: np.ndarray) -> np.ndarray:
        """Return dP_iJ/dF_kL, (..., d, d, d, d), see `two_invariant_tangent`."""
        Finv, J_1 = kinematics(H)
        return self._tangent(H, Finv, self._constants[2] * logarithm(J_1))

    def mixed_tangent(self, H: np.ndarray, before: np.ndarray) -> np.ndarray:
        """Do what `ElasticLaw.mixed_tangent` says, ln J = ln J_b + F_b⁻ᵀ:(H - H_b)."""
        Finv, J_1 = kinematics(before)
        log = logarithm(J_1) + np.einsum("pJi,piJ->p", Finv, stacked(H - before))
        return self._tangent(H, kinematics(H)[0], self._constants[2] * log)

    def _tangent(self, H, Finv, volumetric):
        c2, d, lam = self._constants
        return two_invariant_tangent(H, Finv, volumetric, lam, c2, d)


@dataclass(frozen=True)
class MooneyRivlin(TwoInvariants):
    """Ψ = c1 (I1 - 3) + c2 (I2 - 3) - (2 c1 + 4 c2) ln J + (λ - 4 c2)/2 (ln J)², c2 = share μ/2.

    c1 = (1 - share) μ/2; without a share it would be `neo_hookean` (Holzapfel, Nonlinear Solid
    Mechanics, 6.147, with U = (ln J)²).
    """

    share: float = parameter(
        "-", "part of μ that the second invariant has", above=0.0, at_most=1.0, example=0.3
    )

    @property
    def second_constant(self) -> float:
        """Return c2 [Pa]."""
        return self.share * self.mu / 2
