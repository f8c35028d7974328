"""Integrals over facets: prescribed tractions and seepage fluxes, and a field that vanishes on a surface weakly."""

import numpy as np


def facet_normal(dN, weights, coordinates):
    """Return the outward normals times dA, (F, Q, d) [m^(d-1)], of facets with nodal coordinates (F, A, d); dN (Q, A, d - 1)."""
    tangents = np.swapaxes(coordinates, 1, 2)[:, None] @ dN
    if tangents.shape[-1] == 1:
        normal = np.stack([tangents[..., 1, 0], -tangents[..., 0, 0]], axis=-1)
    else:
        normal = np.cross(tangents[..., 0], tangents[..., 1])
    return normal * weights[:, None]


def surface_load(N, dA, values):
    """Return ∮ N_a t dA, (F, A, k), for values (F, Q, k) at the quadrature points."""
    return N.T @ (values * dA[..., None])


def weak_zero(N, G, normal, penalty):
    """Return -∮ (q ∂_n s + s ∂_n q) dA + ∮ penalty q s dA, (F, A, A) [m^(d-2)]: s = 0 by Nitsche's method (1971).

    N (Q, A), G (F, Q, A, d) of the cells behind the facets at the facets' points; normal (F, Q, d) outward normal times dA;
    penalty (F,) [1/m]
    """
    slope = (G @ normal[..., None])[..., 0]
    crossed = np.swapaxes(slope, 1, 2) @ np.broadcast_to(N, slope.shape)
    dA = np.linalg.norm(normal, axis=-1)
    return penalty[:, None, None] * (N.T @ (dA[..., None] * N)) - crossed - np.swapaxes(crossed, 1, 2)
