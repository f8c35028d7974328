"""A rigid cylinder set free from rest in a viscous fluid in a concentric round box, under gravity.

For displacements that are small against the gap the equations of Navier and Stokes are linear. With
s the variable of Laplace's transform, k = √(s/ν) and the stream function ψ = f(r) sin θ, θ from the
direction of the motion,

    f = A/r + B r + C K_1(kr) + D I_1(kr),    f(a) = V a,  f'(a) = V,  f(R) = f'(R) = 0
    force on the cylinder  -m_f s H V,  m_f = π a² ρ_f,    H = 2A/(V a²) - 1

(Chen, Wambsganss & Jendrzejczyk, J. Appl. Mech. 43 (1976) 325-329, for s = iω), so that the
velocity follows from (ρ_s + ρ_f H) s V = (ρ_s - ρ_f) g/s.  Without viscosity H is the added mass

    C_m = (1 + (a/R)²)/(1 - (a/R)²)

and the acceleration (ρ_s - ρ_f) g/(ρ_s + C_m ρ_f).
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import ive, kve

POINTS = 20  # of Talbot's contour: 12 digits


@dataclass(frozen=True)
class FallingCylinder:
    """Radii of cylinder and box [m], their densities [kg/m³], kinematic viscosity [m²/s] and
    gravity [m/s²].
    """

    radius: float
    wall: float
    density: float
    fluid_density: float
    viscosity: float
    gravity: float

    @property
    def added_mass(self) -> float:
        """Return the coefficient C_m without viscosity [-]."""
        ratio = (self.radius / self.wall) ** 2
        return (1 + ratio) / (1 - ratio)

    @property
    def acceleration(self) -> float:
        """Return the acceleration at t = 0+, along gravity [m/s²]: viscosity is not felt yet."""
        mass = self.density + self.added_mass * self.fluid_density
        return (self.density - self.fluid_density) * self.gravity / mass

    def velocity(self, t: float) -> float:
        """Return the velocity along gravity at t > 0 [m/s]."""
        return self._inverse(t, 1)

    def displacement(self, t: float) -> float:
        """Return the displacement along gravity at t > 0 [m]."""
        return self._inverse(t, 2)

    def added_mass_at(self, s: complex) -> complex:
        """Return H(s), s in 1/s [-]."""
        a, R = 1.0, self.wall / self.radius
        k = np.sqrt(s / self.viscosity) * self.radius
        rows = []
        for r in (a, R):
            # both functions over their size at the surface where they are largest
            K, dK = _decaying(k, r, a)
            growing, slope = _growing(k, r, R)
            rows += [[1 / r, r, K, growing], [-1 / r**2, 1, dK, slope]]
        A = np.linalg.solve(np.array(rows), np.array([1.0, 1.0, 0.0, 0.0]))[0]
        return 2 * A - 1

    def _inverse(self, t: float, power: int) -> float:
        """Return the inverse transform of V/s^(power - 1) at t, on Talbot's contour (Abate &
        Whitt, INFORMS J. Comput. 18 (2006) 408-421).
        """
        theta = np.arange(1, POINTS) * np.pi / POINTS
        cot = 1 / np.tan(theta)
        delta = np.append(2 * POINTS / 5, 2 * theta * POINTS / 5 * (cot + 1j))
        gamma = np.append(
            np.exp(delta[0]) / 2, (1 + 1j * theta * (1 + cot**2) - 1j * cot) * np.exp(delta[1:])
        )
        weight = (self.density - self.fluid_density) * self.gravity
        values = [
            weight
            / (s ** (power + 1) * (self.density + self.fluid_density * self.added_mass_at(s)))
            for s in delta / t
        ]
        return float(2 / (5 * t) * np.real(gamma @ np.array(values)))


def _decaying(k: complex, r: float, a: float) -> tuple[complex, complex]:
    """Return K_1(kr) and its derivative by r, over exp(-ka)."""
    scale = np.exp(-k * (r - a))
    K0, K1 = (kve(order, k * r) * scale for order in (0, 1))
    return K1, -k * K0 - K1 / r


def _growing(k: complex, r: float, R: float) -> tuple[complex, complex]:
    """Return I_1(kr) and its derivative by r, over exp(kR)."""
    # ive is over exp(|Re kr|), here over exp(kR)
    scale = np.exp(np.real(k) * r - k * R)
    I0, I1 = (ive(order, k * r) * scale for order in (0, 1))
    return I1, k * I0 - I1 / r
