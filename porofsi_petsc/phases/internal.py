"""The internal variables of laws with memory at the quadrature points of a solid."""

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np

from ..fem.domain import Domain
from ..kernels.solid import displacement_gradient
from ..materials.elastic import ElasticLaw
from .initial_stress import InitialStress

ARRAY = "cell_internal"  # name in a checkpoint, with a row for each cell


class InternalVariables:
    """Those of the accepted state, (E, Q', m) at the points of the stress, of all elements that the
    rank has; m is that of the law with the most, 0 where no law has a memory.

    A stress between the accepted level and the end of a step is that of the accepted variables
    after a part of the step; they are integrated to its end when it is accepted.
    """

    def __init__(
        self,
        domain: Domain,
        laws: Mapping[str, ElasticLaw],
        initial: InitialStress | None = None,
    ) -> None:
        """Start at rest without strain; laws : region -> law; initial : a stress beside theirs."""
        self._initial = initial
        self._domain = domain
        self._laws = laws
        self._size = max((law.memory for law in laws.values()), default=0)
        if self:
            points = domain.reference_stiffness.G.shape[1]
            self._values = np.zeros((domain.n_cells, points, self._size))

    def __bool__(self) -> bool:
        """Return whether a law has a memory."""
        return self._size > 0

    def law(self, law: ElasticLaw, chunk: slice, duration: float) -> Any:
        """Return the law of some elements at their points, a time [s] after the accepted state."""
        law = self._placed(law, chunk)
        if law.memory:
            law = law.after(self._values[chunk, :, : law.memory], duration)
        return self._initial.law(law, chunk) if self._initial else law

    def law_at(self, law: ElasticLaw, rows: Any, N: np.ndarray | None = None) -> Any:
        """Return the law of some elements in the accepted state at their nodes, or at points with
        the shape functions N (P, A).

        The variables there are the linear ones next to those of the points.
        """
        if N is None:
            N = np.eye(len(self._domain.element.node_coordinates))
        law = self._placed(law, rows, N)
        if law.memory:
            law = law.after(self.at(law, rows, N), 0.0)
        return self._initial.law(law, rows, N) if self._initial else law

    def _placed(self, law, rows, N=None):
        """Return the law at points, if its directions turn."""
        return law.placed(self._domain.points_of_stress(rows, N)) if law.turns else law

    def at(self, law: ElasticLaw, rows: Any, N: np.ndarray | None = None) -> np.ndarray:
        """Return the variables of a law with memory in some elements at their nodes, or at points
        with the shape functions N (P, A): (E, P, memory).
        """
        to_points = self._to_nodes if N is None else N @ self._to_nodes
        return to_points @ self._values[rows][..., : law.memory]

    @cached_property
    def _to_nodes(self):
        """Return the map from the points to the nodes of an element, (A, Q')."""
        element = self._domain.element
        points = self._domain.stiffness.points
        centre = points.mean(axis=0)
        if self._values.shape[1] == 1:
            points = centre[None]
        basis, at_nodes = (
            np.column_stack([np.ones(len(x)), x - centre])
            for x in (points, element.node_coordinates)
        )
        return at_nodes @ np.linalg.pinv(basis)

    def accept(self, u: np.ndarray, duration: float, doubles_per_cell: float) -> None:
        """Integrate them over a time [s] that ends with the displacement u (n_local, d) [m]."""
        domain = self._domain
        for region, chunk in domain.chunks(doubles_per_cell):
            law = self._placed(self._laws[region].at(domain.cell_numbers[chunk]), chunk)
            if law.memory:
                part = domain.reference_stiffness.part(chunk)
                H = displacement_gradient(part.G, domain.displacement(u, chunk), part.hoop)
                values = self._values[chunk, :, : law.memory]
                values[...] = law.updated(values, duration, H)

    def state(self) -> dict[str, np.ndarray]:
        """Return the array that a restart needs, with a row for each cell of the rank's mesh; {}
        without memory.
        """
        if not self:
            return {}
        rows = self._domain.row_of_cell
        array = np.zeros((len(rows), *self._values.shape[1:]))
        array[rows >= 0] = self._values[rows[rows >= 0]]
        return {ARRAY: array}

    def load(self, arrays: Mapping[str, np.ndarray]) -> None:
        """Continue from `state`."""
        if self:
            rows = self._domain.row_of_cell
            self._values[rows[rows >= 0]] = arrays[ARRAY][rows >= 0]
