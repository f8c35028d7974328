"""Integrals on the facets of a rank: interfaces, surfaces where a field vanishes weakly."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ..elements import ELEMENTS, Element
from ..kernels.surface import (
    facet_normal,
    pressure_load,
    surface_mass,
    weak_zero,
)
from ..mesh.topology import boundary_facets, cell_facets, locate_facets
from ..tensors import inverse
from .distribute import LocalMesh
from .domain import Domain
from .geometry import Rule, facet_measure

# Penalty of Nitsche's method over the bound of the trace inequality, `Element.trace_constant`: on a
# simplex of order k (k + 1)(k + d)/d A/V.  The exact one is n·M⁻¹n of the mass behind
# the surface, 2√3/h on a chain of linear elements (bound 4/h), more at corners.  Measured on a
# closed block, both orders, k_f = 1e-2 and 1e-5: at most 27 … 100 Aitken sweeps with 0.6, 51 with
# 0.87, 16 with 1.1, 15 with 1.2, 16 with 1.4.
PENALTY = 1.2


def weak_zero_on(domain: Domain, tags: Iterable[str]) -> tuple[np.ndarray, np.ndarray]:
    """Return rows (F,) of elements of the domain and `kernels.surface.weak_zero` (F, A, A) on the
    facets of the tags that it has.

    Reference configuration; the penalty is that of the mass behind the surface.
    """
    mesh = domain.mesh
    element = domain.element
    facets = [mesh.facets[tag] for tag in tags]
    cells = np.concatenate([f.cells for f in facets] or [np.zeros(0, dtype=int)])
    local = np.concatenate([f.local for f in facets] or [np.zeros(0, dtype=int)])
    rows = domain.row_of_cell[cells]
    rows, local = rows[rows >= 0], local[rows >= 0]
    terms = np.empty((len(rows), element.nodes, element.nodes))
    bound = PENALTY * element.trace_constant
    for number, nodes in enumerate(element.facets):
        here = local == number
        N, G, normal = trace(domain.element, nodes, domain.mesh.X[domain.cells[rows[here]]])
        area = np.linalg.norm(normal, axis=-1).sum(axis=1)
        terms[here] = weak_zero(
            N, G, normal, bound * area / domain.reference.dV[rows[here]].sum(axis=1)
        )
    return rows, terms


def trace(
    element: Element, nodes: Sequence[int], coordinates: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return N (Q, A), G (F, Q, A, d) and normals times dA (F, Q, d) of elements on the facet with
    the given local nodes.

    coordinates : (F, A, d) of the nodes of the elements
    """
    facet = element.facet
    rule = Rule.of(facet, 2 * element.order + element.axisymmetric)
    corners = list(nodes[: element.cell.facet_vertices])
    xi = facet.cell.vertex_functions(rule.points) @ element.node_coordinates[corners]
    dN = element.gradient(xi)
    jacobian = np.swapaxes(coordinates, 1, 2)[:, None] @ dN
    normal = facet_measure(rule, coordinates[:, list(nodes)])
    return element.shape(xi), dN @ inverse(jacobian)[0], normal


@dataclass(frozen=True)
class InterfaceMass:
    """The mass of the facets that a domain shares with another: rows (F,) of its elements, terms
    (F, A, A) = ∮ N_a N_b dA.

    area : on all ranks [m^(d-1)]; extent : the same, around an axis the length of its section [m]
    """

    rows: np.ndarray
    terms: np.ndarray
    area: float
    extent: float

    @classmethod
    def between(cls, domain: Domain, other: Domain, tags: Iterable[str] = ()) -> InterfaceMass:
        """Return that of a `Domain` with another one on the same mesh, in the reference
        configuration (collective).

        tags : of more facets of the domain, where the other one has nodes of its own
        """
        rows, local = interface_facets(domain, other, tags)
        terms, areas = facet_masses(domain, rows, local)
        nodes = domain.cells[rows[:, None], np.array(domain.element.facets)[local]]
        plane = facet_areas(ELEMENTS[domain.element.name], domain.mesh.X[nodes])
        owned = domain.owned[rows]
        sums = (domain.mesh.comm.allreduce(float(part[owned].sum())) for part in (areas, plane))
        return cls(rows, terms, *sums)

    def add_to(self, values: np.ndarray, alpha: float, chunk: slice, dim: int) -> None:
        """Add α times the terms to the components i < dim of the tangents (E, A, m, A, m) of a
        slice of the elements.
        """
        here = (self.rows >= chunk.start) & (self.rows < chunk.stop)
        for i in range(dim):
            np.add.at(
                values[:, :, i, :, i], self.rows[here] - chunk.start, alpha * self.terms[here]
            )

    def times(self, domain: Domain, field: np.ndarray) -> np.ndarray:
        """Return ∮ N_a field dA on the owned nodes, (n_owned, d), of nodal values (n_local, d)."""
        vectors = np.zeros((*domain.cells.shape, field.shape[1]))
        np.add.at(vectors, self.rows, self.terms @ field[domain.cells[self.rows]])
        return domain.scatter_add(vectors)


