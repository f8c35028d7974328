"""What crosses an interface whose sides have nodes of their own: the solid's displacement, and the fluid's forces back."""

from dataclasses import dataclass

import numpy as np
import scipy.sparse

from ..errors import InputError
from .closest import closest_points, facet_sizes

# Distance of a node from the other side over the facet there, at most: curved sides of straight facets are apart by the facets'
# sagitta, 0.1 of a facet where eight of them make a circle.
GAP = 0.1


@dataclass(frozen=True)
class Pair:
    """Two surfaces that lie on each other: tags of the fluid, tags of the solid, and where the scene says so."""

    fluid: tuple
    solid: tuple
    where: str


class InterfaceTransfer:
    """Consistent interpolation and its transpose between the sides of an interface (Farhat, Lesoinne & Le Tallec 1998).

        u_f = P u_s,   F_s = Pᵀ F_f,   so that F_f·u_f = F_s·u_s

    A row of P holds the shape functions of the solid's facet at the point that is closest to the fluid's node in the reference
    configuration: rows sum to 1, so that the total force stays.  Nodes that both sides share are left as they are; without other
    ones both directions return what they get.

    fluid_nodes, solid_nodes : (n_local,) bool, the nodes of the interface on each side; a shared one is in both
    """

    def __init__(self, mesh, shared, pairs):
        """Project the fluid's nodes on the solid's facets (collective); shared : (n_local,) bool; pairs : `Pair`s, may be none.

        Raises InputError where the sides of a pair are apart.
        """
        self.fluid_nodes = self.solid_nodes = shared
        self._matrix = None
        if not pairs:
            return
        taken = np.concatenate(mesh.comm.allgather(mesh.natural[: mesh.n_owned][shared[: mesh.n_owned]]))
        parts = []
        for pair in pairs:
            parts.append(_interpolation(mesh, pair, taken))
            taken = np.concatenate([taken, parts[-1][0]])
        fluid, columns, weights, solid = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
        self._fluid, self._solid = (_SurfaceNodes(mesh, np.unique(nodes)) for nodes in (fluid, solid))
        entries = self._fluid.rows(np.repeat(fluid, columns.shape[1])), self._solid.rows(columns.ravel())
        shape = len(self._fluid.natural), len(self._solid.natural)
        self._matrix = scipy.sparse.csr_matrix((weights.ravel(), entries), shape=shape)
        self._to_fluid = self._matrix[self._fluid.rows(mesh.natural[self._fluid.local])]
        self._to_solid = self._matrix.T.tocsr()[self._solid.rows(mesh.natural[self._solid.owned])]
        self.fluid_nodes, self.solid_nodes = shared.copy(), shared.copy()
        self.fluid_nodes[self._fluid.local] = self.solid_nodes[self._solid.local] = True

    def to_fluid(self, field):
        """Return a field of the solid (n_local, k) with P times it on the fluid's side of the interface (collective)."""
        if self._matrix is None:
            return field
        extended = field.copy()
        extended[self._fluid.local] = self._to_fluid @ self._solid.gather(field)
        return extended

    def to_solid(self, force):
        """Return forces (n_owned, d) [N] of which those on the fluid's side act on the solid's nodes, by Pᵀ (collective)."""
        if self._matrix is None:
            return force
        moved = force.copy()
        moved[self._fluid.owned] = 0.0
        moved[self._solid.owned] += self._to_solid @ self._fluid.gather(force)
        return moved


class _SurfaceNodes:
    """Nodes of a surface, small enough that every rank knows all their values: no rank depends on what others hold.

    natural (N,) : ascending natural numbers; local, owned : the rows of this rank that are among them, with and without ghosts
    """

    def __init__(self, mesh, natural):
        self.natural, self._comm = natural, mesh.comm
        self.local = np.flatnonzero(np.isin(mesh.natural, natural))
        self.owned = self.local[self.local < mesh.n_owned]
        self._order = np.argsort(np.concatenate(mesh.comm.allgather(mesh.natural[self.owned])))

    def rows(self, natural):
        """Return the positions of nodes among those of the surface."""
        return np.searchsorted(self.natural, natural)

    def gather(self, field):
        """Return the values of a field, (n_owned, k) or longer, in the order of the natural numbers, (N, k) (collective)."""
        return np.concatenate(self._comm.allgather(field[self.owned]))[self._order]


def _interpolation(mesh, pair, taken):
    """Return the fluid's nodes (N,) that are not taken, the solid's (N, Af) and weights (N, Af) of each, all the solid's nodes.

    Natural numbers; every rank has both surfaces and finds the same (collective).
    """
    (fluid, X_fluid), (solid, X_solid) = (_surface(mesh, tags) for tags in (pair.fluid, pair.solid))
    nodes, points = _nodes(fluid, X_fluid)
    facet, weights, distance = closest_points(mesh.element, X_solid, points)
    _require_near(points, distance, facet_sizes(X_solid)[facet], pair.fluid, pair.solid, pair.where)
    solid_nodes, solid_points = _nodes(solid, X_solid)
    back, _, distance = closest_points(mesh.element, X_fluid, solid_points)
    _require_near(solid_points, distance, facet_sizes(X_fluid)[back], pair.solid, pair.fluid, pair.where)
    new = ~np.isin(nodes, taken)
    return nodes[new], solid[facet[new]], weights[new], solid_nodes


def _surface(mesh, tags):
    """Return natural node numbers (F, Af) and coordinates (F, Af, d) of all facets of some tags, in one order (collective)."""
    mine = np.concatenate([mesh.facets[tag].nodes[mesh.facets[tag].owned] for tag in tags])
    nodes, X = (np.concatenate(mesh.comm.allgather(field[mine])) for field in (mesh.natural, mesh.X))
    order = np.lexsort(nodes.T)
    return nodes[order], X[order]


def _nodes(facets, X):
    """Return the nodes of facets (F, Af), ascending, and their coordinates."""
    nodes, first = np.unique(facets, return_index=True)
    return nodes, X.reshape(-1, X.shape[2])[first]


def _require_near(points, distance, size, tags, others, where):
    """Raise InputError where a point of some tags is farther from a facet of the other side than a part GAP of its size."""
    worst = np.argmax(distance / size)
    if distance[worst] > GAP * size[worst]:
        place = ", ".join(f"{x:.6g}" for x in points[worst])
        names = [", ".join(f"'{tag}'" for tag in group) for group in (tags, others)]
        apart = f"a node of {names[0]} at ({place}) m is {distance[worst]:.3g} m away from {names[1]}"
        expected = f"expected at most {GAP:g} of the facet there, {GAP * size[worst]:.3g} m"
        raise InputError(f"{where}: {apart}, {expected}; let both surfaces cover the same interface")
