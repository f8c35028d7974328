"""The force of a free fluid on a surface: the residual on its nodes, split where other boundaries have a part in it."""

from typing import NamedTuple

import numpy as np

from ..fem.boundary import facet_areas, trace
from ..fem.essential import owned_nodes
from ..kernels.surface import traction_load
from ..mesh.topology import boundary_facets, cell_facets, locate_facets


class State(NamedTuple):
    """What a force is found from, at one time t.

    residual (n_owned, d) [N] of `FluidPhase.boundary_force`;
    v, c = v - v_m (n_local, d), p (n_local,); u (n_local, d) of the mesh
    """

    residual: np.ndarray
    v: np.ndarray
    c: np.ndarray
    p: np.ndarray
    u: np.ndarray
    t: float


class SurfaceForce:
    """The force on tagged surfaces from the residual on their nodes, which has no error of recovered stresses.

    On the rim the residual of a node holds what other boundaries feel, too: it is -Σ ∮ N σn dA over
    all facets of the node.  Facets whose traction is given have a known part.  Each of the others
    has the integral of the stress in the element behind it, and of what the residual has beyond all
    these parts a share by its area.  So the forces on all boundaries add up to the whole residual,
    and a stress that the elements can represent is split exactly.
    """

    def __init__(self, setup, tags):
        """Take the `FluidSetup` and the tags of the surfaces."""
        self._setup, self._domain = setup, setup.domain
        self._nodes = np.unique(np.concatenate([owned_nodes(setup.domain.mesh, tag) for tag in tags]))
        self._find_rim(tags)

    def _find_rim(self, tags):
        """Set the nodes that other boundaries share, and the facets around them.

        A rank has all elements around its nodes.
        """
        domain = self._domain
        rows, local = boundary_facets(domain.cells, domain.element)
        facets = cell_facets(domain.cells[rows], domain.element)[np.arange(len(rows)), local]
        self._own = self._tagged(tags)
        own = self._own[rows, local]
        rim = np.intersect1d(facets[own], facets[~own])
        self._rim = rim[rim < domain.n_owned]
        here = np.isin(facets, self._rim).any(axis=1)
        self._rows, self._local, self._facets = rows[here], local[here], facets[here]
        self._held = self._prescribed()

    def _located(self, nodes):
        """Return which facets, nodes (F, Af), have an element of the fluid, its row, the local number."""
        rows, local = locate_facets(nodes, self._domain.cells, self._domain.element)
        found = np.flatnonzero(rows >= 0)
        return found, rows[found], local[found]

    def _tagged(self, tags):
        """Return which facets of the elements have one of the tags, (E, facets) bool."""
        tagged = np.zeros((self._domain.n_cells, len(self._domain.element.facets)), dtype=bool)
        for tag in tags:
            _, rows, local = self._located(self._domain.mesh.facets[tag].nodes)
            tagged[rows, local] = True
        return tagged

    def _prescribed(self):
        """Return on which facets of the elements a component of the velocity is prescribed, (E, facets, d) bool.

        On the rest of the boundary its traction is given, or zero.
        """
        held = np.zeros((self._domain.n_cells, len(self._domain.element.facets), self._domain.dim), dtype=bool)
        held[self._rows, self._local] = self._setup.no_slip[self._facets].all(axis=1)[:, None]
        for condition in self._setup.velocity.conditions:
            held[..., condition.given.component] |= self._tagged([condition.given.tag])
        return held

    def on_rank(self, state):
        """Return the sum over the nodes of this rank, (d,) [N]."""
        force = state.residual[self._nodes]
        if len(self._rim):
            force[np.searchsorted(self._nodes, self._rim)] = self._split(state)
        return force.sum(axis=0)

    def _split(self, state):
        """Return the part of the surface in the residual on the rim, (R, d) [N]."""
        held = self._held[self._rows, self._local][:, None]
        tractions = np.where(held, self._tractions(state), 0.0)
        areas = np.where(held, self._areas(state.u)[:, None, None], np.zeros_like(tractions))
        own = self._own[self._rows, self._local]
        parts, shares = (
            [self._on_rim(self._facets[chosen], values[chosen]) for chosen in (own, ~own)] for values in (tractions, areas)
        )
        self._subtract_loads(state, parts)
        total = sum(shares)
        fraction = np.divide(shares[0], total, out=np.zeros_like(total), where=total > 0)
        return parts[0] + fraction * (state.residual[self._rim] - sum(parts))

    def _on_rim(self, nodes, values):
        """Return the sums on the rim, (R, d), of values (F, Af, d) at nodes (F, Af)."""
        here = np.isin(nodes, self._rim)
        sums = np.zeros((len(self._rim), values.shape[2]))
        np.add.at(sums, np.searchsorted(self._rim, nodes[here]), values[here])
        return sums

    def _tractions(self, state):
        """Return -∮ N_a σn dA of the stress in the elements behind the facets, (F, Af, d) [N]."""
        domain, parts = self._domain, np.empty((*self._facets.shape, self._domain.dim))
        mu = np.empty(domain.n_cells)
        for region, span in domain.region_slices.items():
            mu[span] = self._setup.materials[region].viscosity
        for number, nodes in enumerate(domain.element.facets):
            here = np.flatnonzero(self._local == number)
            rows = self._rows[here]
            x, v, p = (domain.gather(field, rows) for field in (domain.mesh.X + state.u, state.v, state.p))
            loads = traction_load(*trace(domain.element, nodes, x), v, p, mu[rows])
            parts[here] = -loads[:, list(nodes)]
        return parts

    def _areas(self, u):
        """Return the areas of the facets, (F,) [m^(d-1)]."""
        return facet_areas(self._domain.element, (self._domain.mesh.X + u)[self._facets])

    def _subtract_loads(self, state, parts):
        """Subtract the given tractions from the parts of the surface and of the other facets, (R, d) each, in place."""
        for load in self._setup.loads:
            vectors = np.zeros((*load.nodes.shape, self._domain.dim))
            for component, values in load.on_facets(state.t):
                vectors[..., component] = values
            self._add_where_free(parts, load.nodes, -vectors)
        for boundary in self._setup.open_boundaries:
            self._add_where_free(parts, boundary.nodes, boundary.on_facets(state.u, state.v, state.c))

    def _add_where_free(self, parts, nodes, vectors):
        """Add vectors (F, Af, d) on facets, nodes (F, Af), to their part where no velocity is prescribed."""
        found, rows, local = self._located(nodes)
        own, free = self._own[rows, local], np.where(self._held[rows, local][:, None], 0.0, vectors[found])
        for part, chosen in zip(parts, (own, ~own), strict=True):
            part += self._on_rim(nodes[found][chosen], free[chosen])
