"""A thin strip clamped level at one end that bends under its own weight, however far.

It keeps its length L; θ(s) is the angle of its axis below the level, w its weight and EI its
stiffness per width, in plane strain E h³/(12 (1 - ν²)),

    EI θ'' = -w (L - s) cos θ,    θ(0) = 0,  θ'(L) = 0

(Rohde, Quart. Appl. Math. 11 (1953) 337-338).  In a fluid at rest w is the weight less the
buoyancy.
"""

from collections.abc import Callable
from functools import cached_property

import numpy as np
from scipy.integrate import solve_bvp

PARTS = 20  # of the weight: the solution under each is the guess for the next
TOLERANCE = 1e-10


class HeavyElastica:
    """A strip of the length 1 and the load w L³/(EI)."""

    def __init__(self, load: float) -> None:
        """Take the load [-]."""
        self.load = load

    @cached_property
    def tip(self) -> tuple[float, float, float]:
        """Return the angle of the tip below the level [rad], its distance from the clamp and its
        depth below it, over the length.
        """
        s = np.linspace(0.0, 1.0, 41)
        values = np.zeros((4, len(s)))  # θ, θ', position along and depth
        for part in np.linspace(0.0, 1.0, PARTS + 1)[1:]:
            found = solve_bvp(
                _slopes(part * self.load), _ends, s, values, tol=TOLERANCE, max_nodes=20_000
            )
            if not found.success:
                raise ValueError(
                    f"a load of {self.load:g} is beyond this solution: {found.message}"
                )
            s, values = found.x, found.y
        angle, _, along, depth = values[:, -1].tolist()
        return angle, along, depth


def _slopes(load: float) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Return the derivatives of (θ, θ', position, depth) by s."""

    def slopes(s: np.ndarray, y: np.ndarray) -> np.ndarray:
        cosine = np.cos(y[0])
        return np.vstack([y[1], -load * (1 - s) * cosine, cosine, np.sin(y[0])])

    return slopes


def _ends(clamp: np.ndarray, tip: np.ndarray) -> np.ndarray:
    """Return what vanishes at the ends."""
    return np.array([clamp[0], tip[1], clamp[2], clamp[3]])
