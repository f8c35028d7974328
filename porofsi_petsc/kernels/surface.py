"""Integrals over facets: prescribed tractions and seepage fluxes."""

import numpy as np


def facet_measure(dN, weights, coordinates):
    """Return the weights dA, (F, Q) [m^(d-1)], of facets with nodal coordinates (F, A, d); dN (Q, A, d - 1)."""
    tangents = np.swapaxes(coordinates, 1, 2)[:, None] @ dN
    if tangents.shape[-1] == 1:
        return np.linalg.norm(tangents[..., 0], axis=-1) * weights
    return np.linalg.norm(np.cross(tangents[..., 0], tangents[..., 1]), axis=-1) * weights


def surface_load(N, dA, values):
    """Return ∮ N_a t dA, (F, A, k), for values (F, Q, k) at the quadrature points."""
    return N.T @ (values * dA[..., None])
