"""Hyperelastic skeletons: energy per reference volume, first Piola-Kirchhoff stress and its
tangent.

All take the displacement gradient H_iJ = du_i/dX_J = F_iJ - delta_iJ, (..., d, d); d = 2 is plane
strain (F_33 = 1).  With H instead of F a strain of 1e-9 keeps its digits.  Stress in tension is
positive.  Units: Pa for energy density, stress and tangent.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..compiled import inlined, plain, specialized, stack
from ..tensors import (
    det_minus_one,
    determinant_minus_one,
    invert,
    scaled_identity,
    stacked,
    trace,
    transpose,
)


def _marking_inadmissible():
    """Return a decorator of functions whose NaN at J <= 0, by intention, is no warning of
    NumPy's.
    """
    return np.errstate(invalid="ignore", divide="ignore")


@dataclass(frozen=True)
class ElasticLaw:
    """Lamé parameters [Pa] that every law reduces to at small strain.

    A new law: a subclass with `energy`, `stress` and `tangent`, its own numbers as fields by
    `law.parameter`, and a line of `materials.ELASTIC`; one with the energy alone is a
    `from_energy.FromEnergy`.

    n_s0 : initial solid fraction [-]; only a law with a compaction point, `compacts`, looks at it
    """

    lam: float
    mu: float
    n_s0: float = 0.0

    small_strain = False  # true: the stress is linear in F and the tangent constant
    # true: the stress is infinite at J = n_s0, where no pore is left, and NaN beyond
    compacts = False

    @property
    def oedometer_modulus(self) -> float:
        """Return E_c = lambda + 2 mu [Pa], the modulus of a laterally confined compression."""
        return self.lam + 2 * self.mu

    lowest_ratio = 0.0  # J in confined compression below which the law softens, or has no stress

    def confined(self, J: float | np.ndarray) -> Any:
        """Return the nominal stress of F = diag(1, 1, J) along it, the shape of J [Pa]; in closed
        form where a law has one.
        """
        H = np.zeros((*np.shape(J), 3, 3))
        H[..., 2, 2] = np.subtract(J, 1)
        return self.stress(H)[..., 2, 2]

    def stress(self, H: np.ndarray) -> np.ndarray:
        """Return P, (..., d, d)."""
        raise NotImplementedError(f"{type(self).__name__} has no stress")

    def tangent(self, H: np.ndarray) -> np.ndarray:
        """Return dP/dF, (..., d, d, d, d)."""
        raise NotImplementedError(f"{type(self).__name__} has no tangent")

    def mixed_tangent(self, H: np.ndarray, before: np.ndarray) -> np.ndarray:
        """Return dP/dF at H with the stress that is linear from another H, of the iterate before,
        in its geometric part.

        A change of displacement that keeps the volume to first order changes it in the second: at λ
        >> μ the stress λ (J - 1) of such an iterate is of no meaning, and in the geometric
        stiffness it spoils the next one.  A stress that is an unknown of its own and eliminated
        from Newton's equations is linear in the change (Magisano, Leonetti & Garcea, CMAME 313
        (2017) 986); the residual stays that of the displacement.  Quadratic convergence is kept.
        """
        return self.tangent(H)


class LinearElastic(ElasticLaw):
    """Ψ = λ/2 (tr ε)² + μ ε:ε, ε = sym H."""

    small_strain = True

    def confined(self, J: float | np.ndarray) -> Any:
        """Return E_c (J - 1)."""
        return self.oedometer_modulus * (J - 1)

    def energy(self, H: np.ndarray) -> np.ndarray:
        """Return Psi, (...)."""
        eps = _small_strain(H)
        return self.lam / 2 * trace(eps) ** 2 + self.mu * np.einsum("...ij,...ij->...", eps, eps)

    def stress(self, H: np.ndarray) -> np.ndarray:
        """Return P = lambda tr(eps) I + 2 mu eps, (..., d, d)."""
        eps = _small_strain(H)
        return scaled_identity(self.lam * trace(eps), H.shape[-1]) + 2 * self.mu * eps

    def tangent(self, H: np.ndarray) -> np.ndarray:
        """Return dP/dF, (..., d, d, d, d), constant."""
        return np.broadcast_to(_isotropic(self.lam, self.mu, H.shape[-1]), H.shape + H.shape[-2:])


class Harmonic(ElasticLaw):
    """P = mu H: every component of the displacement is harmonic.  No material, but the simplest
    motion of a mesh.
    """

    small_strain = True

    def stress(self, H: np.ndarray) -> np.ndarray:
        """Return P, (..., d, d)."""
        return self.mu * H

    def tangent(self, H: np.ndarray) -> np.ndarray:
        """Return dP/dF = mu d_ik d_JL, (..., d, d, d, d), constant."""
        identity = np.eye(H.shape[-1])
        return np.broadcast_to(
            self.mu * np.einsum("ik,JL->iJkL", identity, identity), H.shape + H.shape[-2:]
        )


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
        P = np.empty(H.shape)
        _kirchhoff_stress_loop(H.shape[-1])(
            stacked(H), stacked(self._second_piola(green_strain(H))), stacked(P)
        )
        return P

    def tangent(self, H: np.ndarray) -> np.ndarray:
        """Return dP_iJ/dF_kL = delta_ik S_JL + F_iM C_MJNL F_kN, (..., d, d, d, d), C that of
        linear elasticity.
        """
        return self._tangent(H, self._second_piola(green_strain(H)))

    def mixed_tangent(self, H: np.ndarray, before: np.ndarray) -> np.ndarray:
        """Do what `ElasticLaw.mixed_tangent` says, E = E_b + sym F_b^T (H - H_b)."""
        F = deformation(before)
        change = H - before
        return self._tangent(
            H, self._second_piola(green_strain(before) + _small_strain(transpose(F) @ change))
        )

    def _tangent(self, H, S):
        A = np.empty(H.shape + H.shape[-2:])
        d = H.shape[-1]
        _kirchhoff_tangent_loop(d)(
            stacked(H), stacked(S), float(self.lam), float(self.mu), A.reshape(-1, d, d, d, d)
        )
        return A

    def _second_piola(self, E):
        return scaled_identity(self.lam * trace(E), E.shape[-1]) + 2 * self.mu * E


@specialized
def _kirchhoff_stress_loop(d):
    """Return the loop that writes P_iJ = F_iM S_MJ, (n, d, d), at n points."""

    def loop(H, S, P):
        for p in range(len(H)):
            for i in range(d):
                for J in range(d):
                    total = S[p, i, J]
                    for M in range(d):
                        total += H[p, i, M] * S[p, M, J]
                    P[p, i, J] = total

    return loop


@specialized
def _kirchhoff_tangent_loop(d):
    """Return the loop that writes delta_ik S_JL + lam F_iJ F_kL + mu (F_iL F_kJ + (F F^T)_ik
    delta_JL), (n, d, d, d, d).
    """

    def loop(H, S, lam, mu, A):
        for p in range(len(H)):
            for i in range(d):
                for k in range(d):
                    left = 0.0  # (F F^T)_ik
                    for M in range(d):
                        left += (H[p, i, M] + (i == M)) * (H[p, k, M] + (k == M))
                    for J in range(d):
                        for L in range(d):
                            F_iJ = H[p, i, J] + (i == J)
                            F_kL = H[p, k, L] + (k == L)
                            F_iL = H[p, i, L] + (i == L)
                            F_kJ = H[p, k, J] + (k == J)
                            value = lam * F_iJ * F_kL + mu * F_iL * F_kJ
                            if i == k:
                                value += S[p, J, L]
                            if J == L:
                                value += mu * left
                            A[p, i, J, k, L] = value

    return loop


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
        Finv, J_1 = _kinematics(H)
        P = np.empty(H.shape)
        pull = plain(self._volumetric(J_1)[1])
        _compressible_stress_loop(H.shape[-1])(stacked(H), Finv, pull, float(self.mu), stacked(P))
        return P

    def tangent(self, H: np.ndarray) -> np.ndarray:
        """Return dP_iJ/dF_kL = mu d_ik d_JL + J (J U')' Finv_Ji Finv_Lk + (mu - J U') Finv_Jk
        Finv_Li, (..., d, d, d, d).
        """
        Finv, J_1 = _kinematics(H)
        return self._tangent(H, Finv, *self._volumetric(J_1)[1:])

    def mixed_tangent(self, H: np.ndarray, before: np.ndarray) -> np.ndarray:
        """Do what `ElasticLaw.mixed_tangent` says, J U' = (J U')_b + (J (J U')')_b Finv_b:(H -
        H_b).
        """
        Finv, J_1 = _kinematics(before)
        _, first, second = self._volumetric(J_1)
        linear = first + second * np.einsum("pJi,piJ->p", Finv, stacked(H - before))
        Finv, J_1 = _kinematics(H)
        return self._tangent(H, Finv, linear, self._volumetric(J_1)[2])

    def _tangent(self, H, Finv, first, second):
        A = np.empty(H.shape + H.shape[-2:])
        d = H.shape[-1]
        _compressible_tangent_loop(d)(
            Finv, plain(first), plain(second), float(self.mu), A.reshape(-1, d, d, d, d)
        )
        return A


def _kinematics(H):
    """Return F^-1, (n, d, d), and J - 1, (n,), of all n points of H (..., d, d)."""
    tensors = stacked(H)
    Finv = np.empty(tensors.shape)
    J_1 = np.empty(len(tensors))
    _kinematics_loop(H.shape[-1])(tensors, Finv, J_1)
    return Finv, J_1


@specialized
def _kinematics_loop(d):
    """Return the loop that writes (I + H)^-1, (n, d, d), and det(I + H) - 1, (n,), at n points."""

    def loop(H, Finv, J_1):
        F = stack((d, d))
        for p in range(len(H)):
            for i in range(d):
                for J in range(d):
                    F[i, J] = H[p, i, J] + (i == J)
            invert(d, F, Finv[p])
            J_1[p] = determinant_minus_one(d, H[p])

    return loop


@specialized
def _compressible_stress_loop(d):
    """Return the loop that writes P_iJ = Finv_Ki (2 mu E_KJ + pull delta_KJ), (n, d, d), with pull
    = J U' (n,).
    """

    def loop(H, Finv, pull, mu, P):
        S = stack((d, d))
        for p in range(len(P)):
            for K in range(d):
                for J in range(d):
                    S[K, J] = 2 * mu * _green(d, H[p], K, J)
                S[K, K] += pull[p]
            for i in range(d):
                for J in range(d):
                    total = 0.0
                    for K in range(d):
                        total += Finv[p, K, i] * S[K, J]
                    P[p, i, J] = total

    return loop


@specialized
def _compressible_tangent_loop(d):
    """Return the loop that writes mu d_ik d_JL + second Finv_Ji Finv_Lk + (mu - first) Finv_Jk
    Finv_Li, (n, d, d, d, d).
    """

    def loop(Finv, first, second, mu, A):
        for p in range(len(A)):
            for i in range(d):
                for J in range(d):
                    for k in range(d):
                        for L in range(d):
                            value = (
                                second[p] * Finv[p, J, i] * Finv[p, L, k]
                                + (mu - first[p]) * Finv[p, J, k] * Finv[p, L, i]
                            )
                            if i == k and J == L:
                                value += mu
                            A[p, i, J, k, L] = value

    return loop


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


def deformation(H: np.ndarray) -> np.ndarray:
    """Return F = I + H."""
    return H + np.eye(H.shape[-1])


def _small_strain(H: np.ndarray) -> np.ndarray:
    return (H + transpose(H)) / 2


def green_strain(H: np.ndarray) -> np.ndarray:
    """Return E = (F^T F - I)/2 = (H + H^T + H^T H)/2."""
    E = np.empty(H.shape)
    _green_strain_loop(H.shape[-1])(stacked(H), stacked(E))
    return E


@inlined
def _green(d, H, K, J):
    """Return E_KJ of a tensor H (d, d)."""
    total = H[K, J] + H[J, K]
    for i in range(d):
        total += H[i, K] * H[i, J]
    return 0.5 * total


@specialized
def _green_strain_loop(d):
    """Return the loop that writes E, (n, d, d), at n points."""

    def loop(H, E):
        for p in range(len(H)):
            for K in range(d):
                for J in range(d):
                    E[p, K, J] = _green(d, H[p], K, J)

    return loop


def _isotropic(lam: float, mu: float, dim: int) -> np.ndarray:
    """Return lambda d_iJ d_kL + mu (d_ik d_JL + d_iL d_Jk), (d, d, d, d)."""
    identity = np.eye(dim)
    volumetric = np.einsum("iJ,kL->iJkL", identity, identity)
    symmetric = np.einsum("ik,JL->iJkL", identity, identity) + np.einsum(
        "iL,Jk->iJkL", identity, identity
    )
    return lam * volumetric + mu * symmetric
