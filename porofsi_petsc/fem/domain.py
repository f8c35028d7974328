"""The elements of a rank grouped by material region: gathering, scattering, chunks that stay in cache."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse

from ..errors import ConvergenceError
from .geometry import Rule, SecondDerivatives, element_size, geometry

CHUNK_BYTES = 2_000_000  # element matrices of one chunk; about the size of a core's second-level cache


class Domain:
    """All local elements of a mesh, ordered by region, with their two quadrature rules.

    stiffness : rule exact for products of gradients; mass : exact for products of shape functions (straight-sided elements)
    """

    def __init__(self, mesh):
        """Group the local elements of a `fem.LocalMesh`."""
        self.mesh, self.element = mesh, mesh.element
        self.dim, self.n_local, self.n_owned = mesh.dim, mesh.n_local, mesh.n_owned
        permutation = np.argsort(mesh.cell_region, kind="stable")
        self.cells = np.ascontiguousarray(mesh.cells[permutation])
        self.row_of_cell = np.argsort(permutation)  # number in the mesh -> row here
        self.owned = mesh.cell_owned[permutation]
        region = mesh.cell_region[permutation]
        starts = np.searchsorted(region, np.arange(len(mesh.regions) + 1))
        self.region_slices = {name: slice(a, b) for name, a, b in zip(mesh.regions, starts[:-1], starts[1:], strict=True)}
        order = self.element.order
        self.stiffness = Rule.of(self.element, max(2 * (order - 1), 1))
        self.mass = Rule.of(self.element, 2 * order)
        self._scatter = self._incidence()

    def _incidence(self):
        """Return the (n_owned, E A) matrix that adds element vectors to the rows of owned nodes."""
        nodes = self.cells.ravel()
        columns = np.flatnonzero(nodes < self.n_owned)
        data = np.ones(len(columns))
        return scipy.sparse.csr_matrix((data, (nodes[columns], columns)), shape=(self.n_owned, nodes.size))

    @property
    def n_cells(self):
        """Return the number of local elements."""
        return len(self.cells)

    def gather(self, field):
        """Return the nodal values of every element, (E, A, ...), of a field (n_local, ...)."""
        return field[self.cells]

    def scatter_add(self, element_vectors):
        """Return the sum of element vectors (E, A, k) or (E, A) over the owned nodes, (n_owned, k)."""
        components = 1 if element_vectors.ndim == 2 else element_vectors.shape[2]
        return self._scatter @ element_vectors.reshape(self.n_cells * self.cells.shape[1], components)

    def chunks(self, doubles_per_cell):
        """Yield (region name, slice): runs of elements of one region whose work arrays stay in cache."""
        size = max(64, int(CHUNK_BYTES / (8 * doubles_per_cell)))
        for name, span in self.region_slices.items():
            for start in range(span.start, span.stop, size):
                yield name, slice(start, min(start + size, span.stop))

    @cached_property
    def reference(self):
        """Return the mass-rule geometry of the reference configuration."""
        return geometry(self.mass, self.mesh.X[self.cells])

    @cached_property
    def reference_stiffness(self):
        """Return the stiffness-rule geometry of the reference configuration."""
        return geometry(self.stiffness, self.mesh.X[self.cells])

    @cached_property
    def reference_slope(self):
        """Return the `SecondDerivatives.volume_slope` of the reference configuration, (E, Q, d)."""
        return SecondDerivatives.at(self.element, self.mesh.X[self.cells], self.reference, None).volume_slope

    @cached_property
    def h(self):
        """Return the element sizes in the reference configuration, (E,) [m]."""
        return element_size(self.element, self.mass, self.reference)

    def require(self, admissible, what):
        """Raise ConvergenceError on all ranks unless the condition, (E, ...) bool, holds in every element (collective)."""
        bad = np.flatnonzero(~admissible.all(axis=tuple(range(1, admissible.ndim))))
        centre = self.mesh.X[self.cells[bad[0]]].mean(axis=0).tolist() if len(bad) else None
        found = [place for place in self.mesh.comm.allgather(centre) if place]
        if found:
            where = ", ".join(f"{c:.4g}" for c in found[0])
            raise ConvergenceError(f"{what} (element at ({where}) m of the reference); try a smaller step")

    def sum_owned(self, cell_values):
        """Return the sum over the elements of all ranks of values (E,)."""
        return self.mesh.comm.allreduce(float(cell_values[self.owned].sum()))


@dataclass(frozen=True)
class Configuration:
    """The elements in one configuration of the mesh.

    geometry : mass-rule gradients and weights; J (E, Q) volume ratio dv/dV to the reference configuration;
    second : `SecondDerivatives` on the same rule, or None where they vanish or are not needed
    """

    geometry: object
    J: np.ndarray
    second: SecondDerivatives | None

    @classmethod
    def at(cls, domain, positions, with_hessian=False):
        """Return the configuration with nodal positions (n_local, d) [m]; raises ConvergenceError on inverted elements."""
        coordinates = domain.gather(positions)
        current = geometry(domain.mass, coordinates)
        domain.require(current.dV > 0, "an element is inverted: the deformation is too large for the step")
        second = None
        if with_hessian and domain.element.order > 1:
            second = SecondDerivatives.at(domain.element, coordinates, current, domain.reference_slope)
        return cls(current, current.dV / domain.reference.dV, second)
