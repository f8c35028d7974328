"""Linear constraints of a displacement: its normal component on a surface, and components that
nodes have in common.

u = T q + g with orthonormal columns of T.  The balance of what is free is T^T r = 0; what T T^T
takes away of a residual are the forces that hold the constraints.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from mpi4py import MPI
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ..errors import InputError
from ..mesh.check import place
from .distribute import LocalMesh
from .domain import Domain
from .essential import Formula, owned_nodes
from .normals import nodal_normals

# Sine of the angle between a surface and prescribed components below which both are one smooth
# surface, half of the feature angle of `normals`.
SMOOTH = np.sin(np.radians(20))
INDEPENDENT = 0.1  # least over largest singular value of the normals at an edge
OPPOSITE = 1e-6  # of the size of a surface: digits of the coordinates in a mesh file


class NormalValue(NamedTuple):
    """The normal component on tags: expression(t, x) -> (n,) [m], outward; name : its key."""

    tags: tuple[str, ...]
    expression: Formula
    name: str


class Equal(NamedTuple):
    """Components that all nodes of some tags have in common; name : its key."""

    tags: tuple[str, ...]
    components: tuple[int, ...]
    name: str


class Tie(NamedTuple):
    """Components that nodes of one tag have in common with those opposite on another; name : its
    key.
    """

    first: str
    second: str
    components: tuple[int, ...]
    name: str


def common_nodes(
    entry: Equal | Tie,
    surface: Callable[[str], tuple[np.ndarray, np.ndarray]],
    where: Path | str,
) -> np.ndarray:
    """Return the pairs of nodes (n, 2) that have components in common; surface(tag) -> nodes (n,),
    sorted, and their positions (n, d).

    Raises InputError where nodes of a tie have none opposite, or themselves.
    """
    if isinstance(entry, Equal):
        nodes = np.unique(np.concatenate([surface(tag)[0] for tag in entry.tags]))
        return np.stack([np.full_like(nodes, nodes[0]), nodes], axis=1)[1:]
    (first, X), (second, Y) = (surface(tag) for tag in (entry.first, entry.second))
    size = np.ptp(X, axis=0).max(initial=0.0)
    shift = Y.min(axis=0) - X.min(axis=0)
    distance, at = cKDTree(Y).query(X + shift)
    alone = np.flatnonzero(distance > OPPOSITE * size)
    if len(alone) or len(first) != len(second):
        node = X[alone[0]] if len(alone) else X[0]
        raise InputError(
            f"{where} [{entry.name}]: received {len(first)} nodes on '{entry.first}' and"
            f" {len(second)} on '{entry.second}' that do not lie opposite each other, the"
            f" first at {place(node)} m; expected the same nodes, moved by {place(shift)} m"
        )
    itself = np.flatnonzero(first == second[at])
    if len(itself):
        raise InputError(
            f"{where} [{entry.name}]: received '{entry.first}' and '{entry.second}' with the node"
            f" at {place(X[itself[0]])} m on both, which would be tied to itself; expected two"
            " surfaces apart"
        )
    return np.stack([first, second[at]], axis=1)


class LinearConstraints:
    """What is prescribed of a field (n_local, d) beside single components.

    `normal` : of surfaces that lie along no axis; `shared` : components of several nodes
    """

    def __init__(
        self,
        mesh: LocalMesh,
        mask: np.ndarray,
        given: Sequence[NormalValue | Equal | Tie],
        where: Path | str,
    ) -> None:
        """Take the mesh, where single components are prescribed, (n_local, d) bool, the conditions
        and the file of the scene (collective).

        Raises InputError where conditions contradict each other.
        """
        self._mesh = mesh
        self._where = where
        self._given = tuple(given)
        normals = [entry for entry in given if isinstance(entry, NormalValue)]
        shared = [entry for entry in given if not isinstance(entry, NormalValue)]
        self.normal = _Normal(mesh, mask, normals)
        self.shared = _Shared(mesh, mask, self.normal.touched, shared, where)

    @property
    def surfaces(self) -> list[tuple[str, list[int]]]:
        """Return tag and components of the surfaces on which a force holds the field; on one with a
        normal component all of them.
        """
        found = []
        for entry in self._given:
            tags = (entry.first, entry.second) if isinstance(entry, Tie) else entry.tags
            every = range(self._mesh.dim)
            of_all = every if isinstance(entry, NormalValue) else entry.components
            found += [(tag, list(of_all)) for tag in tags]
        return found

    @property
    def nodes(self) -> np.ndarray:
        """Return the owned nodes that are concerned, sorted."""
        return np.union1d(self.normal.nodes, self.shared.nodes)

    def apply(self, field: np.ndarray, t: float) -> None:
        """Change the owned rows of a field (n_local, d), whose prescribed components have their
        values, so that it satisfies the constraints at time t (collective).
        """
        owned = field[: self._mesh.n_owned]
        self.normal.apply(owned, t)
        self.shared.project(owned)

    def project(self, owned: np.ndarray) -> np.ndarray:
        """Return T T^T r of a vector (n_owned, d) (collective)."""
        result = owned.copy()
        self.normal.project(result)
        self.shared.project(result)
        return result

    def transformation(self, domain: Domain, m: int) -> tuple[csr_matrix, csr_matrix]:
        """Return T and, where its columns vanish, a projection onto what it leaves out, for m
        unknowns on each node of a domain, of which the displacement is the first (collective).

        Rows of the owned nodes of this rank, columns in the numbering of the domain.
        """
        nodes = domain.nodes
        row_of = np.full(self._mesh.n_local, -1, dtype=np.int64)
        row_of[nodes] = np.arange(len(nodes))
        size = len(nodes) * m
        columns = m * self._mesh.comm.allreduce(len(nodes))
        rows = np.arange(size)
        identity = _Entries(rows, m * domain.first + rows, np.ones(size))
        normal = self.normal.entries(row_of, domain.numbering, m)
        free, left_out = self.shared.entries(row_of, domain.numbering, m)
        T = _csr([identity, normal.times(-1.0), free], (size, columns))
        return T, _csr([normal, left_out], (size, columns))


class _Entries(NamedTuple):
    """Entries of a sparse matrix."""

    rows: np.ndarray
    columns: np.ndarray
    values: np.ndarray

    def times(self, factor):
        """Return the entries times a factor."""
        return self._replace(values=factor * self.values)


def _csr(parts, shape):
    rows, columns, values = (np.concatenate(column) for column in zip(*parts, strict=True))
    matrix = coo_matrix((values, (rows, columns)), shape=shape).tocsr()
    matrix.eliminate_zeros()
    return matrix


class _Normal:
    """u·n = g at the nodes of surfaces.

    Of the components that are prescribed on their own the values are known: what is left of a
    normal acts on the others.  nodes (n,) owned; taken (n, d, d) : the projection onto the
    directions that are held
    """

    def __init__(self, mesh, mask, given):
        self._mesh = mesh
        self._given = given
        self.nodes = np.zeros(0, dtype=np.int64)
        self.taken = np.zeros((0, mesh.dim, mesh.dim))
        self.touched = np.zeros((mesh.n_owned, mesh.dim), dtype=bool)
        if given:
            self._bind(mask[: mesh.n_owned])

    def _bind(self, mask):
        mesh = self._mesh
        surfaces = [
            np.concatenate([mesh.facets[tag].nodes for tag in entry.tags]) for entry in self._given
        ]
        found = nodal_normals(mesh.X, surfaces, mesh.element)
        mine = found.node < mesh.n_owned
        node, direction, share = (array[mine] for array in found)
        self.nodes, first, counts = np.unique(node, return_index=True, return_counts=True)
        most = counts.max(initial=0)
        place_of = (
            np.repeat(np.arange(len(first)), counts),
            np.arange(len(node)) - np.repeat(first, counts),
        )
        rows = np.zeros((len(first), most, mesh.dim))
        rows[place_of] = direction
        shares = np.zeros((len(first), most, len(self._given)))
        shares[place_of] = share
        free = ~mask[self.nodes][:, None]
        left = np.linalg.norm(rows * free, axis=2, keepdims=True)
        weight = np.where(left > SMOOTH, 1 / np.maximum(left, SMOOTH), 0.0)
        inverse = np.linalg.pinv(rows * free * weight, rcond=INDEPENDENT)
        self.taken = inverse @ (rows * free * weight)
        self._of_values = inverse @ (shares * weight)
        self._of_prescribed = inverse @ (rows * ~free * weight)
        self.touched[self.nodes] = np.abs(self.taken).max(axis=2, initial=0.0) > OPPOSITE

    def apply(self, owned, t):
        """Give the owned nodes of a field their normal component."""
        if not len(self.nodes):
            return
        X = self._mesh.X[self.nodes]
        values = np.stack([entry.expression(t, X) for entry in self._given], axis=1)
        u = owned[self.nodes]
        change = np.einsum("nie,ne->ni", self._of_values, values)
        change -= np.einsum("nij,nj->ni", self.taken + self._of_prescribed, u)
        owned[self.nodes] = u + change

    def project(self, owned):
        """Take what is held out of a vector."""
        if len(self.nodes):
            owned[self.nodes] -= np.einsum("nij,nj->ni", self.taken, owned[self.nodes])

    def entries(self, row_of, numbering, m):
        """Return the projection as entries of a matrix."""
        inside = row_of[self.nodes] >= 0
        nodes, taken = self.nodes[inside], self.taken[inside]
        i, j = np.indices(taken.shape[1:])
        rows = m * row_of[nodes][:, None, None] + i
        columns = m * numbering[nodes].astype(np.int64)[:, None, None] + j
        return _Entries(rows.ravel(), columns.ravel(), taken.ravel())


class _Shared:
    """Components that several nodes have in common.

    nodes, component, group (n,) of this rank; count (groups,) of all ranks
    """

    def __init__(self, mesh, mask, touched, given, where):
        self._mesh = mesh
        self._where = where
        self.nodes = self.component = self.group = np.zeros(0, dtype=np.int64)
        self.count = np.zeros(0)
        if given:
            self._bind(mask[: mesh.n_owned], touched, given)

    def _bind(self, mask, touched, given):
        mesh = self._mesh
        pairs = np.concatenate([self._pairs(entry) for entry in given])
        keys, ends = np.unique(pairs, return_inverse=True)
        ends = ends.reshape(-1, 2)
        graph = csr_matrix((np.ones(len(ends)), ends.T), shape=(len(keys), len(keys)))
        n, group = connected_components(graph, directed=False)
        own = self._own_keys(keys)
        held = np.zeros(len(keys), dtype=np.uint8)
        held[own.at] = mask[own.node, own.component] + 2 * touched[own.node, own.component]
        mesh.comm.Allreduce(MPI.IN_PLACE, held)
        self._require_consistent(keys, group, n, held, given)
        free = np.bincount(group, held, n) == 0
        number = np.cumsum(free) - 1
        chosen = free[group[own.at]]
        self.nodes, self.component = own.node[chosen], own.component[chosen]
        self.group = number[group[own.at][chosen]]
        self.count = np.bincount(group, minlength=n)[free]
        first = np.unique(group, return_index=True)[1]
        self._leads = np.isin(own.at[chosen], first)

    def _own_keys(self, keys):
        """Return place in the keys, owned node and component of those of this rank."""
        mesh = self._mesh
        natural, component = np.divmod(keys, mesh.dim)
        order = np.argsort(mesh.natural[: mesh.n_owned])
        mine = mesh.natural[order]
        at = np.minimum(np.searchsorted(mine, natural), len(mine) - 1)
        own = np.flatnonzero(mine[at] == natural) if len(mine) else np.zeros(0, dtype=np.int64)
        return _OwnKeys(own, order[at[own]] if len(own) else own, component[own])

    def _pairs(self, entry):
        """Return pairs of keys, natural node times d plus component, that are equal
        (collective).
        """
        pairs = common_nodes(entry, self._gathered, self._where)
        d = self._mesh.dim
        return np.concatenate([d * pairs + component for component in entry.components])

    def _gathered(self, tag):
        """Return natural numbers and positions of the nodes of a tag on all ranks (collective)."""
        mesh = self._mesh
        nodes = owned_nodes(mesh, tag)
        natural = np.concatenate(mesh.comm.allgather(mesh.natural[nodes]))
        X = np.concatenate(mesh.comm.allgather(mesh.X[nodes]))
        order = np.argsort(natural)
        return natural[order].astype(np.int64), X[order]

    def _require_consistent(self, keys, group, n, held, given):
        """Raise InputError where a component of some nodes of a group is prescribed."""
        count = np.bincount(group, minlength=n)
        prescribed, inclined = (np.bincount(group, part, n) for part in (held % 2, held >= 2))
        some = (prescribed > 0) & (prescribed < count) | (inclined > 0)
        if some.any():
            key = keys[np.flatnonzero(some[group] & (held > 0))[0]]
            axis = "xyz"[key % self._mesh.dim]
            names = ", ".join(entry.name for entry in given)
            raise InputError(
                f"{self._where} [{names}]: received nodes with a common u_{axis}, of which node"
                f" {key // self._mesh.dim} (counted from 0) has one that is prescribed; prescribe"
                " it on all of them or on none"
            )

    def project(self, owned):
        """Replace the components of a group by their mean (collective)."""
        if not len(self.count):
            return
        at = self.nodes, self.component
        sums = np.bincount(self.group, owned[at], len(self.count))
        self._mesh.comm.Allreduce(MPI.IN_PLACE, sums)
        owned[at] = (sums / self.count)[self.group]

    def entries(self, row_of, numbering, m):
        """Return what is added to the identity for the columns of the groups, and the unknowns that
        no column has (collective).
        """
        inside = row_of[self.nodes] >= 0
        numbers = m * numbering[self.nodes].astype(np.int64) + self.component
        leader = np.full(len(self.count), -1, dtype=np.int64)
        leads = self._leads & inside if len(self.count) else inside
        leader[self.group[leads]] = numbers[leads]
        self._mesh.comm.Allreduce(MPI.IN_PLACE, leader, MPI.MAX)
        rows = m * row_of[self.nodes[inside]] + self.component[inside]
        group, numbers, leads = self.group[inside], numbers[inside], leads[inside]
        part = 1 / np.sqrt(self.count[group])
        minus = _Entries(rows, numbers, -np.ones(len(rows)))
        common = _Entries(rows, leader[group], part)
        free = _Entries(*(np.concatenate(pair) for pair in zip(minus, common, strict=True)))
        return free, _Entries(rows, numbers, (~leads).astype(float))


class _OwnKeys(NamedTuple):
    at: np.ndarray
    node: np.ndarray
    component: np.ndarray
