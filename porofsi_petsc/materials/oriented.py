"""Anisotropic laws whose directions follow axes that turn from point to point."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from .elastic import ElasticLaw

Axes = Callable[[np.ndarray, np.ndarray], np.ndarray]  # X (E, P, d), cells (E,) -> (E, P, 3, 3)


@dataclass(frozen=True, kw_only=True)
class Oriented(ElasticLaw):
    """Ψ(H) = Ψ°(R H Rᵀ) of a law whose directions are components along the axes of a point.

    law : Ψ°, of numbers; axes : the orthonormal axes, rows of R, at points X [m] of cells; in two
    dimensions the third one is across the plane
    cells : numbers of the cells; rotation : R (E, 1, 3, 3) at their centres, (E, P, 3, 3) at points
    that the law is `placed` at
    """

    law: ElasticLaw
    axes_at: Axes
    cells: np.ndarray
    rotation: np.ndarray

    turns = True

    @property
    def small_strain(self) -> bool:  # type: ignore[override]  # a constant of other laws
        """Return whether the stress is linear in H."""
        return self.law.small_strain

    @property
    def anisotropic(self) -> bool:  # type: ignore[override]  # a constant of other laws
        """Return whether the law is."""
        return self.law.anisotropic

    @property
    def axes(self) -> tuple[np.ndarray, ...]:
        """Return the unit vectors (3,) of the law along the axes of a cell."""
        return self.law.axes

    @property
    def oedometer_modulus(self) -> float:
        """Return the modulus of the stiffest direction [Pa]."""
        return self.law.oedometer_modulus

    @property
    def softest_modulus(self) -> float:
        """Return the modulus of the softest direction [Pa]."""
        return self.law.softest_modulus

    def at(self, cells: slice | np.ndarray) -> Oriented:
        """Return the law of some cells."""
        return replace(self, cells=self.cells[cells], rotation=self.rotation[cells])

    def placed(self, X: np.ndarray) -> Oriented:
        """Return the law at points X (E, P, d) [m] of its cells."""
        return replace(self, rotation=self.axes_at(X, self.cells))

    def energy(self, H: np.ndarray) -> np.ndarray:
        """Return Ψ, (E, Q), of H (E, Q, d, d)."""
        return self.law.energy(self._turned(H))

    def stress(self, H: np.ndarray) -> np.ndarray:
        """Return P = Rᵀ P° R, (E, Q, d, d), of H (E, Q, d, d)."""
        R = self._axes_of(H)
        return np.swapaxes(R, -1, -2) @ self.law.stress(self._turned(H)) @ R

    def tangent(self, H: np.ndarray) -> np.ndarray:
        """Return dP_iJ/dF_kL = R_mi R_nJ R_pk R_qL A°_mnpq, (E, Q, d, d, d, d)."""
        return self._turned_back(self.law.tangent(self._turned(H)), H)

    def mixed_tangent(self, H: np.ndarray, before: np.ndarray) -> np.ndarray:
        """Do what `ElasticLaw.mixed_tangent` says."""
        A = self.law.mixed_tangent(self._turned(H), self._turned(before))
        return self._turned_back(A, H)

    def _axes_of(self, H):
        """Return the axes that have components in H, (E, P, d, d)."""
        d = H.shape[-1]
        return self.rotation[..., :d, :d]

    def _turned(self, H):
        R = self._axes_of(H)
        return R @ H @ np.swapaxes(R, -1, -2)

    def _turned_back(self, A, H):
        d = H.shape[-1]
        R = self._axes_of(H)
        both = np.einsum("...mi,...nJ->...mniJ", R, R).reshape(*R.shape[:-2], d * d, d * d)
        A = A.reshape(*H.shape[:-2], d * d, d * d)
        return (np.swapaxes(both, -1, -2) @ A @ both).reshape(*H.shape, d, d)


def oriented(law: ElasticLaw, axes: Axes, centres: np.ndarray) -> Oriented:
    """Return the law with its directions along axes; centres : X (n, d) [m] of all cells."""
    cells = np.arange(len(centres))
    rotation = axes(centres[:, None], cells)
    return Oriented(
        law.lam,
        law.mu,
        law.n_s0,
        law.prony,
        law=law,
        axes_at=axes,
        cells=cells,
        rotation=rotation,
    )
