"""Lagrange triangles and tetrahedra of order 1 and 2 on the unit simplex, nodes in VTK order.

Vertex a > 0 sits at the unit vector of axis a - 1, vertex 0 at the origin.  A mid-edge node follows
the vertices in the order of `edges`.  With barycentric coordinates L_a the shape functions are L_a
(order 1), and L_a (2 L_a - 1) at the vertices and 4 L_a L_b at the mid-edge nodes (order 2)
(Zienkiewicz & Taylor, The Finite Element Method, vol. 1, ch. 8).
"""

from dataclasses import dataclass

import numpy as np

EDGES = {
    1: ((0, 1),),
    2: ((0, 1), (1, 2), (2, 0)),
    3: ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
}


@dataclass(frozen=True)
class Element:
    """A Lagrange simplex.

    facets : local nodes of every facet, ordered so that a facet is an element of one dimension less
    (outward orientation).
    """

    name: str
    dim: int
    order: int
    meshio_name: str
    facet_meshio_name: str
    facets: tuple

    @property
    def edges(self):
        """Return the vertex pairs that carry the mid-edge nodes of an element of order 2."""
        return EDGES[self.dim]

    @property
    def nodes(self):
        """Return the number of nodes."""
        return self.dim + 1 + (len(self.edges) if self.order == 2 else 0)

    @property
    def node_coordinates(self):
        """Return the reference coordinates of the nodes, (A, dim)."""
        vertices = np.vstack([np.zeros(self.dim), np.eye(self.dim)])
        if self.order == 1:
            return vertices
        return np.vstack([vertices, [(vertices[a] + vertices[b]) / 2 for a, b in self.edges]])

    def shape(self, xi):
        """Return N, (Q, A), at the reference points xi, (Q, dim)."""
        L = barycentric(xi)
        if self.order == 1:
            return L
        return np.hstack([L * (2 * L - 1)] + [4 * L[:, [a]] * L[:, [b]] for a, b in self.edges])

    def gradient(self, xi):
        """Return dN/dxi, (Q, A, dim), at the reference points xi, (Q, dim)."""
        L = barycentric(xi)
        dL = barycentric_gradient(self.dim)
        if self.order == 1:
            return np.broadcast_to(dL, (len(L), *dL.shape)).copy()
        vertex = (4 * L[:, :, None] - 1) * dL
        edge = [4 * (L[:, a, None] * dL[b] + L[:, b, None] * dL[a]) for a, b in self.edges]
        return np.concatenate([vertex, np.stack(edge, axis=1)], axis=1)

    def hessian(self):
        """Return d2N/dxi2, (A, dim, dim), constant over the element."""
        dL = barycentric_gradient(self.dim)
        if self.order == 1:
            return np.zeros((self.nodes, self.dim, self.dim))
        vertex = [4 * np.outer(g, g) for g in dL]
        edge = [4 * (np.outer(dL[a], dL[b]) + np.outer(dL[b], dL[a])) for a, b in self.edges]
        return np.array(vertex + edge)


def barycentric(xi):
    """Return L, (Q, dim + 1), at the reference points xi, (Q, dim)."""
    xi = np.asarray(xi, dtype=float)
    return np.hstack([1 - xi.sum(axis=1, keepdims=True), xi])


def barycentric_gradient(dim):
    """Return dL/dxi, (dim + 1, dim)."""
    return np.vstack([-np.ones(dim), np.eye(dim)])


T3 = Element("T3", 2, 1, "triangle", "line", ((0, 1), (1, 2), (2, 0)))
T6 = Element("T6", 2, 2, "triangle6", "line3", ((0, 1, 3), (1, 2, 4), (2, 0, 5)))
T4 = Element("T4", 3, 1, "tetra", "triangle", ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)))
T10 = Element(
    "T10",
    3,
    2,
    "tetra10",
    "triangle6",
    ((0, 2, 1, 6, 5, 4), (0, 1, 3, 4, 8, 7), (1, 2, 3, 5, 9, 8), (0, 3, 2, 7, 9, 6)),
)
L2 = Element("L2", 1, 1, "line", "vertex", ((0,), (1,)))
L3 = Element("L3", 1, 2, "line3", "vertex", ((0,), (1,)))

FACET = {"T3": L2, "T6": L3, "T4": T3, "T10": T6}
