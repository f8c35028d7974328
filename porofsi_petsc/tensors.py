"""Determinant, inverse and identity of batches of 2x2 and 3x3 tensors, (..., d, d), written out for
speed.
"""

from collections.abc import Callable

import numpy as np

from .compiled import inlined, plain, specialized


@inlined
def _cofactor(d: int, F: np.ndarray, i: int, j: int) -> float:
    """Return d det F / d F_ij of a tensor (d, d)."""
    if d == 2:
        return F[1 - i, 1 - j] if i == j else -F[1 - i, 1 - j]
    k = (i + 1) % 3
    m = (i + 2) % 3
    n = (j + 1) % 3
    r = (j + 2) % 3
    return F[k, n] * F[m, r] - F[k, r] * F[m, n]


@inlined
def _determinant(d: int, F: np.ndarray) -> float:
    """Return det F of a tensor (d, d)."""
    total = 0.0
    for j in range(d):
        total += F[0, j] * _cofactor(d, F, 0, j)
    return total


@inlined
def invert(d: int, F: np.ndarray, inverse: np.ndarray) -> float:
    """Set the inverse of a tensor (d, d) and return its determinant."""
    determinant = _determinant(d, F)
    for i in range(d):
        for j in range(d):
            inverse[i, j] = _cofactor(d, F, j, i) / determinant
    return determinant


@inlined
def determinant_minus_one(d: int, H: np.ndarray) -> float:
    """Return det(I + H) - 1 of a tensor (d, d): tr H + second invariant (+ det H in 3-D), which
    keeps the digits of a small H.
    """
    trace = 0.0
    second = 0.0
    for i in range(d):
        trace += H[i, i]
        for j in range(i):
            second += H[i, i] * H[j, j] - H[i, j] * H[j, i]
    return trace + (second + (_determinant(d, H) if d == 3 else 0.0))


@specialized
def _det_loop(d: int) -> Callable[..., None]:
    def loop(F: np.ndarray, determinant: np.ndarray) -> None:
        for p in range(len(F)):
            determinant[p] = _determinant(d, F[p])

    return loop


@specialized
def _det_minus_one_loop(d: int) -> Callable[..., None]:
    def loop(H: np.ndarray, result: np.ndarray) -> None:
        for p in range(len(H)):
            result[p] = determinant_minus_one(d, H[p])

    return loop


@specialized
def _inverse_loop(d: int) -> Callable[..., None]:
    def loop(F: np.ndarray, inverse: np.ndarray, determinant: np.ndarray) -> None:
        for p in range(len(F)):
            determinant[p] = invert(d, F[p], inverse[p])

    return loop


def det(F: np.ndarray) -> np.ndarray:
    """Return det F, (...)."""
    tensors = stacked(F)
    result = np.empty(F.shape[:-2])
    _det_loop(F.shape[-1])(tensors, result.reshape(-1))
    return result


def det_minus_one(H: np.ndarray) -> np.ndarray:
    """Return det(I + H) - 1 from the invariants of H, without the loss of digits at small H,
    (...).
    """
    tensors = stacked(H)
    result = np.empty(H.shape[:-2])
    _det_minus_one_loop(H.shape[-1])(tensors, result.reshape(-1))
    return result


def inverse(F: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return F^-1 and det F; the caller checks the sign of the determinant."""
    tensors = stacked(F)
    result = np.empty(F.shape)
    determinant = np.empty(F.shape[:-2])
    _inverse_loop(F.shape[-1])(tensors, stacked(result), determinant.reshape(-1))
    return result, determinant


def stacked(F: np.ndarray) -> np.ndarray:
    """Return tensors or anything else of a point, (..., d, d), as (n, d, d) for a compiled loop; a
    view of a contiguous array.
    """
    return plain(F).reshape(-1, *F.shape[-2:])


def three_dimensional(H: np.ndarray) -> np.ndarray:
    """Return displacement gradients (..., 3, 3), those of plane strain with a zero third row and
    column.
    """
    if H.shape[-1] == 3:
        return H
    full = np.zeros((*H.shape[:-2], 3, 3))
    full[..., :2, :2] = H
    return full


def transpose(F: np.ndarray) -> np.ndarray:
    """Return F^T."""
    return np.swapaxes(F, -1, -2)


def trace(F: np.ndarray) -> np.ndarray:
    """Return tr F, (...)."""
    return np.einsum("...ii->...", F)


def weighted(weight: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return weights (...) times scalars (...) or tensors (..., d, d)."""
    return weight * values if values.ndim == weight.ndim else weight[..., None, None] * values


def plus_identity(values: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Return scalars (...) plus weights (...), or tensors (..., d, d) plus weights times I."""
    if values.ndim == weight.ndim:
        return values + weight
    return values + scaled_identity(weight, values.shape[-1])


def scaled_identity(values: np.ndarray, dim: int) -> np.ndarray:
    """Return values * I, (..., d, d), for values (...)."""
    return values[..., None, None] * np.eye(dim)
