"""What crosses an interface whose sides have nodes of their own: the solid's displacement, and the
fluid's forces back.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse

from ..errors import InputError
from .closest import closest_points, facet_sizes
from .distribute import LocalMesh
from .domain import Domain
from .essential import Transformation
from .projection import SurfaceProjection
from .surface_nodes import SurfaceNodes, surface_facets

# Distance of a node from the other side over the facet there, at most: curved sides of straight
# facets are apart by the facets' sagitta, 0.1 of a facet where eight of them make a circle.
GAP = 0.1
ROUND_OFF = 1e-9  # of what a row of P has of free nodes where all others are held


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
        self._mesh, self._shared, self._pairs = mesh, shared, pairs
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

    def force_to_fluid(self, force: np.ndarray) -> np.ndarray:
        """Return forces (n_owned, d) [N] of which those on the solid's side act on the fluid's
        nodes, by Qᵀ, Q the projection of the fluid's motion to the solid (collective).

        Constant tractions stay what they are; what is made of others a Robin condition asks for in
        a sweep, but no solution depends on it.
        """
        return self._back.to_solid(force)

    @cached_property
    def _back(self):
        """Return the transfer with the sides exchanged (collective)."""
        pairs = [Pair(pair.solid, pair.fluid, pair.where) for pair in self._pairs]
        return InterfaceTransfer(self._mesh, self._shared, pairs)

    @property
    def follows(self) -> np.ndarray:
        """Return the fluid's nodes that are none of the solid, of which P is the motion, (n_local,)
        bool.
        """
        return self.fluid_nodes & ~self.solid_nodes

    def held(self, held: np.ndarray) -> np.ndarray:
        """Return where components of the solid are held, (n_local, d) bool, with those of the
        fluid's side that depend on no others (collective).
        """
        return np.abs(self.to_fluid((~held).astype(float))) < ROUND_OFF

    def eliminated(
        self, held: np.ndarray, constraints: Transformation | None
    ) -> Transformation | None:
        """Return the constraints of a displacement in a matrix of both sides: u_f = P u_s beside
        those of the solid.

        held : (n_local, d) bool, prescribed displacements; without nodes of their own the solid's
        are all
        """
        return _Eliminated(self._parts, held, constraints) if self._parts else constraints


class _Eliminated:
    """The transformation u = T q of a displacement of which the fluid's side is no unknown: its
    rows are those of P times what the constraints of the solid make of q.
    """

    def __init__(self, parts, held, constraints):
        self._parts = parts
        self._held = held
        self._constraints = constraints

    def transformation(
        self, domain: Domain, m: int
    ) -> tuple[scipy.sparse.csr_matrix, scipy.sparse.csr_matrix]:
        """Return T and the projection onto what it leaves out, for m unknowns on each node of a
        domain (collective).
        """
        T, left_out = self._of_solid(domain, m)
        size = T.shape[0]
        kept = np.ones(size)
        rows = [np.zeros(0, dtype=int)]
        motion = [scipy.sparse.csr_matrix((0, T.shape[1]))]
        for part in self._parts:
            rows.append(_unknowns(domain, part.fluid.owned, m))
            motion.append(part.matrix(domain.dim) @ self._surface(T, domain, part.solid, m))
        followers = np.concatenate(rows)
        kept[followers] = 0.0
        ones = np.ones(len(followers))
        spread = scipy.sparse.csr_matrix(
            (ones, (followers, np.arange(len(followers)))), shape=(size, len(followers))
        )
        own = scipy.sparse.csr_matrix(
            (ones, (followers, m * domain.first + followers)), shape=T.shape
        )
        T = (scipy.sparse.diags(kept) @ T + spread @ scipy.sparse.vstack(motion)).tocsr()
        T.eliminate_zeros()
        return T, (left_out + own).tocsr()

    def _of_solid(self, domain, m):
        """Return the transformation without the fluid's side (collective)."""
        if self._constraints is not None:
            return self._constraints.transformation(domain, m)
        size = m * len(domain.nodes)
        columns = m * domain.mesh.comm.allreduce(len(domain.nodes))
        T = scipy.sparse.eye(size, columns, m * domain.first, format="csr")
        return T, scipy.sparse.csr_matrix(T.shape)

    def _surface(self, T, domain, nodes, m):
        """Return the rows of T of the free displacements of a surface, node by node, (N d, columns)
        (collective).
        """
        free = (~self._held[nodes.owned]).astype(float).ravel()
        mine = scipy.sparse.diags(free) @ T[_unknowns(domain, nodes.owned, m)]
        return nodes.in_order(scipy.sparse.vstack(domain.mesh.comm.allgather(mine)), domain.dim)


def _unknowns(domain, owned, m):
    """Return the rows of the displacement of owned nodes of a domain among those of this rank."""
    nodes = np.searchsorted(domain.nodes, owned)
    return (m * nodes[:, None] + np.arange(domain.dim)).ravel()


class _Part:
    """The two sides of one pair, which every rank has and projects alike; fluid, solid :
    `SurfaceNodes`.
    """

    def __init__(self, mesh, pair, taken):
        (fluid, X_fluid), (solid, X_solid) = (
            surface_facets(mesh, tags) for tags in (pair.fluid, pair.solid)
        )
        _require_together(mesh.element, (X_fluid, X_solid), pair)
        nodes = np.unique(fluid)
        self._new = ~np.isin(nodes, taken)
        self.fluid = SurfaceNodes(mesh, nodes[self._new])
        self.solid = SurfaceNodes(mesh, np.unique(solid))
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

    def matrix(self, dim):
        """Return the rows of P ⊗ 1 of the owned nodes that are not taken, (n dim, N_s dim)."""
        P = self._projection.matrix()[self._new]
        mine = P[self.fluid.rows[: len(self.fluid.owned)]]
        return scipy.sparse.kron(mine, scipy.sparse.identity(dim), format="csr")


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
