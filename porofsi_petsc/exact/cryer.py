"""Cryer's problem: a saturated sphere whose drained surface is pressed by a sudden load; p in the
middle rises before it falls.

Cryer (1963), with compressible constituents Verruijt (2016).  With the volume change e, div of the
displacement, the radial balance is E_c e' = α p', so that α p = E_c (e(r) - e(R)); the content of
fluid ζ = α e + S p diffuses, ζ_t = c_v Δζ; the load is -p0 = E_c e(R) - 4μ u(R)/R.  With D = α + S
E_c/α a mode ζ = j_0(x r/R) has e = (ζ + (D/α - 1) j_0(x))/D.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from .series import LARGEST_EXPONENT, SMALLEST_TIME, on_distinct

MODES = 2000  # enough down to the smallest dimensionless time of the sums


@dataclass(frozen=True)
class Cryer:
    """load p0 [Pa], radius R [m], λ and μ [Pa], diffusivity c_v = (k_f/γ_fR)/(S + α²/E_c) [m²/s], α
    and storage S [1/Pa]; r [m] from the middle, t > 0 [s].
    """

    load: float
    radius: float
    lam: float
    mu: float
    diffusivity: float
    biot: float = 1.0
    storage: float = 0.0

    @property
    def _stored(self) -> float:
        """Return D/α - 1 = S E_c/α²."""
        return self.storage * self.modulus / self.biot**2

    @property
    def initial_pressure(self) -> float:
        """Return p(r, 0+) = p0 α/(α² + S K), K = λ + 2μ/3 [Pa]."""
        return self.load * self.biot / (self.biot**2 + self.storage * (self.lam + 2 / 3 * self.mu))

    @property
    def modulus(self) -> float:
        """Return E_c = λ + 2μ [Pa]."""
        return self.lam + 2 * self.mu

    @cached_property
    def roots(self) -> np.ndarray:
        """Return x_n with (1 - η x²/2) sin x = x cos x, η = (E_c/2μ) (1 + S K/α²), one below every
        multiple of π, (MODES,).
        """
        bulk = self.lam + 2 / 3 * self.mu
        eta = self.modulus / (2 * self.mu) * (1 + self.storage * bulk / self.biot**2)

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
        """Return the roots that count at time t and their a = -2 p0 e^(-x² T)/(x F'), F(x) = (D/α)
        E_c sin x - 4μ [(sin x - x cos x)/x² + (D/α - 1) sin x/3].
        """
        T = self.diffusivity * t / self.radius**2
        x = self.roots[: int(np.sqrt(LARGEST_EXPONENT / max(T, SMALLEST_TIME)) / np.pi) + 2]
        slope = (1 + self._stored) * self.modulus * np.cos(x) - 4 * self.mu * (
            np.sin(x) / x - 2 * (np.sin(x) - x * np.cos(x)) / x**3 + self._stored * np.cos(x) / 3
        )
        return x, -2 * self.load * np.exp(-(x**2) * T) / (x * slope)

    def pressure(self, r: ArrayLike, t: float) -> np.ndarray:
        """Return p = (E_c/α) Σ (x j_0(x r/R) - sin x) a [Pa]."""
        from scipy.special import spherical_jn

        x, factors = self._modes(t)
        return on_distinct(
            lambda r: (
                self.modulus
                / self.biot
                * (x * spherical_jn(0, np.multiply.outer(r / self.radius, x)) - np.sin(x))
                @ factors
            ),
            r,
        )

    def displacement(self, r: ArrayLike, t: float) -> np.ndarray:
        """Return the outward u = -p0 r/(3K) + Σ [R j_1(x r/R) + (D/α - 1) sin x r/3] a [m], K = λ +
        2μ/3.
        """
        from scipy.special import spherical_jn

        x, factors = self._modes(t)
        linear = -self.load / (3 * self.lam + 2 * self.mu)
        linear += self._stored / 3 * np.sin(x) @ factors
        return on_distinct(
            lambda r: (
                linear * r
                + self.radius * spherical_jn(1, np.multiply.outer(r / self.radius, x)) @ factors
            ),
            r,
        )
