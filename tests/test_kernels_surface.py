"""Kernels on facets: follower pressure and backflow against central differences and exact
integrals, Robin's matrix.
"""

import numpy as np
import pytest
from kernel_states import FD_TOLERANCE, central_difference, relative

from porofsi_petsc.elements import ELEMENTS
from porofsi_petsc.fem.geometry import Rule
from porofsi_petsc.kernels import surface


def facets(name, rng, count=6):
    """Return rule and coordinates (F, A, d) of facets that are bent and turned in space."""
    facet = ELEMENTS[name].facet
    d = ELEMENTS[name].dim
    flat = np.pad(facet.node_coordinates, ((0, 0), (0, 1)))
    turn = np.linalg.qr(rng.standard_normal((count, d, d)))[0]
    x = flat @ turn + 0.06 * rng.standard_normal((count, facet.nodes, d))
    return Rule.of(facet, 2 * facet.order + 1), x


def whole_boundary(name, rng):
    """Return rule and coordinates (F, A, d) of the facets of one distorted element."""
    element = ELEMENTS[name]
    x = element.node_coordinates + 0.06 * rng.standard_normal((element.nodes, element.dim))
    return Rule.of(ELEMENTS[name].facet, 2 * element.order + 1), x[np.array(element.facets)]


@pytest.mark.parametrize("name", ELEMENTS)
def test_pressure_load_follows_the_positions(name):
    rng = np.random.default_rng(21)
    rule, x = facets(name, rng)
    p = rng.standard_normal((len(x), len(rule.weights)))

    def load(x):
        return surface.pressure_load(rule.N, surface.facet_normal(rule.dN, rule.weights, x), p)

    change = surface.facet_normal_by_positions(rule.dN, rule.weights, x)
    exact = surface.pressure_load_by_normal(rule.N, change, p).reshape(len(x), x[0].size, x[0].size)
    assert relative(exact, central_difference(load, x)) < FD_TOLERANCE


@pytest.mark.parametrize("name", ELEMENTS)
def test_uniform_pressure_on_a_closed_surface_has_no_resultant_and_does_the_work_of_the_volume(
    name,
):
    """∮ n dA = 0 and ∮ x·n dA = d V, also on curved facets."""
    rng = np.random.default_rng(22)
    rule, x = whole_boundary(name, rng)
    normal = surface.facet_normal(rule.dN, rule.weights, x)
    load = surface.pressure_load(rule.N, normal, np.full(normal.shape[:2], 3.0))
    assert (
        np.abs(load.sum(axis=(0, 1))).max() < 1e-14 * np.abs(load).sum()
    )  # round-off of a sum of a few dozen terms
    element = ELEMENTS[name]
    inside = Rule.of(element, 2 * element.order + 1)
    nodes = np.zeros((element.nodes, element.dim))
    nodes[np.array(element.facets)] = x
    volume = (np.linalg.det(nodes.T @ inside.dN) * inside.weights).sum()
    # round-off; both rules, of degree 2 order + 1, are exact: x·n dA is at most of degree 2 order,
    # the Jacobian of degree 3
    assert np.isclose((load * x).sum(), 3.0 * element.dim * volume, rtol=1e-13, atol=0)


@pytest.mark.parametrize("name", ELEMENTS)
def test_backflow_tangent_is_the_derivative(name):
    rng = np.random.default_rng(23)
    rule, x = facets(name, rng)
    normal = surface.facet_normal(rule.dN, rule.weights, x)
    v = rng.standard_normal(x.shape)
    v_m = rng.standard_normal(x.shape)
    rho = 0.5 + rng.random(normal.shape[:2])
    # The kink of (c·n)_- must not lie within a difference: all points are on one side by far more
    # than its step.
    flux = ((rule.N @ (v - v_m)) * normal).sum(axis=-1) / np.linalg.norm(normal, axis=-1)
    assert np.abs(flux).min() > 1e-4 and (flux < 0).any() and (flux > 0).any()
    size = v[0].size
    exact = surface.backflow_tangent(rule.N, normal, rho, 0.8, v, v - v_m).reshape(-1, size, size)
    difference = central_difference(
        lambda z: surface.backflow_residual(rule.N, normal, rho, 0.8, z, z - v_m), v
    )
    assert relative(exact, difference) < FD_TOLERANCE


@pytest.mark.parametrize("name", ELEMENTS)
def test_backflow_takes_the_kinetic_energy_that_convection_brings_in_and_nothing_on_the_way_out(
    name,
):
    """With β = 1 on a fixed boundary the power v·R is -∮ ρ/2 |v|² (v·n)_- dA."""
    rng = np.random.default_rng(24)
    rule, x = facets(name, rng)
    normal = surface.facet_normal(rule.dN, rule.weights, x)
    rho = np.full(normal.shape[:2], 1.3)
    unit = normal.sum(axis=1, keepdims=True) / np.linalg.norm(
        normal.sum(axis=1, keepdims=True), axis=-1, keepdims=True
    )
    v = unit * (1 + 0.3 * rng.random((*x.shape[:2], 1)))
    flux = ((rule.N @ v) * normal).sum(axis=-1)
    assert flux.min() > 0
    assert not surface.backflow_residual(rule.N, normal, rho, 1.0, v, v).any()
    assert not surface.backflow_tangent(rule.N, normal, rho, 1.0, v, v).any()
    power = (surface.backflow_residual(rule.N, normal, rho, 1.0, -v, -v) * -v).sum()
    kinetic = (rho / 2 * ((rule.N @ v) ** 2).sum(axis=-1) * flux).sum()
    assert np.isclose(power, kinetic, rtol=1e-13, atol=0)  # round-off


@pytest.mark.parametrize("name", ELEMENTS)
def test_robin_matrix_is_the_derivative_of_its_load(name):
    rng = np.random.default_rng(25)
    rule, x = facets(name, rng)
    dA = np.linalg.norm(surface.facet_normal(rule.dN, rule.weights, x), axis=-1)
    alpha = 0.5 + rng.random(dA.shape)
    u = rng.standard_normal(x.shape[:2])
    load = surface.surface_load(rule.N, dA, (alpha * (u @ rule.N.T))[..., None])[..., 0]
    matrix = surface.surface_mass(rule.N, dA, alpha)
    assert relative((matrix @ u[..., None])[..., 0], load) < 1e-13  # round-off
    assert np.isclose(matrix.sum(), (alpha * dA).sum(), rtol=1e-13, atol=0)
