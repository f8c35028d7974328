"""The law of Holzapfel, Gasser and Ogden for walls of arteries and other tissue with collagen."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..registry import parameter
from .elastic import ElasticLaw
from .fibres import unit
from .neo_hookean import NeoHookean
from .points import add_dyads
from .strain import deformation, green_strain


@dataclass(frozen=True)
class HolzapfelGasserOgden(NeoHookean):
    """Ψ = `neo_hookean` + Σ k1/(2 k2) (exp(k2 <E>²) - 1) of one or two families of fibres, E = κ
    (I1 - 3) + (1 - 3κ) (a·C a - 1), <E> = max(E, 0): fibres bear no compression (Gasser, Ogden &
    Holzapfel, J. R. Soc. Interface 3 (2006) 15; λ and μ are those of the matrix).

    With the invariants of C, not those of its isochoric part: of compressible bodies these let a
    hydrostatic pressure leave fibres without stress (Nolan et al., J. Mech. Behav. Biomed. Mater.
    39 (2014) 48).
    """

    fibre_stiffness: float = parameter("Pa", "k1", above=0.0, example=0.9)
    fibre_stiffening: float = parameter("-", "k2", above=0.0, at_most=1e4, example=2.0)
    dispersion: float = parameter(
        "-", "κ, 0 of parallel fibres, 1/3 of all directions", at_least=0.0, at_most=1 / 3,
        default=0.0, example=0.1,
    )  # fmt: skip
    axis: tuple[float, ...] = parameter(
        "-", "a, direction of a family, three components", kind="numbers", example=(0.6, 0.8, 0.0)
    )
    second_axis: tuple[float, ...] = parameter(
        "-", "a of a second family", kind="numbers", default=(), example=(0.6, -0.8, 0.0)
    )

    anisotropic = True

    def __post_init__(self) -> None:
        """Raise ValueError where a direction is none."""
        _ = self.axes

    @property
    def axes(self) -> tuple[np.ndarray, ...]:
        """Return the unit vectors of the families."""
        first = (unit("axis", self.axis),)
        return (*first, unit("second_axis", self.second_axis)) if self.second_axis else first

    @property
    def oedometer_modulus(self) -> float:
        """Return λ + 2μ + 4 k1 Σ (1 - 2κ)² [Pa], no direction of the fibres is stiffer."""
        stretched = 4 * self.fibre_stiffness * (1 - 2 * self.dispersion) ** 2
        return self.softest_modulus + len(self.axes) * stretched

    @property
    def softest_modulus(self) -> float:
        """Return λ + 2μ [Pa], that of the matrix, since fibres bear no compression."""
        return self.lam + 2 * self.mu

    def confined(self, J: float | np.ndarray) -> Any:
        """Return the nominal stress of F = diag(1, 1, J) along it [Pa]."""
        return ElasticLaw.confined(self, J)

    def energy(self, H: np.ndarray) -> np.ndarray:
        """Return Ψ, (...)."""
        k1, k2 = self.fibre_stiffness, self.fibre_stiffening
        fibres = sum(np.expm1(k2 * E**2) for _, E in self._families(H))
        return super().energy(H) + k1 / (2 * k2) * fibres

    def stress(self, H: np.ndarray) -> np.ndarray:
        """Return P, the matrix's and Σ 2 k1 <E> exp(k2 <E>²) F M, M = κ I + (1 - 3κ) a ⊗ a, (...,
        d, d).
        """
        P = super().stress(H)
        F = deformation(H)
        for M, E in self._families(H):
            P += self._tension(E)[..., None, None] * (F @ M)
        return P

    def tangent(self, H: np.ndarray) -> np.ndarray:
        """Return dP_iJ/dF_kL, the matrix's and, of fibres in tension, Σ 2 k1 E exp(k2 E²) δ_ik M_JL
        + 4 k1 (1 + 2 k2 E²) exp(k2 E²) (F M)_iJ (F M)_kL, (..., d, d, d, d).
        """
        return self._with_fibres(super().tangent(H), H)

    def mixed_tangent(self, H: np.ndarray, before: np.ndarray) -> np.ndarray:
        """Do what `ElasticLaw.mixed_tangent` says for the matrix."""
        return self._with_fibres(super().mixed_tangent(H, before), H)

    def _with_fibres(self, A, H):
        F = deformation(H)
        for M, E in self._families(H):
            growth = np.exp(self.fibre_stiffening * E**2) * (E > 0)
            slope = 4 * self.fibre_stiffness * (1 + 2 * self.fibre_stiffening * E**2) * growth
            add_dyads(A, F @ M, slope, np.ones(E.shape))
            geometric = self._tension(E)[..., None, None] * M
            for i in range(H.shape[-1]):
                A[..., i, :, i, :] += geometric
        return A

    def _families(self, H):
        """Yield M, (d, d), and <E> = <M:(C - I)>, (...), of the families."""
        d = H.shape[-1]
        E2 = 2 * green_strain(H)
        for axis in self.axes:
            a = axis[:d]
            M = self.dispersion * np.eye(d) + (1 - 3 * self.dispersion) * np.outer(a, a)
            yield M, np.maximum(np.einsum("JL,...JL->...", M, E2), 0)

    def _tension(self, E):
        """Return 2 k1 E exp(k2 E²), (...) [Pa]."""
        return 2 * self.fibre_stiffness * E * np.exp(self.fibre_stiffening * E**2)
