"""Springs, dashpots and absorbing boundaries: tractions that oppose displacement or velocity."""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ..kernels.assemble import add_mass
from ..kernels.surface import impedance_load, impedance_weights
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
    reference, u from the reference.
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
        return self.load_of(state.u)

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
class Absorbing(Impedance):
    """Waves leave through it: the traction -(ρ c_p N N + ρ c_s (I - N N)) (v_s - 2 v_in) of the
    material behind, ρ c_p = √(ρ (λ + 2μ)), ρ c_s = √(ρ μ), N the normal of the reference, v_in the
    velocity of a wave that comes in (Lysmer & Kuhlemeyer 1969; Joyner & Chen 1975).
    """

    behind = ("solid",)
    excludes = {"solid": ("spring", "dashpot")}
    otherwise = "give a `dashpot` of its own to a porous medium"

    incident: Any = parameter("m/s", "v_in", kind="vector", default={}, example={"x": 0.3})

    def bind(self, surface: Surface) -> None:
        """Take the impedances of the material."""
        super().bind(surface)
        self._factors = (
            surface.of_material("compression_impedance"),
            surface.of_material("shear_impedance"),
        )

    def factors(self) -> tuple[np.ndarray, np.ndarray]:
        """Return ρ c_p and ρ c_s, (F, 1) each."""
        return self._factors

    def residual(self, state: State) -> np.ndarray:
        """Return ∮ N_a Z (v - 2 v_in) dA, (F, Af, d) [N]."""
        incoming = np.zeros(self.surface.X.shape)
        points = self.surface.X.reshape(-1, incoming.shape[-1])
        for component, formula in self.incident.items():
            incoming[..., component] = formula(state.t, points).reshape(incoming.shape[:2])
        return self.load_at_nodes(self.surface.gather(state.v) - 2 * incoming)

    def tangent(self, state: State, slope: Slope) -> np.ndarray:
        """Return its derivative, (F, Af, d, Af, d) [N/m]."""
        return slope.v * self.matrix()
