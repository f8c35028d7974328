"""The stress that a solid has at the start without strain, by formulas of position."""

from collections.abc import Callable, Collection, Mapping
from functools import cached_property
from typing import Any

import numpy as np

from ..fem.domain import Domain
from ..materials.prestressed import Prestressed

Component = tuple[int, int]


class InitialStress:
    """σ_0 at points of the elements of a solid, see `materials.prestressed`."""

    def __init__(
        self,
        domain: Domain,
        given: Mapping[Component, Callable[[float, np.ndarray], np.ndarray]],
        without: Collection[str] = (),
    ) -> None:
        """Take formulas of (t, x) by component, those of the upper triangle; others are zero.

        without : regions that have none
        """
        self._domain = domain
        self._given = given
        self._has = np.ones((domain.n_cells, 1))
        for region in set(without) & set(domain.regions):
            self._has[domain.region_slices[region]] = 0.0

    def law(self, law: Any, rows: slice | np.ndarray, N: np.ndarray | None = None) -> Prestressed:
        """Return the law of some elements with it at the points of the stress, or at others with
        the shape functions N (P, A).
        """
        return Prestressed(law, self._at_points[rows] if N is None else self._values(rows, N))

    @cached_property
    def _at_points(self):
        """Return σ_0 at the points of the stress, (E, Q', 3, 3) [Pa]."""
        return self._values(slice(None))

    def _values(self, rows, N=None):
        """Return σ_0, (E, P, 3, 3) [Pa], at points, those of the stress or with the shape functions
        N (P, A).
        """
        X = self._domain.points_of_stress(rows, N)
        found = np.zeros((*X.shape[:2], 3, 3))
        for (i, j), formula in self._given.items():
            values = formula(0.0, X.reshape(-1, X.shape[-1])).reshape(X.shape[:2])
            found[..., i, j] = found[..., j, i] = values * self._has[rows]
        return found
