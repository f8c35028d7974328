"""Hyperelastic skeletons: energy per reference volume, first Piola-Kirchhoff stress and its tangent.

All take the deformation gradient F_iJ = dy_i/dX_J, (..., d, d); d = 2 is plane strain (F_33 = 1).  Stress in tension is
positive.  Units: Pa for energy density, stress and tangent.
"""

from dataclasses import dataclass

import numpy as np

from ..tensors import det, inverse, scaled_identity, trace, transpose


@dataclass(frozen=True)
class ElasticLaw:
    """Lamé parameters [Pa] that every law reduces to at small strain."""

    lam: float
    mu: float

    small_strain = False  # true: the stress is linear in F and the tangent constant

    @property
    def oedometer_modulus(self):
        """Return E_c = lambda + 2 mu [Pa], the modulus of a laterally confined compression."""
        return self.lam + 2 * self.mu


class LinearElastic(ElasticLaw):
    """Psi = lambda/2 (tr eps)^2 + mu eps:eps with eps = sym(F - I)."""

    small_strain = True

    def energy(self, F):
        """Return Psi, (...)."""
        eps = _small_strain(F)
        return self.lam / 2 * trace(eps) ** 2 + self.mu * np.einsum("...ij,...ij->...", eps, eps)

    def stress(self, F):
        """Return P = lambda tr(eps) I + 2 mu eps, (..., d, d)."""
        eps = _small_strain(F)
        return scaled_identity(self.lam * trace(eps), F.shape[-1]) + 2 * self.mu * eps

    def tangent(self, F):
        """Return dP/dF, (..., d, d, d, d), constant."""
        return np.broadcast_to(_isotropic(self.lam, self.mu, F.shape[-1]), F.shape + F.shape[-2:])


class SaintVenantKirchhoff(ElasticLaw):
    """Psi = lambda/2 (tr E)^2 + mu E:E with E = (F^T F - I)/2."""

    def energy(self, F):
        """Return Psi, (...)."""
        E = _green_strain(F)
        return self.lam / 2 * trace(E) ** 2 + self.mu * np.einsum("...ij,...ij->...", E, E)

    def stress(self, F):
        """Return P = F S, S = lambda tr(E) I + 2 mu E, (..., d, d)."""
        return F @ self._second_piola(F)

    def tangent(self, F):
        """Return dP_iJ/dF_kL = delta_ik S_JL + F_iM C_MJNL F_kN, (..., d, d, d, d)."""
        identity = np.eye(F.shape[-1])
        material = np.einsum("...iM,MJNL,...kN->...iJkL", F, _isotropic(self.lam, self.mu, F.shape[-1]), F, optimize=True)
        return material + np.einsum("ik,...JL->...iJkL", identity, self._second_piola(F))

    def _second_piola(self, F):
        E = _green_strain(F)
        return scaled_identity(self.lam * trace(E), F.shape[-1]) + 2 * self.mu * E


@dataclass(frozen=True)
class _CompressibleNeoHookean(ElasticLaw):
    """Psi = mu/2 (I1 - 3) - mu ln J + U(J); a law gives U, J U' and J (J U')'."""

    def energy(self, F):
        """Return Psi, (...)."""
        J = det(F)
        I1 = np.einsum("...iJ,...iJ->...", F, F)
        return self.mu / 2 * (I1 - F.shape[-1]) - self.mu * np.log(J) + self._volumetric(J)[0]

    def stress(self, F):
        """Return P = mu (F - F^-T) + J U' F^-T, (..., d, d)."""
        Finv, J = inverse(F)
        pull = self._volumetric(J)[1] - self.mu
        return self.mu * F + pull[..., None, None] * transpose(Finv)

    def tangent(self, F):
        """Return dP_iJ/dF_kL = mu d_ik d_JL + J (J U')' Finv_Ji Finv_Lk + (mu - J U') Finv_Jk Finv_Li, (..., d, d, d, d)."""
        identity = np.eye(F.shape[-1])
        Finv, J = inverse(F)
        _, first, second = self._volumetric(J)
        A = np.einsum("...,...Ji,...Lk->...iJkL", second, Finv, Finv)
        A += np.einsum("...,...Jk,...Li->...iJkL", self.mu - first, Finv, Finv)
        return A + self.mu * np.einsum("ik,JL->iJkL", identity, identity)


class NeoHookean(_CompressibleNeoHookean):
    """U = lambda/2 (ln J)^2 (Bonet & Wood, Nonlinear Continuum Mechanics, eq. 6.27)."""

    def _volumetric(self, J):
        lnJ = np.log(J)
        return self.lam / 2 * lnJ**2, self.lam * lnJ, np.broadcast_to(self.lam, J.shape)


class NeoHookeanJ2(_CompressibleNeoHookean):
    """U = lambda/2 (J - 1)^2."""

    def _volumetric(self, J):
        return self.lam / 2 * (J - 1) ** 2, self.lam * (J - 1) * J, self.lam * (2 * J - 1) * J


def _small_strain(F):
    H = F - np.eye(F.shape[-1])
    return (H + transpose(H)) / 2


def _green_strain(F):
    return (transpose(F) @ F - np.eye(F.shape[-1])) / 2


def _isotropic(lam, mu, dim):
    """Return lambda d_iJ d_kL + mu (d_ik d_JL + d_iL d_Jk), (d, d, d, d)."""
    identity = np.eye(dim)
    volumetric = np.einsum("iJ,kL->iJkL", identity, identity)
    symmetric = np.einsum("ik,JL->iJkL", identity, identity) + np.einsum("iL,Jk->iJkL", identity, identity)
    return lam * volumetric + mu * symmetric
