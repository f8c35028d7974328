"""A rigid elliptic cylinder that turns freely in a simple shear flow without inertia.

In v = (γ̇ y, 0), unbounded, without a torque on the cylinder, its long axis has the angle φ from the
direction of the flow,

    dφ/dt = -γ̇ (a² sin² φ + b² cos² φ)/(a² + b²)
    tan φ = -(b/a) tan(γ̇ t a b/(a² + b²)),    φ(0) = 0

and turns once in T = 2π (a/b + b/a)/γ̇ (Jeffery, Proc. R. Soc. Lond. A 102 (1922) 161-179, of an
ellipsoid; a long third axis leaves the motion in the plane).
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class JefferyOrbit:
    """Half axes a >= b of the ellipse [m] and the rate of shear γ̇ [1/s]."""

    a: float
    b: float
    shear: float

    @property
    def period(self) -> float:
        """Return T, that of a whole turn [s]."""
        return 2 * np.pi * (self.a / self.b + self.b / self.a) / self.shear

    def angle(self, t: float | np.ndarray) -> np.ndarray:
        """Return φ at times t, the shape of t: 0 at t = 0, then negative, -2π at T [rad]."""
        turns, phase = np.divmod(2 * np.pi * np.asarray(t) / self.period + np.pi, 2 * np.pi)
        phase = phase - np.pi
        within = np.arctan2(self.b * np.sin(phase), self.a * np.cos(phase))
        return -(within + 2 * np.pi * turns)

    def rate(self, angle: float | np.ndarray) -> np.ndarray:
        """Return dφ/dt at angles, the shape of angle [rad/s]."""
        a2, b2 = self.a**2, self.b**2
        sine, cosine = np.sin(angle), np.cos(angle)
        return -self.shear * (a2 * sine**2 + b2 * cosine**2) / (a2 + b2)
