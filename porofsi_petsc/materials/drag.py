"""The drag between skeleton and pore fluid: a scalar of the point, or that times a constant tensor
where the permeability has principal axes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..tensors import plus_identity


@dataclass(frozen=True)
class Anisotropy:
    """Principal axes of a permeability K = k Σ_m a_m e_m e_m, fixed in space.

    factors : a_m > 0 [-], d of them; axes : the orthonormal e_m, d rows of d components
    """

    factors: tuple[float, ...]
    axes: tuple[tuple[float, ...], ...]

    @cached_property
    def resistance(self) -> np.ndarray:
        """Return D = Σ_m e_m e_m/a_m, (d, d) [-], the inverse of K/k."""
        axes = np.array(self.axes)
        return axes.T @ (axes / np.array(self.factors)[:, None])


@dataclass(frozen=True)
class Drag:
    """S_ij = s D_ij at points, the force per volume and relative velocity.

    scale : s, any shape [N s/m^4]; anisotropy : what D is the resistance of, None for δ_ij
    """

    scale: np.ndarray
    anisotropy: Anisotropy | None = None

    @property
    def resistance(self) -> np.ndarray | None:
        """Return D, (d, d) [-], None for δ_ij."""
        return None if self.anisotropy is None else self.anisotropy.resistance

    def times(self, weight: float | np.ndarray) -> Drag:
        """Return the drag times a weight of the points."""
        return replace(self, scale=self.scale * weight)

    def on(self, w: np.ndarray) -> np.ndarray:
        """Return S w, (..., d) [N/m³], of w (..., d) [m/s]; a component of w around an axis is
        zero, and that of S w is too.
        """
        force = self.scale[..., None] * w
        if self.anisotropy is None:
            return force
        d = len(self.anisotropy.factors)
        force[..., :d] = force[..., :d] @ self.anisotropy.resistance
        return force

    def turned(self, vectors: np.ndarray) -> np.ndarray:
        """Return D times vectors (..., d)."""
        return vectors if self.anisotropy is None else vectors @ self.anisotropy.resistance

    def plus(self, mass: float | np.ndarray) -> np.ndarray:
        """Return S_ij + m δ_ij at the points: S + m, the shape of s, or (..., d, d) with principal
        axes.
        """
        if self.anisotropy is None:
            return self.scale + mass
        S = self.scale[..., None, None] * self.anisotropy.resistance
        return plus_identity(S, np.broadcast_to(mass, self.scale.shape))

    def carried(self, inertia: np.ndarray) -> np.ndarray:
        """Return χ = S (S + m)^-1, the part of the fluid that the drag carries along: the shape of
        s, or (..., d, d) with principal axes.

        inertia : m = ρ_f c_f, the shape of s [N s/m^4]
        """
        if self.anisotropy is None:
            return self.scale / (self.scale + inertia)
        factors = np.array(self.anisotropy.factors)
        s = self.scale[..., None] / factors
        axes = np.array(self.anisotropy.axes)
        return (axes.T * (s / (s + inertia[..., None]))[..., None, :]) @ axes

    @property
    def largest(self) -> np.ndarray:
        """Return the largest principal value of S, the shape of s."""
        return self.scale if self.anisotropy is None else self.scale / min(self.anisotropy.factors)

    @property
    def smallest(self) -> np.ndarray:
        """Return the smallest principal value of S, the shape of s."""
        return self.scale if self.anisotropy is None else self.scale / max(self.anisotropy.factors)
