"""Principal axes of C = FᵀF at many points, and laws that are sums of powers of the stretches,
compiled.
"""

import numpy as np

from ..compiled import inlined, plain, specialized, stack
from ..tensors import stacked
from .strain import green

# The method of Jacobi squares what is beside the diagonal with each sweep: six leave nothing.
SWEEPS = 10


@inlined
def principal(d: int, H: np.ndarray, strains: np.ndarray, axes: np.ndarray) -> None:
    """Set the eigenvalues of C - I, (d,), and its orthonormal axes, the columns of (d, d), by the
    method of Jacobi: small strains keep their digits, and equal ones have axes at right angles.
    """
    E2 = stack((d, d))
    for K in range(d):
        for J in range(d):
            E2[K, J] = 2 * green(d, H, K, J)
            axes[K, J] = 1.0 if K == J else 0.0
    for _ in range(SWEEPS):
        beside = 0.0
        for p in range(d):
            for q in range(p):
                beside += abs(E2[p, q])
                if E2[p, q] != 0.0:
                    _rotate(d, E2, axes, p, q)
        if beside == 0.0:
            break
    for a in range(d):
        strains[a] = E2[a, a]


@inlined
def _rotate(d: int, E2: np.ndarray, axes: np.ndarray, p: int, q: int) -> None:
    """Make E2_pq zero by a rotation in the plane of p and q (Golub & Van Loan, 8.5.2)."""
    half = (E2[q, q] - E2[p, p]) / (2 * E2[p, q])
    t = (1.0 if half >= 0.0 else -1.0) / (abs(half) + np.sqrt(1 + half * half))
    c = 1 / np.sqrt(1 + t * t)
    s = t * c
    E2[p, p] -= t * E2[p, q]
    E2[q, q] += t * E2[p, q]
    E2[p, q] = 0.0
    E2[q, p] = 0.0
    for r in range(d):
        if r != p and r != q:
            first = E2[r, p]
            second = E2[r, q]
            E2[r, p] = c * first - s * second
            E2[p, r] = E2[r, p]
            E2[r, q] = s * first + c * second
            E2[q, r] = E2[r, q]
        first = axes[r, p]
        second = axes[r, q]
        axes[r, p] = c * first - s * second
        axes[r, q] = s * first + c * second


@inlined
def _power_second_piola(d, strains, volumetric, terms, S):
    """Set S_a = (Σ_p t_p (λ_a^α_p - 1) + volumetric)/λ_a², (d,); terms : t_p and α_p."""
    for a in range(d):
        total = volumetric
        for m in range(terms.shape[1]):
            total += terms[0, m] * np.expm1(terms[1, m] / 2 * np.log1p(strains[a]))
        S[a] = total / (1 + strains[a])


def principal_strains(H: np.ndarray) -> np.ndarray:
    """Return λ_a² - 1 of all n points of H (..., d, d), (n, d)."""
    tensors = stacked(H)
    strains = np.empty(tensors.shape[:-1])
    _strains_loop(H.shape[-1])(tensors, strains)
    return strains


@specialized
def _strains_loop(d):
    def loop(H, strains):
        axes = stack((d, d))
        for p in range(len(H)):
            principal(d, H[p], strains[p], axes)

    return loop


def power_stress(H: np.ndarray, volumetric: np.ndarray, terms: np.ndarray) -> np.ndarray:
    """Return P = Σ_a S_a F N_a ⊗ N_a, S_a = (Σ_p t_p (λ_a^α_p - 1) + volumetric)/λ_a², (..., d,
    d).

    volumetric : (n,) of all points [Pa]; terms : t_p [Pa] and α_p [-], (2, terms)
    """
    P = np.empty(H.shape)
    _stress_loop(H.shape[-1])(stacked(H), plain(volumetric), plain(terms), stacked(P))
    return P


