"""The elements of a rank grouped by material region: gathering, scattering, chunks that stay in
cache.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from mpi4py import MPI

from ..compiled import plain, specialized
from ..errors import ConvergenceError
from .distribute import LocalMesh
from .geometry import Geometry, Rule, SecondDerivatives, element_size, geometry

# element matrices of one chunk: vectors of a residual stay in the second-level cache, calls are few
CHUNK_BYTES = 4_000_000

# largest distance of a mid-edge node of a straight edge from its middle, over its length
STRAIGHT = 1e-6

Failure = Callable[[str], ConvergenceError]  # of what is wrong at a place, given as text


class Domain:
    """The local elements of a mesh, or of some of its regions, ordered by region, with their two
    quadrature rules.

    stiffness : rule exact for products of gradients; mass : exact for products of shape functions
    (straight-sided elements). Tensor products have the mass rule for both, their gradients are of
    the same degree. Where an element is curved the mass rule serves both, too: the volume
    change at fewer points is another one than that which the pressure sees, and at ν = 0.4999 the
    skeleton would answer a pressure six times as much as λ allows. nodes (n_active,) : the owned
    nodes that its elements touch; holds (n_local,) bool : the same with ghosts; first, numbering
    (n_local,) : PETSc's numbers of these nodes, -1 elsewhere; n_nodes : on all ranks Nodal fields
    have rows for all nodes of the mesh; matrices have those of `nodes` only. The reference
    configuration of an element is that of the mesh, or the one in which it was placed, as far as
    displacements are finite.
    """

    def __init__(self, mesh: LocalMesh, regions: Collection[str] | None = None) -> None:
        """Group the local elements of a `fem.LocalMesh`; regions : names, None for all
        (collective).
        """
        self.mesh = mesh
        self.element = mesh.element
        self.dim = mesh.dim
        self.n_local = mesh.n_local
        self.n_owned = mesh.n_owned
        self.regions = tuple(name for name in mesh.regions if regions is None or name in regions)
        numbers = np.array([mesh.regions.index(name) for name in self.regions], dtype=int)
        chosen = np.flatnonzero(np.isin(mesh.cell_region, numbers))
        permutation = chosen[np.argsort(mesh.cell_region[chosen], kind="stable")]
        self.cells = np.ascontiguousarray(mesh.cells[permutation])
        self.cell_numbers = permutation  # of the rows, in the mesh
        self.row_of_cell = np.full(len(mesh.cells), -1)  # number in the mesh -> row here
        self.row_of_cell[permutation] = np.arange(len(permutation))
        self.owned = mesh.cell_owned[permutation]
        self._placed = None if mesh.placed is None else mesh.placed[permutation]
        self._moved = self._placed if mesh.finite else None
        region = mesh.cell_region[permutation]
        spans = [slice(*np.searchsorted(region, (number, number + 1))) for number in numbers]
        self.region_slices = dict(zip(self.regions, spans, strict=True))
        self._number_nodes()
        # a factor r more around an axis
        self.mass = Rule.of(self.element, 2 * self.element.order + self.element.axisymmetric)
        self.stiffness = (
            Rule.of(self.element, max(2 * self.element.gradient_degree, 1))
            if self._is_straight()
            else self.mass
        )

    def _is_straight(self):
        """Return whether the gradients have a lower degree than the shape functions: on simplices
        with the mid-edge nodes of all ranks' elements in the middle of their edges, but not around
        an axis, where N/r is one of them, nor where elements are placed, whatever their shape is
        then (collective).
        """
        if self._moved is not None:
            return False
        if self.element.gradient_degree == self.element.order or self.element.axisymmetric:
            return False
        return self.element.is_affine or not self._has_curved_edge()

    def _has_curved_edge(self):
        """Return whether a mid-edge node of any rank's elements is off the middle of its edge
        (collective).
        """
        points, (a, b) = self.mesh.X[self.cells], np.array(self.element.cell.edges).T
        middle = points[:, self.element.n_vertices :][:, : len(a)]
        off = middle - (points[:, a] + points[:, b]) / 2
        lengths = np.linalg.norm(points[:, a] - points[:, b], axis=-1)
        return self.mesh.comm.allreduce(
            bool((np.linalg.norm(off, axis=-1) > STRAIGHT * lengths).any()), MPI.LOR
        )

    def _number_nodes(self):
        """Set the nodes of the domain and their numbers (collective)."""
        mesh = self.mesh
        touched = np.zeros(mesh.n_local, dtype=bool)
        touched[self.cells] = True
        self.nodes = np.flatnonzero(touched[: mesh.n_owned])
        counts = mesh.comm.allgather(len(self.nodes))
        self.first = sum(counts[: mesh.comm.rank])
        self.n_nodes = sum(counts)
        number = np.full((mesh.n_owned, 1), -1)
        number[self.nodes, 0] = self.first + np.arange(len(self.nodes))
        self.numbering = mesh.halo.extend(number)[:, 0]
        self.holds = self.numbering >= 0

    @property
    def n_cells(self) -> int:
        """Return the number of local elements."""
        return len(self.cells)

    def rows_of(self, part: Domain) -> np.ndarray:
        """Return the rows here of the elements of a part of the domain, (E,)."""
        return self.row_of_cell[part.cell_numbers]

    def gather(self, field: np.ndarray, rows: slice | np.ndarray = slice(None)) -> np.ndarray:
        """Return the nodal values of some elements, (E, A, ...), of a field (n_local, ...)."""
        return np.take(field, self.cells[rows], axis=0)

    def coordinates(self, rows: slice | np.ndarray = slice(None)) -> np.ndarray:
        """Return the nodes of some elements in their reference configuration, (E, A, d) [m]."""
        X = self.gather(self.mesh.X, rows)
        return X if self._moved is None else X + self._moved[rows]

    def displacement(self, u: np.ndarray, rows: slice | np.ndarray = slice(None)) -> np.ndarray:
        """Return the displacement of the nodes of some elements from where they are at rest, (E, A,
        d) [m], for the displacement u (n_local, d) of the nodes of the mesh.
        """
        moved = self.gather(u, rows)
        return moved if self._placed is None else moved - self._placed[rows]

    def scatter_add(self, element_vectors: np.ndarray) -> np.ndarray:
        """Return the sum of element vectors (E, A, k) or (E, A) over the owned nodes, (n_owned,
        k).
        """
        nodal = np.zeros(
            (self.n_owned, 1 if element_vectors.ndim == 2 else element_vectors.shape[2])
        )
        self.add(nodal, slice(None), element_vectors)
        return nodal

    def add(self, nodal: np.ndarray, rows: slice | np.ndarray, element_vectors: np.ndarray) -> None:
        """Add the vectors (E, A, k) or (E, A) of some elements to a field of the owned nodes,
        (n_owned, k), in place.
        """
        A = self.cells.shape[1]
        k = nodal.shape[1]
        _add_loop(A, k)(
            np.ascontiguousarray(self.cells[rows]), plain(element_vectors).reshape(-1, A, k), nodal
        )

    def chunks(self, doubles_per_cell: float) -> Iterator[tuple[str, slice]]:
        """Yield (region name, slice): runs of elements of one region whose work arrays stay in
        cache.
        """
        size = max(64, int(CHUNK_BYTES / (8 * doubles_per_cell)))
        for name, span in self.region_slices.items():
            for start in range(span.start, span.stop, size):
                yield name, slice(start, min(start + size, span.stop))

    @cached_property
    def reference(self) -> Geometry:
        """Return the mass-rule geometry of the reference configuration."""
        return geometry(self.mass, self.coordinates())

    @cached_property
    def reference_stiffness(self) -> Geometry:
        """Return the stiffness-rule geometry of the reference configuration; affine elements have
        one gradient for both rules.
        """
        if self.element.has_constant_gradients:
            volume = self.reference.dV.sum(axis=1, keepdims=True) / self.mass.weights.sum()
            return Geometry(self.reference.G, volume * self.stiffness.weights)
        return (
            self.reference
            if self.stiffness is self.mass
            else geometry(self.stiffness, self.coordinates())
        )

    @cached_property
    def reference_slope(self) -> np.ndarray:
        """Return the `SecondDerivatives.volume_slope` of the reference configuration, (E, Q, d)."""
        return SecondDerivatives.at(
            self.mass, self.coordinates(), self.reference, None
        ).volume_slope

    @cached_property
    def h(self) -> np.ndarray:
        """Return the element sizes in the reference configuration, (E,) [m]."""
        return element_size(self.element, self.mass, self.reference, self.cells)

    def require(self, admissible: np.ndarray, failure: Failure) -> None:
        """Raise an error on all ranks unless the condition, (E, ...) bool, holds in every element
        (collective).

        failure : from the place of the first element as text to the ConvergenceError; called on all
        ranks together
        """
        if self.mesh.comm.allreduce(bool(admissible.all()), MPI.LAND):
            return
        bad = np.flatnonzero(~admissible.all(axis=tuple(range(1, admissible.ndim))))
        centre = self.mesh.X[self.cells[bad[0]]].mean(axis=0).tolist() if len(bad) else None
        found = next(place for place in self.mesh.comm.allgather(centre) if place)
        where = ", ".join(f"{c:.4g}" for c in found)
        raise failure(f"({where}) m of the reference")

    def points_of_stress(self, rows: slice | np.ndarray, N: np.ndarray | None = None) -> np.ndarray:
        """Return the reference positions X, (E, P, d) [m], of the points of the stress in some
        elements, or of others with the shape functions N (P, A).
        """
        return (self._stress_shape if N is None else N) @ self.gather(self.mesh.X, rows)

    @cached_property
    def _stress_shape(self):
        """Return N (Q', A): one gradient is that of the mean of the points."""
        rule = self.stiffness
        is_one = self.reference_stiffness.G.shape[1] == 1
        return (rule.weights @ rule.N / rule.weights.sum())[None] if is_one else rule.N

    def least_volume_ratio(self, u: np.ndarray) -> float:
        """Return the least J of an element under the displacement u (n_local, d), in its mean, 1 at
        most (collective).
        """
        ratio = geometry(self.mass, self.gather(self.mesh.X + u)).dV.sum(
            axis=1
        ) / self.reference.dV.sum(axis=1)
        return self.mesh.comm.allreduce(float(ratio.min(initial=1.0)), MPI.MIN)

    def sum_owned(self, cell_values: np.ndarray) -> float:
        """Return the sum over the elements of all ranks of values (E,)."""
        return self.mesh.comm.allreduce(float(cell_values[self.owned].sum()))


@specialized
def _add_loop(A, k):
    """Return the loop that adds element vectors (E, A, k) to the rows of a field (n_owned, k),
    element after element.
    """

    def loop(cells, vectors, nodal):
        for e in range(len(cells)):
            for a in range(A):
                row = cells[e, a]
                if row < len(nodal):
                    for i in range(k):
                        nodal[row, i] += vectors[e, a, i]

    return loop


def _inverted(place: str) -> ConvergenceError:
    """Return the error of an element that is inverted at a place of the reference."""
    return ConvergenceError(f"an element at {place} is inverted", "try a smaller step")


@dataclass(frozen=True)
class Configuration:
    """The elements in one configuration of the mesh.

    geometry : mass-rule gradients and weights; J (E, Q) volume ratio dv/dV to the reference
    configuration;
    second : `SecondDerivatives` on the same rule, or None where they vanish or are not needed
    wet : the same of the elements that carry a fluid, None where all do
    """

    geometry: Geometry
    J: np.ndarray
    second: SecondDerivatives | None
    wet: Configuration | None = None

    @property
    def of_fluid(self) -> Configuration:
        """Return the configuration of the elements that carry a fluid."""
        return self if self.wet is None else self.wet

    def with_fluid_in(self, rows: np.ndarray) -> Configuration:
        """Return the same configuration, of which some elements carry a fluid."""
        second = self.second and self.second.part(rows)
        return replace(self, wet=Configuration(self.geometry.part(rows), self.J[rows], second))

    @classmethod
    def reference(cls, domain: Domain, with_hessian: bool = False) -> Configuration:
        """Return the reference configuration, which shares the geometry of the domain."""
        second = None
        if with_hessian and not domain.element.has_constant_gradients:
            coordinates = domain.coordinates()
            second = SecondDerivatives.at(
                domain.mass, coordinates, domain.reference, domain.reference_slope
            )
        return cls(domain.reference, np.broadcast_to(1.0, domain.reference.dV.shape), second)

    @classmethod
    def at(
        cls,
        domain: Domain,
        positions: np.ndarray,
        with_hessian: bool = False,
        inverted: Failure = _inverted,
    ) -> Configuration:
        """Return the configuration with nodal positions (n_local, d) [m].

        Raises the error that `inverted` makes of the place of an inverted element.
        """
        coordinates = domain.gather(positions)
        current = geometry(domain.mass, coordinates)
        domain.require(current.dV > 0, inverted)
        second = None
        if with_hessian and not domain.element.has_constant_gradients:
            second = SecondDerivatives.at(domain.mass, coordinates, current, domain.reference_slope)
        return cls(current, current.dV / domain.reference.dV, second)
