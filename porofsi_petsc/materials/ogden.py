"""The law of Ogden for rubber and soft tissue, compressible, in principal stretches."""

from dataclasses import dataclass

import numpy as np

from ..registry import parameter
from ..tensors import stacked
from .elastic import ElasticLaw
from .principal import power_stress, power_tangent, principal_strains
from .strain import kinematics, logarithm


@dataclass(frozen=True)
class Ogden(ElasticLaw):
    """Ψ = Σ_p 2 s_p μ/α_p² (λ1^α_p + λ2^α_p + λ3^α_p - 3 - α_p ln J) + λ/2 (ln J)², λ_a the
    principal stretches, Σ_p s_p = 1 (Ogden, Proc. R. Soc. A 328 (1972) 567).

    With α = 2 alone `neo_hookean`; μ_p of other books is 2 s_p μ/α_p, or s_p μ where it is over
    α_p².
    """

    exponents: tuple[float, ...] = parameter(
        "-", "α_p of one to three terms", kind="numbers", at_least=-100.0, at_most=100.0,
        example=(3.0, -2.0),
    )  # fmt: skip
    shares: tuple[float, ...] = parameter(
        "-", "s_p, parts of μ, in all 1", kind="numbers", above=0.0, at_most=1.0,
        default=(1.0,), example=(0.7, 0.3),
    )  # fmt: skip

    def __post_init__(self) -> None:
        """Raise ValueError where exponents and shares are no law."""
        if 0.0 in self.exponents or not self.exponents:
            raise ValueError(
                f"exponents: received {list(self.exponents)}, expected one to three, none of 0"
            )
        if len(self.shares) != len(self.exponents) or abs(sum(self.shares) - 1) > 1e-9:
            raise ValueError(
                f"shares: received {list(self.shares)}, expected one of each of the"
                f" {len(self.exponents)} exponents, in all 1"
            )

    @property
    def _terms(self):
        """Return 2 s_p μ/α_p [Pa] and α_p, (2, terms)."""
        alpha = np.array(self.exponents)
        return np.stack([2 * self.mu * np.array(self.shares) / alpha, alpha])

    def energy(self, H: np.ndarray) -> np.ndarray:
        """Return Ψ, (...), of e_a = ln λ_a: Σ_p 2 s_p μ/α_p² Σ_a (e^(α_p e_a) - 1 - α_p e_a) + λ/2
        (ln J)².
        """
        e = np.log1p(principal_strains(H)) / 2
        total = self.lam / 2 * logarithm(kinematics(H)[1]) ** 2
        for factor, alpha in self._terms.T:
            total += factor / alpha * (np.expm1(alpha * e) - alpha * e).sum(axis=-1)
        return total.reshape(H.shape[:-2])

    def stress(self, H: np.ndarray) -> np.ndarray:
        """Return P = F S, S_a = (Σ_p 2 s_p μ/α_p (λ_a^α_p - 1) + λ ln J)/λ_a² along the principal
        axes, (..., d, d).
        """
        return power_stress(H, self.lam * logarithm(kinematics(H)[1]), self._terms)

    def tangent(self, H: np.ndarray) -> np.ndarray:
        """Return dP_iJ/dF_kL, (..., d, d, d, d), see `power_tangent`."""
        volumetric = self.lam * logarithm(kinematics(H)[1])
        return power_tangent(H, volumetric, self.lam, self._terms)

    def mixed_tangent(self, H: np.ndarray, before: np.ndarray) -> np.ndarray:
        """Do what `ElasticLaw.mixed_tangent` says, ln J = ln J_b + F_b⁻ᵀ:(H - H_b)."""
        Finv, J_1 = kinematics(before)
        log = logarithm(J_1) + np.einsum("pJi,piJ->p", Finv, stacked(H - before))
        return power_tangent(H, self.lam * log, self.lam, self._terms)
