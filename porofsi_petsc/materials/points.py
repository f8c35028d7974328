"""Stresses and tangents of laws at many points, compiled."""

import numpy as np

from ..compiled import plain, specialized, stack
from ..tensors import stacked
from .strain import green


def kirchhoff_stress(H: np.ndarray, S: np.ndarray) -> np.ndarray:
    """Return P = F S, (..., d, d)."""
    P = np.empty(H.shape)
    _kirchhoff_stress_loop(H.shape[-1])(stacked(H), stacked(S), stacked(P))
    return P


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


def kirchhoff_tangent(H: np.ndarray, S: np.ndarray, lam: float, mu: float) -> np.ndarray:
    """Return dP_iJ/dF_kL = delta_ik S_JL + F_iM C_MJNL F_kN, (..., d, d, d, d), C that of linear
    elasticity.
    """
    A, d = _tangents(H)
    _kirchhoff_tangent_loop(d)(
        stacked(H), stacked(S), float(lam), float(mu), A.reshape(-1, d, d, d, d)
    )
    return A


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


def compressible_stress(
    H: np.ndarray, Finv: np.ndarray, first: np.ndarray, mu: float
) -> np.ndarray:
    """Return P = F^-T (2 mu E + J U' I), (..., d, d); F^-1 (n, d, d) and J U' (n,) of all
    points.
    """
    P = np.empty(H.shape)
    _compressible_stress_loop(H.shape[-1])(stacked(H), Finv, plain(first), float(mu), stacked(P))
    return P


@specialized
def _compressible_stress_loop(d):
    """Return the loop that writes P_iJ = Finv_Ki (2 mu E_KJ + first delta_KJ), (n, d, d), with
    first = J U' (n,).
    """

    def loop(H, Finv, first, mu, P):
        S = stack((d, d))
        for p in range(len(P)):
            for K in range(d):
                for J in range(d):
                    S[K, J] = 2 * mu * green(d, H[p], K, J)
                S[K, K] += first[p]
            for i in range(d):
                for J in range(d):
                    total = 0.0
                    for K in range(d):
                        total += Finv[p, K, i] * S[K, J]
                    P[p, i, J] = total

    return loop


def compressible_tangent(
    H: np.ndarray, Finv: np.ndarray, first: np.ndarray, second: np.ndarray, mu: float
) -> np.ndarray:
    """Return dP_iJ/dF_kL = mu d_ik d_JL + J (J U')' Finv_Ji Finv_Lk + (mu - J U') Finv_Jk Finv_Li,
    (..., d, d, d, d); F^-1 (n, d, d), J U' and J (J U')' (n,) of all points.
    """
    A, d = _tangents(H)
    _compressible_tangent_loop(d)(
        Finv, plain(first), plain(second), float(mu), A.reshape(-1, d, d, d, d)
    )
    return A


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


def two_invariant_stress(
    H: np.ndarray, Finv: np.ndarray, volumetric: np.ndarray, c2: float, d1: float
) -> np.ndarray:
    """Return P = F⁻ᵀ (2 d1 E + volumetric I) + 2 c2 F (tr(2E) I - 2E), (..., d, d), so that a small
    strain keeps its digits: 2 c1 F + 2 c2 F (I1 I - C) + (volumetric - d1) F⁻ᵀ, d1 = 2 c1 + 4 c2.

    F⁻¹ (n, d, d) and volumetric (n,) [Pa] of all points
    """
    P = np.empty(H.shape)
    _two_invariant_stress_loop(H.shape[-1])(
        stacked(H), Finv, plain(volumetric), float(c2), float(d1), stacked(P)
    )
    return P


