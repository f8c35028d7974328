"""Laws whose stress is linear in the displacement gradient."""

from typing import Any

import numpy as np

from ..tensors import scaled_identity, trace
from .elastic import ElasticLaw
from .strain import linear_strain


class LinearElastic(ElasticLaw):
    """Ψ = λ/2 (tr ε)² + μ ε:ε, ε = sym H."""

    small_strain = True

    def confined(self, J: float | np.ndarray) -> Any:
        """Return E_c (J - 1)."""
        return self.oedometer_modulus * (J - 1)

    def energy(self, H: np.ndarray) -> np.ndarray:
        """Return Psi, (...)."""
        eps = linear_strain(H)
        return self.lam / 2 * trace(eps) ** 2 + self.mu * np.einsum("...ij,...ij->...", eps, eps)

    def stress(self, H: np.ndarray) -> np.ndarray:
        """Return P = lambda tr(eps) I + 2 mu eps, (..., d, d)."""
        eps = linear_strain(H)
        return scaled_identity(self.lam * trace(eps), H.shape[-1]) + 2 * self.mu * eps

    def tangent(self, H: np.ndarray) -> np.ndarray:
        """Return dP/dF, (..., d, d, d, d), constant."""
        return np.broadcast_to(_isotropic(self.lam, self.mu, H.shape[-1]), H.shape + H.shape[-2:])


class Harmonic(ElasticLaw):
    """P = mu H: every component of the displacement is harmonic.  No material, but the simplest
    motion of a mesh.
    """

    small_strain = True

    def stress(self, H: np.ndarray) -> np.ndarray:
        """Return P, (..., d, d)."""
        return self.mu * H

    def tangent(self, H: np.ndarray) -> np.ndarray:
        """Return dP/dF = mu d_ik d_JL, (..., d, d, d, d), constant."""
        identity = np.eye(H.shape[-1])
        return np.broadcast_to(
            self.mu * np.einsum("ik,JL->iJkL", identity, identity), H.shape + H.shape[-2:]
        )


def _isotropic(lam: float, mu: float, dim: int) -> np.ndarray:
    """Return lambda d_iJ d_kL + mu (d_ik d_JL + d_iL d_Jk), (d, d, d, d)."""
    identity = np.eye(dim)
    volumetric = np.einsum("iJ,kL->iJkL", identity, identity)
    symmetric = np.einsum("ik,JL->iJkL", identity, identity) + np.einsum(
        "iL,Jk->iJkL", identity, identity
    )
    return lam * volumetric + mu * symmetric
