"""Consolidation of a layer of height H under a sudden load q: Terzaghi at small, Xie & Leo at large
strain.

With M = π (2n + 1)/2 and T = c_v t/H² both are written in the decaying sums

    A(z, t) = Σ 2/M sin(M z/H) e^(-M² T)        B(z, t) = Σ 2/M² cos(M z/H) e^(-M² T)
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .series import modes, on_distinct


@dataclass(frozen=True)
class _Layer:
    """load q [Pa], height H [m], modulus E_c [Pa], diffusivity c_v = k_f E_c/γ_fR [m²/s] of the
    reference state.
    """

    load: float
    height: float
    modulus: float
    diffusivity: float

    def _sums(self, z: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Return A and B at the depths z (n,)."""
        T = self.diffusivity * t / self.height**2
        M = modes(T)
        decay = np.exp(-(M**2) * T)
        angle = np.multiply.outer(z / self.height, M)
        return np.sin(angle) @ (2 / M * decay), np.cos(angle) @ (2 / M**2 * decay)


@dataclass(frozen=True)
class Terzaghi(_Layer):
    """Terzaghi (1923): p = γ q A, w = (q H/E_c) (1 - z/H - α γ B).

    α, storage S [1/Pa] and γ = α/(α² + S E_c), 1 of incompressible constituents (Biot 1941).
    """

    biot: float = 1.0
    storage: float = 0.0

    @property
    def efficiency(self) -> float:
        """Return γ, the pressure at 0+ over the load."""
        return self.biot / (self.biot**2 + self.storage * self.modulus)

    def pressure(self, z: ArrayLike, t: float) -> np.ndarray:
        """Return p at depths z [m], any shape, and time t [s]: [Pa]."""
        return on_distinct(lambda z: self.efficiency * self.load * self._sums(z, t)[0], z)

    def settlement(self, z: ArrayLike, t: float) -> np.ndarray:
        """Return the settlement w at depths z [m], any shape, and time t [s]: [m]."""
        scale = self.load * self.height / self.modulus
        part = self.biot * self.efficiency
        return on_distinct(lambda z: scale * (1 - z / self.height - part * self._sums(z, t)[1]), z)


class XieLeo(_Layer):
    """Xie & Leo (2004): uniaxial Cauchy stress E_c ln J and permeability k_0 J²; z counts in the
    reference configuration.

    J = 1 - (1 - e^(-q/E_c)) (1 - A),  p = q + E_c ln J,  w = H (1 - e^(-q/E_c)) (1 - z/H - B).
    """

    def volume_ratio(self, z: ArrayLike, t: float) -> np.ndarray:
        """Return J at depths z [m], any shape, and time t [s]."""
        return on_distinct(lambda z: 1 - self._compression * (1 - self._sums(z, t)[0]), z)

    def pressure(self, z: ArrayLike, t: float) -> np.ndarray:
        """Return p at depths z [m], any shape, and time t [s]: [Pa]."""
        return self.load + self.modulus * np.log(self.volume_ratio(z, t))

    def settlement(self, z: ArrayLike, t: float) -> np.ndarray:
        """Return the settlement w at depths z [m], any shape, and time t [s]: [m]."""
        scale = self.height * self._compression
        return on_distinct(lambda z: scale * (1 - z / self.height - self._sums(z, t)[1]), z)

    @property
    def _compression(self) -> float:
        return -np.expm1(-self.load / self.modulus)
