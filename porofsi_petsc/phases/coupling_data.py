"""What the phases tell each other on the collocation level of a step; a phase knows of the other
nothing else.
"""

from dataclasses import dataclass

import numpy as np

from ..fem.domain import Configuration
from ..materials.drag import Drag
from ..tensors import weighted


@dataclass(frozen=True)
class MeshState:
    """The mesh of a fluid, which moves with a solid: its configuration and v_s on the collocation
    level, (n_local, d) [m/s].

    In a porous medium they are the skeleton's own; a free fluid has the motion of its mesh, the
    solid's on their interface.
    end_velocity : v_s on the new level, which no-slip walls prescribe; displacement : u (n_local,
    d) [m] of the configuration.
    """

    configuration: Configuration
    velocity: np.ndarray
    end_velocity: np.ndarray
    displacement: np.ndarray
    moving_mesh: bool

    @property
    def mesh_velocity(self) -> np.ndarray:
        """Return v_m, (n_local, d): the skeleton's velocity, or zero on a fixed mesh."""
        return self.velocity if self.moving_mesh else np.zeros_like(self.velocity)


@dataclass(frozen=True)
class Flow:
    """From the fluid to the solid: phase velocity v_f (n_local, d) [m/s] and pressure p (n_local,)
    [Pa].

    force : of a free fluid on the nodes of the interface, (n_owned, d) [N], zero elsewhere; None in
    a porous medium
    """

    velocity: np.ndarray
    pressure: np.ndarray
    force: np.ndarray | None = None


@dataclass(frozen=True)
class Rates:
    """How much of each phase follows the other within a step: the tangents of the corrected split
    need both sides.

    c_f, c_v, c_a : d a_f/d v_f, d v_s/d y, d a_s/d y on the collocation level; 0 where that inertia
    is left out.
    """

    c_f: float
    c_v: float
    c_a: float

    def dragged_fraction(self, drag: Drag, rho_f: np.ndarray) -> np.ndarray:
        """Return χ = S (S + ρ_f c_f)^-1: the part of the fluid that the drag carries along (0 free,
        1 undrained), (E, Q), or tensors (E, Q, d, d) of a drag with principal axes.
        """
        return drag.carried(rho_f * self.c_f)

    def dragged_inertia(self, chi: np.ndarray, rho_f: np.ndarray) -> np.ndarray:
        """Return χ ρ_f c_f c_v [kg/(m³ s²)], the inertia of the fluid that moves with the skeleton,
        of the shape of χ.
        """
        return weighted(rho_f, chi) * self.c_f * self.c_v