@specialized
def _stress_loop(d):
    def loop(H, volumetric, terms, P):
        strains = stack((d,))
        S = stack((d,))
        axes = stack((d, d))
        turned = stack((d, d))
        for p in range(len(P)):
            principal(d, H[p], strains, axes)
            _power_second_piola(d, strains, volumetric[p], terms, S)
            _turn(d, H[p], axes, turned)
            for i in range(d):
                for J in range(d):
                    total = 0.0
                    for a in range(d):
                        total += S[a] * turned[i, a] * axes[J, a]
                    P[p, i, J] = total

    return loop


@inlined
def _turn(d, H, axes, turned):
    """Set F N_a, the columns of (d, d)."""
    for i in range(d):
        for a in range(d):
            total = axes[i, a]
            for M in range(d):
                total += H[i, M] * axes[M, a]
            turned[i, a] = total


def power_tangent(
    H: np.ndarray, volumetric: np.ndarray, lam: float, terms: np.ndarray
) -> np.ndarray:
    """Return dP_iJ/dF_kL = δ_ik S_JL + F_iM C_MJNL F_kN of `power_stress` with d volumetric = lam d
    ln J, (..., d, d, d, d).

    C = Σ_ab 2 ∂S_a/∂λ_b² N_a N_a N_b N_b + Σ_(a≠b) (S_b - S_a)/(λ_b² - λ_a²) N_a N_b (N_a N_b + N_b
    N_a) (Holzapfel, Nonlinear Solid Mechanics, 6.180).  The quotient is one of powers of λ², whose
    limit at equal stretches comes out by itself.
    """
    d = H.shape[-1]
    A = np.empty(H.shape + (d, d))
    _tangent_loop(d)(
        stacked(H), plain(volumetric), float(lam), plain(terms), A.reshape(-1, d, d, d, d)
    )
    return A


@inlined
def _power_slope(x, y, volumetric, terms):
    """Return (S(y) - S(x))/(y - x) of S(x) = Σ_p t_p (x^(α_p/2) - 1)/x + volumetric/x, dS/dx where
    x = y: the quotient of powers is x^(k-1) (e^(kδ) - 1)/(e^δ - 1), δ = ln y/x.
    """
    ratio = np.log1p((y - x) / x)
    total = -volumetric / (x * y)
    for m in range(terms.shape[1]):
        k = terms[1, m] / 2 - 1
        quotient = k if ratio == 0.0 else np.expm1(k * ratio) / np.expm1(ratio)
        total += terms[0, m] * (np.exp((k - 1) * np.log(x)) * quotient + 1 / (x * y))
    return total


@specialized
def _tangent_loop(d):
    def loop(H, volumetric, lam, terms, A):
        strains = stack((d,))
        S = stack((d,))
        axes = stack((d, d))
        turned = stack((d, d))
        material = stack((d, d))
        mixed = stack((d, d))
        for p in range(len(A)):
            principal(d, H[p], strains, axes)
            _power_second_piola(d, strains, volumetric[p], terms, S)
            _turn(d, H[p], axes, turned)
            for a in range(d):
                x = 1 + strains[a]
                for b in range(d):
                    y = 1 + strains[b]
                    slope = _power_slope(x, y, volumetric[p], terms)
                    mixed[a, b] = 0.0 if a == b else slope
                    material[a, b] = lam / (x * y) + (2 * slope if a == b else 0.0)
            for i in range(d):
                for J in range(d):
                    for k in range(d):
                        for L in range(d):
                            total = 0.0
                            for a in range(d):
                                if i == k:
                                    total += S[a] * axes[J, a] * axes[L, a]
                                for b in range(d):
                                    crossed = turned[i, a] * axes[L, a] * turned[k, b] * axes[J, b]
                                    beside = turned[i, a] * turned[k, a] * axes[J, b] * axes[L, b]
                                    total += mixed[a, b] * (crossed + beside)
                                    total += (
                                        material[a, b]
                                        * (turned[i, a] * axes[J, a])
                                        * (turned[k, b] * axes[L, b])
                                    )
                            A[p, i, J, k, L] = total

    return loop
