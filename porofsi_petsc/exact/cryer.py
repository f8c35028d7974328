"""Cryer's problem: a saturated sphere whose drained surface is pressed by a sudden load; p in the
middle rises before it falls.

Incompressible constituents; Cryer (1963).  With the volume change e, div of the displacement, the
radial balance is E_c e' = p', so that p = E_c (e(r) - e(R)) and e diffuses, e_t = c_v Δe; the load
is -p0 = E_c e(R) - 4μ u(R)/R.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from .series import LARGEST_EXPONENT, SMALLEST_TIME, on_distinct

MODES = 2000  # enough down to the smallest dimensionless time of the sums


@dataclass(frozen=True)
class Cryer:
    """load p0 [Pa], radius R [m], λ and μ [Pa], diffusivity c_v = k_f (λ + 2μ)/γ_fR [m²/s]; r [m]
    from the middle, t > 0 [s].
    """

    load: float
    radius: float
    lam: float
    mu: float
    diffusivity: float

    @property
    def modulus(self) -> float:
        """Return E_c = λ + 2μ [Pa]."""
        return self.lam + 2 * self.mu

    @cached_property
    def roots(self) -> np.ndarray:
        """Return x_n with (1 - η x²/2) sin x = x cos x, η = E_c/2μ, one below every multiple of π,
        (MODES,).
        """
        eta = self.modulus / (2 * self.mu)

        def equation(x: float) -> float:
            return (1 - eta * x**2 / 2) * np.sin(x) - x * np.cos(x)

        from scipy.optimize import brentq  # slow to import, and few scenes have this reference

        ends = np.pi * np.arange(MODES + 1)
        ends[0] = 1e-3  # x = 0 is no mode
        return np.array(
            [
                brentq(equation, low, high, xtol=1e-14)
                for low, high in zip(ends[:-1], ends[1:], strict=True)
            ]
        )

    def _modes(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the roots that count at time t and their -2 p0 e^(-x² T)/(x D'), D(x) = E_c sin x
        - 4μ (sin x - x cos x)/x².
        """
        T = self.diffusivity * t / self.radius**2
        x = self.roots[: int(np.sqrt(LARGEST_EXPONENT / max(T, SMALLEST_TIME)) / np.pi) + 2]
        slope = self.modulus * np.cos(x) - 4 * self.mu * (
            np.sin(x) / x - 2 * (np.sin(x) - x * np.cos(x)) / x**3
        )
        return x, -2 * self.load * np.exp(-(x**2) * T) / (x * slope)

    def pressure(self, r: ArrayLike, t: float) -> np.ndarray:
        """Return p = E_c Σ (x j_0(x r/R) - sin x) a, a = -2 p0 e^(-x² T)/(x D') [Pa]; p(r, 0+) =
        p0.
        """
        from scipy.special import spherical_jn

        x, factors = self._modes(t)
        return on_distinct(
            lambda r: (
                self.modulus
                * (x * spherical_jn(0, np.multiply.outer(r / self.radius, x)) - np.sin(x))
                @ factors
            ),
            r,
        )

    def displacement(self, r: ArrayLike, t: float) -> np.ndarray:
        """Return the outward u = -p0 r/(3K) + R Σ j_1(x r/R) a [m], K = λ + 2μ/3."""
        from scipy.special import spherical_jn

        x, factors = self._modes(t)
        drained = -self.load / (3 * self.lam + 2 * self.mu)
        return on_distinct(
            lambda r: (
                drained * r
                + self.radius * spherical_jn(1, np.multiply.outer(r / self.radius, x)) @ factors
            ),
            r,
        )
