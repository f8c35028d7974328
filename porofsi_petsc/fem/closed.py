"""Closed parts of a free fluid: where the velocity is known all around, any constant pressure
solves the equations.
"""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse
from scipy.sparse.csgraph import connected_components

from ..errors import IncompatibleData
from .distribute import LocalMesh
from .domain import Domain
from .essential import Dirichlet, Essential, Formula
from .geometry import Rule, facet_measure

# Largest |∫ ∂_i N_a dV| of a free component i over ∫ |∂_i N_a| dV: a mesh file may have six digits.
TIGHT = 1e-6
# Part of ∮ |v| dA that passes for round-off; and of the flow within a step, whose boundary may
# move, for the error in time.
ROUND_OFF = 1e-9
STEP = 1e-3


class ClosedPart:
    """A connected part of a fluid whose velocity is known wherever it could leave.

    Weakly, ∫ p div w = 0 for a constant p: ∫ ∂_i N_a dV = 0 for every free component i of a node a.
    The level of the pressure is then that of zero mean over the reference configuration; and only
    data without a net flux have a solution.  What the shape functions make of such data may have a
    small one, of which every node has the same share of its volume as a source.

    nodes : (n_local,) bool; weight : (n_owned,) ∫ N_a dV/V [-], of sum 1 over all ranks;
    pin : owned node with the smallest number of the mesh file, None where another rank owns it
    """

    def __init__(
        self,
        domain: Domain,
        nodes: np.ndarray,
        velocity: Dirichlet,
        entries: Iterable[Essential],
        where: str,
    ) -> None:
        """Take a `Domain`, the nodes of the part, the `Dirichlet` of the velocity, its
        `Essential`s, the scene (collective).
        """
        self._domain = domain
        self.nodes = nodes
        self._where = where
        self._comm = domain.mesh.comm
        self._rows = nodes[domain.cells[:, 0]]
        self.weight = _volumes(domain, self._rows)
        self.weight /= self._comm.allreduce(float(self.weight.sum()))
        self.pin = self._first_node()
        self._data = _BoundaryData(domain.mesh, nodes, velocity, entries)

    def _first_node(self):
        mesh = self._domain.mesh
        mine = np.flatnonzero(self.nodes[: mesh.n_owned])
        first = mine[np.argmin(mesh.natural[mine])] if len(mine) else None
        everywhere = self._comm.allgather(None if first is None else int(mesh.natural[first]))
        smallest = min(number for number in everywhere if number is not None)
        return first if everywhere[self._comm.rank] == smallest else None

    def has(self, rows: slice | np.ndarray) -> np.ndarray:
        """Return whether elements of the domain are in the part, (E,) bool."""
        return self._rows[rows]

    def mean(self, nodal: np.ndarray) -> float:
        """Return the mean over the part of nodal values (n_local,) or (n_owned,) (collective)."""
        return self._comm.allreduce(float(self.weight @ nodal[: len(self.weight)]))

    def net(self, terms: Sequence[np.ndarray]) -> float:
        """Return the net flux out of the part [m^d/s] from the terms (n_owned, 1) of its volume
        residuals (collective).

        Raise IncompatibleData where it is none of interpolation, nor round-off of a flow that
        diverges.
        """
        here = self.nodes[: len(self.weight)]
        inside = np.concatenate([term[here, 0] for term in terms])
        net, size = self._comm.allreduce(np.array([inside.sum(), np.abs(inside).sum()]))
        if np.isfinite(size):
            self._require(net, self._bound + ROUND_OFF * size, self._end)
        return net

    def require_balanced_data(self, t: float) -> None:
        """Raise IncompatibleData where the formulas of the velocity have a net flux at a time, in
        the reference (collective).
        """
        found = self._data.flux(t)
        self._require(found.net, found.missed + ROUND_OFF * found.size, t)

    def begin_step(self, t: float, end: float) -> None:
        """Find what may pass for a net flux in a step between two times: the error of interpolation
        and in time (collective).
        """
        fluxes = self._data.flux(t), self._data.flux(end)
        self._bound = max(f.missed + f.missed_at_nodes + STEP * f.size for f in fluxes)
        self._end = end

    def _require(self, net, bound, t):
        if abs(net) <= bound:
            return
        plane = self._domain.dim == 2 and not self._domain.element.axisymmetric
        unit = "m²/s" if plane else "m³/s"
        received = (
            f"received velocities that carry {abs(net):.6g} {unit}"
            f" {'out of' if net > 0 else 'into'} a fluid closed all around"
        )
        advice = (
            "let as much flow in as out, or leave a component of the velocity free on one boundary"
        )
        raise IncompatibleData(
            f"{self._where} [[boundary]]: {received} at t = {t:g} s, expected 0 within {bound:.1e}"
            f" {unit}; {advice}"
        )


@dataclass(frozen=True)
class DataFlux:
    """Fluxes of prescribed velocities over the boundary of a closed part, all [m^d/s].

    net : ∮ v·n dA of the formulas; missed : Σ |∮ (v_h - v)·n dA| over the facets, v_h of each
    formula's own values at the nodes;
    missed_at_nodes : the same with the values that nodes of two surfaces have; size : ∮ |v| dA
    """

    net: float
    missed: float
    missed_at_nodes: float
    size: float


