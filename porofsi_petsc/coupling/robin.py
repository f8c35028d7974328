"""Conditions on an interface: which side is told the velocity, which the traction, and what of each
lies between.
"""

from dataclasses import dataclass
from math import pi, sqrt, tanh
from typing import Literal

import numpy as np

from ..fem.boundary import InterfaceMass
from ..fem.transfer import InterfaceTransfer
from ..phases.coupling_data import Rates
from ..phases.residual import Residual
from .protocols import InterfaceFluid, InterfaceSolid

# α_f over the impedance S_s of a layer that moves as a whole, the smallest of all waves.  The error
# factor of Robin-Neumann is S_f/S_s |S_s - α_f|/(S_f + α_f): with 3/2 below 1/2 for these waves,
# whatever the added mass (with 2 below 1), and smaller than with 1 for all stiff ones, S_f/(S_f +
# α_f).  Measured on a ring in ten times its mass of fluid: 0.66 with 1, 0.49, 0.53 with 2.
STIFFER = 1.5
# Largest α_s over α_f: along the interface a fluid has next to no impedance, and beside a stiff
# solid the error factor of Robin-Robin, |S_f - α_s|/(S_s + α_s) |S_s - α_f|/(S_f + α_f), is α_s/α_f
# there.
TANGENTIAL = 0.5


def solid_impedance(modulus: float, rho: float, thickness: float, rates: Rates) -> float:
    """Return force per velocity of a layer with a free back, time-discrete, √(E ρ c_a) tanh(H √(ρ
    c_a/E))/c_v [Pa s/m].

    A wave that does not reach the back within the step sees √(E ρ); a thin layer is its mass, ρ H
    c_a/c_v. modulus E = λ + 2μ [Pa], rho [kg/m³], thickness H [m]; rates :
    `phases.coupling_data.Rates`
    """
    return (
        sqrt(modulus * rho * rates.c_a)
        * tanh(thickness * sqrt(rho * rates.c_a / modulus))
        / rates.c_v
    )


def fluid_impedance(rho: float, length: float, rates: Rates) -> float:
    """Return force per velocity of an incompressible fluid, its added mass ρ ℓ times c_f [Pa s/m];
    a wave k has ℓ = 1/k.
    """
    return rho * length * rates.c_f


@dataclass(frozen=True)
class InterfaceMeans:
    """Means of what meets at an interface: E [Pa], ρ_s, ρ_f [kg/m³], solid volume over area [m],
    extent and facet size [m].
    """

    modulus: float
    rho_s: float
    rho_f: float
    thickness: float
    extent: float
    facet: float

    @property
    def mass_ratio(self) -> float:
        """Return added over own mass of the longest wave of the interface, ρ_f ℓ/(ρ_s H) with ℓ =
        extent/π [-].
        """
        return self.rho_f * self.extent / pi / (self.rho_s * self.thickness)


class InterfaceConditions:
    """A pair of conditions: its coefficients α_f and α_s [Pa s/m] in a step, what drives the fluid
    in a sweep and what it adds to the solid's side.
    """

    def __init__(
        self,
        name: str,
        interface: InterfaceMeans | None,
        coefficient: float | Literal["auto"],
        mass: InterfaceMass,
        transfer: InterfaceTransfer,
    ) -> None:
        """Take the name of the pair, the `InterfaceMeans`, α_f or "auto", the
        `fem.boundary.InterfaceMass` of the fluid and the `fem.transfer.InterfaceTransfer`.
        """
        self.name = name
        self._interface = interface
        self._given = coefficient
        self._mass = mass
        self._transfer = transfer

    @property
    def first_factor(self) -> float | None:
        """Return the relaxation that Dirichlet-Neumann starts with, None for the accelerator's own.

        Its error factor is 1 - ω (1 + μ), μ the ratio of added to own mass (Causin, Gerbeau &
        Nobile, CMAME 194 (2005) 4506). 2/(2 + μ) makes the largest of all waves, with ratios from 0
        to that of the longest, the smallest: μ/(2 + μ).
        """
        if self.name != "dirichlet_neumann" or self._interface is None:
            return None
        return 2 / (2 + self._interface.mass_ratio)

    def prepare(self, fluid: InterfaceFluid, solid: InterfaceSolid, rates: Rates) -> None:
        """Set the coefficients of both phases for a step with these rates."""
        if self.name not in ("robin_neumann", "robin_robin"):
            return
        this = self._interface
        assert this is not None  # these pairs are refused where there is no common surface
        solid_side = STIFFER * solid_impedance(this.modulus, this.rho_s, this.thickness, rates)
        fluid.robin_coefficient = solid_side if self._given == "auto" else self._given
        if self.name == "robin_robin":
            # between the longest wave of the interface and the shortest of its mesh
            alpha = fluid_impedance(this.rho_f, sqrt(this.extent * this.facet) / pi, rates)
            solid.robin_coefficient = min(alpha, TANGENTIAL * fluid.robin_coefficient)

    def unbalanced(self, solid_residual: Residual) -> np.ndarray | None:
        """Return R_s + R_f of the interface on the fluid's nodes, (n_owned, d) [N], which drives a
        fluid that is not told the velocity.

        Where the solid is held there is none: what it takes is no balance of the two, but the
        reaction of a support.
        """
        if self.name == "dirichlet_neumann":
            return None
        return self._transfer.force_to_fluid(solid_residual.total)

    def robin_force(self, fluid: InterfaceFluid, solid: InterfaceSolid) -> np.ndarray:
        """Return α_s Pᵀ M (P v_s - v_f) on the owned nodes, (n_owned, d) [N]; a solid that is told
        the velocity takes it.
        """
        gap = self._transfer.to_fluid(solid.velocity) - fluid.flow().velocity
        if self.name == "robin_robin":
            force = self._mass.times(fluid.domain, gap)
            return solid.robin_coefficient * self._transfer.to_solid(force)
        if self.name == "neumann_dirichlet":
            solid.take_velocity(gap)
        return np.zeros((solid.mesh.n_owned, solid.mesh.dim))
