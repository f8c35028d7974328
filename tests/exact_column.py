"""The dynamic column of incompressible constituents, exact (de Boer, Ehlers & Liu 1993); z downward from the load.

E_c u_zz = M ü + C u̇,   p_z = (n_s/n_f) ρ_fR ü + C u̇,   σ_zz(0) = -f(t), p(0) = 0, u(L) = 0
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import ive


@dataclass(frozen=True)
class Column:
    """Set A of the literature; lengths [m], densities [kg/m³], moduli [Pa], k [m/s], specific weight [N/m³]."""

    length: float = 10.0
    lam: float = 8.375e6
    mu: float = 5.583e6
    n_s: float = 0.67
    rho_sR: float = 2000.0
    rho_fR: float = 1000.0
    k: float = 1e-2
    gamma: float = 1e4
    modes: int = 4000

    @property
    def modulus(self):
        """Return E_c = λ + 2 μ."""
        return self.lam + 2 * self.mu

    @property
    def n_f(self):
        """Return the fluid fraction."""
        return 1 - self.n_s

    @property
    def mass(self):
        """Return M = n_s ρ_sR + n_s² ρ_fR/n_f."""
        return self.n_s * self.rho_sR + self.n_s**2 * self.rho_fR / self.n_f

    @property
    def damping(self):
        """Return C = S/n_f² = γ_fR/k."""
        return self.gamma / self.k

    @property
    def speed(self):
        """Return the speed of the front, √(E_c/M)."""
        return np.sqrt(self.modulus / self.mass)

    def step_surface(self, load, t):
        """Return u(0, t) under a step load until the front comes back: the Bessel form of the half-space."""
        x = self.damping * t / (2 * self.mass)
        return load * t / np.sqrt(self.mass * self.modulus) * (ive(0, x) + ive(1, x))

    def step_front(self, load, z):
        """Return the jump of u̇ at the front where it passes z: it decays as exp(-C t/(2M)), t = z/c."""
        return load / np.sqrt(self.mass * self.modulus) * np.exp(-self.damping * z / self.speed / (2 * self.mass))

    def harmonic(self, amplitude, omega, z, t):
        """Return u and p at (z, t) under f = amplitude (1 - cos ω t), at rest at t = 0; the static part is summed in closed form.

        u = Σ cos(k z) q, M q̈ + C q̇ + E_c k² q = 2 f/L, k = (2n+1) π/2L; in the sum of q - 2 f/(L E_c k²) the terms fall like k⁻⁴.
        """
        k = (2 * np.arange(self.modes) + 1) * np.pi / (2 * self.length)
        stiffness, unit = self.modulus * k**2, 2 * amplitude / self.length
        steady, oscillating = unit / stiffness, -unit / (stiffness - self.mass * omega**2 + 1j * omega * self.damping)
        root = np.sqrt(self.damping**2 - 4 * self.mass * stiffness + 0j)
        s1, s2 = (-self.damping + root) / (2 * self.mass), (-self.damping - root) / (2 * self.mass)
        q0, v0 = -(steady + oscillating.real), -(1j * omega * oscillating).real
        a = (v0 - s2 * q0) / (s1 - s2)
        parts = [(1j * omega, oscillating), (s1, a), (s2, q0 - a)]
        q, v, acceleration = (sum((c * s**order * np.exp(s * t)).real for s, c in parts) for order in range(3))
        load = amplitude * (1 - np.cos(omega * t))
        u = load * (self.length - z) / self.modulus + (np.cos(k * z) * (q + steady - unit / amplitude * load / stiffness)).sum()
        p = ((self.n_s / self.n_f * self.rho_fR * acceleration + self.damping * v) * np.sin(k * z) / k).sum()
        return u, p
