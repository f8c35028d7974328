"""Vibration of an elastic ring in plane strain with an ideal incompressible fluid between it and a
rigid wall around it.

Displacement of circumferential mode n, harmonic in time: u_r = U(r) cos nθ, u_θ = V(r) sin nθ.  The
two-dimensional elasticity of Navier and Lamé (small strain, inside free) is kept in its weak form
over the thickness,

    ∫ [λ (U' + H)² + 2μ (U'² + H²) + μ (V' - (nU + V)/r)²] r dr = ω² {∫ ρ_s (U² + V²) r dr + ρ_f m R
    U(R)²},  H = (U + nV)/r

and solved in Legendre polynomials, which converge exponentially.  The fluid is the potential flow φ
~ rⁿ + b²ⁿ r⁻ⁿ between R and the wall at b: its pressure on the ring is p = ρ_f m ü_r (positive when
the ring is accelerated outward), where the length

    m = (R/n) (b²ⁿ + R²ⁿ)/(b²ⁿ - R²ⁿ)

is the added mass per area over the density (Fritz, J. Eng. Ind. 94 (1972) 167-173, for rigid
motion, n = 1).
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre
from scipy.linalg import eigh

# of the polynomials: 8 digits up to a ring as thick as its inner radius; round-off takes more than
# a higher one gives
DEGREE = 8


@dataclass(frozen=True)
class Ring:
    """Radii inside, outside and of the wall [m], λ and μ [Pa], density of the solid [kg/m³],
    circumferential mode n >= 2.
    """

    inner: float
    outer: float
    wall: float
    lam: float
    mu: float
    density: float
    mode: int = 2

    @property
    def added_length(self) -> float:
        """Return m = (R/n) (b²ⁿ + R²ⁿ)/(b²ⁿ - R²ⁿ) [m]."""
        ratio = (self.outer / self.wall) ** (2 * self.mode)
        return self.outer / self.mode * (1 + ratio) / (1 - ratio)

    def compression(self, pressure: float) -> float:
        """Return the inward displacement of the outer surface under a uniform pressure on it, at
        rest [m] (Lamé 1852).

        σ_r = A - B/r², σ_θ = A + B/r² with σ_r = 0 inside and -p outside; 2 u = A r/(λ + μ) + B/(μ
        r).
        """
        A = -pressure * self.outer**2 / (self.outer**2 - self.inner**2)
        B = A * self.inner**2
        return -(A * self.outer / (self.lam + self.mu) + B / (self.mu * self.outer)) / 2

    def frequency(self, fluid_density: float = 0.0) -> float:
        """Return the lowest angular frequency of the mode [rad/s] under a fluid of the density
        [kg/m³]; 0: dry.
        """
        return math.sqrt(self._lowest(fluid_density)[0])

    def shape(self, X: np.ndarray, fluid_density: float = 0.0) -> np.ndarray:
        """Return the displacement of the mode at points of the ring, (N, 2) for X : (N, 2) [m].

        It is scaled to 1 outward on the outer surface at θ = 0, the direction of x; there and at θ
        = π/n u_θ = 0.
        """
        coefficients = self._lowest(fluid_density)[1]
        r = np.hypot(*X.T)
        angle = np.arctan2(X[:, 1], X[:, 0])
        radial, tangential = (self._basis(r)[0] @ c for c in np.split(coefficients, 2))
        u_r = radial * np.cos(self.mode * angle)
        u_t = tangential * np.sin(self.mode * angle)
        x = np.cos(angle)
        y = np.sin(angle)
        return np.stack([u_r * x - u_t * y, u_r * y + u_t * x], axis=1)

    def _basis(self, r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the Legendre polynomials over the thickness and their derivatives at r, each (N,
        DEGREE + 1).
        """
        half = (self.outer - self.inner) / 2
        s = (r - self.inner) / half - 1
        slopes = legendre.legder(np.eye(DEGREE + 1)) / half
        return legendre.legvander(s, DEGREE), legendre.legvander(s, DEGREE - 1) @ slopes

    def _lowest(self, fluid_density: float) -> tuple[float, np.ndarray]:
        """Return the smallest ω² and the coefficients of U and V, (2 DEGREE + 2,), with U(R) =
        1.
        """
        stiffness, mass = self._matrices()
        surface = np.append(
            np.ones(DEGREE + 1), np.zeros(DEGREE + 1)
        )  # every Legendre polynomial is 1 at R
        mass += fluid_density * self.added_length * self.outer * np.outer(surface, surface)
        values, vectors = eigh(stiffness, mass, subset_by_index=[0, 0])
        return values[0], vectors[:, 0] / (surface @ vectors[:, 0])

    def _matrices(self) -> tuple[np.ndarray, np.ndarray]:
        """Return stiffness and mass without the fluid, each (2 DEGREE + 2, 2 DEGREE + 2), by Gauss
        quadrature.
        """
        s, gauss = legendre.leggauss(3 * DEGREE)  # 1/r is no polynomial
        r = self.inner + (self.outer - self.inner) / 2 * (s + 1)
        weight = gauss * r * (self.outer - self.inner) / 2
        N, slope = self._basis(r)
        zero = np.zeros_like(N)
        by_r = N / r[:, None]
        radial = np.hstack([slope, zero])
        hoop = np.hstack([by_r, self.mode * by_r])
        shear = np.hstack([-self.mode * by_r, slope - by_r])

        def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
            return a.T @ (weight[:, None] * b)

        stiffness = self.lam * product(radial + hoop, radial + hoop) + self.mu * product(
            shear, shear
        )
        stiffness += 2 * self.mu * (product(radial, radial) + product(hoop, hoop))
        return stiffness, self.density * np.kron(np.eye(2), product(N, N))
