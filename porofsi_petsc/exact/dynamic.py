"""The dynamic column of incompressible constituents (de Boer, Ehlers & Liu 1993), and of
compressible ones (Biot 1956); z downward from the drained, loaded top.

    E_c u_zz = M ü + C u̇,   p_z = (n_s/n_f) ρ_fR ü + C u̇,   σ_zz(0) = -f(t), p(0) = 0, u(L) = 0

In the modes u = Σ cos(k z) q, k = (2n+1) π/2L, every mode is an oscillator M q̈ + C q̇ + E_c k² q =
2 f/L; its static part is summed in closed form.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ive

from .series import on_distinct


@dataclass(frozen=True)
class DynamicColumn:
    """Length L [m], λ and μ [Pa], n_s [-], real densities [kg/m³], k_f [m/s], γ_fR [N/m³], number
    of modes of the sums.
    """

    length: float
    lam: float
    mu: float
    n_s: float
    rho_sR: float
    rho_fR: float
    k: float
    gamma: float
    modes: int = 4000

    @property
    def modulus(self) -> float:
        """Return E_c = λ + 2 μ."""
        return self.lam + 2 * self.mu

    @property
    def n_f(self) -> float:
        """Return the fluid fraction."""
        return 1 - self.n_s

    @property
    def mass(self) -> float:
        """Return M = n_s ρ_sR + n_s² ρ_fR/n_f."""
        return self.n_s * self.rho_sR + self.n_s**2 * self.rho_fR / self.n_f

    @property
    def damping(self) -> float:
        """Return C = S/n_f² = γ_fR/k."""
        return self.gamma / self.k

    @property
    def speed(self) -> float:
        """Return the speed of the front, √(E_c/M)."""
        return np.sqrt(self.modulus / self.mass)

    def step_surface(self, load: float, t: float) -> float:
        """Return u(0, t) under a step load until the front comes back: the Bessel form of the
        half-space.
        """
        x = self.damping * t / (2 * self.mass)
        return load * t / np.sqrt(self.mass * self.modulus) * (ive(0, x) + ive(1, x))

    def step_front(self, load: float, z: float) -> float:
        """Return the jump of u̇ at the front where it passes z: it decays as exp(-C t/(2M)), t =
        z/c.
        """
        return (
            load
            / np.sqrt(self.mass * self.modulus)
            * np.exp(-self.damping * z / self.speed / (2 * self.mass))
        )

    def step(self, load: float, z: ArrayLike, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Return u and p at depths z [m], any shape, and time t under a step load, at rest at t =
        0.

        The sums fall like k⁻² (p ahead of the front only); u at the surface has more digits by
        `step_surface`.
        """
        k, s1, s2 = self._modes()
        unit = 2 * load / (self.length * self.mass) / (s1 - s2)  # q̇ = unit (e^(s1 t) - e^(s2 t))
        return self._sum(z, t, k, load, [(s1, unit / s1), (s2, -unit / s2)])

    def harmonic(
        self, amplitude: float, omega: float, z: ArrayLike, t: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return u and p at depths z [m], any shape, and time t under f = amplitude (1 - cos ω t),
        at rest at t = 0.

        In the sum of q - 2 f/(L E_c k²) the terms fall like k⁻⁴.
        """
        k, s1, s2 = self._modes()
        unit = 2 * amplitude / self.length
        steady = unit / (self.modulus * k**2)
        oscillating = -unit / (
            self.modulus * k**2 - self.mass * omega**2 + 1j * omega * self.damping
        )
        q0 = -(steady + oscillating.real)
        v0 = -(1j * omega * oscillating).real
        a = (v0 - s2 * q0) / (s1 - s2)
        quasi_static = unit * np.cos(omega * t) / (self.modulus * k**2)
        parts = [(1j * omega, oscillating), (s1, a), (s2, q0 - a)]
        return self._sum(z, t, k, amplitude * (1 - np.cos(omega * t)), parts, quasi_static)

    def _modes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return k (modes,) and the two roots of M s² + C s + E_c k²; the small one without loss of
        digits.
        """
        k = (2 * np.arange(self.modes) + 1) * np.pi / (2 * self.length)
        root = np.sqrt(self.damping**2 - 4 * self.mass * self.modulus * k**2 + 0j)
        s2 = (-self.damping - root) / (2 * self.mass)
        return k, self.modulus * k**2 / (self.mass * s2), s2

    def _sum(
        self,
        z: ArrayLike,
        t: float,
        k: np.ndarray,
        load: float,
        parts: list[tuple[Any, np.ndarray]],
        remainder: float | np.ndarray = 0.0,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return u = f (L - z)/E_c + Σ cos(k z) (Σ c e^(s t) + remainder) and p = Σ sin(k z)/k
        (n_s/n_f ρ_fR q̈ + C q̇).
        """
        q, v, a = (sum((c * s**order * np.exp(s * t)).real for s, c in parts) for order in range(3))
        drag = (self.n_s / self.n_f * self.rho_fR * a + self.damping * v) / k
        u = on_distinct(
            lambda z: (
                load * (self.length - z) / self.modulus
                + np.cos(np.multiply.outer(z, k)) @ (q + remainder)
            ),
            z,
        )
        return u, on_distinct(lambda z: np.sin(np.multiply.outer(z, k)) @ drag, z)


@dataclass(frozen=True)
class CompressibleColumn:
    """Length L [m], E_c [Pa], partial densities ρ_s, ρ_f [kg/m³], n_f [-], drag S_d [N s/m⁴], α [-]
    and storage S [1/Pa], number of modes of the sums.

    ρ_s ü = E_c u_zz - (α - n_f) p_z + S_d (U̇ - u̇),  ρ_f Ü = -n_f p_z - S_d (U̇ - u̇),
    S p = -(n_f U_z + (α - n_f) u_z), σ_E(0) = -f(t), p(0) = 0, u(L) = U(L) = 0.  In the modes
    cos(k z), k = (2n+1) π/2L, they are two oscillators with the force 2 f/L on the first; the
    static part of u is summed in closed form.
    """

    length: float
    modulus: float
    rho_s: float
    rho_f: float
    n_f: float
    drag: float
    biot: float
    storage: float
    modes: int = 1000

    def harmonic(
        self, amplitude: float, omega: float, z: ArrayLike, t: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return u and p at depths z [m], any shape, and time t under f = amplitude (1 - cos ω t),
        at rest at t = 0.
        """
        k = (2 * np.arange(self.modes) + 1) * np.pi / (2 * self.length)
        f = amplitude * (1 - np.cos(omega * t))
        q, Q = self._modal(k, amplitude, omega, t)
        content = self.n_f * Q + (self.biot - self.n_f) * q
        rest = q - 2 * f / (self.length * self.modulus * k**2)
        u = on_distinct(
            lambda z: f * (self.length - z) / self.modulus + np.cos(np.multiply.outer(z, k)) @ rest,
            z,
        )
        p = on_distinct(lambda z: np.sin(np.multiply.outer(z, k)) @ (k * content) / self.storage, z)
        return u, p

    def _modal(
        self, k: np.ndarray, amplitude: float, omega: float, t: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the amplitudes of u and U of all modes, (modes,) each."""
        n, rest = self.n_f, self.biot - self.n_f
        stored = np.outer([rest, n], [rest, n]) / self.storage + np.diag([self.modulus, 0.0])
        K = k[:, None, None] ** 2 * stored
        M = np.diag([self.rho_s, self.rho_f])
        C = self.drag * np.array([[1.0, -1.0], [-1.0, 1.0]])
        force = np.zeros((len(k), 2, 1))
        force[:, 0] = 2 * amplitude / self.length
        constant = np.linalg.solve(K, force)
        X = -np.linalg.solve(K - omega**2 * M + 1j * omega * C, force)
        start = -np.concatenate([constant + X.real, (1j * omega * X).real], axis=1)
        A = np.zeros((len(k), 4, 4))
        A[:, :2, 2:] = np.eye(2)
        A[:, 2:, :2] = -np.linalg.solve(M, K)
        A[:, 2:, 2:] = -np.linalg.solve(M, C)
        s, vectors = np.linalg.eig(A)
        parts = np.linalg.solve(vectors, start.astype(complex))
        free = vectors[:, :2] @ (np.exp(s * t)[..., None] * parts)
        found = (free + constant + X * np.exp(1j * omega * t)).real[..., 0]
        return found[:, 0], found[:, 1]
