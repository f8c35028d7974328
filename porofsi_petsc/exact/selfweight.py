"""A column that settles under its own weight in a fluid at rest (buoyant, suddenly switched on).

The weight γ' = n_s (ρ_sR - ρ_fR) g per reference volume is carried by the excess pressure at first,
p(z, 0+) = γ' z, and by the skeleton in the end, P(J) = -γ' z.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .confined import confined_ratio
from .series import modes, on_distinct

GAUSS_POINTS = 24  # of the integral of J - 1, which is smooth: digits are round-off


@dataclass(frozen=True)
class Selfweight:
    """weight γ' [N/m³], height H [m], E_c [Pa], diffusivity c_v = k_f E_c/γ_fR [m²/s]; stress,
    lowest of `confined_ratio`.
    """

    weight: float
    height: float
    modulus: float
    diffusivity: float
    stress: Callable[[float], float]
    lowest: float = 0.0

    def end_settlement(self, z: ArrayLike) -> np.ndarray:
        """Return w(z) = ∫_z^H (1 - J) dZ, P(J) = -γ' Z, of the drained end state at depths z, any
        shape: [m].
        """
        nodes, weights = np.polynomial.legendre.leggauss(GAUSS_POINTS)

        def settle(depths: np.ndarray) -> np.ndarray:
            half = (self.height - depths) / 2
            Z = np.add.outer(self.height - half, np.zeros(GAUSS_POINTS)) + np.multiply.outer(
                half, nodes
            )
            strain = np.vectorize(
                lambda Z: 1 - confined_ratio(self.stress, self.weight * Z, self.lowest)
            )
            return half * (strain(Z) @ weights)

        return on_distinct(settle, z)

    def pressure(self, z: ArrayLike, t: float) -> np.ndarray:
        """Return p = γ' H Σ 2 (-1)ⁿ/M² sin(M z/H) e^(-M² T) at small strain, at depths z, any
        shape: [Pa].
        """
        return on_distinct(lambda z: self.weight * self.height * self._sum(z, t, 2, np.sin), z)

    def settlement(self, z: ArrayLike, t: float) -> np.ndarray:
        """Return w = γ'/E_c [(H² - z²)/2 - H² Σ 2 (-1)ⁿ/M³ cos(M z/H) e^(-M² T)] at small strain:
        [m].
        """
        scale = self.weight / self.modulus
        H = self.height
        return on_distinct(
            lambda z: scale * ((H**2 - z**2) / 2 - H**2 * self._sum(z, t, 3, np.cos)), z
        )

    def _sum(
        self, z: np.ndarray, t: float, power: int, shape: Callable[[np.ndarray], np.ndarray]
    ) -> np.ndarray:
        T = self.diffusivity * t / self.height**2
        M = modes(T)
        signs = 1.0 - 2.0 * (np.arange(len(M)) % 2)
        return shape(np.multiply.outer(z / self.height, M)) @ (
            2 * signs / M**power * np.exp(-(M**2) * T)
        )
