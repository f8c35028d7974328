"""The contractions that turn pointwise quantities into element vectors and matrices, where no
compiled loop does.

Quadrature is merged into the contracted axis of one stacked matrix product.
"""

import numpy as np


def broadcast_gradient(G: np.ndarray, points: int) -> np.ndarray:
    """Return G, (E, Q, A, d), from gradients that may be constant over the element, (E, 1, A,
    d).
    """
    return np.broadcast_to(G, (G.shape[0], points, *G.shape[2:]))


def test_value(N: np.ndarray, dV: np.ndarray, X: np.ndarray) -> np.ndarray:
    """Return the sum over q of N_a X dV, (E, A, k), for X (E, Q, k)."""
    return N.T @ (X * dV[..., None])


def mass_matrix(N: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the sum over q of N_a w N_b, (E, A, A), for weights (E, Q) that include dV."""
    return N.T @ (weights[..., None] * N)


def bilinear(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return the sum over q of left_a right_b, (E, A, B), for (E, Q, A) and (E, Q, B)."""
    return np.swapaxes(left, 1, 2) @ right


def laplacian(G: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the sum over q of dN_a/dx_j w dN_b/dx_j, (E, A, A), for weights (E, Q) that include
    dV.
    """
    if G.shape[1] == 1:
        return weights.sum(axis=1)[:, None, None] * (G[:, 0] @ np.swapaxes(G[:, 0], 1, 2))
    E, Q, A, d = G.shape
    flat = np.ascontiguousarray(np.moveaxis(G, 2, 1)).reshape(E, A, Q * d)
    weighted = (np.moveaxis(G, 2, 1) * weights[:, None, :, None]).reshape(E, A, Q * d)
    return weighted @ np.swapaxes(flat, 1, 2)


def add_drag(matrix: np.ndarray, block: np.ndarray, resistance: np.ndarray | None, d: int) -> None:
    """Add D_ij times a scalar block (E, A, B) to the components (i, j) of matrix (E, A, m, B, n)
    for i, j < d, in place; D (d, d), None for δ_ij.
    """
    if resistance is None:
        add_isotropic(matrix, block, d)
        return
    for i in range(d):
        for j in range(d):
            matrix[:, :, i, :, j] += resistance[i, j] * block


def add_mass(matrix: np.ndarray, N: np.ndarray, weights: np.ndarray, d: int) -> None:
    """Add the sum over q of N_a w_ij N_b to matrix (E, A, m, B, n), i, j < d, in place, for weights
    that include dV: (E, Q, d, d), or (E, Q) for w δ_ij.
    """
    if weights.ndim == 2:
        add_isotropic(matrix, mass_matrix(N, weights), d)
        return
    for i in range(d):
        for j in range(d):
            matrix[:, :, i, :, j] += mass_matrix(N, weights[..., i, j])


def add_isotropic(matrix: np.ndarray, block: np.ndarray, components: int) -> None:
    """Add a scalar block (E, A, B) to the components (i, i) of matrix (E, A, m, B, m) for i <
    components, in place.
    """
    for i in range(components):
        matrix[:, :, i, :, i] += block
