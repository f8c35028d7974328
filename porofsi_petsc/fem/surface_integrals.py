"""Integrals of fields over tagged surfaces of a domain, in the configuration of its mesh."""

from collections.abc import Iterable, Iterator

import numpy as np

from ..kernels.surface import wall_shear
from ..mesh.topology import locate_facets
from .boundary import trace
from .domain import Domain


class SurfaceIntegrals:
    """The facets of some tags that an element of a domain is behind, normals out of it; around an
    axis areas are those of whole rings.

    An integral is that of this rank: each facet in parts to its nodes, of which a rank has its own,
    so that the sum over the ranks is the whole.  x (n_local, d) [m] : positions of the nodes.
    """

    def __init__(self, domain: Domain, tags: Iterable[str]) -> None:
        """Find the facets."""
        self._domain = domain
        nodes = np.concatenate([domain.mesh.facets[tag].nodes for tag in tags])
        rows, local = locate_facets(nodes, domain.cells, domain.element)
        self._rows = rows[rows >= 0]
        self._local = local[rows >= 0]

    def _traces(self, x: np.ndarray) -> Iterator[tuple[np.ndarray, ...]]:
        """Yield rows of elements (F,), N (Q, A), G (F, Q', A, d), normals times dA (F, Q, d) and
        the part of this rank (F, Q), by the number of the facet in the element.
        """
        domain = self._domain
        for number, nodes in enumerate(domain.element.facets):
            rows = self._rows[self._local == number]
            N, G, normal = trace(domain.element, nodes, domain.gather(x, rows))
            part = (domain.cells[rows] < domain.n_owned) @ N.T
            yield rows, N, G, normal, part

    def area(self, x: np.ndarray) -> float:
        """Return ∮ dA [m^(d-1)]."""
        return sum(
            float((np.linalg.norm(normal, axis=-1) * part).sum())
            for _, _, _, normal, part in self._traces(x)
        )

    def scalar(self, x: np.ndarray, p: np.ndarray) -> float:
        """Return ∮ p dA of a nodal field (n_local,)."""
        total = 0.0
        for rows, N, _, normal, part in self._traces(x):
            values = self._domain.gather(p, rows) @ N.T
            total += float((values * np.linalg.norm(normal, axis=-1) * part).sum())
        return total

    def normal(self, x: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Return ∮ p n dA, (d,), of a nodal field (n_local,)."""
        total = np.zeros(self._domain.dim)
        for rows, N, _, normal, part in self._traces(x):
            values = (self._domain.gather(p, rows) @ N.T) * part
            total += (values[..., None] * normal).sum(axis=(0, 1))
        return total

    def flow(self, x: np.ndarray, c: np.ndarray) -> float:
        """Return ∮ c·n dA of a nodal field (n_local, d)."""
        total = 0.0
        for rows, N, _, normal, part in self._traces(x):
            through = ((N @ self._domain.gather(c, rows)) * normal).sum(axis=-1)
            total += float((through * part).sum())
        return total

    def shear(self, x: np.ndarray, v: np.ndarray, mu: np.ndarray) -> tuple[float, float]:
        """Return ∮ |τ| dA [N] and the largest |τ| [Pa] at the points of the quadrature, of the
        tangential viscous traction τ, 0 without a facet; v (n_local, d), mu (E,) [Pa s].
        """
        total = largest = 0.0
        for rows, _, G, normal, part in self._traces(x):
            size = wall_shear(G, normal, self._domain.gather(v, rows), mu[rows])
            total += float((size * np.linalg.norm(normal, axis=-1) * part).sum())
            largest = max(largest, float(size.max(initial=0.0)))
        return total, largest
