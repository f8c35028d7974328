"""One tagged surface of a domain: the facets of a rank with what conditions on them ask for."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from .domain import Domain
from .geometry import Rule, facet_measure, facet_measure_by_positions


class Surface:
    """The facets of a tag with an element of a domain behind them, F of them, Af nodes each;
    `conditions.condition.Surface`.

    nodes (F, Af); rows (F,) of their elements in the domain; local (F, Af) numbers of the nodes in
    these
    """

    def __init__(self, domain: Domain, tag: str, materials: Mapping[str, Any]) -> None:
        """Find the facets; materials : region -> `PorousMaterial`."""
        mesh = domain.mesh
        facets = mesh.facets[tag]
        behind = np.flatnonzero(domain.row_of_cell[facets.cells] >= 0)
        cells = facets.cells[behind]
        self.tag = tag
        self.comm = mesh.comm
        self.rows = domain.row_of_cell[cells]
        self.local = np.array(domain.element.facets)[facets.local[behind]]
        self.nodes = domain.cells[self.rows[:, None], self.local]
        self.X = mesh.X[self.nodes]
        self.order = mesh.element.order
        self._owned = facets.owned[behind]
        self._regions = [mesh.regions[number] for number in mesh.cell_region[cells]]
        self._materials = materials
        self._cells = cells
        self._mesh = mesh
        self._domain = domain

    @property
    def depth(self) -> np.ndarray:
        """Return the volume of the elements behind the facets over the areas of these, (F,) [m]."""
        area = np.linalg.norm(self.normal(self.rule(2 * self.order)), axis=-1).sum(axis=1)
        return self._domain.reference.dV[self.rows].sum(axis=1) / area

    def rule(self, degree: int) -> Rule:
        """Return the rule that is exact for polynomials of a degree, around an axis times r."""
        facet = self._mesh.element.facet
        return Rule.of(facet, degree + facet.axisymmetric)

    def gather(self, field: np.ndarray) -> np.ndarray:
        """Return the values of a nodal field (n_local, ...) on the facets, (F, Af, ...)."""
        return field[self.nodes]

    def displacement(self, u: np.ndarray) -> np.ndarray:
        """Return the displacement on the facets, (F, Af, d) [m], from where the cells behind them
        are at rest, see `Domain.displacement`.
        """
        nodal = self._domain.displacement(u, self.rows)
        return np.take_along_axis(nodal, self.local[..., None], axis=1)

    def normal(self, rule: Rule, u: np.ndarray | None = None) -> np.ndarray:
        """Return the outward normals times dA, (F, Q, d) [m^(d-1)], where a displacement u
        (n_local, d) [m] has taken the surface; in the reference without.  Around an axis those of
        whole rings [m²].
        """
        x = self.X if u is None else self.X + u[self.nodes]
        return facet_measure(rule, x)

    def normal_by_positions(self, rule: Rule, u: np.ndarray) -> np.ndarray:
        """Return the derivative of `normal` (component i) by the positions x_bj of the nodes, (F,
        Q, b, i, j).
        """
        return facet_measure_by_positions(rule, self.X + u[self.nodes])

    def of_material(self, name: str) -> np.ndarray:
        """Return an attribute of the material behind the facets, (F, 1)."""
        values = np.empty((len(self._regions), 1))
        for region in set(self._regions):
            here = np.array([name == region for name in self._regions])
            values[here] = getattr(self._materials[region].at(self._cells[here]), name)
        return values

    def sum(self, values: np.ndarray) -> float:
        """Return the sum of values (F,) over the facets of all ranks (collective)."""
        return self._mesh.comm.allreduce(float(values[self._owned].sum()))

    def add_to(self, nodal: np.ndarray, vectors: np.ndarray) -> None:
        """Add vectors (F, Af, k) on the facets to a field (n_owned, k); raises ValueError where
        they have another shape.
        """
        wanted = (*self.nodes.shape, nodal.shape[1])
        if vectors.shape != wanted:
            raise ValueError(f"'{self.tag}': received vectors {vectors.shape}, expected {wanted}")
        owned = self.nodes < self._mesh.n_owned
        np.add.at(nodal, self.nodes[owned], vectors[owned])

    def add_tangent(
        self, K: np.ndarray, chunk: slice, tangent: np.ndarray, row: int = 0, column: int = 0
    ) -> None:
        """Add tangents of the facets (F, Af, k, Af, l) to those of a slice of the elements, (E, A,
        m, A, n), from their components row and column on.
        """
        here = np.flatnonzero((self.rows >= chunk.start) & (self.rows < chunk.stop))
        local = self.local[here]
        i, j = (first + np.arange(tangent.shape[k]) for first, k in ((row, 2), (column, 4)))
        rows = (self.rows[here] - chunk.start)[:, None, None, None, None]
        places = (
            rows,
            local[:, :, None, None, None],
            i[:, None, None],
            local[:, None, None, :, None],
            j,
        )
        np.add.at(K, places, tangent[here])
