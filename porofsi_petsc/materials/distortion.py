"""A power of the distortion: no material, but a motion of a mesh that takes large turns."""

from typing import NamedTuple

import numpy as np

from ..tensors import stacked, trace, transpose, weighted
from .elastic import ElasticLaw
from .points import add_dyads, compressible_stress, compressible_tangent
from .strain import green_strain, kinematics, logarithm

POWER = 3  # p; others: docs/interface.md, Large turns


class _Distorted(NamedTuple):
    """D - 1 (n,) of n points, D_F = a F + b F⁻ᵀ and F⁻¹, (n, d, d), and a, b, c (n,) of D_FF = a
    δ_ik δ_JL - b F⁻¹_Jk F⁻¹_Li + c F⁻ᵀ ⊗ F⁻ᵀ - 2/d (D_F ⊗ F⁻ᵀ + F⁻ᵀ ⊗ D_F).
    """

    excess: np.ndarray
    slope: np.ndarray
    Finv: np.ndarray
    a: np.ndarray
    b: np.ndarray
    c: np.ndarray


class Distortion(ElasticLaw):
    """Ψ = d μ/(2 p) (D^p - 1),   D = I1/(d J^(2/d)) + κ (J + 1/J - 2),   κ = (λ + 2 μ/d)/(d μ).

    I1/(d J^(2/d)) is one over the mean ratio of F (Knupp, SIAM J. Sci. Comput. 23 (2001) 193), 1
    where angles are kept; the other term is 0 where volumes are.  D is polyconvex and infinite at J
    = 0, and so is its power, which spreads a distortion: the larger p, the smaller the largest D.
    d = 2 is the plane alone, without a third direction.
    """

    def energy(self, H: np.ndarray) -> np.ndarray:
        """Return Psi, (...)."""
        power = np.expm1(POWER * np.log1p(self._distorted(H).excess))
        return (H.shape[-1] * self.mu / (2 * POWER) * power).reshape(H.shape[:-2])

    def stress(self, H: np.ndarray) -> np.ndarray:
        """Return P = d μ/2 D^(p-1) D_F, (..., d, d)."""
        state = self._distorted(H)
        return weighted(self._growth(state), state.slope).reshape(H.shape)

    def tangent(self, H: np.ndarray) -> np.ndarray:
        """Return dP/dF = d μ/2 D^(p-1) [D_FF + (p - 1)/D D_F ⊗ D_F], (..., d, d, d, d).

        The mixed terms of D_FF are taken into the square of X = D_F + m F⁻ᵀ, m = -2 D/(d (p - 1)).
        """
        state = self._distorted(H)
        growth = self._growth(state)
        dyad = (POWER - 1) / (1 + state.excess)
        m = -2 / (H.shape[-1] * dyad)
        square = state.c - dyad * m**2
        A = compressible_tangent(
            H, state.Finv, 1 + state.b / state.a, square / state.a, 1.0
        )  # of which (mu - first) = -b/a
        X = state.slope + weighted(m, transpose(state.Finv))
        add_dyads(A, X, growth * dyad, growth * state.a)
        return A

    def _growth(self, state):
        """Return d μ/2 D^(p-1), (n,)."""
        d = state.Finv.shape[-1]
        return d * self.mu / 2 * (1 + state.excess) ** (POWER - 1)

    def _distorted(self, H):
        """Return the `_Distorted` of displacement gradients (..., d, d), by intention NaN at J <=
        0; digits of a small H are kept.
        """
        d = H.shape[-1]
        Finv, J_1 = kinematics(H)
        kappa = (self.lam + 2 * self.mu / d) / (d * self.mu)
        stretch = 2 / d * trace(green_strain(stacked(H)))  # I1/d - 1
        scale = np.exp(-2 / d * logarithm(J_1))
        a = 2 / d * scale
        pressure = kappa * J_1 * (2 + J_1) / (1 + J_1)  # κ (J - 1/J)
        both = pressure - a * stretch  # a + b
        b = both - a
        slope = weighted(a, compressible_stress(stacked(H), Finv, both / a, 1.0))
        excess = scale * (1 + stretch) - 1 + kappa * J_1**2 / (1 + J_1)
        c = kappa * (1 + J_1 + 1 / (1 + J_1)) + 2 / d * (b + pressure)
        return _Distorted(excess, slope, Finv, a, b, c)