class _BoundaryData:
    """The prescribed velocities on the boundary of a closed part: their nodal values beside their
    formulas.
    """

    def __init__(
        self, mesh: LocalMesh, nodes: np.ndarray, velocity: Dirichlet, entries: Iterable[Essential]
    ) -> None:
        """Prepare the quadrature on the facets of every tag; see `ClosedPart`."""
        self._mesh = mesh
        self._velocity = velocity
        self._rule = Rule.of(mesh.element.facet, 2 * mesh.element.order + 3)
        expressions: dict[str, dict[int, Formula]] = defaultdict(dict)
        for tag, component, expression, *_ in entries:
            expressions[tag][component] = expression
        self._surfaces = []
        for tag, of_tag in expressions.items():
            facets = mesh.facets[tag]
            mine = facets.nodes[facets.owned & nodes[facets.nodes].all(axis=1)]
            self._surfaces.append((mine, facet_measure(self._rule, mesh.X[mine]), of_tag))

    def flux(self, t: float) -> DataFlux:
        """Return the `DataFlux` of a time (collective)."""
        nodal = np.zeros((self._mesh.n_local, self._mesh.dim))
        self._velocity.apply(nodal, t)
        sums = sum(self._surface(surface, nodal, t) for surface in self._surfaces)
        return DataFlux(*self._mesh.comm.allreduce(np.asarray(sums, dtype=float)).tolist())

    def _surface(self, surface, nodal, t):
        """Return the shares of one surface in a `DataFlux`, (4,)."""
        nodes, normal, expressions = surface
        X = self._mesh.X[nodes]
        N = self._rule.N

        def values(expression, points):
            flat = points.reshape(-1, points.shape[-1])
            return expression(t, flat).reshape(points.shape[:-1])

        def formula(points):
            v = np.zeros(points.shape)
            for i, expression in expressions.items():
                inside = points is not X and getattr(expression, "nodal", False)
                found = values(expression, X if inside else points)
                v[..., i] = (N @ found[..., None])[..., 0] if inside else found
            return v

        given = list(expressions)
        exact = formula(N @ X)
        through, own, mixed = (
            (v[..., given] * normal[..., given]).sum(axis=(1, 2))
            for v in (exact, N @ formula(X), N @ nodal[nodes])
        )
        size = np.linalg.norm(exact, axis=2) * np.linalg.norm(normal, axis=2)
        return np.array(
            [through.sum(), np.abs(own - through).sum(), np.abs(mixed - through).sum(), size.sum()]
        )


def closed_nodes(domain: Domain, held: np.ndarray) -> list[np.ndarray]:
    """Return the nodes of the closed parts of a `Domain`, (n_local,) bool each, by ascending node
    number (collective).

    held : (n_local, d) bool, components of the velocity that are known
    """
    label = _components(domain)
    n = domain.n_owned
    flux = np.zeros((n, domain.dim))
    size = np.zeros((n, domain.dim))
    for _, chunk in domain.chunks(domain.cells.shape[1] * domain.dim):
        geometry = domain.reference.part(chunk)
        for total, gradient in ((flux, _at_points(geometry)), (size, np.abs(_at_points(geometry)))):
            domain.add(total, chunk, np.einsum("eqai,eq->eai", gradient, geometry.dV))
    leaks = ((np.abs(flux) > TIGHT * size) & ~held[:n]).any(axis=1)
    mine = label[:n]
    found = domain.mesh.comm.allgather(
        (set(mine[domain.nodes].tolist()), set(mine[leaks].tolist()))
    )
    everywhere, leaking = (set().union(*labels) for labels in zip(*found, strict=True))
    return [label == name for name in sorted(everywhere - leaking)]


def _at_points(geometry):
    return np.broadcast_to(geometry.divergence, (*geometry.dV.shape, *geometry.G.shape[2:]))


def _components(domain):
    """Return the smallest node number of the mesh file in the part of every node, -1 outside of the
    domain, (n_local,).

    Every rank joins what its elements connect, until no number falls any more (collective).
    """
    mesh = domain.mesh
    n = domain.n_local
    ends = np.repeat(domain.cells[:, 0], domain.cells.shape[1] - 1), domain.cells[:, 1:].ravel()
    piece = connected_components(
        scipy.sparse.coo_matrix((np.ones(len(ends[0])), ends), shape=(n, n)), directed=False
    )[1]
    label = mesh.natural.copy()
    before = None
    while before is None or mesh.comm.allreduce(int((label != before).any())):
        before = label
        smallest = np.full(n, mesh.n_global)
        np.minimum.at(smallest, piece, label)
        label = smallest[piece]
        mesh.halo.update(label)
    return np.where(domain.holds, label, -1)


def _volumes(domain, rows):
    """Return ∫ N_a dV over some elements of a domain, rows (E,) bool, (n_owned,) [m^d]."""
    shares = (domain.reference.dV @ domain.mass.N) * rows[:, None]
    return domain.scatter_add(shares)[:, 0]
