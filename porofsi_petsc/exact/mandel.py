"""Mandel's problem: a saturated slab between two rigid smooth plates, squeezed by a sudden force,
drained at its two sides.

Mandel (1953), with compressible constituents Cheng & Detournay (1988); ν_u = 1/2 and Skempton's B =
1 of incompressible ones.  x [m] is
measured from the middle of the slab of width 2a, y from its middle plane; the force is 2F per depth
[N/m].
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from .series import LARGEST_EXPONENT, SMALLEST_TIME, on_distinct

MODES = 2000  # enough down to the smallest dimensionless time of the sums


@dataclass(frozen=True)
class Mandel:
    """force F [N/m], half width a [m], λ and μ [Pa], diffusivity c_v = (k_f/γ_fR)/(S + α²/E_c)
    [m²/s], α and storage S [1/Pa].
    """

    force: float
    half_width: float
    lam: float
    mu: float
    diffusivity: float
    biot: float = 1.0
    storage: float = 0.0

    @property
    def poisson(self) -> float:
        """Return ν."""
        return self.lam / (2 * (self.lam + self.mu))

    @property
    def _bulk(self) -> tuple[float, float, float]:
        """Return K, B and ν_u: B = α/(α² + S K), K_u = K/(1 - α B)."""
        K = self.lam + 2 / 3 * self.mu
        B = self.biot / (self.biot**2 + self.storage * K)
        softness = 1 - self.biot * B  # K/K_u
        undrained = (3 * K - 2 * self.mu * softness) / (2 * (3 * K + self.mu * softness))
        return K, B, undrained

    @property
    def undrained_poisson(self) -> float:
        """Return ν_u."""
        return self._bulk[2]

    @property
    def initial_pressure(self) -> float:
        """Return p(x, 0+) = F B (1 + ν_u)/(3 a) [Pa]."""
        _, B, undrained = self._bulk
        return self.force * B * (1 + undrained) / (3 * self.half_width)

    @cached_property
    def roots(self) -> np.ndarray:
        """Return a_n with tan a_n = (1 - ν)/(ν_u - ν) a_n, one below every odd multiple of π/2,
        (MODES,).
        """
        ratio = (1 - self.poisson) / (self.undrained_poisson - self.poisson)

        def equation(a: float) -> float:
            return np.sin(a) - ratio * a * np.cos(a)

        poles = np.pi * (np.arange(MODES) + 0.5)
        lower = np.append(
            1e-3, poles[1:] - np.pi / 2
        )  # sin > 0 there and cos > 0, so that the sign changes up to the pole
        from scipy.optimize import brentq  # slow to import, and few scenes have this reference

        return np.array(
            [
                brentq(equation, low, high, xtol=1e-14)
                for low, high in zip(lower, poles, strict=True)
            ]
        )

    def _decay(self, t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the roots that count at time t, their e^(-a² T) and their a - sin a cos a."""
        T = self.diffusivity * t / self.half_width**2
        count = int(np.sqrt(LARGEST_EXPONENT / max(T, SMALLEST_TIME)) / np.pi) + 2
        a = self.roots[:count]
        return a, np.exp(-(a**2) * T), a - np.sin(a) * np.cos(a)

    def pressure(self, x: ArrayLike, t: float) -> np.ndarray:
        """Return p = 2 p(0+) Σ sin a_n/(a_n - sin a_n cos a_n) (cos(a_n x/a) - cos a_n) e^(-a_n² T)
        [Pa].
        """
        a, decay, denominator = self._decay(t)
        factors = 2 * self.initial_pressure * np.sin(a) / denominator * decay
        return on_distinct(
            lambda x: (np.cos(np.multiply.outer(x / self.half_width, a)) - np.cos(a)) @ factors, x
        )

    def displacement_x(self, x: ArrayLike, t: float) -> np.ndarray:
        """Return u_x = (F/G) {[ν/2 - ν_u Σ sin a cos a/(a - sin a cos a) e] x/a + Σ cos a/(a - sin
        a cos a) sin(a x/a) e} [m].
        """
        a, decay, denominator = self._decay(t)
        sums = (np.sin(a) * np.cos(a) / denominator) @ decay
        linear = self.poisson / 2 - self.undrained_poisson * sums
        factors = np.cos(a) / denominator * decay
        r = self.force / self.mu
        return on_distinct(
            lambda x: (
                r
                * (
                    linear * x / self.half_width
                    + np.sin(np.multiply.outer(x / self.half_width, a)) @ factors
                )
            ),
            x,
        )

    def displacement_y(self, y: ArrayLike, t: float) -> np.ndarray:
        """Return u_y = -(F/(2 G a)) [1 - ν - 2 (1 - ν_u) Σ sin a cos a/(a - sin a cos a) e^(-a²
        T)] y [m].
        """
        a, decay, denominator = self._decay(t)
        sums = (np.sin(a) * np.cos(a) / denominator) @ decay
        strain = 1 - self.poisson - 2 * (1 - self.undrained_poisson) * sums
        return -self.force / (2 * self.mu * self.half_width) * strain * np.asarray(y)
