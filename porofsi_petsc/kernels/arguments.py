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

    @property
    def anisotropic(self) -> bool: ...
    def stress(self, H: np.ndarray) -> np.ndarray: ...
    def tangent(self, H: np.ndarray) -> np.ndarray: ...
    def mixed_tangent(self, H: np.ndarray, before: np.ndarray) -> np.ndarray: ...


class StrainEnergy(Protocol):
    """The energy per reference volume of H (..., d, d) [J/m³]."""

    def energy(self, H: np.ndarray) -> np.ndarray: ...


class Drag(Protocol):
    """S_ij = s D_ij at points: s (E, Q) [N s/m⁴], D (d, d) [-], None for δ_ij; S w of w (E, Q, d),
    D times vectors.
    """

    @property
    def scale(self) -> np.ndarray: ...
    @property
    def resistance(self) -> np.ndarray | None: ...
    def on(self, w: np.ndarray) -> np.ndarray: ...
    def turned(self, vectors: np.ndarray) -> np.ndarray: ...


class Pores(Protocol):
    """Fluid fraction [-], the shape of J, and drag of a volume ratio."""

    def fluid_fraction(self, J: np.ndarray) -> np.ndarray: ...
    def drag(self, J: np.ndarray) -> Drag: ...
