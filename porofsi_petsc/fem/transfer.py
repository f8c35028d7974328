"""What crosses an interface whose sides have nodes of their own: the solid's displacement, and the
fluid's forces back.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from .closest import closest_points, facet_sizes
from .distribute import LocalMesh
from .projection import SurfaceProjection

# Distance of a node from the other side over the facet there, at most: curved sides of straight
# facets are apart by the facets' sagitta, 0.1 of a facet where eight of them make a circle.
GAP = 0.1


@dataclass(frozen=True)
class Pair:
    """Two surfaces that lie on each other: tags of the fluid, tags of the solid, and where the
    scene says so.
    """

    fluid: tuple
    solid: tuple
    where: str


class InterfaceTransfer:
    """L2 projection between the sides of an interface, and its transpose for the forces.

        ∮ N_a u_f dA = ∮ N_a u_s dA  for the shape functions N_a of the fluid's side:   u_f = P u_s,
        F_s = Pᵀ F_f

    so that F_f·u_f = F_s·u_s; P reproduces what both sides can represent, constants and linear
    fields at least: the total force and its moment stay (Farhat, Lesoinne & Le Tallec, CMAME 157
    (1998) 95; Bernardi, Maday & Patera 1994).  Pᵀ spreads the traction of the fluid, M⁻¹ F_f, over
    the solid's nodes, however fine they are.  Nodes that both sides share are left as they are;
    without other ones both directions return what they get.

    fluid_nodes, solid_nodes : (n_local,) bool, the nodes of the interface on each side; a shared
    one is in both
    """

    def __init__(self, mesh: LocalMesh, shared: np.ndarray, pairs: Sequence[Pair]) -> None:
        """Make the projections (collective); shared : (n_local,) bool; pairs : `Pair`s, may be
        none.

        Raises InputError where the sides of a pair are apart.
        """
        self.fluid_nodes = shared.copy()
        self.solid_nodes = shared.copy()
        self._parts = []
        if pairs:
            taken = np.concatenate(
                mesh.comm.allgather(mesh.natural[: mesh.n_owned][shared[: mesh.n_owned]])
            )
        for pair in pairs:
            part = _Part(mesh, pair, taken)
            taken = np.concatenate([taken, part.fluid.natural])
            self.fluid_nodes[part.fluid.local] = self.solid_nodes[part.solid.local] = True
            self._parts.append(part)

    def to_fluid(self, field: np.ndarray) -> np.ndarray:
        """Return a field of the solid (n_local, k) with P times it on the fluid's side of the
        interface (collective).
        """
        extended = field.copy() if self._parts else field
        for part in self._parts:
            extended[part.fluid.local] = part.to_fluid(part.solid.gather(field))[part.fluid.rows]
        return extended

    def to_solid(self, force: np.ndarray) -> np.ndarray:
        """Return forces (n_owned, d) [N] of which those on the fluid's side act on the solid's
        nodes, by Pᵀ (collective).
        """
        moved = force.copy() if self._parts else force
        for part in self._parts:
            moved[part.fluid.owned] = 0.0
            spread = part.to_solid(part.fluid.gather(force))
            moved[part.solid.owned] += spread[part.solid.rows[: len(part.solid.owned)]]
        return moved


class _Part:
    """The two sides of one pair, which every rank has and projects alike; fluid, solid :
    `_SurfaceNodes`.
    """

    def __init__(self, mesh, pair, taken):
        (fluid, X_fluid), (solid, X_solid) = (
            _surface(mesh, tags) for tags in (pair.fluid, pair.solid)
        )
        _require_together(mesh.element, (X_fluid, X_solid), pair)
        nodes = np.unique(fluid)
        self._new = ~np.isin(nodes, taken)
        self.fluid = _SurfaceNodes(mesh, nodes[self._new])
        self.solid = _SurfaceNodes(mesh, np.unique(solid))
        facets = np.searchsorted(nodes, fluid), np.searchsorted(self.solid.natural, solid)
        self._projection = SurfaceProjection(mesh.element, facets, (X_fluid, X_solid))

    def to_fluid(self, values):
        """Return P times values (N_s, k) on the nodes that are not taken."""
        return self._projection.project(values)[self._new]

    def to_solid(self, forces):
        """Return Pᵀ times forces (N_f, d) on the nodes that are not taken."""
        whole = np.zeros((len(self._new), forces.shape[1]))
        whole[self._new] = forces
        return self._projection.transposed(whole)


class _SurfaceNodes:
    """Nodes of a surface, few enough that every rank knows all their values: what it computes does
    not depend on the others.

    natural (N,) : ascending natural numbers; local, owned : the nodes of this rank among them, with
    and without ghosts;
    rows : the positions of `local` in `natural`
    """

    def __init__(self, mesh, natural):
        self.natural = natural
        self._comm = mesh.comm
        self.local = np.flatnonzero(np.isin(mesh.natural, natural))
        self.owned = self.local[self.local < mesh.n_owned]
        self.rows = np.searchsorted(natural, mesh.natural[self.local])
        self._order = np.argsort(np.concatenate(mesh.comm.allgather(mesh.natural[self.owned])))

    def gather(self, field):
        """Return the values of a field, (n_owned, k) or longer, in the order of the natural
        numbers, (N, k) (collective).
        """
        return np.concatenate(self._comm.allgather(field[self.owned]))[self._order]


def _surface(mesh, tags):
    """Return natural node numbers (F, Af) and coordinates (F, Af, d) of all facets of some tags, in
    one order (collective).
    """
    mine = np.concatenate([mesh.facets[tag].nodes[mesh.facets[tag].owned] for tag in tags])
    nodes, X = (
        np.concatenate(mesh.comm.allgather(field[mine])) for field in (mesh.natural, mesh.X)
    )
    order = np.lexsort(nodes.T)
    return nodes[order], X[order]


def _require_together(element, sides, pair):
    """Raise InputError where a node of one side, (F, Af, d) each, is farther from the other than
    GAP times the facet there.
    """
    for near, far, tags, others in ((0, 1, pair.fluid, pair.solid), (1, 0, pair.solid, pair.fluid)):
        points = sides[near].reshape(-1, element.dim)
        facet, _, distance = closest_points(element, sides[far], points)
        size = facet_sizes(sides[far])[facet]
        worst = np.argmax(distance / size)
        if distance[worst] > GAP * size[worst]:
            place = ", ".join(f"{x:.6g}" for x in points[worst])
            names = [", ".join(f"'{tag}'" for tag in group) for group in (tags, others)]
            apart = (
                f"a node of {names[0]} at ({place}) m is {distance[worst]:.3g} m away from"
                f" {names[1]}"
            )
            expected = f"expected at most {GAP:g} of the facet there, {GAP * size[worst]:.3g} m"
            raise InputError(
                f"{pair.where}: {apart}, {expected}; let both surfaces cover the same interface"
            )
