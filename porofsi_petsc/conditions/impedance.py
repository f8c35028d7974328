"""Springs, dashpots and absorbing boundaries: tractions that oppose displacement or velocity."""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ..kernels.assemble import add_mass
from ..kernels.surface import impedance_load, impedance_weights, pressure_coupling, pressure_load
from ..registry import parameter
from .condition import Kind, Slope, State, Surface, SurfaceCondition


@dataclass
class Impedance(SurfaceCondition):
    """A traction of two factors, one along the normal of the reference and one across it."""

    behind: ClassVar[tuple[Kind, ...]] = ("porous", "solid")

    def bind(self, surface: Surface) -> None:
        """Take a rule that is exact on flat facets."""
        super().bind(surface)
        self._rule = surface.rule(2 * surface.order)
        self._normal = surface.normal(self._rule)

    def factors(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the factor along the normal and that across it, (F, 1) each."""
        raise NotImplementedError

    def uniform(self, value: float) -> np.ndarray:
        """Return a number for every facet, (F, 1)."""
        return np.full((len(self.surface.nodes), 1), value)

    def load_of(self, field: np.ndarray) -> np.ndarray:
        """Return ∮ N_a Z f dA of a nodal field (n_local, d), (F, Af, d)."""
        return self.load_at_nodes(self.surface.gather(field))

    def load_at_nodes(self, values: np.ndarray) -> np.ndarray:
        """Return the same of values at the nodes of the facets, (F, Af, d)."""
        return impedance_load(self._rule.N, self._normal, self.factors(), values)

    def matrix(self) -> np.ndarray:
        """Return ∮ N_a Z N_b dA, (F, Af, d, Af, d)."""
        F, A, d = self.surface.X.shape
        K = np.zeros((F, A, d, A, d))
        add_mass(K, self._rule.N, impedance_weights(self._normal, self.factors()), d)
        return K


@dataclass
class Spring(Impedance):
    """Winkler's foundation: the traction -(k_n N N + k_t (I - N N)) u, N the normal of the
    reference, u from where the solid is at rest: the reference, or where a stage has placed it.
    """

    normal: float = parameter("Pa/m", "k_n", at_least=0.0, default=0.0, example=3.0)
    tangential: float = parameter("Pa/m", "k_t", at_least=0.0, default=0.0, example=0.7)

    @property
    def holds(self) -> Collection[str]:  # type: ignore[override]
        """Return in which directions there is a stiffness."""
        return [name for name in ("normal", "tangential") if getattr(self, name)]

    def factors(self) -> tuple[np.ndarray, np.ndarray]:
        """Return k_n and k_t, (F, 1) each."""
        return self.uniform(self.normal), self.uniform(self.tangential)

    def residual(self, state: State) -> np.ndarray:
        """Return ∮ N_a k u dA, (F, Af, d) [N]."""
        return self.load_at_nodes(self.surface.displacement(state.u))

    def tangent(self, state: State, slope: Slope) -> np.ndarray:
        """Return its derivative, (F, Af, d, Af, d) [N/m]."""
        return slope.u * self.matrix()


@dataclass
class Dashpot(Impedance):
    """The traction -(c_n N N + c_t (I - N N)) v_s, N the normal of the reference, v_s the velocity
    of the solid.
    """

    normal: float = parameter("Pa s/m", "c_n", at_least=0.0, default=0.0, example=3.0)
    tangential: float = parameter("Pa s/m", "c_t", at_least=0.0, default=0.0, example=0.7)

    def factors(self) -> tuple[np.ndarray, np.ndarray]:
        """Return c_n and c_t, (F, 1) each."""
        return self.uniform(self.normal), self.uniform(self.tangential)

    def residual(self, state: State) -> np.ndarray:
        """Return ∮ N_a c v dA, (F, Af, d) [N]."""
        return self.load_of(state.v)

    def tangent(self, state: State, slope: Slope) -> np.ndarray:
        """Return its derivative, (F, Af, d, Af, d) [N/m]."""
        return slope.v * self.matrix()


@dataclass
class AbsorbingFlux(SurfaceCondition):
    """Total flux n_f v_f + n_s v_s = 0 through a surface of a porous medium, which a plane wave has
    there where both constituents are incompressible: the seepage flux -v_s·N.  With compressible
    ones there is no seepage.
    """

    balance = "volume"
    behind = ("porous",)

    def bind(self, surface: Surface) -> None:
        """Take a rule that is exact on flat facets."""
        super().bind(surface)
        self._rule = surface.rule(2 * surface.order)
        still = surface.of_material("is_compressible").astype(bool)
        self._normal = np.where(still[..., None], 0.0, surface.normal(self._rule))

    def residual(self, state: State) -> np.ndarray:
        """Return -∮ N_a v_s·N dA, (F, Af, 1) [m³/s]."""
        assert state.v_s is not None  # of a pore fluid
        through = self._rule.N @ self.surface.gather(state.v_s) * self._normal
        return -(self._rule.N.T @ through.sum(axis=-1)[..., None])

    def exchange(self, state: State, slope: Slope) -> np.ndarray:
        """Return its derivative by the motion, (F, Af, 1, Af, d)."""
        by_pressure = pressure_coupling(self._rule.N, self._normal)
        return -slope.v * np.moveaxis(by_pressure, (1, 2, 3, 4), (3, 4, 1, 2))


@dataclass
class Absorbing(Impedance):
    """Waves leave through it: the traction -(Z_P N N + Z_S (I - N N)) (v_s - 2 v_in), Z_P = √(ρ (λ
    + 2μ)), Z_S = √(ρ μ) of the solid behind, N the normal of the reference, v_in the velocity of a
    wave that comes in (Lysmer & Kuhlemeyer 1969; Joyner & Chen 1975). Of a porous medium it is the
    effective traction, beside -p N, with the masses that the waves move at a frequency f, and the
    total flux through the surface is zero.

    With both constituents incompressible the fluid moves against the skeleton in a plane P wave,
    v_f = -(n_s/n_f) v_s, and in an S wave by drag alone:
    ρ_P = ρ_s + (n_s/n_f)² ρ_f + S/(n_f² i ω), ρ_S = ρ_s + ρ_f S/(S + i ω ρ_f), Z = Re √(ρ M).

    With compressible ones it is the total traction, without seepage, and the P wave that of the
    undrained medium: Z_P = √((ρ_s + ρ_f) (λ + 2μ + α²/S)), S the storage.
    """

    behind = ("solid", "porous")
    excludes = {
        "solid": ("spring", "dashpot"),
        "porous": ("spring", "dashpot", "pressure", "flux", "no_slip"),
    }
    beside = (AbsorbingFlux,)
    carries_pressure = True

    incident: Any = parameter("m/s", "v_in", kind="vector", default={}, example={"x": 0.3})
    frequency: float = parameter(
        "Hz", "f of the waves in a porous medium", above=0.0, default=1.0, example=0.4
    )

    def bind(self, surface: Surface) -> None:
        """Take the impedances of the material."""
        super().bind(surface)
        self._undrained = surface.of_material("is_compressible").astype(bool)
        self._factors = self._impedances()
        pores = surface.of_material("n_s0") < 1
        self._pores = (pores & ~self._undrained).astype(float)

    def _impedances(self):
        """Return Z_P and Z_S, (F, 1) each."""
        of = self.surface.of_material
        omega = 2 * np.pi * self.frequency
        n_f = 1 - of("n_s0")
        pores = n_f > 0
        drag = n_f**2 * of("drag0") * pores
        ratio = np.divide(of("n_s0"), n_f, out=np.zeros_like(n_f), where=pores)
        against = ratio**2 * of("rho_f") - 1j * of("drag0") * pores / omega
        shaken = 1j * omega * of("rho_f")
        along = of("rho_f") * drag / np.where(pores, drag + shaken, 1.0)
        together = np.where(self._undrained, of("rho_f"), against)
        masses = of("rho_s") + together, of("rho_s") + along
        moduli = of("undrained_modulus"), of("shear_modulus")
        return tuple(
            np.sqrt(mass * modulus).real for mass, modulus in zip(masses, moduli, strict=True)
        )

    def factors(self) -> tuple[np.ndarray, np.ndarray]:
        """Return Z_P and Z_S, (F, 1) each."""
        return self._factors

    def residual(self, state: State) -> np.ndarray:
        """Return ∮ N_a (Z (v - 2 v_in) + p N) dA, (F, Af, d) [N], p of a porous medium alone."""
        incoming = np.zeros(self.surface.X.shape)
        points = self.surface.X.reshape(-1, incoming.shape[-1])
        for component, formula in self.incident.items():
            incoming[..., component] = formula(state.t, points).reshape(incoming.shape[:2])
        load = self.load_at_nodes(self.surface.gather(state.v) - 2 * incoming)
        if not self._pores.any():
            return load
        assert state.p is not None  # of the pore fluid
        p = self._pores * (self.surface.gather(state.p) @ self._rule.N.T)
        return load + pressure_load(self._rule.N, self._normal, p)

    def tangent(self, state: State, slope: Slope) -> np.ndarray:
        """Return its derivative by the motion, (F, Af, d, Af, d) [N/m]."""
        return slope.v * self.matrix()

    def exchange(self, state: State, slope: Slope) -> np.ndarray | None:
        """Return its derivative by p, (F, Af, d, Af, 1) [m²]."""
        if not self._pores.any():
            return None
        return pressure_coupling(self._rule.N, self._pores[..., None] * self._normal)
