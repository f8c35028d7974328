"""Boundary data on the facets of a rank: surface loads, open boundaries, interfaces."""

from dataclasses import dataclass

import numpy as np

from ..kernels.surface import (
    backflow_residual,
    backflow_tangent,
    facet_normal,
    pressure_load,
    surface_load,
    surface_mass,
    weak_zero,
)
from ..mesh.topology import boundary_facets, cell_facets, locate_facets
from ..tensors import inverse
from .geometry import Rule


class SurfaceLoad:
    """A vector of nodal loads ∮ N_a t dA from expressions per component on one tagged surface of
    the reference configuration.
    """

    def __init__(self, mesh, tag, expressions):
        """Prepare the facets; expressions : dict component -> expression(t, x), units of the load
        per reference area.
        """
        facet = mesh.element.facet
        self._rule = Rule.of(facet, 2 * mesh.element.order + 1)
        self.nodes = mesh.facets[tag].nodes
        coordinates = mesh.X[self.nodes]
        self._dA = np.linalg.norm(
            facet_normal(self._rule.dN, self._rule.weights, coordinates), axis=-1
        )
        self._points = (self._rule.N @ coordinates).reshape(-1, mesh.dim)
        self._expressions = expressions
        self._n_owned = mesh.n_owned

    def add_to(self, loads, t):
        """Add the loads at time t to a field (n_owned, k)."""
        owned = self.nodes < self._n_owned
        for component, nodal in self.on_facets(t):
            loads[:, component] += np.bincount(
                self.nodes[owned], weights=nodal[owned], minlength=self._n_owned
            )

    def on_facets(self, t):
        """Yield (component, loads at time t on the nodes of every facet, (F, Af))."""
        for component, expression in self._expressions.items():
            values = expression(t, self._points).reshape(self._dA.shape)
            yield component, surface_load(self._rule.N, self._dA, values[..., None])[..., 0]


class OpenBoundary:
    """Facets of a free fluid on which what flows in brings no kinetic energy along:
    `kernels.surface.backflow_residual`.
    """

    def __init__(self, domain, tag, beta, density):
        """Prepare the facets of a tag; beta [-], density : region -> ρ_f [kg/m³]."""
        mesh = domain.mesh
        facets = domain.mesh.facets[tag]
        behind = np.flatnonzero(domain.row_of_cell[facets.cells] >= 0)
        cells = facets.cells[behind]
        self._rows = domain.row_of_cell[cells]
        self._local = np.array(domain.element.facets)[facets.local[behind]]
        self.nodes = domain.cells[self._rows[:, None], self._local]
        self._beta = beta
        self._rho = np.array([density[name] for name in mesh.regions])[
            mesh.cell_region[cells], None
        ]
        self._rule = Rule.of(
            mesh.element.facet, 3 * mesh.element.order
        )  # exact on flat facets while all of one flows in
        self._mesh = mesh

    def add_to(self, loads, displacement, v, c):
        """Add the residual's traction to a field (n_owned, d); displacement of the mesh, v and c
        (n_local, d).
        """
        vectors = self.on_facets(displacement, v, c)
        owned = self.nodes < self._mesh.n_owned
        np.add.at(loads, self.nodes[owned], vectors[owned])

    def on_facets(self, displacement, v, c):
        """Return the residual's traction on the nodes of every facet, (F, Af, d)."""
        here = slice(None)
        return backflow_residual(*self._data(here, displacement), *self._traces(here, v, c))

    def add_tangent(self, K, chunk, displacement, v, c):
        """Add the derivative by v to the tangents (E, A, m, A, m) of a slice of the elements."""
        here = np.flatnonzero((self._rows >= chunk.start) & (self._rows < chunk.stop))
        tangent = backflow_tangent(*self._data(here, displacement), *self._traces(here, v, c))
        local = self._local[here]
        i = np.arange(self._mesh.dim)
        rows = (self._rows[here] - chunk.start)[:, None, None, None, None]
        np.add.at(
            K,
            (
                rows,
                local[:, :, None, None, None],
                i[:, None, None],
                local[:, None, None, :, None],
                i,
            ),
            tangent,
        )

    def _data(self, here, displacement):
        """Return N, normals, ρ and β of some facets."""
        nodes = self.nodes[here]
        normal = facet_normal(
            self._rule.dN, self._rule.weights, self._mesh.X[nodes] + displacement[nodes]
        )
        return self._rule.N, normal, self._rho[here], self._beta

    def _traces(self, here, *fields):
        """Return nodal values (n_local, d) on the nodes of some facets, (F, A, d) each."""
        return [field[self.nodes[here]] for field in fields]


# Penalty of Nitsche's method over the bound of the trace inequality, `Element.trace_constant`: on a
# simplex of order k (k + 1)(k + d)/d A/V.  The exact one is n·M⁻¹n of the mass behind
# the surface, 2√3/h on a chain of linear elements (bound 4/h), more at corners.  Measured on a
# closed block, both orders, k_f = 1e-2 and 1e-5: at most 27 … 100 Aitken sweeps with 0.6, 51 with
# 0.87, 16 with 1.1, 15 with 1.2, 16 with 1.4.
PENALTY = 1.2


