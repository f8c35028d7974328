"""A strip load on a drained saturated half-space in plane strain (McNamee & Gibson 1960),
incompressible constituents.

For the component cos(ξ x) of the load, with s the Laplace variable and q² = ξ² + s/c_v, the
equations of equilibrium and (λ+2μ) ∇²e = ∇²p, ∂e/∂t = c_v ∇²e give

    p̂ = E_c P̂ (e^(-ξ z) - e^(-q z))/(λ + 2 μ q/(q + ξ)),    P̂ = P_0/s · 2 sin(ξ a)/(π ξ)

inverted here by Talbot's contour; the settlement of the surface is inverted in closed form.  All
decays like e^(-ξ² c_v t).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import erf, erfcx, sici

TALBOT_NODES = 18  # 0.6 of it are the digits of the inversion (Abate & Whitt 2006)
DECAY = 6.5  # ξ √(c_v t) beyond which e^(-ξ² c_v t) changes no digit
# Gauss points over a phase [rad] of cos(ξ x) sin(ξ a): all digits
PANEL_POINTS = 16
PANEL_PHASE = 10.0
MOST_PANELS = 10_000  # c_v t/a² of 1e-8 near the load; more take gigabytes

BLOCK = 1000  # points at once, which bounds the memory


@dataclass(frozen=True)
class StripFooting:
    """load P_0 [Pa] on |x| < a, half width a [m], λ and μ [Pa], diffusivity c_v = k_f (λ + 2μ)/γ_fR
    [m²/s].
    """

    load: float
    half_width: float
    lam: float
    mu: float
    diffusivity: float

    def pressure(self, x: ArrayLike, z: ArrayLike, t: float) -> np.ndarray:
        """Return p at points x, z (n,) [m] (x from the axis, z the depth) and a time t > 0 [s]:
        (n,) [Pa].
        """
        across, at_x = np.unique(np.abs(x) / self.half_width, return_inverse=True)
        depths, at_z = np.unique(np.asarray(z) / self.half_width, return_inverse=True)
        T = self.diffusivity * t / self.half_width**2
        xi, weights = _wave_numbers(T, across[-1] + 1)
        amplitude = self._amplitude(xi, depths, T) * (
            weights * 2 * self.load * np.sin(xi) / (np.pi * xi)
        )
        cosine = np.cos(np.multiply.outer(across, xi))
        blocks = np.array_split(np.arange(at_x.size), at_x.size // BLOCK + 1)
        return np.concatenate(
            [np.einsum("nk,nk->n", amplitude[at_z[rows]], cosine[at_x[rows]]) for rows in blocks]
        )

    def _amplitude(self, xi: np.ndarray, z: np.ndarray, T: float) -> np.ndarray:
        """Return p(ξ, z, T) under a load P_0 cos(ξ x) of unit size, ξ (k,) and z (m,) in units of
        a: (m, k).
        """
        s, factors = _talbot(T)
        total = np.zeros((len(z), len(xi)))
        for pole, factor in zip(s, factors, strict=True):
            q = np.sqrt(xi**2 + pole)
            response = (self.lam + 2 * self.mu) / (self.lam + 2 * self.mu * q / (q + xi)) / pole
            decay = np.exp(-np.multiply.outer(z, xi)) - np.exp(-np.multiply.outer(z, q))
            total += (factor * response * decay).real
        return total

    def settlement_increment(self, x: ArrayLike, t: float) -> np.ndarray:
        """Return the settlement of the surface at x (n,) [m] since t = 0+, (n,) [m].

        2 G Δw/(P_0 a) = η/(2η-1) ∫ 2/(π ξ²) sin ξ cos(ξ x/a) {erf(ξ√T) - (η-1)/η [1 - e^((1-2η) ξ²
        T/η²) erfc((η-1)/η ξ√T)]} dξ with η = (1-ν)/(1-2ν) = (λ+2μ)/2μ and T = c_v t/a².  (Some
        copies have (η - 1/η) for (η-1)/η in the last exponent.) The braces are 1/η but for terms
        like e^(-ξ² T): the rest of the range is integrated in closed form.
        """
        across = np.atleast_1d(np.asarray(x, dtype=float)) / self.half_width
        T = self.diffusivity * t / self.half_width**2
        eta = (self.lam + 2 * self.mu) / (2 * self.mu)
        xi, weights = _wave_numbers(T, np.abs(across).max() + 1)
        root = xi * np.sqrt(T)
        part = (eta - 1) / eta
        braces = erf(root) - part * (
            1 - np.exp(-(root**2)) * erfcx(part * root)
        )  # erfc(y) = e^(-y²) erfcx(y)
        near = np.cos(np.multiply.outer(across, xi)) @ (weights * np.sin(xi) / xi**2 * braces)
        far = (_tail(1 + across, DECAY / np.sqrt(T)) + _tail(1 - across, DECAY / np.sqrt(T))) / (
            2 * eta
        )
        return self.load * self.half_width / (np.pi * self.mu) * eta / (2 * eta - 1) * (near + far)


def _tail(frequency: np.ndarray, start: float) -> np.ndarray:
    """Return ∫ sin(b ξ)/ξ² dξ from start to infinity for frequencies b (n,): sin(b X)/X - b Ci(b
    X).
    """
    size = np.abs(frequency)
    cosine = np.where(size > 0, sici(np.where(size > 0, size, 1.0) * start)[1], 0.0)
    return np.sign(frequency) * (np.sin(size * start) / start - size * cosine)


def _wave_numbers(T: float, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Return points and weights of ξ a on (0, DECAY/√T), Gauss in panels, for phases up to ξ a ·
    reach.

    Raises ValueError for a time so early that there would be too many.
    """
    panels = DECAY / np.sqrt(T) * reach / PANEL_PHASE
    if not panels < MOST_PANELS:
        raise ValueError(f"c_v t/length² = {T:.2g} is too early for its integral")
    edges = np.linspace(0, DECAY / np.sqrt(T), int(panels) + 6)
    points, weights = np.polynomial.legendre.leggauss(PANEL_POINTS)
    half = np.diff(edges)[:, None] / 2
    return (edges[:-1, None] + half * (points + 1)).ravel(), (half * weights).ravel()


def _talbot(T: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the poles s (m,) and factors (m,) with f(T) ≈ Σ Re[factor F(s)]: the fixed Talbot rule
    of Abate & Whitt (2006).
    """
    theta = np.pi * np.arange(1, TALBOT_NODES) / TALBOT_NODES
    cot = 1 / np.tan(theta)
    delta = 2 * TALBOT_NODES / 5 * np.append(1.0, theta * (cot + 1j))
    gamma = np.append(0.5, 1 + 1j * theta * (1 + cot**2) - 1j * cot) * np.exp(delta)
    return delta / T, 2 / (5 * T) * gamma
