"""Shape gradients and quadrature weights of elements in physical space."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..compiled import plain, specialized, stack
from ..elements import Element
from ..elements.element import Cell, moments
from ..mesh.topology import is_collapsed
from ..tensors import invert


@dataclass(frozen=True)
class Rule:
    """A quadrature rule with the shape functions of one element at its points (Q, d).

    N (Q, A), dN (Q', A, d) on the reference cell, weights (Q,).  Q' = 1 for affine elements, whose
    gradients are constant.
    """

    element: Element
    points: np.ndarray
    N: np.ndarray
    dN: np.ndarray
    weights: np.ndarray

    @classmethod
    def of(cls, element: Element, degree: int) -> Rule:
        """Return the rule of the degree on the element."""
        return cls.at(element, *element.cell.quadrature(degree))

    @classmethod
    def at(cls, element: Element, points: np.ndarray, weights: np.ndarray) -> Rule:
        """Return the rule with points (Q, d) and weights (Q,)."""
        gradient_points = points[:1] if element.is_affine else points
        return cls(
            element, points, element.shape(points), element.gradient(gradient_points), weights
        )

    @cached_property
    def hessian(self) -> np.ndarray:
        """Return d²N/dxi², (Q', A, d, d), at the points; Q' = 1 where it is constant."""
        return self.element.hessian(self.points)


@dataclass(frozen=True)
class Geometry:
    """Elements in one configuration: G = dN/dx, (E, Q', A, d) [1/m], and dV = |dx/dxi| w, (E, Q)
    [m^d].
    """

    G: np.ndarray
    dV: np.ndarray

    def part(self, chunk: slice) -> Geometry:
        """Return the geometry of a slice of the elements."""
        return Geometry(self.G[chunk], self.dV[chunk])


def geometry(rule: Rule, coordinates: np.ndarray) -> Geometry:
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
    """Second derivatives by x on elements that are not affine, in one configuration:

        d²U/dx_i dx_j = (d²U/dxi_m dxi_n - dU/dx_k d²x_k/dxi_m dxi_n) dxi_m/dx_i dxi_n/dx_j

    G (E, Q, A, d) [1/m]; bend (E, Q', d, d²) = d²x_k/dxi_m dxi_n [m], Q' = 1 where it is constant;
    reference_slope (E, Q, d), the `volume_slope` of the reference configuration.
    """

    rule: Rule
    G: np.ndarray
    bend: np.ndarray
    reference_slope: np.ndarray | None

    @classmethod
    def at(
        cls,
        rule: Rule,
        coordinates: np.ndarray,
        geometry_of_elements: Geometry,
        reference_slope: np.ndarray | None,
    ) -> SecondDerivatives:
        """Return those at the points of a rule, of elements with nodal coordinates (E, A, d);
        without a reference slope there is no `volume_gradient`.
        """
        return cls(rule, geometry_of_elements.G, _by_reference(rule, coordinates), reference_slope)

    def part(self, chunk: slice) -> SecondDerivatives:
        """Return those of a slice of the elements."""
        return SecondDerivatives(
            self.rule,
            self.G[chunk],
            self.bend[chunk],
            None if self.reference_slope is None else self.reference_slope[chunk],
        )

    @cached_property
    def shapes(self) -> np.ndarray:
        """Return d²N_a/dx_i dx_j, (E, Q, A, d, d) [1/m²]."""
        return self._to_space(_flat(self.rule.hessian), self.G)

    def field(self, U: np.ndarray, gradient: np.ndarray) -> np.ndarray:
        """Return d²U_k/dx_i dx_j, (E, Q, k, d, d), of nodal values U (E, A, k) with dU_k/dx_j (E,
        Q, k, d).
        """
        return self._to_space(_by_reference(self.rule, U), gradient)

    def viscous(self, U: np.ndarray, gradient: np.ndarray) -> np.ndarray:
        """Return ΔU + ∇ div U, (E, Q, d), of nodal values U (E, A, d) with dU_k/dx_j (E, Q, d, d):
        `field` contracted early.
        """
        pull = self._pull
        d = self.rule.element.dim
        second = _by_reference(self.rule, U) - self._bent(gradient)
        metric = (pull @ np.swapaxes(pull, 2, 3)).reshape(*pull.shape[:2], d * d, 1)
        mixed = np.einsum("eqlmn,eqnl->eqm", second.reshape(*pull.shape[:2], d, d, d), pull)
        return (second @ metric + np.swapaxes(pull, 2, 3) @ mixed[..., None])[..., 0]

    def _to_space(self, second, gradient):
        """Return second derivatives by x, (E, Q, k, d, d), from those by xi, (..., k, d²), and
        first ones by x, (E, Q, k, d).
        """
        d = self.rule.element.dim
        pairs = np.einsum("eqmi,eqnj->eqmnij", self._pull, self._pull).reshape(
            *self.G.shape[:2], d * d, d * d
        )
        return ((second - self._bent(gradient)) @ pairs).reshape(*gradient.shape, d)

    def _bent(self, gradient):
        """Return dU_k/dx_l d²x_l/dxi_m dxi_n, (E, Q, k, d²), of dU_k/dx_l (E, Q, k, d): one product
        for each element where the latter is constant.
        """
        if self.bend.shape[1] > 1:
            return gradient @ self.bend
        E, Q, k, d = gradient.shape
        return (gradient.reshape(E, Q * k, d) @ self.bend[:, 0]).reshape(E, Q, k, d * d)

    @cached_property
    def _pull(self):
        """Return dxi/dx, (E, Q, d, d) [1/m]: the map represents xi by its values at the nodes."""
        return self.rule.element.node_coordinates.T @ self.G

    @property
    def volume_slope(self) -> np.ndarray:
        """Return d ln|dx/dxi| / dxi_m = dxi_n/dx_k d²x_k/dxi_n dxi_m, (E, Q, d)."""
        E, Q, _, d = self.G.shape
        bend = np.swapaxes(self.bend.reshape(E, -1, d, d, d), 2, 3).reshape(E, -1, d * d, d)
        pull = self._pull.reshape(E, Q, d * d)
        return pull @ bend[:, 0] if bend.shape[1] == 1 else (pull[:, :, None] @ bend)[:, :, 0]

    @property
    def volume_gradient(self) -> np.ndarray:
        """Return ∇ ln J, (E, Q, d) [1/m], J the volume ratio to the reference configuration."""
        return np.einsum("eqmi,eqm->eqi", self._pull, self.volume_slope - self.reference_slope)


def _by_reference(rule, U):
    """Return d²U_k/dxi_m dxi_n, (E, Q', k, d²), of nodal values (E, A, k)."""
    return np.swapaxes(U, 1, 2)[:, None] @ _flat(rule.hessian)


def _flat(hessian):
    """Return second derivatives (Q', A, d, d) as (Q', A, d²)."""
    return hessian.reshape(*hessian.shape[:2], -1)


def element_size(
    element: Element, rule: Rule, geometry_of_elements: Geometry, cells: np.ndarray
) -> np.ndarray:
    """Return h = (V/V_0)^(1/d) / order, (E,) [m], V_0 the volume of the reference cell: the leg of
    a right-angled simplex, or the edge of a cube, of the same volume, per node spacing.

    cells (E, A) nodes, of which a collapsed cell has some twice
    """
    volume = np.broadcast_to(
        geometry_of_elements.dV, (len(geometry_of_elements.dV), len(rule.weights))
    ).sum(axis=1)
    count = np.full(len(cells), float(element.cell.count_in_cube))
    collapsed = is_collapsed(cells, element)
    if collapsed.any():
        first = (cells[collapsed, :, None] == cells[collapsed, None]).argmax(axis=2)
        count[collapsed] = 1 / geometry(rule, element.node_coordinates[first]).dV.sum(axis=1)
    return (count * volume) ** (1 / element.dim) / element.order


def element_size_tensor(vertices: np.ndarray, h: np.ndarray) -> np.ndarray:
    """Return the tensor of the second moments of the vertices, scaled to det = h^(2 d), (E, d, d)
    [m²].

    An element that is stretched has one length along and another one across; a regular one has h²
    times the identity.  On parallelograms it is the inverse of the metric tensor of the map from
    the reference cell (Bazilevs et al., CMAME 197 (2007) 173), up to its determinant.
    vertices (E, V, d); h (E,) of `element_size`
    """
    M = moments(vertices)
    return M * (h**2 / np.linalg.det(M) ** (1 / vertices.shape[-1]))[:, None, None]


def shape_quality(cell: Cell, vertices: np.ndarray) -> np.ndarray:
    """Return the least d det(M)^(1/d) / tr M of the `Cell.shape_tensors` M of elements, (E,).

    The mean ratio d det(A)^(2/d) / A:A of the map A of an equilateral cell (Knupp, SIAM J. Sci.
    Comput. 23 (2001) 193): 1 for an equilateral one, 0 for a flat one, whatever its size.
    vertices (E, V, d)
    """
    M = cell.shape_tensors(vertices)
    d = vertices.shape[-1]
    return (d * np.linalg.det(M) ** (1 / d) / np.trace(M, axis1=2, axis2=3)).min(axis=1)
