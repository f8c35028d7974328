"""Lagrange triangles and tetrahedra of order 1 and 2 on the unit simplex, nodes in VTK order.

Vertex a > 0 sits at the unit vector of axis a - 1, vertex 0 at the origin.  A mid-edge node follows
the vertices in the order of `edges`.  With barycentric coordinates L_a the shape functions are L_a
(order 1), and L_a (2 L_a - 1) at the vertices and 4 L_a L_b at the mid-edge nodes (order 2)
(Zienkiewicz & Taylor, The Finite Element Method, vol. 1).
"""

from itertools import combinations
from math import factorial

import numpy as np

from .element import Cell, Element, moments
from .quadrature import closed, quadrature, subdivided

EDGES = {
    1: ((0, 1),),
    2: ((0, 1), (1, 2), (2, 0)),
    3: ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
}
POLYGONS = {1: ((0, 2), (2, 1)), 2: ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5))}  # of order 2


class Simplex(Cell):
    """The simplex of the origin and the unit vectors."""

    @property
    def vertices(self) -> np.ndarray:
        """Return the coordinates of the vertices, (dim + 1, dim)."""
        return np.vstack([np.zeros(self.dim), np.eye(self.dim)])

    @property
    def edges(self) -> tuple:
        """Return the pairs of vertices of the edges."""
        return EDGES[self.dim]

    @property
    def facet_vertices(self) -> int:
        """Return dim."""
        return self.dim

    @property
    def count_in_cube(self) -> int:
        """Return dim!."""
        return factorial(self.dim)

    @property
    def simplices(self) -> np.ndarray:
        """Return all vertices as one simplex."""
        return np.arange(self.dim + 1)[None]

    @property
    def parts(self) -> list:
        """Return the simplices of all sets of vertices; see `Cell`."""
        sets = [c for k in range(self.dim + 1) for c in combinations(self.vertices, k + 1)]
        return [(Simplex(len(c) - 1), c[0], np.reshape(c[1:], (-1, self.dim)) - c[0]) for c in sets]

    @property
    def centroid(self) -> np.ndarray:
        """Return the point of equal barycentric coordinates, (1, dim)."""
        return np.full((1, self.dim), 1 / (self.dim + 1))

    def vertex_functions(self, xi: np.ndarray) -> np.ndarray:
        """Return the barycentric coordinates of points xi, (Q, dim), (Q, dim + 1)."""
        xi = np.asarray(xi, dtype=float)
        return np.hstack([1 - xi.sum(axis=1, keepdims=True), xi])

    @property
    def vertex_gradient(self) -> np.ndarray:
        """Return the derivatives of the barycentric coordinates, (dim + 1, dim)."""
        return np.vstack([-np.ones(self.dim), np.eye(self.dim)])

    def contains(self, xi: np.ndarray, tolerance: float) -> np.ndarray:
        """Return which points are in the simplex."""
        return (xi >= -tolerance).all(axis=1) & (xi.sum(axis=1) <= 1 + tolerance)

    def quadrature(self, degree: int) -> tuple[np.ndarray, np.ndarray]:
        """Return points and weights that integrate polynomials of the degree exactly."""
        return quadrature(self.dim, degree)

    def closed_quadrature(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the rule of degree 3 with the vertices; see `Cell`."""
        return closed(self.dim)

    def subdivided(self, degree: int, n: int) -> tuple[np.ndarray, np.ndarray]:
        """Return points and weights on the parts of a line or triangle."""
        return subdivided(self.dim, degree, n)

    def shape_tensors(self, vertices: np.ndarray) -> np.ndarray:
        """Return the second moments of the vertices, which are A Aᵀ times a number."""
        return moments(vertices)[:, None]


class LagrangeSimplex(Element):
    """A triangle or tetrahedron, or a line as a facet."""

    @property
    def supports(self) -> tuple:
        """Return the ends of the edges that have a node in their middle."""
        return self.cell.edges if self.order == 2 else ()

    @property
    def is_affine(self) -> bool:
        """Return whether the shape functions are the barycentric coordinates."""
        return self.order == 1

    @property
    def gradient_degree(self) -> int:
        """Return the degree of the gradients."""
        return self.order - 1

    @property
    def trace_constant(self) -> float:
        """Return (k + 1)(k + d)/d (Warburton & Hesthaven, CMAME 192 (2003) 2765)."""
        return (self.order + 1) * (self.order + self.dim) / self.dim

    @property
    def lebesgue_constant(self) -> float:
        """Return 1, or that of order 2: at a quarter of a line, else at the centroid."""
        return 1.0 if self.order == 1 else {1: 5 / 4, 2: 5 / 3, 3: 2.0}[self.dim]

    @property
    def polygons(self) -> tuple:
        """Return the element itself, or the parts between its nodes."""
        if self.order == 1:
            return (tuple(range(self.nodes)),)
        return POLYGONS[self.dim]

    def shape(self, xi: np.ndarray) -> np.ndarray:
        """Return N, (Q, A), at the reference points xi, (Q, dim)."""
        L = self.cell.vertex_functions(xi)
        if self.order == 1:
            return L
        edges = [4 * L[:, [a]] * L[:, [b]] for a, b in self.cell.edges]
        return np.hstack([L * (2 * L - 1), *edges])

    def gradient(self, xi: np.ndarray) -> np.ndarray:
        """Return dN/dxi, (Q, A, dim), at the reference points xi, (Q, dim)."""
        L = self.cell.vertex_functions(xi)
        dL = self.cell.vertex_gradient
        if self.order == 1:
            return np.broadcast_to(dL, (len(L), *dL.shape)).copy()
        vertex = (4 * L[:, :, None] - 1) * dL
        edge = [4 * (L[:, a, None] * dL[b] + L[:, b, None] * dL[a]) for a, b in self.cell.edges]
        return np.concatenate([vertex, np.stack(edge, axis=1)], axis=1)

    def hessian(self, xi: np.ndarray) -> np.ndarray:
        """Return d²N/dxi², (1, A, dim, dim), constant over the element."""
        dL = self.cell.vertex_gradient
        if self.order == 1:
            return np.zeros((1, self.nodes, self.dim, self.dim))
        vertex = [4 * np.outer(g, g) for g in dL]
        edge = [4 * (np.outer(dL[a], dL[b]) + np.outer(dL[b], dL[a])) for a, b in self.cell.edges]
        return np.array(vertex + edge)[None]


LINE = Simplex(1)
TRIANGLE = Simplex(2)
TETRAHEDRON = Simplex(3)

L2 = LagrangeSimplex("L2", LINE, 1, "line", "Polyline", ((0,), (1,)), None)  # type: ignore[arg-type]
L3 = LagrangeSimplex("L3", LINE, 2, "line3", "Edge_3", ((0,), (1,)), None)  # type: ignore[arg-type]
T3 = LagrangeSimplex("T3", TRIANGLE, 1, "triangle", "Triangle", ((0, 1), (1, 2), (2, 0)), L2)
T6 = LagrangeSimplex(
    "T6", TRIANGLE, 2, "triangle6", "Triangle_6", ((0, 1, 3), (1, 2, 4), (2, 0, 5)), L3
)
T4 = LagrangeSimplex(
    "T4", TETRAHEDRON, 1, "tetra", "Tetrahedron", ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)), T3
)
T10 = LagrangeSimplex(
    "T10",
    TETRAHEDRON,
    2,
    "tetra10",
    "Tetrahedron_10",
    ((0, 2, 1, 6, 5, 4), (0, 1, 3, 4, 8, 7), (1, 2, 3, 5, 9, 8), (0, 3, 2, 7, 9, 6)),
    T6,
)
