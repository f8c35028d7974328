"""Lagrange quadrilaterals and hexahedra of order 1 and 2 on the unit square and cube, nodes in VTK
order.

The shape functions are products of those of a line with 2 or 3 equidistant nodes, one of every
coordinate (Zienkiewicz & Taylor, The Finite Element Method, vol. 1).  Nodes: vertices,
middles of edges, of the faces of a hexahedron, of the cell.
"""

from itertools import permutations

import numpy as np

from .element import Cell, Element, coincident, moments
from .quadrature import closed_product, gauss_product
from .simplex import L2, L3, LINE

VERTICES = {
    2: ((0, 0), (1, 0), (1, 1), (0, 1)),
    3: (
        *((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)),
        *((0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)),
    ),
}
EDGES = {
    2: ((0, 1), (1, 2), (2, 3), (3, 0)),
    3: (
        *((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4)),
        *((0, 4), (1, 5), (2, 6), (3, 7)),
    ),
}
# In the order of the nodes in their middle, each as seen from outside.
FACES = ((0, 4, 7, 3), (1, 2, 6, 5), (0, 1, 5, 4), (3, 7, 6, 2), (0, 3, 2, 1), (4, 5, 6, 7))
COLLAPSED = {
    2: {"triangle": [0, 1, 2, 2]},
    3: {
        "tetra": [0, 1, 2, 2, 3, 3, 3, 3],
        "wedge": [0, 1, 2, 2, 3, 4, 5, 5],
        "pyramid": [0, 1, 2, 3, 4, 4, 4, 4],
    },
}


