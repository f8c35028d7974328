"""One saturated porous material: what the kernels need of a point, from its volume ratio J.

Its limits are a free fluid (n_s = 0, no drag) and a solid without pores (n_s = 1), which the same
two phases solve.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .drag import Anisotropy, Drag
from .elastic import ElasticLaw
from .permeability import Constant, PermeabilityLaw


@dataclass(frozen=True)
class PorousMaterial:
    """Skeleton law and fluid of one region; densities are real (intrinsic) ones [kg/m^3].

    drag0 : γ_fR/k_f = μ_f/K, the drag per n_f² in the reference configuration [N s/m^4]
    anisotropy : principal axes of the permeability, with factors of k_f or K; None without any
    viscosity : μ_f [Pa s], zero where the Brinkman term is left out
    variable_porosity : n_s = n_s0/J, else n_s = n_s0
    n_s0, rho_sR, drag0 : numbers, or fields (n, 1) over all cells of the mesh, NaN in other
    regions, as the moduli of the law may be; `at` is the material of some cells, for points (E, Q)
    biot : α, the part of the pressure that the skeleton bears against; fluid_compliance : 1/K_f
    [1/Pa]
    averaged : whether the velocity of the fluid is the volume-averaged one, v_s + n_f w, of which
    the drag is γ_fR/k_f without n_f²
    """

    elastic: ElasticLaw | None
    n_s0: Any
    rho_sR: Any
    rho_fR: float
    drag0: Any
    permeability: PermeabilityLaw = Constant()
    viscosity: float = 0.0
    variable_porosity: bool = False
    anisotropy: Anisotropy | None = None
    biot: float = 1.0
    fluid_compliance: float = 0.0
    averaged: bool = False

    @classmethod
    def free_fluid(cls, rho: float, viscosity: float) -> PorousMaterial:
        """Return a fluid without a skeleton; rho [kg/m^3], viscosity [Pa s]."""
        return cls(None, 0.0, 0.0, rho, 0.0, viscosity=viscosity)

    @classmethod
    def dense_solid(cls, elastic: ElasticLaw, rho: float) -> PorousMaterial:
        """Return a solid without pores; rho [kg/m^3]."""
        return cls(elastic, 1.0, rho, 0.0, 0.0)

    def at(self, cells: slice | np.ndarray) -> PorousMaterial:
        """Return the material of some cells of the mesh, by their numbers; itself without
        fields.
        """
        fields = {
            name: getattr(self, name)[cells]
            for name in ("n_s0", "rho_sR", "drag0")
            if np.ndim(getattr(self, name))
        }
        elastic = self.elastic and self.elastic.at(cells)
        if not fields and elastic is self.elastic:
            return self
        return replace(self, elastic=elastic, **fields)

    @property
    def resists(self) -> bool:
        """Return whether there is a drag."""
        return bool(np.ndim(self.drag0) or self.drag0)

    @property
    def has_pores(self) -> bool:
        """Return whether there are a skeleton and a fluid in it."""
        return bool(np.ndim(self.n_s0) or 0 < self.n_s0 < 1)

    @property
    def is_free_fluid(self) -> bool:
        """Return whether the fluid is a free one, which may flow through a skeleton that is not
        its own.
        """
        return self.elastic is None

    @property
    def immersed(self) -> PorousMaterial:
        """Return the skeleton for a free fluid that flows through it, of which it feels the drag
        γ_fR/k_f (v - v_s) alone; itself without pores.
        """
        return replace(self, averaged=True) if self.has_pores else self

    @property
    def pore_fluid(self) -> PorousMaterial:
        """Return the fluid in the pores of `immersed`: a free one with the volume-averaged velocity
        and the drag.

        With ρ = n_f ρ_fR the whole has the density of the mixture where the fluid moves with the
        skeleton.
        """
        return replace(self, elastic=None, averaged=True)

    def fluid_fraction(self, J: np.ndarray) -> np.ndarray:
        """Return n_f, the shape of J."""
        if not self.variable_porosity:
            return np.broadcast_to(1 - self.n_s0, J.shape)
        return 1 - self.n_s0 / J

    def fluid_fraction_slope(self, J: np.ndarray) -> np.ndarray:
        """Return J dn_f/dJ = n_s0/J, or 0 with constant porosity, the shape of J."""
        return self.n_s0 / J if self.variable_porosity else np.zeros(J.shape)

    def fluid_density(self, J: np.ndarray) -> np.ndarray:
        """Return ρ_f = n_f ρ_fR [kg/m^3], the shape of J."""
        return self.fluid_fraction(J) * self.rho_fR

    def flow_fraction(self, J: np.ndarray) -> np.ndarray:
        """Return the n of the fluid's balances, the shape of J: n_f, or 1 of a free fluid, whose
        velocity in pores is that of the whole volume.
        """
        return np.ones(J.shape) if self.is_free_fluid else self.fluid_fraction(J)

    @property
    def flow_fraction_varies(self) -> bool:
        """Return whether `flow_fraction` depends on J."""
        return self.variable_porosity and not self.is_free_fluid

    def flow_fraction_gradient(self, J: np.ndarray, second: Any) -> np.ndarray:
        """Return ∇n = J dn/dJ ∇ ln J, (E, Q, d) [1/m], at J (E, Q) and
        `fem.geometry.SecondDerivatives`.
        """
        if not self.flow_fraction_varies:
            return np.broadcast_to(0.0, (*J.shape, second.G.shape[-1]))
        return self.fluid_fraction_slope(J)[..., None] * second.volume_gradient

    def drag(self, J: np.ndarray) -> Drag:
        """Return S = n_f² γ_fR/k_f(J) D [N s/m^4] at points J, without n_f² of an averaged
        velocity; D is δ_ij or that of the principal axes.
        """
        return Drag(self._drag_scale(J), self.anisotropy)

    def _drag_scale(self, J):
        resistance = self.drag0 / self.permeability.factor(J, self.n_s0)
        return resistance if self.averaged else self.fluid_fraction(J) ** 2 * resistance

    def volume_derivatives(self, J: np.ndarray) -> tuple[np.ndarray, np.ndarray, Drag]:
        """Return J dn/dJ of `flow_fraction`, (J dρ_f/dJ)/ρ_f, both the shape of J, and J dS/dJ, by
        a complex step exact to round-off (Squire & Trapp 1998).
        """
        slope = self.fluid_fraction_slope(J)
        drag = np.imag(self._drag_scale(J * (1 + 1e-30j))) / 1e-30
        relative = slope / self.fluid_fraction(J)
        of_flow = np.zeros(J.shape) if self.is_free_fluid else slope
        return of_flow, relative, Drag(drag, self.anisotropy)

    @property
    def is_compressible(self) -> bool:
        """Return whether its constituents are."""
        return self.biot != 1.0 or self.fluid_compliance > 0.0

    def storage(self, J: np.ndarray) -> np.ndarray:
        """Return S = n_f/K_f + (α - n_f)(1 - α)/K [1/Pa], the shape of J; K = λ + 2/3 μ, and K/(1 -
        α) the bulk modulus of the grains (Biot & Willis 1957).
        """
        assert self.elastic is not None  # nobody asks a fluid
        n = self.fluid_fraction(J)
        bulk = self.elastic.lam + 2 / 3 * self.elastic.mu
        return n * self.fluid_compliance + (self.biot - n) * (1 - self.biot) / bulk

    @property
    def diffusivity(self) -> Any:
        """Return c_v = (k_f/γ_fR)/(S + α²/E_c) along the most permeable axis in the reference
        configuration [m²/s].
        """
        assert self.elastic is not None  # nobody asks a fluid
        compliance = self.biot**2 / self.elastic.oedometer_modulus
        return self.mobility / (self.storage(np.ones(np.shape(self.n_s0))) + compliance)

    @property
    def mobility(self) -> Any:
        """Return k_f/γ_fR = K/μ_f along the most permeable axis in the reference configuration
        [m^4/(N s)].
        """
        return (max(self.anisotropy.factors) if self.anisotropy else 1.0) / self.drag0

    def open_pores(self, J: np.ndarray) -> np.ndarray:
        """Return where the pores are open, J > n_s0, (bool, the shape of J); everywhere when
        nothing depends on it.
        """
        compacts = self.elastic and self.elastic.compacts
        if self.variable_porosity or self.permeability.closes or compacts:
            return self.n_s0 < J
        return np.ones(J.shape, dtype=bool)

    @property
    def rho_s(self) -> Any:
        """Return the skeleton's partial density in the reference configuration, n_s0 ρ_sR
        [kg/m^3].
        """
        return self.n_s0 * self.rho_sR

    @property
    def rho_f(self) -> Any:
        """Return the fluid's partial density in the reference configuration, n_f ρ_fR [kg/m^3]."""
        return (1 - self.n_s0) * self.rho_fR

    @property
    def confined_modulus(self) -> Any:
        """Return λ + 2μ [Pa], 0 without a skeleton."""
        return self.elastic.oedometer_modulus if self.elastic else 0.0

    @property
    def undrained_modulus(self) -> Any:
        """Return λ + 2μ + α²/S [Pa] of compressible constituents, λ + 2μ of others."""
        if not (self.elastic and self.is_compressible):
            return self.confined_modulus
        return self.confined_modulus + self.biot**2 / self.storage(np.ones(np.shape(self.n_s0)))

    @property
    def shear_modulus(self) -> float:
        """Return μ [Pa], 0 without a skeleton."""
        return self.elastic.mu if self.elastic else 0.0
