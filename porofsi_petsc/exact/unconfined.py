"""Unconfined compression: a saturated cylinder or strip between smooth impermeable plates that come
together at once.

Incompressible constituents, small strain; Armstrong, Lai & Mow, J. Biomech. Eng. 106 (1984) 165 for
the cylinder, and the same in plane strain.  The side r = R (x = a of the strip) is drained and
free; the axial strain is -ε from t = 0+.  With H = λ + 2μ, diffusivity c = k H/γ and T = c t/R² the
radial balance and Darcy's law leave u_t = c (div u)_r, p_r = H (div u)_r, div the radial one:

    at t = 0+   div u = ε, that is u = ε r/2 (strip: ε x), p = 2μ (u/r) = μ ε (strip: 2μ ε)
    at the end  u = ν ε r (strip: ν/(1 - ν) ε x), p = 0

and in between the modes of the boundary condition σ_r = H u_r + λ (u/r - ε) = 0 (strip: H u_x = λ
ε).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from .series import LARGEST_EXPONENT, SMALLEST_TIME, modes, on_distinct

MODES = 2000  # enough down to the smallest dimensionless time of the sums


@dataclass(frozen=True)
class UnconfinedCylinder:
    """strain ε [-], radius R [m], λ and μ [Pa], diffusivity c [m²/s]."""

    strain: float
    radius: float
    lam: float
    mu: float
    diffusivity: float

    @property
    def poisson(self) -> float:
        """Return ν."""
        return self.lam / (2 * (self.lam + self.mu))

    @cached_property
    def roots(self) -> np.ndarray:
        """Return a_n with J1(a) = (1 - ν)/(1 - 2ν) a J0(a), one below every zero of J0,
        (MODES,).
        """
        from scipy.optimize import brentq  # slow to import, and few scenes have this reference
        from scipy.special import j0, j1, jn_zeros

        ratio = (1 - self.poisson) / (1 - 2 * self.poisson)

        def equation(a: float) -> float:
            return j1(a) - ratio * a * j0(a)

        upper = jn_zeros(0, MODES)
        lower = np.append(1e-3, jn_zeros(1, MODES - 1))
        return np.array(
            [
                brentq(equation, low, high, xtol=1e-14)
                for low, high in zip(lower, upper, strict=True)
            ]
        )

    def _modes(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the roots a that count at time t and A e^(-a² T), A = ε (1 - 2ν)/(1 - ν)/(J1(a)
        (a² - (1 - 2ν)/(1 - ν)²)).
        """
        from scipy.special import j1

        T = self.diffusivity * t / self.radius**2
        nu = self.poisson
        a = self.roots[: int(np.sqrt(LARGEST_EXPONENT / max(T, SMALLEST_TIME)) / np.pi) + 2]
        amplitude = (
            self.strain * (1 - 2 * nu) / (1 - nu) / (j1(a) * (a**2 - (1 - 2 * nu) / (1 - nu) ** 2))
        )
        return a, amplitude * np.exp(-(a**2) * T)

    def displacement(self, r: ArrayLike, t: float) -> np.ndarray:
        """Return u_r = ν ε r + R Σ A_n J1(a_n r/R) e^(-a_n² T) [m]."""
        from scipy.special import j1

        a, amplitude = self._modes(t)
        linear = self.poisson * self.strain
        return on_distinct(
            lambda r: (
                linear * r + self.radius * j1(np.multiply.outer(r / self.radius, a)) @ amplitude
            ),
            r,
        )

    def pressure(self, r: ArrayLike, t: float) -> np.ndarray:
        """Return p = H Σ A_n a_n (J0(a_n r/R) - J0(a_n)) e^(-a_n² T) [Pa]."""
        from scipy.special import j0

        a, amplitude = self._modes(t)
        factors = (self.lam + 2 * self.mu) * amplitude * a
        return on_distinct(
            lambda r: (j0(np.multiply.outer(r / self.radius, a)) - j0(a)) @ factors, r
        )


@dataclass(frozen=True)
class UnconfinedStrip:
    """strain ε [-], half width a [m], λ and μ [Pa], diffusivity c [m²/s]; plane strain."""

    strain: float
    half_width: float
    lam: float
    mu: float
    diffusivity: float

    def _modes(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Return M = π (2n + 1)/2, and (-1)^n 2 ε (1 - λ/H)/M² e^(-M² T), for the modes that count
        at time t.
        """
        T = self.diffusivity * t / self.half_width**2
        M = modes(T)
        drained = self.lam / (self.lam + 2 * self.mu)
        return M, 2 * self.strain * (1 - drained) * np.sin(M) / M**2 * np.exp(-(M**2) * T)

    def displacement(self, x: ArrayLike, t: float) -> np.ndarray:
        """Return u_x = λ/H ε x + a Σ A_n sin(M_n x/a) e^(-M_n² T) [m]."""
        M, amplitude = self._modes(t)
        linear = self.lam / (self.lam + 2 * self.mu) * self.strain
        modal = self.half_width * amplitude
        return on_distinct(
            lambda x: linear * x + np.sin(np.multiply.outer(x / self.half_width, M)) @ modal, x
        )

    def pressure(self, x: ArrayLike, t: float) -> np.ndarray:
        """Return p = H Σ A_n M_n cos(M_n x/a) e^(-M_n² T) [Pa]."""
        M, amplitude = self._modes(t)
        factors = (self.lam + 2 * self.mu) * amplitude * M
        return on_distinct(lambda x: np.cos(np.multiply.outer(x / self.half_width, M)) @ factors, x)
