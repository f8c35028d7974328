"""Compressible constituents of a porous medium (Biot 1941): what the pressure stores, and the part
of it that the grains bear.

Over the current configuration, with the coefficient α and the storage S = n_f/K_f + (α - n_f)/K_s:

    volume balance  + ∫ q S dp/dt - (1 - α) ∫ q div v_s        skeleton  + (1 - α) ∫ p div w

α = 1 and S = 0 are the incompressible constituents of `kernels.flow` and `kernels.solid`.  What
seepage carries along, n_f w·∇p/K_f, is of second order in the strain of the fluid and left out.
"""

import numpy as np

from .arguments import Geometry
from .assemble import bilinear, broadcast_gradient, mass_matrix, test_value


def stored_volume(
    N: np.ndarray, geometry: Geometry, storage: np.ndarray, rate: np.ndarray
) -> np.ndarray:
    """Return ∫ q S dp/dt, (E, A) [m³/s]; S (E, Q) [1/Pa], dp/dt (E, A) [Pa/s]."""
    return test_value(N, geometry.dV, (storage * (rate @ N.T))[..., None])[..., 0]


def grain_volume(N: np.ndarray, geometry: Geometry, alpha: float, v_s: np.ndarray) -> np.ndarray:
    """Return -(1 - α) ∫ q div v_s, (E, A) [m³/s]; v_s (E, A, d) [m/s]."""
    divergence = np.einsum("eqai,eai->eq", _divergence(geometry), v_s, optimize=True)
    return (alpha - 1) * test_value(N, geometry.dV, divergence[..., None])[..., 0]


def grain_force(N: np.ndarray, geometry: Geometry, alpha: float, p: np.ndarray) -> np.ndarray:
    """Return (1 - α) ∫ p div w, (E, A, d) [N]; p (E, A) [Pa]."""
    weight = (1 - alpha) * (p @ N.T) * geometry.dV
    return np.einsum("eq,eqai->eai", weight, _divergence(geometry), optimize=True)


def storage_tangent(
    N: np.ndarray, geometry: Geometry, storage: np.ndarray, c_p: float
) -> np.ndarray:
    """Return the derivative of `stored_volume` by p, (E, A, A), c_p = d(dp/dt)/dp [1/s]."""
    return mass_matrix(N, c_p * storage * geometry.dV)


def grain_tangent(N: np.ndarray, geometry: Geometry, alpha: float) -> np.ndarray:
    """Return the derivative of `grain_force` by p, (E, A, d, A) [m²]; minus its transpose is that
    of `grain_volume` by v_s.
    """
    div = _divergence(geometry)
    right = np.broadcast_to(N, div.shape[:3])
    weighted = (1 - alpha) * geometry.dV[..., None, None] * div
    return np.stack([bilinear(weighted[..., i], right) for i in range(div.shape[-1])], axis=2)


def _divergence(geometry):
    return broadcast_gradient(geometry.divergence, geometry.dV.shape[1])
