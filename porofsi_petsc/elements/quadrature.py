"""Quadrature on the unit simplex: symmetric rules of low degree, collapsed Gauss-Jacobi products
above; on the unit cube products of Gauss rules.
"""

import math
from functools import cache
from itertools import permutations, product

import numpy as np


def _orbit(barycentric):
    return sorted(set(permutations(barycentric)))


def _symmetric(dim, orbits):
    points = []
    weights = []
    for weight, coordinates in orbits:
        for L in _orbit(coordinates):
            points.append(L[1:])
            weights.append(weight)
    volume = 1.0 / math.factorial(dim)
    return np.array(points, dtype=float).reshape(-1, dim), volume * np.array(weights)


_A3 = 0.58541019662496845446
_B3 = 0.13819660112501051518
_STRANG_A = 0.44594849091596488632
_STRANG_B = 0.09157621350977074346
# (dim, degree): orbits (weight relative to the volume, barycentric coordinates); Strang & Fix 1973,
# Dunavant 1985, Keast 1986.
SYMMETRIC = {
    (2, 1): [(1.0, (1 / 3,) * 3)],
    (2, 2): [(1 / 3, (2 / 3, 1 / 6, 1 / 6))],
    (2, 4): [
        (0.22338158967801146570, (1 - 2 * _STRANG_A, _STRANG_A, _STRANG_A)),
        (0.10995174365532186764, (1 - 2 * _STRANG_B, _STRANG_B, _STRANG_B)),
    ],
    (3, 1): [(1.0, (1 / 4,) * 4)],
    (3, 2): [(1 / 4, (_A3, _B3, _B3, _B3))],
}
# By dim, orbits of degree 3 with the vertices, in one dimension Simpson's rule.
CLOSED = {
    1: [(1 / 6, (1, 0)), (2 / 3, (1 / 2, 1 / 2))],
    2: [(1 / 20, (1, 0, 0)), (2 / 15, (1 / 2, 1 / 2, 0)), (9 / 20, (1 / 3,) * 3)],
    3: [(1 / 40, (1, 0, 0, 0)), (9 / 40, (1 / 3, 1 / 3, 1 / 3, 0))],
}


@cache
def closed(dim: int) -> tuple[np.ndarray, np.ndarray]:
    """Return points, (Q, dim), the vertices among them, and weights, (Q,), that integrate
    polynomials of degree 3 exactly on the unit simplex.
    """
    return _symmetric(dim, CLOSED[dim])


@cache
def closed_product(dim: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the product of Simpson's rules on the unit cube, points (Q, dim) and weights (Q,)."""
    points, weights = closed(1)
    return _product(points[:, 0], weights, dim)


@cache
def quadrature(dim: int, degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Return points, (Q, dim), and weights, (Q,), that integrate polynomials of the degree exactly
    on the unit simplex.
    """
    for available in sorted(d for s, d in SYMMETRIC if s == dim):
        if available >= degree:
            return _symmetric(dim, SYMMETRIC[dim, available])
    return _collapsed(dim, degree)


@cache
def gauss_product(dim: int, degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Return points, (Q, dim), and weights, (Q,), that integrate polynomials of the degree in each
    coordinate exactly on the unit cube.
    """
    t, w = _gauss_jacobi(degree // 2 + 1, 0)
    return _product(t, w, dim)


def _product(t, w, dim):
    """Return the product of a rule on a line, points (Q,) and weights (Q,), with itself."""
    points = np.stack(np.meshgrid(*[t] * dim, indexing="ij"), axis=-1).reshape(-1, dim)
    weights = np.stack(np.meshgrid(*[w] * dim, indexing="ij"), axis=-1).reshape(-1, dim)
    return points, weights.prod(axis=1)


def subdivided(dim: int, degree: int, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return points and weights of the degree on each of the n^dim parts of a line or triangle
    whose edges are cut into n.
    """
    points, weights = quadrature(dim, degree)
    corners = np.array([c for c in product(range(n), repeat=dim) if sum(c) < n])
    parts = [corner + points for corner in corners]
    if dim == 2:
        parts += [corner + 1 - points for corner in corners if sum(corner) < n - 1]
    return np.vstack(parts) / n, np.tile(weights, len(parts)) / n**dim


def _collapsed(dim, degree):
    """Return the Stroud conical product rule: x_i = t_i (1 - x_1 - ... - x_{i-1}) with Gauss-Jacobi
    points t_i.
    """
    n = degree // 2 + 1
    points = np.zeros((1, 0))
    weights = np.ones(1)
    for axis in range(dim):
        t, w = _gauss_jacobi(n, dim - 1 - axis)
        remaining = 1 - points.sum(axis=1)
        points = np.vstack([np.column_stack([points, ti * remaining]) for ti in t])
        weights = np.concatenate([wi * weights for wi in w])
    return points, weights


def _gauss_jacobi(n, alpha):
    """Return the n Gauss points and weights on (0, 1) for the weight (1 - t)^alpha (Golub & Welsch
    1969).
    """
    k = np.arange(1, n)
    diagonal = np.array(
        [-(alpha**2) / ((2 * j + alpha) * (2 * j + alpha + 2)) if alpha else 0.0 for j in range(n)]
    )
    off = np.sqrt(
        4 * k * (k + alpha) * k * (k + alpha) / ((2 * k + alpha) ** 2 * ((2 * k + alpha) ** 2 - 1))
    )
    x, V = np.linalg.eigh(np.diag(diagonal) + np.diag(off, 1) + np.diag(off, -1))
    return (x + 1) / 2, V[0] ** 2 / (alpha + 1)
