"""Conditions on an interface: which side is told the velocity, which the traction, and what of each lies between."""

from dataclasses import dataclass
from math import pi, sqrt, tanh

import numpy as np

NAMES = ("dirichlet_neumann", "robin_neumann", "robin_robin", "neumann_dirichlet")


def solid_impedance(modulus, rho, thickness, rates):
    """Return force per velocity of a layer with a free back, time-discrete, √(E ρ c_a) tanh(H √(ρ c_a/E))/c_v [Pa s/m].

    A wave that does not reach the back within the step sees √(E ρ); a thin layer is its mass, ρ H c_a/c_v.
    modulus E = λ + 2μ [Pa], rho [kg/m³], thickness H [m]; rates : `phases.transfer.Rates`
    """
    return sqrt(modulus * rho * rates.c_a) * tanh(thickness * sqrt(rho * rates.c_a / modulus)) / rates.c_v


def fluid_impedance(rho, length, rates):
    """Return force per velocity of an incompressible fluid, its added mass ρ ℓ times c_f [Pa s/m]; a wave k has ℓ = 1/k."""
    return rho * length * rates.c_f


@dataclass(frozen=True)
class Interface:
    """Means of what meets at an interface: E [Pa], ρ_s, ρ_f [kg/m³], solid volume over area [m], extent and facet size [m]."""

    modulus: float
    rho_s: float
    rho_f: float
    thickness: float
    extent: float
    facet: float


class Conditions:
    """The coefficients α_f and α_s of a pair of conditions.

    fluid : None (Dirichlet) or α_f : Rates -> [Pa s/m]; solid : None (Dirichlet) or α_s
    """

    def __init__(self, name, interface, coefficient, masses):
        """Take the name of the pair, the `Interface`, α_f or "auto", and the `fem.boundary.InterfaceMass` of fluid and solid."""
        self.name, self._interface, self._given, self._masses = name, interface, coefficient, masses

    def prepare(self, fluid, solid, rates):
        """Set the coefficients of both phases for a step with these rates."""
        this = self._interface
        if self.name in ("robin_neumann", "robin_robin"):
            auto = self._given == "auto"
            fluid.robin_coefficient = solid_impedance(this.modulus, this.rho_s, this.thickness, rates) if auto else self._given
        if self.name == "robin_robin":
            # between the longest wave of the interface and the shortest of its mesh
            solid.robin_coefficient = fluid_impedance(this.rho_f, sqrt(this.extent * this.facet) / pi, rates)

    def pull(self, fluid, solid):
        """Return α_s M (v_s - v_f) on the owned nodes, (n_owned, d) [N]; a solid that is told the velocity takes it."""
        gap = solid.velocity - fluid.flow().velocity
        if self.name == "robin_robin":
            return solid.robin_coefficient * self._masses[1].times(solid.domain, gap)
        if self.name == "neumann_dirichlet":
            solid.take_velocity(gap)
        return np.zeros((solid.mesh.n_owned, solid.mesh.dim))