class InterfacePressure:
    """What a pressure does to a surface that has moved, beyond what it does in the reference
    configuration.

    A fluid that sees a rigid wall gives forces that keep their direction.  A uniform pressure on
    all sides of a body is nothing but compression; its dead forces on the undeformed outline would
    buckle a slender one.
    """

    def __init__(self, domain: Domain, other: Domain, tags: Iterable[str] = ()) -> None:
        """Prepare the facets of a `Domain` of the fluid, as `InterfaceMass.between` takes them."""
        self._mesh = domain.mesh
        element = domain.element
        rows, local = interface_facets(domain, other, tags)
        self._nodes = domain.cells[rows[:, None], np.array(element.facets)[local]]
        # exact: N_a p times the normal of a flat facet, around an axis times r
        self._rule = Rule.of(element.facet, 3 * element.order + element.axisymmetric)
        self._reference = self._normals(np.zeros((domain.n_local, domain.dim)))

    def _normals(self, displacement):
        x = (self._mesh.X + displacement)[self._nodes]
        return facet_measure(self._rule, x)

    def turned(self, p: np.ndarray, displacement: np.ndarray) -> np.ndarray:
        """Return ∮ N_a p (n da - n dA) on the owned nodes, (n_owned, d) [N], n out of the fluid.

        p (n_local,) [Pa]; displacement (n_local, d) [m]
        """
        forces = np.zeros((self._mesh.n_local, self._mesh.dim))
        change = self._normals(displacement) - self._reference
        np.add.at(
            forces,
            self._nodes,
            pressure_load(self._rule.N, change, p[self._nodes] @ self._rule.N.T),
        )
        return forces[: self._mesh.n_owned]


def interface_facets(
    domain: Domain, other: Domain, tags: Iterable[str] = ()
) -> tuple[np.ndarray, np.ndarray]:
    """Return rows and local numbers, (F,) each, of the facets that a `Domain` shares with another
    one on the same mesh.

    tags : of more facets of the domain, where the other one has nodes of its own
    """
    element = domain.element
    facets = domain.cells[:, element.facet_corners]
    rows, local = np.nonzero((domain.holds & other.holds)[facets].all(axis=2))
    shared = (
        locate_facets(facets[rows, local], other.cells, element)[0] >= 0
        if len(other.cells)
        else np.zeros(len(rows), bool)
    )
    more = [domain.mesh.facets[tag] for tag in tags]
    rows = np.concatenate([rows[shared], *(domain.row_of_cell[tagged.cells] for tagged in more)])
    return rows, np.concatenate([local[shared], *(tagged.local for tagged in more)])


def open_facets(domain: Domain, held: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return rows and local numbers, (F,) each, of the facets around a `Domain` through which it
    may flow.

    held : (n_local, d) bool, prescribed components of the velocity; a facet is closed where all its
    nodes hold its normal
    """
    element = domain.element
    facet = domain.element.facet
    rows, local = boundary_facets(domain.cells, element)
    nodes = cell_facets(domain.cells[rows], element)[np.arange(len(rows)), local]
    normal = facet_normal(facet.gradient(facet.cell.centroid), np.ones(1), domain.mesh.X[nodes])
    held2 = (held[nodes] * normal**2).sum(axis=2)
    is_open = (held2 <= 0.5 * (normal**2).sum(axis=2)).any(axis=1)
    return rows[is_open], local[is_open]


def facet_masses(
    domain: Domain, rows: np.ndarray, local: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return ∮ N_a N_b dA, (F, A, A), and the areas (F,) of facets of a `Domain` in the reference
    configuration.

    rows, local : (F,) their elements and local numbers
    """
    element = domain.element
    facet = domain.element.facet
    rule = Rule.of(facet, 2 * element.order + element.axisymmetric)
    terms = np.zeros((len(rows), element.nodes, element.nodes))
    areas = np.zeros(len(rows))
    for number, nodes in enumerate(element.facets):
        here = np.flatnonzero(local == number)
        coordinates = domain.mesh.X[domain.cells[rows[here]][:, list(nodes)]]
        dA = np.linalg.norm(facet_measure(rule, coordinates), axis=-1)
        areas[here] = dA.sum(axis=1)
        terms[np.ix_(here, nodes, nodes)] = surface_mass(rule.N, dA, np.ones((len(here), 1)))
    return terms, areas


def facet_areas(element: Element, coordinates: np.ndarray) -> np.ndarray:
    """Return the areas of facets with nodes at coordinates (F, Af, d), (F,) [m^(d-1)]."""
    rule = Rule.of(element.facet, 2 * element.order)
    return np.linalg.norm(facet_measure(rule, coordinates), axis=-1).sum(axis=1)


def has_facets(domain: Domain, tags: Iterable[str]) -> bool:
    """Return whether an element of a `Domain` on some rank has a facet with one of the tags
    (collective).
    """
    facets = [domain.mesh.facets[tag].nodes for tag in tags]
    mine = any(
        (locate_facets(nodes, domain.cells, domain.element)[0] >= 0).any() for nodes in facets
    )
    return any(domain.mesh.comm.allgather(mine))


def tags_of(mesh: LocalMesh, row_of_cell: np.ndarray) -> set[str]:
    """Return the set of tags of a `LocalMesh` with a facet on a cell whose row, (cells,), is not
    negative (collective).
    """
    mine = {tag for tag, facets in mesh.facets.items() if (row_of_cell[facets.cells] >= 0).any()}
    return set().union(*mesh.comm.allgather(mine))


def facet_normals(mesh: LocalMesh, nodes: np.ndarray) -> np.ndarray:
    """Return the outward unit normals of facets, nodes (F, Af), at their centroid, (F, d),
    reference configuration.
    """
    facet = mesh.element.facet
    normal = facet_normal(facet.gradient(facet.cell.centroid), np.ones(1), mesh.X[nodes])[:, 0]
    return normal / np.linalg.norm(normal, axis=1, keepdims=True)
