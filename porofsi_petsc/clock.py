"""Generalized-alpha in time: the weights of a step, the rates on the new level, the values on the
collocation levels.

Both phases share rho_inf and alpha_f (Chung & Hulbert 1993 for second order, Jansen, Whiting &
Hulbert 2000 for first order). A tangent is written in the increment on the alpha_f level,
d(.)_alpha = alpha_f d(.)_{n+1}; the factors `c_v`, `c_a` turn it into the increments of the
collocated rates.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np


def second_order(rho_inf: float, dt: float) -> SecondOrder:
    """Return the scheme of y'' (skeleton with inertia)."""
    alpha_m = (2 - rho_inf) / (1 + rho_inf)
    alpha_f = 1 / (1 + rho_inf)
    gamma = 0.5 + alpha_m - alpha_f
    beta = 0.25 * (1 + alpha_m - alpha_f) ** 2
    return SecondOrder(dt, alpha_m, alpha_f, gamma, beta)


def first_order(rho_inf: float, dt: float) -> FirstOrder:
    """Return the scheme of y' (fluid; skeleton without inertia)."""
    alpha_m = (3 - rho_inf) / (2 * (1 + rho_inf))
    alpha_f = 1 / (1 + rho_inf)
    return FirstOrder(dt, alpha_m, alpha_f, 0.5 + alpha_m - alpha_f)


def backward_euler(dt: float) -> FirstOrder:
    """Return the implicit Euler rule in the form of a first-order scheme."""
    return FirstOrder(dt, 1.0, 1.0, 1.0)


def implicit_second_order(dt: float) -> SecondOrder:
    """Return the scheme of y'' whose balance holds at the end of the step, with y1 = y0 + dt v0 +
    dt²/2 a1, v1 = v0 + dt a1.
    """
    return SecondOrder(dt, 1.0, 1.0, 1.0, 0.5)


def at_end(scheme: Scheme, age: float | None, before: np.ndarray, now: np.ndarray) -> np.ndarray:
    """Return a value at the end of a step, on the line through the last two collocated ones.

    age : from the level of the one before to the start of the step [s]; None: there is no line
    """
    if age is None:
        return now.copy()
    return now + (1 - scheme.alpha_f) * scheme.dt / (age + scheme.alpha_f * scheme.dt) * (
        now - before
    )


@dataclass(frozen=True)
class Steady:
    """No rates at all: the balance holds at the end of a step, whose size only counts the steps of
    a load.
    """

    dt: float

    alpha_m = alpha_f = 1.0
    c_v = c_a = 0.0
    duration = math.inf  # of a step [s]: what takes time has come to its end

    def rates(
        self, y1: np.ndarray, y0: np.ndarray, r0: np.ndarray, a0: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return zero rates."""
        return 0.0 * r0, 0.0 * a0

    def predict(self, y0: np.ndarray, r0: np.ndarray, a0: np.ndarray) -> np.ndarray:
        """Return y0."""
        return y0.copy()

    def velocity_level(self, r0: np.ndarray, r1: np.ndarray) -> np.ndarray:
        """Return zero."""
        return r1

    def acceleration_level(self, a0: np.ndarray, a1: np.ndarray) -> np.ndarray:
        """Return zero."""
        return a1


@dataclass(frozen=True)
class FirstOrder:
    """y1 = y0 + dt ((1 - gamma) r0 + gamma r1); the balance holds for r at alpha_m and y at
    alpha_f.
    """

    dt: float
    alpha_m: float
    alpha_f: float
    gamma: float

    @property
    def c_v(self) -> float:
        """Return d r_alpha / d y_alpha [1/s]."""
        return self.alpha_m / (self.alpha_f * self.gamma * self.dt)

    c_a = 0.0  # no second rate

    @property
    def duration(self) -> float:
        """Return the time that passes in a step [s]."""
        return self.dt

    def rates(
        self, y1: np.ndarray, y0: np.ndarray, r0: np.ndarray, a0: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the rate on the new level and a zero second rate."""
        return (y1 - y0) / (self.gamma * self.dt) - (1 - self.gamma) / self.gamma * r0, 0.0 * a0

    def predict(self, y0: np.ndarray, r0: np.ndarray, a0: np.ndarray) -> np.ndarray:
        """Return y1 for a constant rate."""
        return y0 + self.dt * r0

    def velocity_level(self, r0: np.ndarray, r1: np.ndarray) -> np.ndarray:
        """Return the collocated rate."""
        return r0 + self.alpha_m * (r1 - r0)

    def acceleration_level(self, a0: np.ndarray, a1: np.ndarray) -> np.ndarray:
        """Return zero: there is no second rate."""
        return a1


@dataclass(frozen=True)
class SecondOrder:
    """Newmark's y1, v1 from a1 with gamma, beta; the balance holds for a at alpha_m, y and v at
    alpha_f.
    """

    dt: float
    alpha_m: float
    alpha_f: float
    gamma: float
    beta: float

    @property
    def duration(self) -> float:
        """Return the time that passes in a step [s]."""
        return self.dt

    @property
    def c_v(self) -> float:
        """Return d v_alpha / d y_alpha = gamma/(beta dt) [1/s]."""
        return self.gamma / (self.beta * self.dt)

    @property
    def c_a(self) -> float:
        """Return d a_alpha / d y_alpha [1/s²]."""
        return self.alpha_m / (self.alpha_f * self.beta * self.dt**2)

    def rates(
        self, y1: np.ndarray, y0: np.ndarray, v0: np.ndarray, a0: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return velocity and acceleration on the new level."""
        a1 = (y1 - y0 - self.dt * v0) / (self.beta * self.dt**2) - (0.5 / self.beta - 1) * a0
        return v0 + self.dt * ((1 - self.gamma) * a0 + self.gamma * a1), a1

    def predict(self, y0: np.ndarray, v0: np.ndarray, a0: np.ndarray) -> np.ndarray:
        """Return y1 for a constant acceleration."""
        return y0 + self.dt * v0 + 0.5 * self.dt**2 * a0

    def velocity_level(self, v0: np.ndarray, v1: np.ndarray) -> np.ndarray:
        """Return the collocated velocity."""
        return v0 + self.alpha_f * (v1 - v0)

    def acceleration_level(self, a0: np.ndarray, a1: np.ndarray) -> np.ndarray:
        """Return the collocated acceleration."""
        return a0 + self.alpha_m * (a1 - a0)


Scheme = Steady | FirstOrder | SecondOrder