@specialized
def _two_invariant_stress_loop(d):
    def loop(H, Finv, volumetric, c2, d1, P):
        E2 = stack((d, d))
        for p in range(len(P)):
            first = 0.0
            for K in range(d):
                for J in range(d):
                    E2[K, J] = 2 * green(d, H[p], K, J)
                first += E2[K, K]
            for i in range(d):
                for J in range(d):
                    total = volumetric[p] * Finv[p, J, i]
                    for K in range(d):
                        F_iK = H[p, i, K] + (i == K)
                        total += (d1 * Finv[p, K, i] - 2 * c2 * F_iK) * E2[K, J]
                        if K == J:
                            total += 2 * c2 * first * F_iK
                    P[p, i, J] = total

    return loop


def two_invariant_tangent(
    H: np.ndarray, Finv: np.ndarray, volumetric: np.ndarray, lam: float, c2: float, d1: float
) -> np.ndarray:
    """Return dP_iJ/dF_kL = (2 c1 + 2 c2 I1) δ_ik δ_JL + 2 c2 (2 F_iJ F_kL - δ_ik C_JL - F_iL F_kJ -
    (F Fᵀ)_ik δ_JL) + lam F⁻¹_Ji F⁻¹_Lk + (d1 - volumetric) F⁻¹_Jk F⁻¹_Li of `two_invariant_stress`,
    d volumetric = lam d ln J, (..., d, d, d, d).
    """
    A, d = _tangents(H)
    _two_invariant_tangent_loop(d)(
        stacked(H),
        Finv,
        plain(volumetric),
        float(lam),
        float(c2),
        float(d1),
        A.reshape(-1, d, d, d, d),
    )
    return A


@specialized
def _two_invariant_tangent_loop(d):
    def loop(H, Finv, volumetric, lam, c2, d1, A):
        F = stack((d, d))
        left = stack((d, d))  # F F^T
        right = stack((d, d))  # 2 c2 C - (2 c1 + 2 c2 I1) I
        for p in range(len(A)):
            first = 3.0 - d  # I1 of plane strain has the third direction's
            for i in range(d):
                for J in range(d):
                    F[i, J] = H[p, i, J] + (i == J)
                    first += F[i, J] * F[i, J]
            for i in range(d):
                for k in range(d):
                    left[i, k] = 0.0
                    right[i, k] = 0.0
                    for M in range(d):
                        left[i, k] += F[i, M] * F[k, M]
                        right[i, k] += 2 * c2 * F[M, i] * F[M, k]
                right[i, i] -= d1 - 4 * c2 + 2 * c2 * first
            for i in range(d):
                for J in range(d):
                    for k in range(d):
                        for L in range(d):
                            value = 2 * c2 * (2 * F[i, J] * F[k, L] - F[i, L] * F[k, J])
                            value += lam * Finv[p, J, i] * Finv[p, L, k]
                            value += (d1 - volumetric[p]) * Finv[p, J, k] * Finv[p, L, i]
                            if i == k:
                                value -= right[J, L]
                            if J == L:
                                value -= 2 * c2 * left[i, k]
                            A[p, i, J, k, L] = value

    return loop


def add_dyads(A: np.ndarray, P: np.ndarray, dyad: np.ndarray, growth: np.ndarray) -> None:
    """Make of A_iJkL at every point growth A_iJkL + dyad P_iJ P_kL, (..., d, d, d, d); dyad and
    growth of the points (...).
    """
    d = P.shape[-1]
    _dyads_loop(d)(A.reshape(-1, d * d, d * d), stacked(P), plain(dyad).ravel(), growth.ravel())


@specialized
def _dyads_loop(d):
    def loop(A, P, dyad, growth):
        for p in range(len(A)):
            for m in range(d * d):
                left = dyad[p] * P[p, m // d, m % d]
                for n in range(d * d):
                    A[p, m, n] = growth[p] * A[p, m, n] + left * P[p, n // d, n % d]

    return loop


def _tangents(H):
    """Return memory for the tangents of displacement gradients, (..., d, d, d, d), and d."""
    return np.empty(H.shape + H.shape[-2:]), H.shape[-1]
