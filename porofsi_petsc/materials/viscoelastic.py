"""Viscoelasticity at finite strain: a generalized Maxwell body, whose spring that remains is an
elastic law.

    P = P° + F Σ Q_i        dQ_i/dt + Q_i/τ_i = g_i dS°/dt

P° is the stress of the law and S° = F⁻¹ P° its second Piola-Kirchhoff stress, Q_i the overstress of
a branch with the relative modulus g_i and the relaxation time τ_i (Simo, CMAME 60 (1987) 153, with
the whole stress in the place of its deviator: every modulus relaxes alike, and Poisson's ratio
stays).  With S° linear in time over a step the solution is exact,

    Q_i(t + h) = e_i Q_i + g_i r_i (S°(t + h) - S°),    e_i = exp(-h/τ_i),  r_i = (1 - e_i) τ_i/h,

of second order in time for every h/τ_i; h → ∞ leaves the elastic law alone.  Under a law for small
strain F = I.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from .strain import deformation


class Branch(NamedTuple):
    """A Maxwell element: modulus over that of the law [-], relaxation time [s]."""

    modulus: float
    time: float


class Spring(Protocol):
    """The elastic law of a generalized Maxwell body."""

    @property
    def prony(self) -> tuple[Branch, ...]: ...
    @property
    def small_strain(self) -> bool: ...
    def energy(self, H: np.ndarray) -> np.ndarray: ...
    def stress(self, H: np.ndarray) -> np.ndarray: ...
    def tangent(self, H: np.ndarray) -> np.ndarray: ...
    def mixed_tangent(self, H: np.ndarray, before: np.ndarray) -> np.ndarray: ...


@dataclass(frozen=True)
class Overstressed:
    """The stress at the end of a time h [s] that starts with internal variables (..., m): Q_1, Q_2,
    ..., S°, tensors (3, 3) [Pa].

    P = (1 + c) P° + F R with c = Σ g_i r_i and R = Σ e_i Q_i - c S°, of which neither depends on H.
    """

    spring: Spring
    internal: np.ndarray
    duration: float

    @property
    def small_strain(self) -> bool:
        """Return whether the spring has a stress that is linear in H."""
        return self.spring.small_strain

    @property
    def _share(self):
        """Return c [-]."""
        return sum(b.modulus * _ramp(self.duration / b.time) for b in self.spring.prony)

    def _remainder(self, d):
        """Return R, (..., d, d) [Pa]."""
        *Q, S = _tensors(self.internal)
        R = -self._share * S
        for branch, overstress in zip(self.spring.prony, Q, strict=True):
            R = R + math.exp(-self.duration / branch.time) * overstress
        return R[..., :d, :d]

    def energy(self, H: np.ndarray) -> np.ndarray:
        """Return the energy of the spring that remains, (...) [J/m³]."""
        return self.spring.energy(H)

    def stress(self, H: np.ndarray) -> np.ndarray:
        """Return P, (..., d, d) [Pa]."""
        R = self._remainder(H.shape[-1])
        extra = R if self.spring.small_strain else deformation(H) @ R
        return (1 + self._share) * self.spring.stress(H) + extra

    def tangent(self, H: np.ndarray) -> np.ndarray:
        """Return dP_iJ/dF_kL = (1 + c) dP°_iJ/dF_kL + δ_ik R_JL, (..., d, d, d, d) [Pa]."""
        return self._whole(self.spring.tangent(H))

    def mixed_tangent(self, H: np.ndarray, before: np.ndarray) -> np.ndarray:
        """Do what `ElasticLaw.mixed_tangent` says."""
        return self._whole(self.spring.mixed_tangent(H, before))

    def _whole(self, A):
        A = (1 + self._share) * A
        if not self.spring.small_strain:
            d = A.shape[-1]
            R = self._remainder(d)
            for i in range(d):
                A[..., i, :, i, :] += R
        return A


def relaxed(law: Spring, internal: np.ndarray, duration: float, H: np.ndarray) -> np.ndarray:
    """Return the internal variables of `Overstressed`, (..., m), at the end of a time [s] that ends
    with H, (..., 3, 3).
    """
    *Q, before = _tensors(internal)
    S: Any = law.stress(H)
    if not law.small_strain:
        S = np.linalg.solve(deformation(H), S)
    new = [
        math.exp(-duration / branch.time) * overstress
        + branch.modulus * _ramp(duration / branch.time) * (S - before)
        for branch, overstress in zip(law.prony, Q, strict=True)
    ]
    return np.concatenate([tensor.reshape(*S.shape[:-2], 9) for tensor in (*new, S)], axis=-1)


def _tensors(internal):
    """Return the tensors, (..., 3, 3) each, of internal variables (..., m)."""
    count = internal.shape[-1] // 9
    return list(np.moveaxis(internal.reshape(*internal.shape[:-1], count, 3, 3), -3, 0))


def _ramp(x):
    """Return (1 - exp(-x))/x, 1 at x = 0 and 0 at infinity."""
    return -math.expm1(-x) / x if x else 1.0