def weak_zero_on(domain, tags):
    """Return rows (F,) of elements of the domain and `kernels.surface.weak_zero` (F, A, A) on the
    facets of the tags.

    Reference configuration; the penalty is that of the mass behind the surface.
    """
    mesh = domain.mesh
    element = domain.element
    facets = [mesh.facets[tag] for tag in tags]
    cells = np.concatenate([f.cells for f in facets] or [np.zeros(0, dtype=int)])
    local = np.concatenate([f.local for f in facets] or [np.zeros(0, dtype=int)])
    rows = domain.row_of_cell[cells]
    terms = np.empty((len(cells), element.nodes, element.nodes))
    bound = PENALTY * element.trace_constant
    for number, nodes in enumerate(element.facets):
        here = local == number
        N, G, normal = trace(domain.element, nodes, domain.mesh.X[domain.cells[rows[here]]])
        area = np.linalg.norm(normal, axis=-1).sum(axis=1)
        terms[here] = weak_zero(
            N, G, normal, bound * area / domain.reference.dV[rows[here]].sum(axis=1)
        )
    return rows, terms


def trace(element, nodes, coordinates):
    """Return N (Q, A), G (F, Q, A, d) and normals times dA (F, Q, d) of elements on the facet with
    the given local nodes.

    coordinates : (F, A, d) of the nodes of the elements
    """
    facet = element.facet
    points, weights = facet.cell.quadrature(2 * element.order)
    corners = list(nodes[: element.cell.facet_vertices])
    xi = facet.cell.vertex_functions(points) @ element.node_coordinates[corners]
    dN = element.gradient(xi)
    jacobian = np.swapaxes(coordinates, 1, 2)[:, None] @ dN
    normal = facet_normal(facet.gradient(points), weights, coordinates[:, list(nodes)])
    return element.shape(xi), dN @ inverse(jacobian)[0], normal


@dataclass(frozen=True)
class InterfaceMass:
    """The mass of the facets that a domain shares with another: rows (F,) of its elements, terms
    (F, A, A) = ∮ N_a N_b dA.

    area : on all ranks [m^(d-1)]
    """

    rows: np.ndarray
    terms: np.ndarray
    area: float

    @classmethod
    def between(cls, domain, other, tags=()):
        """Return that of a `Domain` with another one on the same mesh, in the reference
        configuration (collective).

        tags : of more facets of the domain, where the other one has nodes of its own
        """
        rows, local = interface_facets(domain, other, tags)
        terms, areas = facet_masses(domain, rows, local)
        return cls(rows, terms, domain.mesh.comm.allreduce(float(areas[domain.owned[rows]].sum())))

    def add_to(self, values, alpha, chunk, dim):
        """Add α times the terms to the components i < dim of the tangents (E, A, m, A, m) of a
        slice of the elements.
        """
        here = (self.rows >= chunk.start) & (self.rows < chunk.stop)
        for i in range(dim):
            np.add.at(
                values[:, :, i, :, i], self.rows[here] - chunk.start, alpha * self.terms[here]
            )

    def times(self, domain, field):
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

    def __init__(self, domain, other, tags=()):
        """Prepare the facets of a `Domain` of the fluid, as `InterfaceMass.between` takes them."""
        self._mesh = domain.mesh
        element = domain.element
        rows, local = interface_facets(domain, other, tags)
        self._nodes = domain.cells[rows[:, None], np.array(element.facets)[local]]
        self._rule = Rule.of(
            element.facet, 3 * element.order
        )  # exact: N_a p times the normal of a flat facet
        self._reference = self._normals(np.zeros((domain.n_local, domain.dim)))

    def _normals(self, displacement):
        x = (self._mesh.X + displacement)[self._nodes]
        return facet_normal(self._rule.dN, self._rule.weights, x)

    def turned(self, p, displacement):
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


def interface_facets(domain, other, tags=()):
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


def open_facets(domain, held):
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


def facet_masses(domain, rows, local):
    """Return ∮ N_a N_b dA, (F, A, A), and the areas (F,) of facets of a `Domain` in the reference
    configuration.

    rows, local : (F,) their elements and local numbers
    """
    element = domain.element
    facet = domain.element.facet
    rule = Rule.of(facet, 2 * element.order)
    terms = np.zeros((len(rows), element.nodes, element.nodes))
    areas = np.zeros(len(rows))
    for number, nodes in enumerate(element.facets):
        here = np.flatnonzero(local == number)
        coordinates = domain.mesh.X[domain.cells[rows[here]][:, list(nodes)]]
        dA = np.linalg.norm(facet_normal(rule.dN, rule.weights, coordinates), axis=-1)
        areas[here] = dA.sum(axis=1)
        terms[np.ix_(here, nodes, nodes)] = surface_mass(rule.N, dA, np.ones((len(here), 1)))
    return terms, areas


def facet_areas(element, coordinates):
    """Return the areas of facets with nodes at coordinates (F, Af, d), (F,) [m^(d-1)]."""
    rule = Rule.of(element.facet, 2 * element.order)
    return np.linalg.norm(facet_normal(rule.dN, rule.weights, coordinates), axis=-1).sum(axis=1)


def has_facets(domain, tags):
    """Return whether an element of a `Domain` on some rank has a facet with one of the tags
    (collective).
    """
    facets = [domain.mesh.facets[tag].nodes for tag in tags]
    mine = any(
        (locate_facets(nodes, domain.cells, domain.element)[0] >= 0).any() for nodes in facets
    )
    return any(domain.mesh.comm.allgather(mine))


def tags_of(mesh, row_of_cell):
    """Return the set of tags of a `LocalMesh` with a facet on a cell whose row, (cells,), is not
    negative (collective).
    """
    mine = {tag for tag, facets in mesh.facets.items() if (row_of_cell[facets.cells] >= 0).any()}
    return set().union(*mesh.comm.allgather(mine))


def facet_normals(mesh, nodes):
    """Return the outward unit normals of facets, nodes (F, Af), at their centroid, (F, d),
    reference configuration.
    """
    facet = mesh.element.facet
    normal = facet_normal(facet.gradient(facet.cell.centroid), np.ones(1), mesh.X[nodes])[:, 0]
    return normal / np.linalg.norm(normal, axis=1, keepdims=True)
