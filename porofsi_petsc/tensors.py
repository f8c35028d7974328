"""Determinant, inverse and identity of batches of 2x2 and 3x3 tensors, (..., d, d), written out for speed."""

import numpy as np


def det(F):
    """Return det F, (...)."""
    if F.shape[-1] == 2:
        return F[..., 0, 0] * F[..., 1, 1] - F[..., 0, 1] * F[..., 1, 0]
    return np.einsum("...i,...i->...", F[..., 0, :], np.cross(F[..., 1, :], F[..., 2, :]))


def det_minus_one(H):
    """Return det(I + H) - 1 from the invariants of H, without the loss of digits at small H, (...)."""
    if H.shape[-1] == 2:
        return trace(H) + det(H)
    second = (trace(H) ** 2 - np.einsum("...ij,...ji->...", H, H)) / 2
    return trace(H) + second + det(H)


def inverse(F):
    """Return F^-1 and det F; the caller checks the sign of the determinant."""
    if F.shape[-1] == 2:
        J = det(F)
        adjugate = np.stack([F[..., 1, 1], -F[..., 0, 1], -F[..., 1, 0], F[..., 0, 0]], axis=-1).reshape(F.shape)
        return adjugate / J[..., None, None], J
    rows = F[..., 0, :], F[..., 1, :], F[..., 2, :]
    adjugate = np.stack([np.cross(rows[1], rows[2]), np.cross(rows[2], rows[0]), np.cross(rows[0], rows[1])], axis=-1)
    J = np.einsum("...i,...i->...", rows[0], adjugate[..., 0])
    return adjugate / J[..., None, None], J


def transpose(F):
    """Return F^T."""
    return np.swapaxes(F, -1, -2)


def trace(F):
    """Return tr F, (...)."""
    return np.einsum("...ii->...", F)


def scaled_identity(values, dim):
    """Return values * I, (..., d, d), for values (...)."""
    return values[..., None, None] * np.eye(dim)
