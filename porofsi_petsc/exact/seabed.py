"""A standing wave on a deep seabed: incompressible constituents, quasi-static, plane strain
(Yamamoto et al. 1978; Madsen 1978).

Where the surface is pressed by the pressure of the water alone, p̂ = p0 sin ωt cos kx with k =
2π/L, the volume does not change, the permeability and ν have no influence, and p is harmonic.  z
[m] is the depth, x [m] the distance from a crest.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Seabed:
    """load p0 [Pa], length L of the wave [m], frequency ω [rad/s], shear modulus μ [Pa]."""

    load: float
    length: float
    frequency: float
    mu: float

    @property
    def wavenumber(self) -> float:
        """Return k = 2π/L [1/m]."""
        return 2 * np.pi / self.length

    def _surface(self, t: float) -> float:
        return self.load * np.sin(self.frequency * t)

    def pressure(self, x: np.ndarray, z: np.ndarray, t: float) -> np.ndarray:
        """Return p = p0 sin ωt e^(-kz) cos kx [Pa]."""
        k = self.wavenumber
        return self._surface(t) * np.exp(-k * z) * np.cos(k * x)

    def displacement(self, x: np.ndarray, z: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Return u_x = p0 sin ωt/(2μ) z e^(-kz) sin kx and the upward u_y = -p0 sin ωt/(2μk) (1 +
        kz) e^(-kz) cos kx [m].
        """
        k = self.wavenumber
        size = self._surface(t) * np.exp(-k * z) / (2 * self.mu)
        return size * z * np.sin(k * x), -size / k * (1 + k * z) * np.cos(k * x)
