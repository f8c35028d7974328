"""Exact solutions of the Navier-Stokes equations without a body force; the pressure has no level of
its own.

Each has velocity(t, X) (n, d) [m/s] and pressure(t, X) (n,) [Pa] at points X (n, d) [m], and
`density` and `speed`: ρU² is the size of its pressure.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Kovasznay:
    """Steady flow behind a row of obstacles, of period `length` in y (Kovasznay, Proc. Camb. Phil.
    Soc. 44 (1948) 58-62).

    v_x = U (1 - e^ξ cos η), v_y = U κ/2π e^ξ sin η, p = ρU²/2 (1 - e^2ξ) with ξ = κ x/L, η = 2π
    y/L, κ = Re/2 - √(Re²/4 + 4π²), Re = ρUL/μ
    """

    density: float
    viscosity: float
    speed: float
    length: float

    @property
    def _decay(self) -> float:
        half = self.density * self.speed * self.length / self.viscosity / 2
        return half - np.sqrt(half**2 + 4 * np.pi**2)

    def velocity(self, t: float, X: np.ndarray) -> np.ndarray:
        """Return the velocity at any time."""
        x, y = X.T / self.length
        grown = np.exp(self._decay * x)
        angle = 2 * np.pi * y
        decay = self._decay
        return self.speed * np.column_stack(
            [1 - grown * np.cos(angle), decay / (2 * np.pi) * grown * np.sin(angle)]
        )

    def pressure(self, t: float, X: np.ndarray) -> np.ndarray:
        """Return the pressure at any time."""
        return (
            self.density * self.speed**2 / 2 * (1 - np.exp(2 * self._decay * X[:, 0] / self.length))
        )


@dataclass(frozen=True)
class TaylorGreen:
    """Decaying vortices of side `length` in the plane (Taylor, Phil. Mag. 46 (1923) 671-674).

    v = U e^(-2νk²t) (sin kx cos ky, -cos kx sin ky), p = ρU²/4 e^(-4νk²t) (cos 2kx + cos 2ky), k =
    π/L
    """

    density: float
    viscosity: float
    speed: float
    length: float

    def _fading(self, t: float) -> float:
        return np.exp(-2 * self.viscosity / self.density * (np.pi / self.length) ** 2 * t)

    def velocity(self, t: float, X: np.ndarray) -> np.ndarray:
        """Return the velocity at a time."""
        x, y = np.pi * X.T / self.length
        return (
            self.speed
            * self._fading(t)
            * np.column_stack([np.sin(x) * np.cos(y), -np.cos(x) * np.sin(y)])
        )

    def pressure(self, t: float, X: np.ndarray) -> np.ndarray:
        """Return the pressure at a time."""
        x, y = 2 * np.pi * X.T / self.length
        return self.density * (self.speed * self._fading(t)) ** 2 / 4 * (np.cos(x) + np.cos(y))


@dataclass(frozen=True)
class EthierSteinman:
    """Decaying three-dimensional flow along its own vorticity (Ethier & Steinman, Int. J. Numer.
    Meth. Fluids 19 (1994) 369-375).

    v_x = -U e^(-νd²t) (e^ax sin(ay + dz) + e^az cos(ax + dy)), the others by x → y → z → x, p =
    -ρ|v|²/2, with a = π/4L, d = π/2L
    """

    density: float
    viscosity: float
    speed: float
    length: float

    def velocity(self, t: float, X: np.ndarray) -> np.ndarray:
        """Return the velocity at a time."""
        a = np.pi / 4 / self.length
        d = np.pi / 2 / self.length
        x, y, z = X.T
        fading = -self.speed * np.exp(-self.viscosity / self.density * d**2 * t)

        def component(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
            return np.exp(a * x) * np.sin(a * y + d * z) + np.exp(a * z) * np.cos(a * x + d * y)

        return fading * np.column_stack(
            [component(x, y, z), component(y, z, x), component(z, x, y)]
        )

    def pressure(self, t: float, X: np.ndarray) -> np.ndarray:
        """Return the pressure at a time."""
        return -self.density / 2 * (self.velocity(t, X) ** 2).sum(axis=1)
