"""What an element is: a reference cell with shape functions of an order on it.

An element that is added is one class of shape functions, or one line of a class that is here.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True)
class Cell(ABC):
    """A reference cell, its first vertex at the origin and the legs at it of length 1."""

    dim: int

    @property
    @abstractmethod
    def vertices(self) -> np.ndarray:
        """Return the coordinates of the vertices, (V, dim)."""

    @property
    @abstractmethod
    def edges(self) -> tuple:
        """Return the pairs of vertices of the edges, in VTK's order."""

    @property
    @abstractmethod
    def facet_vertices(self) -> int:
        """Return the number of vertices of a facet."""

    @property
    @abstractmethod
    def count_in_cube(self) -> int:
        """Return how many cells of the same volume the unit cube has."""

    @property
    @abstractmethod
    def simplices(self) -> np.ndarray:
        """Return the vertices of the simplices that the cell is cut into, (S, dim + 1)."""

    @property
    @abstractmethod
    def parts(self) -> list:
        """Return vertices, edges, ... and the cell: their own cell, one vertex (dim,), the legs
        there (k, dim).
        """

    @property
    def centroid(self) -> np.ndarray:
        """Return the mean of the vertices, (1, dim)."""
        return self.vertices.mean(axis=0, keepdims=True)

    @abstractmethod
    def vertex_functions(self, xi: np.ndarray) -> np.ndarray:
        """Return the shape functions of order 1, (Q, V), at the points xi, (Q, dim)."""

    @property
    @abstractmethod
    def vertex_gradient(self) -> np.ndarray:
        """Return the derivatives of `vertex_functions` at the centroid, (V, dim)."""

    @abstractmethod
    def contains(self, xi: np.ndarray, tolerance: float) -> np.ndarray:
        """Return which points xi, (Q, dim), are in the cell, (Q,) bool."""

    @abstractmethod
    def quadrature(self, degree: int) -> tuple[np.ndarray, np.ndarray]:
        """Return points (Q, dim) and weights (Q,), exact for shape functions of the degree."""

    @abstractmethod
    def closed_quadrature(self) -> tuple[np.ndarray, np.ndarray]:
        """Return points (Q, dim), the vertices among them, and weights (Q,), exact for products of
        two gradients of order 2.
        """

    @abstractmethod
    def subdivided(self, degree: int, n: int) -> tuple[np.ndarray, np.ndarray]:
        """Return points and weights of the degree on each of the n^dim parts of a line or plane
        cell whose edges are cut into n.
        """

    @abstractmethod
    def shape_tensors(self, vertices: np.ndarray) -> np.ndarray:
        """Return A Aᵀ of the maps A from an equilateral cell to cells with vertices (E, V, dim),
        (E, K, dim, dim), up to a number: where A varies, that at the vertices.
        """


@dataclass(frozen=True)
class Element(ABC):
    """Lagrange functions of an order on a reference cell; nodes in VTK's order, the vertices first.

    meshio_name, xdmf_name : what it is called in mesh files and in XDMF
    facets : local nodes of every facet in the order of the nodes of `facet`, the element of one
    dimension less (outward orientation; None on a line, where nobody asks for it)
    axisymmetric : whether a plane element stands for the ring that it makes around the axis x = 0,
    with coordinates (r, z)
    """

    name: str
    cell: Cell
    order: int
    meshio_name: str
    xdmf_name: str
    facets: tuple
    facet: "Element"
    axisymmetric: bool = False

    def around_axis(self) -> "Element":
        """Return the same plane element, or line, as a ring."""
        facet = self.facet.around_axis() if self.dim > 1 else self.facet
        return replace(self, facet=facet, axisymmetric=True)

    @property
    def has_constant_gradients(self) -> bool:
        """Return whether gradients of vectors are constant over every element: the hoop strain
        u_r/r of a ring is not.
        """
        return self.is_affine and not self.axisymmetric

    @property
    def dim(self) -> int:
        """Return the dimension of the reference cell."""
        return self.cell.dim

    @property
    def n_vertices(self) -> int:
        """Return the number of vertices, which are the first nodes."""
        return len(self.cell.vertices)

    @property
    def nodes(self) -> int:
        """Return the number of nodes."""
        return self.n_vertices + len(self.supports)

    @property
    @abstractmethod
    def supports(self) -> tuple:
        """Return for each node that is no vertex the vertices in whose middle it is."""

    @property
    def node_coordinates(self) -> np.ndarray:
        """Return the reference coordinates of the nodes, (A, dim)."""
        vertices = self.cell.vertices
        return np.vstack([vertices, *(vertices[list(s)].mean(axis=0) for s in self.supports)])

    @property
    def facet_corners(self) -> np.ndarray:
        """Return the local vertices of every facet, (facets, vertices of a facet)."""
        return np.array(self.facets)[:, : self.cell.facet_vertices]

    @property
    def collapsed(self) -> dict[str, list[int]]:
        """Return meshio's names of cells that this one is when vertices fall together, and of which
        of their nodes its own are.
        """
        return {}

    @property
    @abstractmethod
    def is_affine(self) -> bool:
        """Return whether gradients are constant over every element, and second derivatives zero."""

    @property
    @abstractmethod
    def gradient_degree(self) -> int:
        """Return the degree of the gradients, in the meaning of `Cell.quadrature`."""

    @property
    @abstractmethod
    def trace_constant(self) -> float:
        """Return the least C with ∮_f w² dA <= C A/V ∫ w² dV on a facet f of an affine element."""

    @property
    @abstractmethod
    def lebesgue_constant(self) -> float:
        """Return the largest Σ |N_a| in the cell: how far over its farthest node from a point a
        curved element may reach.
        """

    @property
    @abstractmethod
    def polygons(self) -> tuple:
        """Return the local nodes of the polygons, of one number of vertices, that a plane element
        is drawn as, or of the segments of a line; no three nodes at the begin are in a row.
        """

    @abstractmethod
    def shape(self, xi: np.ndarray) -> np.ndarray:
        """Return N, (Q, A), at the reference points xi, (Q, dim)."""

    @abstractmethod
    def gradient(self, xi: np.ndarray) -> np.ndarray:
        """Return dN/dxi, (Q, A, dim), at the reference points xi, (Q, dim)."""

    @abstractmethod
    def hessian(self, xi: np.ndarray) -> np.ndarray:
        """Return d²N/dxi², (Q', A, dim, dim), at the points xi, (Q, dim); Q' = 1 where constant."""

    @property
    def mirror(self) -> list[int]:
        """Return the numbers of the nodes when the first two reference coordinates are swapped."""
        nodes = self.node_coordinates.tolist()
        return [nodes.index([y, x, *rest]) for x, y, *rest in nodes]


def moments(vertices: np.ndarray) -> np.ndarray:
    """Return the second moments of vertices (E, V, d) about their mean, (E, d, d) [m²]; those that
    fall together count once.
    """
    if vertices.shape[1] == vertices.shape[2] + 1:  # a simplex
        arms = vertices - vertices.mean(axis=1, keepdims=True)
        return np.swapaxes(arms, 1, 2) @ arms
    weights = 1 / coincident(vertices).sum(axis=2)[..., None]
    mean = (weights * vertices).sum(axis=1, keepdims=True) / weights.sum(axis=1, keepdims=True)
    arms = vertices - mean
    return np.swapaxes(weights * arms, 1, 2) @ arms


def coincident(vertices: np.ndarray) -> np.ndarray:
    """Return which pairs of vertices (E, V, d) are the same point, (E, V, V) bool."""
    return (vertices[:, :, None] == vertices[:, None]).all(axis=3)
