"""The force of a phase on a surface: the residual on its nodes, split where others have a part in
it.
"""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..fem.boundary import facet_areas, trace
from ..fem.geometry import hoop_functions
from ..kernels.solid import stress_load
from ..kernels.surface import traction_load
from ..mesh.topology import boundary_facets, cell_facets, locate_facets
from .internal import InternalVariables
from .setup import FreeFluidSetup, PhaseSetup


class State(NamedTuple):
    """What a force is found from, at one time t.

    residual (n_owned, k) of `FreeFluid.force` or `SolidPhase.force` [N], of a porous medium the sum
    of both phases, or `PoreFluid.outflow` [m³/s]; u (n_local, d) [m] of the mesh or the solid; of a
    fluid v, c = v - v_m (n_local, d), p (n_local,);
    given : facets, nodes (F, Af), and vectors (F, Af, k) of the conditions on surfaces;
    internal : internal variables of the solid
    """

    residual: np.ndarray
    t: float
    u: np.ndarray
    v: np.ndarray | None = None
    c: np.ndarray | None = None
    p: np.ndarray | None = None
    given: tuple[tuple[np.ndarray, np.ndarray], ...] = ()
    internal: InternalVariables | None = None


class SurfaceForce:
    """The force on some facets from the residual on their nodes, which has no error of recovered
    stresses.

    On the rim the residual of a node holds what other boundaries feel, too: it is -Σ ∮ N σn dA over
    all facets of the node.  Facets whose traction is given have a known part.  Each of the others
    has the integral of the stress in the element behind it, and of what the residual has beyond all
    these parts a share by its area.  So the forces on all boundaries add up to the whole residual,
    and a stress that the elements can represent is split exactly.  A phase says what its stress is.
    """

    @property
    def _components(self):
        return self._domain.dim

    def __init__(self, setup: PhaseSetup, surfaces: Sequence[np.ndarray]) -> None:
        """Take the `PhaseSetup` and the facets of the surfaces, each (F, Af) nodes."""
        self._setup = setup
        self._domain = setup.domain
        nodes = np.unique(np.concatenate([facets.ravel() for facets in surfaces]))
        self._nodes = nodes[nodes < self._domain.n_owned]
        self._find_rim(surfaces)

    @classmethod
    def on(cls, setup: PhaseSetup, tags: Iterable[str], *more: Any) -> Any:
        """Return that on tagged surfaces; more : what else the class takes."""
        return cls(setup, [setup.domain.mesh.facets[tag].nodes for tag in tags], *more)

    def _find_rim(self, surfaces):
        """Set the nodes that other boundaries share, and the facets around them.

        A rank has all elements around its nodes.
        """
        domain = self._domain
        rows, local = boundary_facets(domain.cells, domain.element)
        facets = cell_facets(domain.cells[rows], domain.element)[np.arange(len(rows)), local]
        self._own = self._marked(surfaces)
        own = self._own[rows, local]
        rim = np.intersect1d(facets[own], facets[~own])
        self._rim = rim[rim < domain.n_owned]
        here = np.isin(facets, self._rim).any(axis=1)
        self._rows = rows[here]
        self._local = local[here]
        self._facets = facets[here]
        self._held = self._prescribed()

    def _located(self, nodes):
        """Return which facets, nodes (F, Af), have an element of the phase, its row, the local
        number.
        """
        rows, local = locate_facets(nodes, self._domain.cells, self._domain.element)
        found = np.flatnonzero(rows >= 0)
        return found, rows[found], local[found]

    def _marked(self, surfaces):
        """Return which facets of the elements are those of surfaces, each (F, Af) nodes, (E,
        facets) bool.
        """
        marked = np.zeros((self._domain.n_cells, len(self._domain.element.facets)), dtype=bool)
        for facets in surfaces:
            _, rows, local = self._located(facets)
            marked[rows, local] = True
        return marked

    def _prescribed(self):
        """Return on which facets of the elements the field is prescribed, (E, facets, k) bool.

        On the rest of the boundary the traction is given, or zero.
        """
        shape = self._domain.n_cells, len(self._domain.element.facets), self._components
        held = np.zeros(shape, dtype=bool)
        essential = self._essential
        places = [(c.given.tag, [c.given.component]) for c in essential.conditions]
        if essential.constraints is not None:
            places += essential.constraints.surfaces
        for tag, components in places:
            facets = self._domain.mesh.facets[tag].nodes
            held[..., components] |= self._marked([facets])[..., None]
        return held

    def on_rank(self, state: State) -> np.ndarray:
        """Return the sum over the nodes of this rank, (k,) [N]."""
        force = state.residual[self._nodes]
        if len(self._rim):
            force[np.searchsorted(self._nodes, self._rim)] = self._split(state)
        return force.sum(axis=0)

    def of_others(self, state: State) -> np.ndarray:
        """Return what other boundaries have in the residual on the surface beside given tractions,
        (n_owned, d) [N].
        """
        others = np.zeros_like(state.residual)
        if len(self._rim):
            given = [np.zeros((len(self._rim), self._components)) for _ in range(2)]
            self._add_loads(state, given)
            others[self._rim] = state.residual[self._rim] - self._split(state) - given[1]
        return others

    def _split(self, state):
        """Return the part of the surface in the residual on the rim, (R, k) [N]."""
        held = self._held[self._rows, self._local][:, None]
        tractions = np.where(held, self._tractions(state), 0.0)
        areas = np.where(held, self._areas(state)[:, None, None], np.zeros_like(tractions))
        own = self._own[self._rows, self._local]
        parts, shares = (
            [self._on_rim(self._facets[chosen], values[chosen]) for chosen in (own, ~own)]
            for values in (tractions, areas)
        )
        self._add_loads(state, parts)
        total = sum(shares)
        fraction = np.divide(shares[0], total, out=np.zeros_like(total), where=total > 0)
        return parts[0] + fraction * (state.residual[self._rim] - sum(parts))

    def _on_rim(self, nodes, values):
        """Return the sums on the rim, (R, k), of values (F, Af, k) at nodes (F, Af)."""
        here = np.isin(nodes, self._rim)
        sums = np.zeros((len(self._rim), values.shape[2]))
        np.add.at(sums, np.searchsorted(self._rim, nodes[here]), values[here])
        return sums

    def _tractions(self, state):
        """Return -∮ N_a σn dA of the stress in the elements behind the facets, (F, Af, k) [N]."""
        domain = self._domain
        parts = np.empty((*self._facets.shape, self._components))
        region = np.empty(domain.n_cells, dtype=int)
        for i, span in enumerate(domain.region_slices.values()):
            region[span] = i
        for i, name in enumerate(domain.region_slices):
            for number, nodes in enumerate(domain.element.facets):
                here = np.flatnonzero((self._local == number) & (region[self._rows] == i))
                rows = self._rows[here]
                loads = self._loads_of_stress(nodes, self._setup.material(name, rows), state, rows)
                parts[here] = -loads[:, list(nodes)]
        return parts

    def _trace(self, nodes, positions, rows):
        """Return N, G and normals of `fem.boundary.trace` on the facet of elements with the given
        local nodes.
        """
        return trace(self._domain.element, nodes, self._domain.gather(positions, rows))

    def _areas(self, state):
        """Return the areas of the facets, (F,) [m^(d-1)]."""
        return facet_areas(self._domain.element, self._positions(state)[self._facets])

    def _add_loads(self, state, parts):
        """Add the given tractions to the parts, own and others, (R, k) each, in place."""
        for nodes, vectors in state.given:
            self._add_where_free(parts, nodes, vectors)

    def _add_where_free(self, parts, nodes, vectors):
        """Add vectors (F, Af, k) on facets, nodes (F, Af), to their part where nothing is
        prescribed.
        """
        found, rows, local = self._located(nodes)
        own = self._own[rows, local]
        free = np.where(self._held[rows, local][:, None], 0.0, vectors[found])
        for part, chosen in zip(parts, (own, ~own), strict=True):
            part += self._on_rim(nodes[found][chosen], free[chosen])


