"""Every element on its reference cell: shape functions, derivatives, quadrature, facets, node
order.
"""

from itertools import product
from math import factorial, prod

import numpy as np
import pytest
from kernel_states import FD_STEP, FD_TOLERANCE

from porofsi_petsc.elements import ELEMENTS
from porofsi_petsc.elements.tensor import Cube
from porofsi_petsc.kernels.surface import facet_normal

# Nodes of VTK's (bi)quadratic quadrilateral and (tri)quadratic hexahedron in [0, 2]^d (vtk.org,
# classes vtkQuadraticQuad, vtkBiQuadraticQuad, vtkQuadraticHexahedron and
# vtkTriQuadraticHexahedron, their coordinates times 2): middles of edges, of faces x-, x+, y-, y+,
# z-, z+, and of the cell.
Q8 = ["00", "20", "22", "02", "10", "21", "12", "01"]
H20 = [
    *("000", "200", "220", "020", "002", "202", "222", "022"),
    *("100", "210", "120", "010", "102", "212", "122", "012"),
    *("001", "201", "221", "021"),
]
VTK = {
    "Q8": Q8,
    "Q9": [*Q8, "11"],
    "H20": H20,
    "H27": [*H20, "011", "211", "101", "121", "110", "112", "111"],
}


@pytest.fixture(params=ELEMENTS)
def element(request):
    return ELEMENTS[request.param]


def inside(element, count=5):
    """Return points of the cell, (count, d)."""
    rng = np.random.default_rng(31)
    weights = rng.dirichlet(np.ones(element.n_vertices), count)
    return weights @ element.cell.vertices


def test_a_shape_function_is_one_at_its_node_and_all_are_one_together(element):
    assert np.allclose(element.shape(element.node_coordinates), np.eye(element.nodes), atol=1e-15)
    xi = inside(element)
    assert np.allclose(element.shape(xi).sum(axis=1), 1, rtol=0, atol=1e-14)
    assert np.allclose(element.shape(xi) @ element.node_coordinates, xi, rtol=0, atol=1e-14)


def test_derivatives_are_those_of_the_shape_functions(element):
    xi = inside(element)
    hessian = np.broadcast_to(element.hessian(xi), (len(xi), element.nodes, *(element.dim,) * 2))
    for m, step in enumerate(FD_STEP * np.eye(element.dim)):
        slope = (element.shape(xi + step) - element.shape(xi - step)) / (2 * FD_STEP)
        assert np.abs(slope - element.gradient(xi)[..., m]).max() < FD_TOLERANCE
        slope = (element.gradient(xi + step) - element.gradient(xi - step)) / (2 * FD_STEP)
        assert np.abs(slope - hessian[..., m]).max() < FD_TOLERANCE
    assert element.is_affine == (np.ptp(element.gradient(xi), axis=0).max() < 1e-15)


def test_polynomials_of_the_order_are_in_the_space(element):
    """And x²y with its like: the space of serendipity (Arnold & Awanou, Found. Comput. Math. 11
    (2011) 337).
    """
    xi = inside(element, 20)
    for powers in product(range(element.order + 1), repeat=element.dim):
        superlinear = sum(k for k in powers if k > 1)
        if sum(powers) <= element.order or (
            isinstance(element.cell, Cube) and superlinear <= element.order
        ):
            nodal = (element.node_coordinates**powers).prod(axis=1)
            exact = (xi**powers).prod(axis=1)
            assert np.allclose(element.shape(xi) @ nodal, exact, rtol=0, atol=1e-14)


def test_the_lebesgue_constant_is_the_largest_sum_of_shape_functions(element):
    """At a quarter of a line or at the centroid, points of the grid."""
    grid = np.stack(np.meshgrid(*[np.arange(25) / 24] * element.dim), axis=-1)
    xi = np.vstack([grid.reshape(-1, element.dim), element.cell.centroid])
    sums = np.abs(element.shape(xi[element.cell.contains(xi, 0.0)])).sum(axis=1)
    assert sums.max() == pytest.approx(element.lebesgue_constant, rel=1e-13)


@pytest.mark.parametrize("degree", range(1, 8))
def test_quadrature_is_exact(element, degree):
    """∫ Π x_i^k_i is Π k_i!/(d + Σ k_i)! on a simplex, Π 1/(k_i + 1) on a cube (of every k_i)."""
    points, weights = element.cell.quadrature(degree)
    cube = isinstance(element.cell, Cube)
    assert element.cell.contains(points, 0.0).all() and (weights > 0).all()
    for powers in product(range(degree + 1), repeat=element.dim):
        if cube:
            exact = 1 / prod(k + 1 for k in powers)
        elif sum(powers) > degree:
            continue
        else:
            exact = prod(map(factorial, powers)) / factorial(element.dim + sum(powers))
        assert weights @ (points**powers).prod(axis=1) == pytest.approx(exact, rel=1e-13)


@pytest.mark.parametrize("n", [1, 3])
def test_a_facet_is_its_element_seen_from_outside(element, n):
    """Nodes of a facet are at the places of its element's nodes, and ∮ x·n dA is d times the
    volume.
    """
    facet = element.facet
    points, weights = facet.cell.subdivided(2, n)
    flux = 0.0
    for nodes in element.facets:
        x = element.node_coordinates[list(nodes)]
        corners = x[: element.cell.facet_vertices]
        straight = facet.cell.vertex_functions(facet.node_coordinates) @ corners
        assert np.allclose(x, straight, rtol=0, atol=1e-15)
        normal = facet_normal(facet.gradient(points), weights, x[None])[0]
        flux += ((facet.shape(points) @ x) * normal).sum()
    volume = 1 / element.cell.count_in_cube
    assert flux == pytest.approx(element.dim * volume, rel=1e-14)


def test_a_cell_consists_of_its_simplices(element):
    X = element.cell.vertices[element.cell.simplices]
    volumes = np.linalg.det(X[:, 1:] - X[:, :1]) / factorial(element.dim)
    assert (volumes > 0).all()
    assert volumes.sum() == pytest.approx(1 / element.cell.count_in_cube, rel=1e-15)


def test_the_trace_constant_is_the_largest_quotient(element):
    """Of ∮_f w² dA V/A over ∫ w² dV, an eigenvalue: sharp on the polynomials of full degree."""
    points, weights = element.cell.quadrature(2 * element.order)
    N = element.shape(points)
    mass = N.T @ (weights[:, None] * N)
    facet = element.facet
    points, weights = facet.cell.quadrature(2 * element.order)
    nodes = list(element.facets[0])
    N = facet.shape(points)
    dA = np.linalg.norm(
        facet_normal(facet.gradient(points), weights, element.node_coordinates[None, nodes])[0],
        axis=1,
    )
    side = np.zeros_like(mass)
    side[np.ix_(nodes, nodes)] = N.T @ (dA[:, None] * N) / dA.sum()
    largest = np.linalg.eigvals(np.linalg.solve(mass, side)).real.max()
    assert largest / element.cell.count_in_cube == pytest.approx(element.trace_constant, rel=1e-10)


@pytest.mark.parametrize("name", VTK)
def test_nodes_are_in_the_order_of_vtk(name):
    expected = np.array([list(map(int, node)) for node in VTK[name]])
    assert np.array_equal(2 * ELEMENTS[name].node_coordinates, expected)
