"""Shape gradients and quadrature weights of elements in physical space."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..compiled import plain, specialized, stack
from ..elements import Element
from ..elements.element import Cell, moments
from ..kernels.surface import facet_normal, facet_normal_by_positions
from ..mesh.topology import is_collapsed
from ..tensors import invert

# Distance from the axis over the largest one in an element, below which a point is on the axis.
ON_AXIS = 1e-9


@dataclass(frozen=True)
class Rule:
    """A quadrature rule with the shape functions of one element at its points (Q, d).

    N (Q, A), dN (Q', A, d) on the reference cell, weights (Q,).  Q' = 1 where gradients are
    constant.
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
        gradient_points = points[:1] if element.has_constant_gradients else points
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

    Around an axis dV = 2π r |dx/dxi| w [m³] is that of the whole ring, and hoop = N/r, (E, Q, A)
    [1/m], is what a radial nodal value adds to the third diagonal entry of a gradient, u_r/r; None
    elsewhere.
    """

    G: np.ndarray
    dV: np.ndarray
    hoop: np.ndarray | None = None

    def part(self, chunk: slice | np.ndarray) -> Geometry:
        """Return the geometry of some of the elements."""
        return Geometry(
            self.G[chunk], self.dV[chunk], None if self.hoop is None else self.hoop[chunk]
        )

    @property
    def divergence(self) -> np.ndarray:
        """Return div(N_a e_i), (E, Q', A, d) [1/m]: G, and around an axis the hoop part with
        it.
        """
        if self.hoop is None:
            return self.G
        whole = self.G.copy()
        whole[..., 0] += self.hoop
        return whole

    @property
    def section(self) -> np.ndarray:
        """Return |dx/dxi| w, (E, Q) [m^d]: around an axis the area of the section, else dV."""
        return self.dV if self.hoop is None else self.dV * self.hoop.sum(axis=-1) / (2 * np.pi)


def geometry(rule: Rule, coordinates: np.ndarray) -> Geometry:
    """Return the geometry of elements with nodal coordinates (E, A, d); dV <= 0 tells an inverted
    element.
    """
    E, A, d = coordinates.shape
    points = len(rule.dN)
    G = np.empty((E, points, A, d))
    determinant = np.empty((E, points))
    _geometry_loop(A, d)(plain(rule.dN), plain(coordinates), G, determinant)
    if rule.element.axisymmetric:
        return _ring(rule, coordinates, G, determinant)
    return Geometry(G, determinant * rule.weights)


def _ring(rule, coordinates, G, determinant):
    """Return the geometry of rings; dV <= 0 where an element is inverted or has passed the axis."""
    r = coordinates[..., 0] @ rule.N.T
    volume = np.copysign(2 * np.pi * r * determinant, np.minimum(r, determinant))
    return Geometry(G, volume * rule.weights, hoop_functions(rule.N, G, r))


def hoop_functions(N: np.ndarray, G: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Return N_a/r, (E, Q, A) [1/m], on the axis its limit dN_a/dr for fields that vanish there.

    N (Q, A), G (E, Q, A, 2), r (E, Q) [m]
    """
    on_axis = np.abs(r) <= ON_AXIS * np.abs(r).max(axis=1, keepdims=True)
    hoop = N / np.where(on_axis, 1.0, r)[..., None]
    return np.where(on_axis[..., None], G[..., 0], hoop)


@specialized
def _geometry_loop(A, d):
    """Return the loop that writes dN/dx = dN/dxi (dx/dxi)^-1 and |dx/dxi| at the points of dN (Q',
    A, d).

    The derivatives of all shape functions add up to zero: differences of coordinates keep the
    digits that those of an element far from the origin lose in a sum.
    """

    def loop(dN, coordinates, G, determinant):
        jacobian = stack((d, d))
        inverse = stack((d, d))
        for e in range(len(G)):
            for q in range(len(dN)):
                for i in range(d):
                    for m in range(d):
                        total = 0.0
                        for a in range(1, A):
                            along = coordinates[e, a, i] - coordinates[e, 0, i]
                            total += along * dN[q, a, m]
                        jacobian[i, m] = total
                determinant[e, q] = invert(d, jacobian, inverse)
                for a in range(A):
                    for i in range(d):
                        total = 0.0
                        for m in range(d):
                            total += dN[q, a, m] * inverse[m, i]
                        G[e, q, a, i] = total

    return loop


def facet_measure(rule: Rule, coordinates: np.ndarray) -> np.ndarray:
    """Return the outward normals times dA, (F, Q, d) [m^(d-1)], at the points of a rule of facets
    with nodal coordinates (F, A, d); around an axis dA [m²] is that of the whole ring.
    """
    normal = facet_normal(rule.dN, rule.weights, coordinates)
    if rule.element.axisymmetric:
        normal = normal * (2 * np.pi * coordinates[..., 0] @ rule.N.T)[..., None]
    return normal


def facet_measure_by_positions(rule: Rule, coordinates: np.ndarray) -> np.ndarray:
    """Return the derivative of `facet_measure` (component i) by the positions x_bj, (F, Q, b, i, j)
    [m^(d-2)], around an axis [m].
    """
    change = facet_normal_by_positions(rule.dN, rule.weights, coordinates)
    if rule.element.axisymmetric:
        around = 2 * np.pi * coordinates[..., 0] @ rule.N.T
        change = change * around[..., None, None, None]
        normal = facet_normal(rule.dN, rule.weights, coordinates)
        change[..., 0] += 2 * np.pi * rule.N[..., None] * normal[:, :, None]
    return change


@dataclass(frozen=True)
class SecondDerivatives:
    """Second derivatives by x on elements whose gradients are not constant, in one configuration:

        d²U/dx_i dx_j = (d²U/dxi_m dxi_n - dU/dx_k d²x_k/dxi_m dxi_n) dxi_m/dx_i dxi_n/dx_j

    G (E, Q, A, d) [1/m]; bend (E, Q', d, d²) = d²x_k/dxi_m dxi_n [m], Q' = 1 where it is constant;
    reference_slope (E, Q, d), the `volume_slope` of the reference configuration.

    Around an axis a field is one in space, whose derivatives are taken at a point with the
    directions r, z and, third, around the axis: hoop (E, Q, A) of `Geometry` and radial_slope (E,
    Q, d) = d ln r / dxi_m; None elsewhere.
    """

    rule: Rule
    G: np.ndarray
    bend: np.ndarray
    reference_slope: np.ndarray | None
    hoop: np.ndarray | None = None
    radial_slope: np.ndarray | None = None

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
        hoop = geometry_of_elements.hoop
        slope = None
        if hoop is not None:
            along = np.einsum("ea,qam->eqm", coordinates[..., 0], rule.dN)
            slope = along * hoop.sum(axis=-1, keepdims=True)
        bend = _by_reference(rule, coordinates - coordinates[:, :1])
        return cls(rule, geometry_of_elements.G, bend, reference_slope, hoop, slope)

    def part(self, chunk: slice | np.ndarray) -> SecondDerivatives:
        """Return those of some of the elements."""
        hoop, slope = (
            None if array is None else array[chunk] for array in (self.hoop, self.radial_slope)
        )
        return SecondDerivatives(
            self.rule,
            self.G[chunk],
            self.bend[chunk],
            None if self.reference_slope is None else self.reference_slope[chunk],
            hoop,
            slope,
        )

    @cached_property
    def shapes(self) -> np.ndarray:
        """Return d²N_a/dx_i dx_j, (E, Q, A, d, d) [1/m²]."""
        return self._to_space(_flat(self.rule.hessian), self.G)

    def field(self, U: np.ndarray, gradient: np.ndarray) -> np.ndarray:
        """Return d²U_k/dx_i dx_j, (E, Q, k, d, d), of nodal values U (E, A, k) with dU_k/dx_j (E,
        Q, k, d); around an axis of a vector in space, (E, Q, 3, 3, 3), with its gradient (E, Q, 3,
        3).
        """
        if self.hoop is None:
            return self._to_space(_by_reference(self.rule, U), gradient)
        second = np.zeros((*gradient.shape, 3))
        plane = np.ascontiguousarray(gradient[..., :2, :2])
        second[..., :2, :2, :2] = self._to_space(_by_reference(self.rule, U), plane)
        radial, axial, other = self._around(gradient)
        second[..., 0, 2, 2] = second[..., 2, 0, 2] = second[..., 2, 2, 0] = radial
        second[..., 2, 1, 2] = second[..., 2, 2, 1] = axial
        second[..., 1, 2, 2] = other
        return second

    def _around(self, gradient):
        """Return ∂_θ∂_θ U_r = ∂_r ∂_θ U_θ = ∂_r (U_r/r), ∂_z ∂_θ U_θ = ∂_z U_r/r and ∂_θ∂_θ U_z =
        ∂_r U_z/r, (E, Q) each, of a vector around the axis with its gradient in space.
        """
        over_r = self.hoop.sum(axis=-1)
        return (
            (gradient[..., 0, 0] - gradient[..., 2, 2]) * over_r,
            gradient[..., 0, 1] * over_r,
            gradient[..., 1, 0] * over_r,
        )

    @cached_property
    def shapes_around(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return ∂_r (N_a/r), ∂_z N_a/r and ∂_r N_a/r, (E, Q, A) each, the parts of `shapes` around
        an axis.
        """
        hoop = self.hoop
        assert hoop is not None  # nobody asks where there is no axis
        over_r = hoop.sum(axis=-1, keepdims=True)
        return (
            (self.G[..., 0] - hoop) * over_r,
            self.G[..., 1] * over_r,
            self.G[..., 0] * over_r,
        )

    def viscous(self, U: np.ndarray, gradient: np.ndarray) -> np.ndarray:
        """Return ΔU + ∇ div U, (E, Q, d), of nodal values U (E, A, d) with dU_k/dx_j (E, Q, d, d):
        `field` contracted early; around an axis (E, Q, 3).
        """
        if self.hoop is not None:
            second = self.field(U, gradient)
            return np.einsum("eqijj->eqi", second) + np.einsum("eqjji->eqi", second)
        inverse = self._inverse_jacobian
        d = self.rule.element.dim
        second = _by_reference(self.rule, U) - self._bent(gradient)
        metric = (inverse @ np.swapaxes(inverse, 2, 3)).reshape(*inverse.shape[:2], d * d, 1)
        mixed = np.einsum("eqlmn,eqnl->eqm", second.reshape(*inverse.shape[:2], d, d, d), inverse)
        return (second @ metric + np.swapaxes(inverse, 2, 3) @ mixed[..., None])[..., 0]

    def _to_space(self, second, gradient):
        """Return second derivatives by x, (E, Q, k, d, d), from those by xi, (..., k, d²), and
        first ones by x, (E, Q, k, d).
        """
        d = self.rule.element.dim
        pairs = np.einsum(
            "eqmi,eqnj->eqmnij", self._inverse_jacobian, self._inverse_jacobian
        ).reshape(*self.G.shape[:2], d * d, d * d)
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
    def _inverse_jacobian(self):
        """Return dxi/dx, (E, Q, d, d) [1/m]: the map represents xi by its values at the nodes."""
        return self.rule.element.node_coordinates.T @ self.G

    @property
    def volume_slope(self) -> np.ndarray:
        """Return d ln|dx/dxi| / dxi_m = dxi_n/dx_k d²x_k/dxi_n dxi_m, (E, Q, d); around an axis
        that of r|dx/dxi|.
        """
        slope = self._section_slope
        return slope if self.radial_slope is None else slope + self.radial_slope

    @property
    def _section_slope(self) -> np.ndarray:
        E, Q, _, d = self.G.shape
        points = self.bend.shape[1]
        bend = np.swapaxes(self.bend.reshape(E, points, d, d, d), 2, 3)
        bend = bend.reshape(E, points, d * d, d)
        inverse = self._inverse_jacobian.reshape(E, Q, d * d)
        return inverse @ bend[:, 0] if bend.shape[1] == 1 else (inverse[:, :, None] @ bend)[:, :, 0]

    @property
    def volume_gradient(self) -> np.ndarray:
        """Return ∇ ln J, (E, Q, d) [1/m], J the volume ratio to the reference configuration."""
        return np.einsum(
            "eqmi,eqm->eqi", self._inverse_jacobian, self.volume_slope - self.reference_slope
        )


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
    a right-angled simplex, or the edge of a cube, of the same volume, per node spacing; of a ring
    that of its section.

    cells (E, A) nodes, of which a collapsed cell has some twice
    """
    section = geometry_of_elements.section
    volume = np.broadcast_to(section, (len(section), len(rule.weights))).sum(axis=1)
    count = np.full(len(cells), float(element.cell.count_in_cube))
    collapsed = is_collapsed(cells, element)
    if collapsed.any():
        first = (cells[collapsed, :, None] == cells[collapsed, None]).argmax(axis=2)
        reference = geometry(rule, element.node_coordinates[first]).section
        count[collapsed] = 1 / np.broadcast_to(reference, (len(first), len(rule.weights))).sum(
            axis=1
        )
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
