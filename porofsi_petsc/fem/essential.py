"""Essential conditions: values prescribed on the nodes of tagged surfaces, one at a node that
several of them share.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from scipy.sparse import csr_matrix

from ..errors import InputError
from .distribute import LocalMesh

# Of two values on one node, over the largest that their conditions have prescribed at this time or
# one before: above round-off of formulas and tables, far below any error of discretization.  The
# values of one time say nothing where both pass zero, as sin(pi*t) and cos(pi*t - pi/2) at t = 1.
SAME = 1e-9

Formula = Callable[[float, np.ndarray], np.ndarray]  # (t, x (n, d)) -> values (n,)


class Essential(NamedTuple):
    """One component of a field on one tag: expression(t, x) -> (n,).

    expression : with an attribute `nodal` that is true it is known at nodes alone, between them by
    the shape functions;
    precedence : on a node with several, the highest alone holds; name : its key in the scene
    """

    tag: str
    component: int
    expression: Formula
    precedence: float = 0.0
    name: str = ""


@dataclass(frozen=True)
class Prescribed:
    """What is left of an `Essential` on the owned nodes, (n,)."""

    given: Essential
    nodes: np.ndarray

    def values(self, mesh: LocalMesh, t: float) -> np.ndarray:
        """Return the values at time t, (n,)."""
        return self.given.expression(t, mesh.X[self.nodes])


class Transformation(Protocol):
    """Linear constraints u = T q of the displacements in a matrix."""

    def transformation(self, domain: Any, m: int) -> tuple[csr_matrix, csr_matrix]:
        """Return T and the projection onto what it leaves out, for m unknowns on each node
        (collective).
        """


class Constraints(Transformation, Protocol):
    """What is prescribed beside single components; see `constraints.LinearConstraints`."""

    @property
    def nodes(self) -> np.ndarray:
        """Return the owned nodes that are concerned."""

    @property
    def surfaces(self) -> list[tuple[str, list[int]]]:
        """Return tag and components of the surfaces on which a force holds the field."""

    def apply(self, field: np.ndarray, t: float) -> None:
        """Change the owned rows of a field (n_local, k) so that it holds at time t (collective)."""

    def project(self, owned: np.ndarray) -> np.ndarray:
        """Return a vector (n_owned, k) without the forces that hold it (collective)."""


class Dirichlet:
    """The essential conditions of one nodal field with k components.

    mask : (n_local, k) bool, true where a value is prescribed, ghosts included.  At a node the
    conditions of the highest precedence hold, whatever their order; they must agree, which is
    checked at given times and whenever they are applied.  constraints : what is prescribed beside
    single components, which is set where there is any
    """

    def __init__(
        self,
        mesh: LocalMesh,
        components: int,
        given: Iterable[tuple],
        times: Iterable[float] = (),
        where: Path | str = "scene",
    ) -> None:
        """Collect the conditions, tuples as `Essential` takes them (collective).

        times : at which values on common nodes are compared now; where : file of the scene, for
        messages
        """
        self._mesh = mesh
        self._where = where
        self.constraints: Constraints | None = None
        entries = sorted(
            (Essential(*entry) for entry in given), key=lambda entry: (entry.tag, entry.component)
        )
        self.conditions = [
            Prescribed(entry, nodes)
            for entry, nodes in zip(entries, _held(mesh, components, entries), strict=True)
        ]
        self.mask = np.zeros((mesh.n_local, components), dtype=np.uint8)
        for condition in self.conditions:
            self.mask[condition.nodes, condition.given.component] = 1
        mesh.halo.update(self.mask)
        self.mask = self.mask.astype(bool)
        self._shared, self._largest = (
            _shared(mesh.comm, self.conditions),
            np.zeros(len(self.conditions)),
        )
        looked_at = [
            (t, [condition.values(mesh, t) for condition in self.conditions])
            for t in times
            if self._shared
        ]
        for _, values in looked_at:
            self._note_largest(values)
        for t, values in looked_at:
            self._require_one_value(t, values)

    def apply(self, field: np.ndarray, t: float) -> None:
        """Overwrite the prescribed entries of a field (n_local, k) by their values at time t,
        ghosts included (collective).

        Raises InputError where two conditions that hold at a node differ.
        """
        values = [condition.values(self._mesh, t) for condition in self.conditions]
        if self._shared:
            self._require_one_value(t, values)
        for condition, found in zip(self.conditions, values, strict=True):
            field[condition.nodes, condition.given.component] = found
        if self.constraints is not None:
            self.constraints.apply(field, t)
        self._mesh.halo.update(field)

    def free(self, owned: np.ndarray) -> np.ndarray:
        """Return a copy of (n_owned, k) without what acts on prescribed entries, which are zero,
        and on constraints (collective).
        """
        found = np.where(self.mask[: self._mesh.n_owned], 0.0, owned)
        return found if self.constraints is None else self.constraints.project(found)

    def _require_one_value(self, t, values):
        """Raise InputError at the first node, in the order of the mesh file, on which two values
        differ (collective).
        """
        self._note_largest(values)
        largest, found = self._largest, []
        for first, second, in_first, in_second in self._shared:
            a = values[first][in_first]
            b = values[second][in_second]
            nodes = self.conditions[first].nodes[in_first]
            apart = np.abs(a - b) > SAME * max(largest[first], largest[second])
            found += [
                (node, first, second, x, y)
                for node, x, y in zip(nodes[apart], a[apart], b[apart], strict=True)
            ]
        worst = first_node(self._mesh, found)
        if worst is not None:
            raise InputError(self._conflict(t, *worst))

    def _note_largest(self, values):
        """Keep the largest absolute value of each condition (collective)."""
        mine = [float(np.abs(found).max(initial=0.0)) for found in values]
        self._largest = np.max([self._largest, *self._mesh.comm.allgather(mine)], axis=0)

    def _conflict(self, t, place, first, second, a, b):
        """Return the sentence about two values at a place."""
        one, other = (self.conditions[i].given for i in (first, second))
        text = f"received {b:g} on '{other.tag}' at the node ({place}) m at t = {t:g} s"
        text += f", where {one.name} gives {a:g} on '{one.tag}'"
        advice = (
            "expected one value; let them agree there, or give the entry that is to hold a higher"
            " `priority`"
        )
        return f"{self._where} [{other.name}]: {text}, {advice}"


def _held(mesh, components, given):
    """Return the owned nodes of every `Essential` on which none of higher precedence holds the
    component.
    """
    nodes = [owned_nodes(mesh, entry.tag) for entry in given]
    highest = np.full((mesh.n_owned, components), -np.inf)
    for entry, here in zip(given, nodes, strict=True):
        highest[here, entry.component] = np.maximum(
            highest[here, entry.component], entry.precedence
        )
    return [
        here[highest[here, entry.component] == entry.precedence]
        for entry, here in zip(given, nodes, strict=True)
    ]


def _shared(comm, conditions):
    """Return (first, second, places in first, places in second) of all pairs with common nodes on
    some rank (collective).

    A pair that prescribes the same expression is left out.
    """
    pairs = []
    for j, second in enumerate(conditions):
        for i, first in enumerate(conditions[:j]):
            if first.given.component == second.given.component and not _equal(
                first.given.expression, second.given.expression
            ):
                common, in_first, in_second = np.intersect1d(
                    first.nodes, second.nodes, True, return_indices=True
                )
                pairs.append((i, j, in_first, in_second))
    counts = comm.allreduce(np.array([len(pair[2]) for pair in pairs], dtype=int))
    return [pair for pair, count in zip(pairs, counts, strict=True) if count]


def first_node(mesh: LocalMesh, found: Iterable[tuple]) -> tuple | None:
    """Return the place as text and the rest of the record of the first node in the order of the
    mesh file, or None (collective).

    found : (local node, numbers …) of this rank
    """
    mine = min(((int(mesh.natural[node]), *rest) for node, *rest in found), default=None)
    if mine is not None:
        node = int(np.flatnonzero(mesh.natural == mine[0])[0])
        mine = (mine[0], ", ".join(f"{c:g}" for c in mesh.X[node]), *mine[1:])
    records = [record for record in mesh.comm.allgather(mine) if record]
    return min(records)[1:] if records else None


def _equal(one, other):
    """Return whether two expressions are the same by their text, or the same object."""
    return one is other or getattr(one, "source", one) == getattr(other, "source", other)


def owned_nodes(mesh: LocalMesh, tag: str) -> np.ndarray:
    """Return the owned nodes that lie on a tagged surface, sorted."""
    nodes = np.unique(mesh.facets[tag].nodes)
    return nodes[nodes < mesh.n_owned]
