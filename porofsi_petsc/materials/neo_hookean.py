"""Compressible neo-Hookean laws: one deviatoric energy, several of the volume."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..tensors import det_minus_one, stacked, trace
from .elastic import ElasticLaw
from .points import compressible_stress, compressible_tangent
from .strain import green_strain, kinematics


def _marking_inadmissible():
    """Return a decorator of functions whose NaN at J <= 0, by intention, is no warning of
    NumPy's.
    """
    return np.errstate(invalid="ignore", divide="ignore")


@dataclass(frozen=True)
class _CompressibleNeoHookean(ElasticLaw):
    """Psi = mu/2 (I1 - 3) - mu ln J + U(J); a law gives U, J U' and J (J U')' as functions of J -
    1, and U' of J.
    """

    def confined(self, J: float | np.ndarray) -> Any:
        """Return mu (J - 1/J) + U'."""
        return self.mu * (J - 1 / J) + self._pressure(J)

    def _volumetric(self, J_1: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return U, J U' and J (J U')', the shape of J - 1."""
        raise NotImplementedError

    def _pressure(self, J: float | np.ndarray) -> Any:
        """Return U', the shape of J."""
        raise NotImplementedError

    @_marking_inadmissible()
    def energy(self, H: np.ndarray) -> np.ndarray:
        """Return Psi, (...); I1 - 3 = 2 tr E."""
        J_1 = det_minus_one(H)
        return self.mu * (trace(green_strain(H)) - np.log1p(J_1)) + self._volumetric(J_1)[0]

    def stress(self, H: np.ndarray) -> np.ndarray:
        """Return P = mu (F - F^-T) + J U' F^-T = F^-T (2 mu E + J U' I), (..., d, d)."""
        Finv, J_1 = kinematics(H)
        return compressible_stress(H, Finv, self._volumetric(J_1)[1], self.mu)

    def tangent(self, H: np.ndarray) -> np.ndarray:
        """Return dP_iJ/dF_kL = mu d_ik d_JL + J (J U')' Finv_Ji Finv_Lk + (mu - J U') Finv_Jk
        Finv_Li, (..., d, d, d, d).
        """
        Finv, J_1 = kinematics(H)
        _, first, second = self._volumetric(J_1)
        return compressible_tangent(H, Finv, first, second, self.mu)

    def mixed_tangent(self, H: np.ndarray, before: np.ndarray) -> np.ndarray:
        """Do what `ElasticLaw.mixed_tangent` says, J U' = (J U')_b + (J (J U')')_b Finv_b:(H -
        H_b).
        """
        Finv, J_1 = kinematics(before)
        _, first, second = self._volumetric(J_1)
        linear = first + second * np.einsum("pJi,piJ->p", Finv, stacked(H - before))
        Finv, J_1 = kinematics(H)
        return compressible_tangent(H, Finv, linear, self._volumetric(J_1)[2], self.mu)


class NeoHookean(_CompressibleNeoHookean):
    """Ψ = μ/2 (I1 - 3) - μ ln J + λ/2 (ln J)² (Bonet & Wood 2008, 6.27)."""

    @_marking_inadmissible()
    def _volumetric(self, J_1):
        lnJ = np.log1p(J_1)
        return self.lam / 2 * lnJ**2, self.lam * lnJ, np.broadcast_to(self.lam, J_1.shape)

    def _pressure(self, J):
        return self.lam * np.log(J) / J


class NeoHookeanJ2(_CompressibleNeoHookean):
    """Ψ = μ/2 (I1 - 3) - μ ln J + λ/2 (J - 1)²."""

    def _volumetric(self, J_1):
        return (
            self.lam / 2 * J_1**2,
            self.lam * J_1 * (1 + J_1),
            self.lam * (2 * J_1 + 1) * (1 + J_1),
        )

    def _pressure(self, J):
        return self.lam * (J - 1)


class XieLeo(_CompressibleNeoHookean):
    """Ψ = μ/2 (I1 - 3) + E_c (J ln J - J + 1) - μ/2 (J² - 1): in confined compression P = E_c ln J.

    The law of the exact consolidation of Xie & Leo (2004), 1/m = E_c; for compression (the energy
    falls at J far above 1).
    """

    def confined(self, J: float | np.ndarray) -> Any:
        """Return E_c ln J."""
        return self.oedometer_modulus * np.log(J)

    @_marking_inadmissible()
    def _volumetric(self, J_1):
        J = 1 + J_1
        lnJ = np.log1p(J_1)
        E_c = self.oedometer_modulus
        square = J_1 * (2 + J_1)
        U = E_c * (J * lnJ - J_1) - self.mu / 2 * square + self.mu * lnJ
        return U, E_c * J * lnJ - self.mu * square, E_c * J * (lnJ + 1) - 2 * self.mu * J**2


class EhlersEipper(_CompressibleNeoHookean):
    """Ψ = μ/2 (I1 - 3) - μ ln J + λ m² [(J - 1)/m - ln((J - n_s0)/m)], m = 1 - n_s0.

    Infinite at the compaction point J = n_s0 (Ehlers & Eipper 1999).
    """

    compacts = True

    @property
    def lowest_ratio(self) -> float:  # type: ignore[override]  # a constant of other laws
        """Return the compaction point."""
        return self.n_s0

    def _pressure(self, J):
        return self.lam * (1 - self.n_s0) ** 2 * (1 / (1 - self.n_s0) - 1 / (J - self.n_s0))

    @_marking_inadmissible()
    def _volumetric(self, J_1):
        n = self.n_s0
        J = 1 + J_1
        open_fraction = 1 - n
        pore = np.where(J > n, open_fraction + J_1, np.nan)
        U = self.lam * open_fraction**2 * (J_1 / open_fraction - np.log(pore / open_fraction))
        first = self.lam * open_fraction * J * J_1 / pore
        return U, first, self.lam * J * (open_fraction + n * open_fraction**2 / pore**2)