class Cube(Cell):
    """The unit square or cube."""

    @property
    def vertices(self) -> np.ndarray:
        """Return the coordinates of the vertices, (2^dim, dim)."""
        return np.array(VERTICES[self.dim], dtype=float)

    @property
    def edges(self) -> tuple:
        """Return the pairs of vertices of the edges."""
        return EDGES[self.dim]

    @property
    def facet_vertices(self) -> int:
        """Return 2^(dim - 1)."""
        return 2 ** (self.dim - 1)

    @property
    def count_in_cube(self) -> int:
        """Return 1."""
        return 1

    @property
    def simplices(self) -> np.ndarray:
        """Return Kuhn's subdivision: a simplex for each way along the axes from vertex 0 to the
        opposite one, (dim!, dim + 1).
        """
        number = {vertex: i for i, vertex in enumerate(VERTICES[self.dim])}
        simplices = []
        for path in permutations(np.eye(self.dim, dtype=int)):
            walk = [tuple(point) for point in np.cumsum([0 * path[0], *path], axis=0).tolist()]
            corners = [number[point] for point in walk]
            if np.linalg.det(path) < 0:
                corners[1:3] = corners[2:0:-1]
            simplices.append(corners)
        return np.array(simplices)

    @property
    def parts(self) -> list:
        """Return vertices, edges and the square; see `Cell`."""
        if self.dim != 2:
            raise NotImplementedError("parts of a cube")
        x = self.vertices
        points = [(type(LINE)(0), vertex, np.zeros((0, 2))) for vertex in x]
        lines = [(LINE, x[a], (x[b] - x[a])[None]) for a, b in self.edges]
        return [*points, *lines, (self, x[0], np.eye(2))]

    def vertex_functions(self, xi: np.ndarray) -> np.ndarray:
        """Return the products of t or 1 - t, (Q, V), at the points xi, (Q, dim)."""
        xi = np.asarray(xi, dtype=float)[:, None]
        return np.where(self.vertices == 1, xi, 1 - xi).prod(axis=2)

    @property
    def vertex_gradient(self) -> np.ndarray:
        """Return the derivatives of the `vertex_functions` at the centroid, (V, dim)."""
        return (2 * self.vertices - 1) / self.facet_vertices

    def contains(self, xi: np.ndarray, tolerance: float) -> np.ndarray:
        """Return which points are in the cell."""
        return ((xi >= -tolerance) & (xi <= 1 + tolerance)).all(axis=1)

    def quadrature(self, degree: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the product of Gauss rules that are exact for the degree in each coordinate."""
        return gauss_product(self.dim, degree)

    def closed_quadrature(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the product of Simpson's rules, of degree 3 in each coordinate."""
        return closed_product(self.dim)

    def subdivided(self, degree: int, n: int) -> tuple[np.ndarray, np.ndarray]:
        """Return points and weights on n^dim equal parts."""
        points, weights = self.quadrature(degree)
        corners = np.stack(np.meshgrid(*[np.arange(n)] * self.dim), axis=-1).reshape(-1, self.dim)
        parts = np.vstack([corner + points for corner in corners])
        return parts / n, np.tile(weights, len(corners)) / n**self.dim

    def shape_tensors(self, vertices: np.ndarray) -> np.ndarray:
        """Return J Jᵀ at the vertices, (E, V, dim, dim), J the derivative of the map of order 1; of
        a collapsed cell the moments of its vertices.
        """
        own = self.vertices
        legs = [own + (1 - 2 * own[:, [i]]) * np.eye(self.dim)[i] for i in range(self.dim)]
        ends = np.stack([(leg[:, None] == own).all(axis=2).argmax(axis=1) for leg in legs], axis=1)
        arms = vertices[:, ends] - vertices[:, :, None]  # their signs have no part in J Jᵀ
        tensors = np.swapaxes(arms, 2, 3) @ arms
        collapsed = coincident(vertices).sum(axis=(1, 2)) > vertices.shape[1]
        tensors[collapsed] = moments(vertices[collapsed])[:, None]
        return tensors


class TensorProduct(Element):
    """A quadrilateral or a hexahedron."""

    @property
    def supports(self) -> tuple:
        """Return the vertices of edges, faces and cell that have a node in their middle."""
        if self.order == 1:
            return ()
        faces = FACES if self.dim == 3 else ()
        return (*self.cell.edges, *faces, tuple(range(self.n_vertices)))

    @property
    def collapsed(self) -> dict[str, list[int]]:
        """Return those of a linear cell, whose shape functions are those of the linear triangle,
        tetrahedron and prism when it has their vertices.
        """
        return COLLAPSED[self.dim] if self.order == 1 else {}

    @property
    def is_affine(self) -> bool:
        """Return False: the functions have mixed terms."""
        return False

    @property
    def gradient_degree(self) -> int:
        """Return the degree of the gradients: a derivative leaves that in the other coordinates."""
        return self.order

    @property
    def trace_constant(self) -> float:
        """Return (k + 1)², that of a line (Warburton & Hesthaven, CMAME 192 (2003) 2765)."""
        return (self.order + 1) ** 2

    @property
    def lebesgue_constant(self) -> float:
        """Return that of a line, for every coordinate."""
        return {1: 1.0, 2: 5 / 4}[self.order] ** self.dim

    @property
    def polygons(self) -> tuple:
        """Return the element itself, or the four parts between its nodes."""
        if self.order == 1:
            return (tuple(range(self.nodes)),)
        return ((0, 4, 8, 7), (4, 1, 5, 8), (8, 5, 2, 6), (7, 8, 6, 3))

    def shape(self, xi: np.ndarray) -> np.ndarray:
        """Return N, (Q, A), at the reference points xi, (Q, dim)."""
        return self._product(self._on_lines(xi), [0] * self.dim)

    def gradient(self, xi: np.ndarray) -> np.ndarray:
        """Return dN/dxi, (Q, A, dim), at the reference points xi, (Q, dim)."""
        lines = self._on_lines(xi)
        return np.stack([self._product(lines, row) for row in np.eye(self.dim, dtype=int)], axis=-1)

    def hessian(self, xi: np.ndarray) -> np.ndarray:
        """Return d²N/dxi², (Q, A, dim, dim), at the reference points xi, (Q, dim)."""
        lines = self._on_lines(xi)
        unit = np.eye(self.dim, dtype=int)
        rows = [
            [self._product(lines, unit[m] + unit[n]) for n in range(self.dim)]
            for m in range(self.dim)
        ]
        return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)

    def _product(self, lines, derivatives):
        """Return the products, (Q, A), of derivatives of the given order along each axis."""
        steps = np.rint(self.order * self.node_coordinates).astype(int)
        factors = [lines[k][:, i, steps[:, i]] for i, k in enumerate(derivatives)]
        return np.prod(factors, axis=0)

    def _on_lines(self, xi):
        """Return functions of a line, first and second derivatives at all coordinates of points
        xi, (Q, dim): (Q, dim, order + 1) each, nodes in ascending order.
        """
        t = np.asarray(xi, dtype=float)[:, :, None]
        one = np.ones_like(t)
        if self.order == 1:
            tables = [1 - t, t], [-one, one], [0 * one, 0 * one]
        else:
            tables = (
                [(1 - t) * (1 - 2 * t), 4 * t * (1 - t), t * (2 * t - 1)],
                [4 * t - 3, 4 - 8 * t, 4 * t - 1],
                [4 * one, -8 * one, 4 * one],
            )
        return [np.concatenate(table, axis=2) for table in tables]


SQUARE = Cube(2)
CUBE = Cube(3)

Q4 = TensorProduct("Q4", SQUARE, 1, "quad", "Quadrilateral", EDGES[2], L2)
Q9 = TensorProduct(
    "Q9", SQUARE, 2, "quad9", "Quadrilateral_9", ((0, 1, 4), (1, 2, 5), (2, 3, 6), (3, 0, 7)), L3
)
H8 = TensorProduct("H8", CUBE, 1, "hexahedron", "Hexahedron", FACES, Q4)
H27 = TensorProduct(
    "H27",
    CUBE,
    2,
    "hexahedron27",
    "Hexahedron_27",
    (
        (0, 4, 7, 3, 16, 15, 19, 11, 20),
        (1, 2, 6, 5, 9, 18, 13, 17, 21),
        (0, 1, 5, 4, 8, 17, 12, 16, 22),
        (3, 7, 6, 2, 19, 14, 18, 10, 23),
        (0, 3, 2, 1, 11, 10, 9, 8, 24),
        (4, 5, 6, 7, 12, 13, 14, 15, 25),
    ),
    Q9,
)