class FluidForce(SurfaceForce):
    """The force of a free fluid, whose stress is that on the moved mesh."""

    @classmethod
    def on_interface(cls, setup: FreeFluidSetup) -> "FluidForce":
        """Return that on the interface with a solid."""
        cells = setup.domain.cells
        element = setup.domain.element
        rows, local = boundary_facets(cells, element)
        facets = cell_facets(cells[rows], element)[np.arange(len(rows)), local]
        return cls(setup, [facets[setup.no_slip[facets].all(axis=1)]])

    @property
    def _essential(self):
        return self._setup.velocity

    def _prescribed(self):
        held = super()._prescribed()
        held[self._rows, self._local] |= self._setup.no_slip[self._facets].all(axis=1)[:, None]
        return held

    def _positions(self, state):
        return self._domain.mesh.X + state.u

    def _loads_of_stress(self, nodes, material, state, rows):
        surface = self._trace(nodes, self._positions(state), rows)
        v = self._domain.gather(state.v, rows)
        p = self._domain.gather(state.p, rows)
        return traction_load(*surface, v, p, material.viscosity)


class SolidForce(SurfaceForce):
    """The force of a solid on what holds it, minus the reaction; its stress is that of the
    reference.

    The force of a fluid on it is part of the residual.
    """

    @property
    def _essential(self):
        return self._setup.dirichlet

    def _positions(self, state):
        return self._domain.mesh.X

    def _loads_of_stress(self, nodes, material, state, rows):
        domain = self._domain
        X = domain.coordinates(rows)
        surface = N, G, _ = trace(domain.element, nodes, X)
        hoop = None
        if domain.element.axisymmetric:
            r = X[..., 0] @ N.T
            hoop = hoop_functions(N, G, r)
        law = material.elastic
        if state.internal is not None:
            law = state.internal.law_at(law, rows, N)
        return stress_load(*surface, law, domain.displacement(state.u, rows), hoop)
