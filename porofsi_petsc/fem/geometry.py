"""Shape gradients and quadrature weights of elements in physical space."""

from dataclasses import dataclass

import numpy as np

from ..elements.quadrature import quadrature
from ..tensors import inverse


@dataclass(frozen=True)
class Rule:
    """A quadrature rule with the shape functions of one element at its points.

    N (Q, A), dN (Q', A, d) on the reference simplex, weights (Q,).  Q' = 1 for affine elements, whose gradients are constant.
    """

    N: np.ndarray
    dN: np.ndarray
    weights: np.ndarray

    @classmethod
    def of(cls, element, degree):
        """Return the rule of the degree on the element."""
        points, weights = quadrature(element.dim, degree)
        gradient_points = points[:1] if element.order == 1 else points
        return cls(element.shape(points), element.gradient(gradient_points), weights)


@dataclass(frozen=True)
class Geometry:
    """Elements in one configuration: G = dN/dx, (E, Q', A, d) [1/m], and dV = |dx/dxi| w, (E, Q) [m^d]."""

    G: np.ndarray
    dV: np.ndarray

    def part(self, chunk):
        """Return the geometry of a slice of the elements."""
        return Geometry(self.G[chunk], self.dV[chunk])


def geometry(rule, coordinates):
    """Return the geometry of elements with nodal coordinates (E, A, d); dV <= 0 tells an inverted element."""
    jacobian = np.swapaxes(coordinates, 1, 2)[:, None] @ rule.dN
    jacobian_inverse, determinant = inverse(jacobian)
    return Geometry(rule.dN @ jacobian_inverse, determinant * rule.weights)


def shape_hessians(element, coordinates):
    """Return d2N/dx2, (E, A, d, d) [1/m²], of the affine part of the map (exact on straight-sided elements)."""
    pull = _affine_pull(element, coordinates)
    return np.swapaxes(pull, 1, 2)[:, None] @ element.hessian() @ pull[:, None]


def affine_gradients(element, coordinates):
    """Return how the affine part of the map follows the nodes, (E, A, d) [1/m]: barycentric gradients, 0 beside the vertices."""
    gradients, d = np.zeros(coordinates.shape), element.dim
    gradients[:, 1 : d + 1] = _affine_pull(element, coordinates)
    gradients[:, 0] = -gradients.sum(axis=1)
    return gradients


def _affine_pull(element, coordinates):
    """Return dxi/dx of the affine part of the map, (E, d, d) [1/m]."""
    edges = coordinates[:, 1 : element.dim + 1] - coordinates[:, :1]
    return inverse(np.swapaxes(edges, 1, 2))[0]


def element_size(element, rule, geometry_of_elements):
    """Return h = (d! V)^(1/d) / order, (E,) [m]: the leg of a right-angled simplex of the same volume, per node spacing."""
    factorial = {2: 2.0, 3: 6.0}[element.dim]
    volume = np.broadcast_to(geometry_of_elements.dV, (len(geometry_of_elements.dV), len(rule.weights))).sum(axis=1)
    return (factorial * volume) ** (1 / element.dim) / element.order
