"""Linear elasticity with an axis: layered soils and rock, wood, bone, tendon."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..registry import parameter
from ..tensors import trace
from .elastic import ElasticLaw
from .fibres import unit
from .strain import linear_strain


@dataclass(frozen=True)
class TransverselyIsotropic(ElasticLaw):
    """Ψ = C12/2 (tr ε)² + μ ε:ε + (C13 - C12) (a·εa) tr ε + 2 (G_a - μ) |εa|² + β/2 (a·εa)², a the
    axis; λ and μ (or young and poisson) are those of the plane across it, as if it were isotropic
    (Spencer, Continuum Theory of the Mechanics of Fibre-Reinforced Composites, 1984).

    β = C33 + C12 - 2 C13 - 4 G_a + 2μ; with E and ν of the plane and m = 1 - ν - 2 ν_a² E/E_a:
    C33 = E_a (1 - ν)/m, C13 = E ν_a/m, C12 = E (ν + ν_a² E/E_a)/((1 + ν) m), C11 = C12 + 2μ.
    """

    young_along: float = parameter("Pa", "E_a, under a pull along the axis", above=0.0, example=3.0)
    poisson_along: float = parameter(
        "-", "ν_a, contraction across under a pull along the axis", above=-1.0, example=0.25
    )
    shear_along: float = parameter("Pa", "G_a, of planes through the axis", above=0.0, example=0.6)
    axis: tuple[float, ...] = parameter(
        "-", "direction of the axis, three components", kind="numbers", example=(0.6, 0.8, 0.0)
    )

    small_strain = True
    anisotropic = True

    def __post_init__(self) -> None:
        """Raise ValueError where the constants are those of no stable material."""
        unit("axis", self.axis)
        if self._margin <= 0:
            raise ValueError(
                f"poisson_along: received {self.poisson_along:g}, with which 1 - ν - 2 ν_a² E/E_a ="
                f" {self._margin:.3g}; expected a smaller one, for which this is positive"
            )

    @property
    def axes(self) -> tuple[np.ndarray, ...]:
        """Return the unit vector of the axis."""
        return (unit("axis", self.axis),)

    @property
    def _plane(self):
        """Return E [Pa] and ν of the plane across the axis."""
        poisson = self.lam / (2 * (self.lam + self.mu))
        return 2 * self.mu * (1 + poisson), poisson

    @property
    def _margin(self):
        E, nu = self._plane
        return 1 - nu - 2 * self.poisson_along**2 * E / self.young_along

    @cached_property
    def _constants(self):
        """Return C11, C12, C13 and C33 [Pa]."""
        E, nu = self._plane
        m = self._margin
        C12 = E * (nu + self.poisson_along**2 * E / self.young_along) / ((1 + nu) * m)
        C13 = E * self.poisson_along / m
        return C12 + 2 * self.mu, C12, C13, self.young_along * (1 - nu) / m

    @cached_property
    def _confined_moduli(self):
        """Return the extrema of C11 (1 - x)² + C33 x² + 2 (C13 + 2 G_a) x (1 - x) [Pa], x = (n·a)²,
        of compressions along n.
        """
        C11, _, C13, C33 = self._constants
        b = C13 + 2 * self.shear_along
        bend = C11 + C33 - 2 * b
        x = np.clip((C11 - b) / bend, 0, 1) if bend else 0.0
        return C11, C33, C11 * (1 - x) ** 2 + C33 * x**2 + 2 * b * x * (1 - x)

    @property
    def oedometer_modulus(self) -> float:
        """Return the modulus of the stiffest direction [Pa]."""
        return float(max(self._confined_moduli))

    @property
    def softest_modulus(self) -> float:
        """Return the modulus of the softest direction [Pa]."""
        return float(min(self._confined_moduli))

    def confined(self, J: float | np.ndarray) -> Any:
        """Return the stress of F = diag(1, 1, J) along it [Pa]."""
        return ElasticLaw.confined(self, J)

    def stiffness(self, d: int) -> np.ndarray:
        """Return dσ_iJ/dε_kL, (d, d, d, d) [Pa]."""
        C11, C12, C13, C33 = self._constants
        a = self.axes[0][:d]
        I = np.eye(d)  # noqa: E741
        M = np.outer(a, a)
        beta = C33 + C12 - 2 * C13 - 4 * self.shear_along + 2 * self.mu
        C = C12 * np.einsum("iJ,kL->iJkL", I, I) + beta * np.einsum("iJ,kL->iJkL", M, M)
        C += (C13 - C12) * (np.einsum("iJ,kL->iJkL", I, M) + np.einsum("iJ,kL->iJkL", M, I))
        C += self.mu * (np.einsum("ik,JL->iJkL", I, I) + np.einsum("iL,Jk->iJkL", I, I))
        for left, right in ((I, M), (M, I)):
            C += (self.shear_along - self.mu) * np.einsum("ik,JL->iJkL", left, right)
            C += (self.shear_along - self.mu) * np.einsum("iL,Jk->iJkL", left, right)
        return C

    def energy(self, H: np.ndarray) -> np.ndarray:
        """Return Ψ, (...)."""
        return trace(linear_strain(H) @ self.stress(H)) / 2

    def stress(self, H: np.ndarray) -> np.ndarray:
        """Return σ, (..., d, d)."""
        return np.einsum("iJkL,...kL->...iJ", self.stiffness(H.shape[-1]), linear_strain(H))

    def tangent(self, H: np.ndarray) -> np.ndarray:
        """Return dP/dF, (..., d, d, d, d), constant."""
        return np.broadcast_to(self.stiffness(H.shape[-1]), H.shape + H.shape[-2:])
