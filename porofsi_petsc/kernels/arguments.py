"""What the kernels ask of arguments that are made elsewhere: gradients and volumes, laws."""

from typing import Protocol

import numpy as np


class Geometry(Protocol):
    """Elements in one configuration: gradients (E, Q', A, d) [1/m], Q' = 1 where they are constant,
    and volumes (E, Q) [m^d] of the points; hoop (E, Q, A) [1/m], N/r of elements around an axis,
    None of others; divergence (E, Q', A, d) [1/m] of N e_i.
    """

    @property
    def G(self) -> np.ndarray: ...
    @property
    def dV(self) -> np.ndarray: ...
    @property
    def hoop(self) -> np.ndarray | None: ...
    @property
    def divergence(self) -> np.ndarray: ...


class Stress(Protocol):
    """The first Piola-Kirchhoff stress of H (..., d, d) [Pa] and its derivatives."""

    def stress(self, H: np.ndarray) -> np.ndarray: ...
    def tangent(self, H: np.ndarray) -> np.ndarray: ...
    def mixed_tangent(self, H: np.ndarray, before: np.ndarray) -> np.ndarray: ...


class StrainEnergy(Protocol):
    """The energy per reference volume of H (..., d, d) [J/m³]."""

    def energy(self, H: np.ndarray) -> np.ndarray: ...


class Pores(Protocol):
    """Fluid fraction [-] and drag [N s/m⁴] of a volume ratio, the shape of J."""

    def fluid_fraction(self, J: np.ndarray) -> np.ndarray: ...
    def drag(self, J: np.ndarray) -> np.ndarray: ...
