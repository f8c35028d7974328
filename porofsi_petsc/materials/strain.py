"""Strains of a displacement gradient H = F - I, (..., d, d)."""

import numpy as np

from ..compiled import inlined, specialized, stack
from ..tensors import determinant_minus_one, invert, stacked, transpose


def deformation(H: np.ndarray) -> np.ndarray:
    """Return F = I + H."""
    return H + np.eye(H.shape[-1])


def linear_strain(H: np.ndarray) -> np.ndarray:
    """Return ε = sym H."""
    return (H + transpose(H)) / 2


def green_strain(H: np.ndarray) -> np.ndarray:
    """Return E = (F^T F - I)/2 = (H + H^T + H^T H)/2."""
    E = np.empty(H.shape)
    _green_strain_loop(H.shape[-1])(stacked(H), stacked(E))
    return E


@inlined
def green(d: int, H: np.ndarray, K: int, J: int) -> float:
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
                    E[p, K, J] = green(d, H[p], K, J)

    return loop


def logarithm(J_1: np.ndarray) -> np.ndarray:
    """Return ln J of J - 1, by intention NaN at J <= 0, which marks the state."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.log1p(J_1)


def kinematics(H: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
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
