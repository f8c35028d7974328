"""Laws that give their energy alone; stress and tangent follow by differentiation with complex
numbers.
"""

from dataclasses import dataclass

import numpy as np

from .elastic import ElasticLaw

# of a complex step, whose error vanishes with it (Squire & Trapp, SIAM Rev. 40 (1998) 110)
STRESS_STEP = 1e-30
# Of the central difference of complex steps, relative to strains of order one: its truncation is of
# order step², its round-off that of the stress over the step; together below 1e-10 of the tangent,
# which a Newton iteration does not see.
TANGENT_STEP = 1e-5


@dataclass(frozen=True)
class FromEnergy(ElasticLaw):
    """An elastic law by its energy; a subclass has `energy`, written with operations of NumPy that
    take complex numbers.

    The stress is exact to round-off.  In three dimensions the energy is evaluated 9 times for the
    stress of a point and 90 times for its tangent; times beside laws by hand: docs/python.md.
    """

    def energy(self, H: np.ndarray) -> np.ndarray:
        """Return Psi, (...), of displacement gradients (..., d, d), real or complex; d = 2 is plane
        strain.
        """
        raise NotImplementedError

    def stress(self, H: np.ndarray) -> np.ndarray:
        """Return P_iJ = dPsi/dF_iJ = Im Psi(H + i h e_iJ)/h, (..., d, d)."""
        P = np.empty(H.shape)
        for i, J in np.ndindex(H.shape[-2:]):
            P[..., i, J] = self._slope(H, i, J)
        return P

    def tangent(self, H: np.ndarray) -> np.ndarray:
        """Return dP_iJ/dF_kL by central differences of the complex steps, (..., d, d, d, d), made
        symmetric by its making.
        """
        d = H.shape[-1]
        A = np.empty(H.shape + (d, d))
        pairs = list(np.ndindex(d, d))
        for column, (k, L) in enumerate(pairs):
            step = np.zeros((d, d))
            step[k, L] = TANGENT_STEP
            for i, J in pairs[: column + 1]:
                slope = (self._slope(H + step, i, J) - self._slope(H - step, i, J)) / (
                    2 * TANGENT_STEP
                )
                A[..., i, J, k, L] = slope
                A[..., k, L, i, J] = slope
        return A

    def _slope(self, H, i, J):
        """Return dPsi/dF_iJ at H, (...)."""
        perturbed = H.astype(complex)
        perturbed[..., i, J] += 1j * STRESS_STEP
        return np.imag(self.energy(perturbed)) / STRESS_STEP


def invariants(H: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return I1 - 3 and I2 - 3 of C = FᵀF, and J - 1, each (...), of H = F - I (..., d, d); d = 2
    is plane strain.

    Real or complex; a small strain keeps its digits: I1 - 3 = 2 tr E, I2 - 3 = 4 tr E + 2 ((tr E)²
    - tr E²).
    """
    E = (H + np.swapaxes(H, -1, -2) + np.swapaxes(H, -1, -2) @ H) / 2
    first = np.trace(E, axis1=-2, axis2=-1)
    second = np.einsum("...ij,...ji->...", E, E)
    return 2 * first, 4 * first + 2 * (first**2 - second), _determinant_minus_one(H)


def _determinant_minus_one(H):
    """Return det(I + H) - 1 = tr H + (the second invariant of H) + det H, (...)."""
    trace = np.trace(H, axis1=-2, axis2=-1)
    minors = (trace**2 - np.einsum("...ij,...ji->...", H, H)) / 2
    if H.shape[-1] == 2:
        return trace + minors
    first, second, third = (H[..., i, :] for i in range(3))
    return trace + minors + np.einsum("...i,...i->...", first, np.cross(second, third))
