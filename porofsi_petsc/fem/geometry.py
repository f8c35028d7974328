"""Shape gradients and quadrature weights of elements in physical space."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..compiled import plain, specialized, stack
from ..elements import Element
from ..elements.quadrature import quadrature
from ..tensors import invert


@dataclass(frozen=True)
class Rule:
    """A quadrature rule with the shape functions of one element at its points.

    N (Q, A), dN (Q', A, d) on the reference simplex, weights (Q,).  Q' = 1 for affine elements,
    whose gradients are constant.
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
    """Elements in one configuration: G = dN/dx, (E, Q', A, d) [1/m], and dV = |dx/dxi| w, (E, Q)
    [m^d].
    """

    G: np.ndarray
    dV: np.ndarray

    def part(self, chunk):
        """Return the geometry of a slice of the elements."""
        return Geometry(self.G[chunk], self.dV[chunk])


def geometry(rule, coordinates):
    """Return the geometry of elements with nodal coordinates (E, A, d); dV <= 0 tells an inverted
    element.
    """
    E, A, d = coordinates.shape
    points = len(rule.dN)
    G = np.empty((E, points, A, d))
    determinant = np.empty((E, points))
    _geometry_loop(A, d)(plain(rule.dN), plain(coordinates), G, determinant)
    return Geometry(G, determinant * rule.weights)


@specialized
def _geometry_loop(A, d):
    """Return the loop that writes dN/dx = dN/dxi (dx/dxi)^-1 and |dx/dxi| at the points of dN (Q',
    A, d).
    """

    def loop(dN, coordinates, G, determinant):
        jacobian = stack((d, d))
        pull = stack((d, d))
        for e in range(len(G)):
            for q in range(len(dN)):
                for i in range(d):
                    for m in range(d):
                        total = 0.0
                        for a in range(A):
                            total += coordinates[e, a, i] * dN[q, a, m]
                        jacobian[i, m] = total
                determinant[e, q] = invert(d, jacobian, pull)
                for a in range(A):
                    for i in range(d):
                        total = 0.0
                        for m in range(d):
                            total += dN[q, a, m] * pull[m, i]
                        G[e, q, a, i] = total

    return loop


@dataclass(frozen=True)
class SecondDerivatives:
    """Second derivatives by x on quadratic elements in one configuration, curved ones included:

        d²U/dx_i dx_j = (d²U/dxi_m dxi_n - dU/dx_k d²x_k/dxi_m dxi_n) dxi_m/dx_i dxi_n/dx_j

    G (E, Q, A, d) [1/m]; bend (E, d, d²) = d²x_k/dxi_m dxi_n [m]; reference_slope (E, Q, d), the
    `volume_slope` of the reference configuration.
    """

    element: Element
    G: np.ndarray
    bend: np.ndarray
    reference_slope: np.ndarray | None

    @classmethod
    def at(cls, element, coordinates, geometry_of_elements, reference_slope):
        """Return those of elements with nodal coordinates (E, A, d); without a reference slope
        there is no `volume_gradient`.
        """
        return cls(
            element, geometry_of_elements.G, _by_reference(element, coordinates), reference_slope
        )

    def part(self, chunk):
        """Return those of a slice of the elements."""
        return SecondDerivatives(
            self.element, self.G[chunk], self.bend[chunk], self.reference_slope[chunk]
        )

    @cached_property
    def shapes(self):
        """Return d²N_a/dx_i dx_j, (E, Q, A, d, d) [1/m²]."""
        hessian = self.element.hessian()
        return self._to_space(hessian.reshape(len(hessian), -1), self.G)

    def field(self, U, gradient):
        """Return d²U_k/dx_i dx_j, (E, Q, k, d, d), of nodal values U (E, A, k) with dU_k/dx_j (E,
        Q, k, d).
        """
        return self._to_space(_by_reference(self.element, U)[:, None], gradient)

    def viscous(self, U, gradient):
        """Return ΔU + ∇ div U, (E, Q, d), of nodal values U (E, A, d) with dU_k/dx_j (E, Q, d, d):
        `field` contracted early.
        """
        pull = self._pull
        d = self.element.dim
        second = _by_reference(self.element, U)[:, None] - self._bent(gradient)
        metric = (pull @ np.swapaxes(pull, 2, 3)).reshape(*pull.shape[:2], d * d, 1)
        mixed = np.einsum("eqlmn,eqnl->eqm", second.reshape(*pull.shape[:2], d, d, d), pull)
        return (second @ metric + np.swapaxes(pull, 2, 3) @ mixed[..., None])[..., 0]

    def _to_space(self, second, gradient):
        """Return second derivatives by x, (E, Q, k, d, d), from those by xi, (..., k, d²), and
        first ones by x, (E, Q, k, d).
        """
        d = self.element.dim
        pairs = np.einsum("eqmi,eqnj->eqmnij", self._pull, self._pull).reshape(
            *self.G.shape[:2], d * d, d * d
        )
        return ((second - self._bent(gradient)) @ pairs).reshape(*gradient.shape, d)

    def _bent(self, gradient):
        """Return dU_k/dx_l d²x_l/dxi_m dxi_n, (E, Q, k, d²), of dU_k/dx_l (E, Q, k, d): one product
        for each element.
        """
        E, Q, k, d = gradient.shape
        return (gradient.reshape(E, Q * k, d) @ self.bend).reshape(E, Q, k, d * d)

    @cached_property
    def _pull(self):
        """Return dxi/dx, (E, Q, d, d) [1/m]: the map represents xi by its values at the nodes."""
        return self.element.node_coordinates.T @ self.G

    @property
    def volume_slope(self):
        """Return d ln|dx/dxi| / dxi_m = dxi_n/dx_k d²x_k/dxi_n dxi_m, (E, Q, d)."""
        E, Q, _, d = self.G.shape
        bend = np.swapaxes(self.bend.reshape(E, d, d, d), 1, 2)
        return self._pull.reshape(E, Q, d * d) @ bend.reshape(E, d * d, d)

    @property
    def volume_gradient(self):
        """Return ∇ ln J, (E, Q, d) [1/m], J the volume ratio to the reference configuration."""
        return np.einsum("eqmi,eqm->eqi", self._pull, self.volume_slope - self.reference_slope)


def _by_reference(element, U):
    """Return d²U_k/dxi_m dxi_n, (E, k, d²), of nodal values (E, A, k)."""
    hessian = element.hessian()
    return np.swapaxes(U, 1, 2) @ hessian.reshape(len(hessian), -1)


def element_size(element, rule, geometry_of_elements):
    """Return h = (d! V)^(1/d) / order, (E,) [m]: the leg of a right-angled simplex of the same
    volume, per node spacing.
    """
    factorial = {2: 2.0, 3: 6.0}[element.dim]
    volume = np.broadcast_to(
        geometry_of_elements.dV, (len(geometry_of_elements.dV), len(rule.weights))
    ).sum(axis=1)
    return (factorial * volume) ** (1 / element.dim) / element.order


def element_size_tensor(vertices, h):
    """Return the tensor of the second moments of the vertices, scaled to det = h^(2 d), (E, d, d)
    [m²].

    An element that is stretched has one length along and another one across; a regular one has h²
    times the identity. vertices (E, d + 1, d); h (E,) of `element_size`
    """
    moments = _moments(vertices)
    return moments * (h**2 / np.linalg.det(moments) ** (1 / vertices.shape[-1]))[:, None, None]


def shape_quality(vertices):
    """Return d det(M)^(1/d) / tr M of simplices, M the second moments of their vertices (E, d + 1,
    d), (E,).

    The mean ratio d det(A)^(2/d) / A:A of the map A of a regular simplex (Knupp, SIAM J. Sci.
    Comput. 23 (2001) 193): 1 for a regular one, 0 for a flat one, whatever its size.
    """
    moments = _moments(vertices)
    d = vertices.shape[-1]
    return d * np.linalg.det(moments) ** (1 / d) / np.trace(moments, axis1=1, axis2=2)


def _moments(vertices):
    """Return the second moments of the vertices (E, d + 1, d) about their mean, (E, d, d) [m²]."""
    arms = vertices - vertices.mean(axis=1, keepdims=True)
    return np.swapaxes(arms, 1, 2) @ arms
