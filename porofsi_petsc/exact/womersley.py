"""Flows that oscillate in rigid channels and pipes, and waves in elastic tubes that are tethered
along their axis.

J. R. Womersley, J. Physiol. 127 (1955) 553-563; tethered tubes: J. R. Womersley, Phys. Med. Biol. 2
(1957) 178-187.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import jve


@dataclass(frozen=True)
class Womersley(ABC):
    """Flow along a rigid duct whose mean over the section is U cos ωt:

    v = U Re[e^(iωt) (1 - f)/(1 - F)], -∂p/∂s = ρωU Re[i e^(iωt)/(1 - F)], f (0 at ω → ∞, 1 on the
    wall) with the mean F; s runs along the duct, from zero, where p = 0.

    density [kg/m³], viscosity [Pa s], speed U [m/s], length: half height or radius a [m], frequency
    ω [rad/s]
    """

    density: float
    viscosity: float
    speed: float
    length: float
    frequency: float

    @property
    def number(self) -> float:
        """Return Womersley's number α = a √(ωρ/μ) [-]."""
        return self.length * np.sqrt(self.frequency * self.density / self.viscosity)

    @abstractmethod
    def _place(self, X: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
        """Return the distance from the middle over a and s, (n,) each, and the axis of s."""

    @abstractmethod
    def shape(self, part: np.ndarray) -> np.ndarray:
        """Return f at distances from the middle over a, (n,), complex."""

    @property
    @abstractmethod
    def mean(self) -> complex:
        """Return F."""

    def profile(self, part: np.ndarray) -> np.ndarray:
        """Return (1 - f)/(1 - F), of mean 1, at distances from the middle over a, (n,), complex."""
        return (1 - self.shape(part)) / (1 - self.mean)

    def velocity(self, t: float, X: np.ndarray) -> np.ndarray:
        """Return the velocity at a time, (n, d)."""
        part, _, axis = self._place(X)
        v = np.zeros(X.shape)
        v[:, axis] = self.speed * (self._turn(t) * self.profile(part)).real
        return v

    def pressure(self, t: float, X: np.ndarray) -> np.ndarray:
        """Return the pressure at a time, (n,)."""
        _, s, _ = self._place(X)
        rate = 1j * self.density * self.frequency * self.speed / (1 - self.mean)
        return -s * (self._turn(t) * rate).real

    def _turn(self, t: float) -> complex:
        return complex(np.exp(1j * self.frequency * t))


class WomersleyChannel(Womersley):
    """The flow between the plates y = -a and y = a, along x."""

    @cached_property
    def _root(self) -> complex:
        return complex(np.sqrt(1j) * self.number)

    def _place(self, X: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
        return X[:, 1] / self.length, X[:, 0], 0

    def shape(self, part: np.ndarray) -> np.ndarray:
        """Return f = cosh(√i α y/a)/cosh(√i α)."""
        return np.cosh(self._root * part) / np.cosh(self._root)

    @property
    def mean(self) -> complex:
        """Return F = tanh(√i α)/(√i α)."""
        return complex(np.tanh(self._root) / self._root)


class WomersleyPipe(Womersley):
    """The flow in a pipe around the last axis, y = z around an axis of symmetry, else z."""

    @cached_property
    def _root(self) -> complex:
        return complex(1j**1.5 * self.number)

    def _place(self, X: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
        return np.linalg.norm(X[:, :-1], axis=1) / self.length, X[:, -1], X.shape[1] - 1

    def shape(self, part: np.ndarray) -> np.ndarray:
        """Return f = J0(i^(3/2) α r/a)/J0(i^(3/2) α)."""
        inside = self._root * part
        grown = np.exp(np.abs(inside.imag) - abs(self._root.imag))
        return grown * jve(0, inside) / jve(0, self._root)

    @property
    def mean(self) -> complex:
        """Return F = 2 J1(i^(3/2) α)/(i^(3/2) α J0(i^(3/2) α))."""
        return complex(2 * jve(1, self._root) / (self._root * jve(0, self._root)))


@dataclass(frozen=True)
class TetheredTube:
    """A wave of small amplitude along a long elastic tube whose wall moves radially alone:

        p = Re[Z Q e^(i(ωt - kz))], k = ω/(c √(1 - F)), Z = ρc/(πa² √(1 - F)), c² = aK/2ρ

    with F of `WomersleyPipe`, Q that of z = 0 [m³/s].  The wall has the stiffness K = p/u_r of
    Lamé's tube in plane strain less the inertia of its mass, ω² ρ_s (b² - a²)/2a: exact for waves
    that are long beside the radius, (ka)² ≪ 1.

    radius a, outer b [m]; young [Pa], poisson, solid_density [kg/m³] of the wall
    """

    density: float
    viscosity: float
    frequency: float
    radius: float
    outer: float
    young: float
    poisson: float
    solid_density: float

    @property
    def flow(self) -> WomersleyPipe:
        """Return the flow with the same profile in a rigid pipe, of mean speed 1 m/s."""
        return WomersleyPipe(self.density, self.viscosity, 1.0, self.radius, self.frequency)

    @property
    def stiffness(self) -> float:
        """Return K = p/u_r on the inner surface [Pa/m]."""
        a, b, nu = self.radius, self.outer, self.poisson
        soft = a * (1 + nu) * ((1 - 2 * nu) * a**2 + b**2) / (self.young * (b**2 - a**2))
        mass = self.solid_density * (b**2 - a**2) / (2 * a)
        return 1 / soft - self.frequency**2 * mass

    @property
    def _slowness(self) -> complex:
        speed = np.sqrt(self.radius * self.stiffness / (2 * self.density))
        return complex(1 / (speed * np.sqrt(1 - self.flow.mean)))

    @property
    def wave_number(self) -> complex:
        """Return k [1/m]: the wave has the speed ω/Re k and falls as e^(Im k z)."""
        return self.frequency * self._slowness

    @property
    def impedance(self) -> complex:
        """Return Z = p/Q [Pa s/m³]."""
        return self.stiffness * self._slowness / (2 * np.pi * self.radius)

    def pressure(self, t: float, z: np.ndarray, flow_rate: complex) -> np.ndarray:
        """Return p at a time at places along the tube, (n,) [Pa], of the flow Re(Q e^(iωt)) at
        z = 0.
        """
        turn = np.exp(1j * (self.frequency * t - self.wave_number * z))
        return (self.impedance * flow_rate * turn).real
