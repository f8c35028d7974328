"""Kernels of a free fluid: tangents against central differences, the porous form as a special case,
exact flows, tractions.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from grids import grid
from kernel_states import (
    FD_TOLERANCE,
    RINGS,
    SHAPES,
    TURNED,
    central_difference,
    distorted,
    free_chunk,
    relative,
)
from mixed import cut, one_mesh, unit_grid

from porofsi_petsc.elements import ELEMENTS
from porofsi_petsc.fem.geometry import Rule, SecondDerivatives, geometry
from porofsi_petsc.kernels import exchange, flow, shape
from porofsi_petsc.kernels.surface import facet_normal, surface_load
from porofsi_petsc.materials.drag import Drag
from porofsi_petsc.mesh.topology import add_midside_nodes, boundary_facets, cell_facets


def joined(el, fields):
    """Return the sums of the momentum and the volume terms, (E, A, d + 1)."""
    momentum, volume = flow.flow_residual(el, fields)
    return np.concatenate([momentum.sum(axis=0), volume.sum(axis=0)[..., None]], axis=-1)


@pytest.mark.parametrize("convection", [False, True])
@pytest.mark.parametrize("mu", [0.0, 0.7])
@pytest.mark.parametrize("name", SHAPES)
def test_flow_tangent_is_the_derivative(name, mu, convection):
    rng = np.random.default_rng(11)
    element = SHAPES[name]
    d = element.dim
    c_f = 1.3
    el, z = free_chunk(element, rng, mu, convection)

    def fields(unknowns):
        v = unknowns[..., :d]
        p = unknowns[..., d]
        return flow.FlowFields(v, z["a"] + c_f * (v - z["v"]), v - z["v_m"], None, p, None, z["b"])

    unknowns = np.concatenate([z["v"], z["p"][..., None]], axis=-1)
    size = unknowns[0].size
    exact = flow.flow_tangent(el, fields(unknowns), c_f).reshape(-1, size, size)
    assert (
        relative(exact, central_difference(lambda u: joined(el, fields(u)), unknowns))
        < FD_TOLERANCE
    )


@pytest.mark.parametrize("convection", [False, True])
@pytest.mark.parametrize("name", SHAPES)
def test_tangents_of_a_flow_through_a_solid_are_the_derivatives(name, convection):
    """With the drag of a porous solid: by (v, p), and by the solid's positions through v_s
    alone.
    """
    compare_tangents_through_a_solid(name, convection, None)


@pytest.mark.parametrize("name", ["T3", "T4"])
def test_tangents_of_a_flow_through_a_solid_with_axes_are_the_derivatives(name):
    compare_tangents_through_a_solid(name, True, TURNED[SHAPES[name].dim])


def compare_tangents_through_a_solid(name, convection, anisotropy):
    """Compare both with central differences of the residual."""
    rng = np.random.default_rng(16)
    el, z = free_chunk(SHAPES[name], rng, 0.7, convection)
    el, v_s, d, c_v = (
        replace(el, drag=Drag(el.rho + 1.0, anisotropy)),
        rng.standard_normal(z["v"].shape),
        el.geometry.G.shape[-1],
        2.3,
    )

    def fields(vp, y=0.0):
        v = vp[..., :d]
        return flow.FlowFields(v, z["a"], v - z["v_m"], v_s + c_v * y, vp[..., d], None, z["b"])

    vp = np.concatenate([z["v"], z["p"][..., None]], axis=-1)
    y = np.zeros_like(v_s)
    exact = flow.flow_tangent(el, fields(vp), 0.0).reshape(len(vp), vp[0].size, -1)
    assert relative(exact, central_difference(lambda vp: joined(el, fields(vp)), vp)) < FD_TOLERANCE
    exact = exchange.flow_by_drag(el, fields(vp), c_v).reshape(len(y), -1, y[0].size)
    assert (
        relative(exact, central_difference(lambda y: joined(el, fields(vp, y)), y)) < FD_TOLERANCE
    )


@pytest.mark.parametrize("convection", [False, True])
@pytest.mark.parametrize("name", SHAPES)
def test_mesh_velocity_tangent_is_the_derivative(name, convection):
    rng = np.random.default_rng(15)
    el, z = free_chunk(SHAPES[name], rng, 0.7, convection)
    c_m = 1.7
    v = z["v"]

    def fields(y):
        return flow.FlowFields(v, z["a"], v - z["v_m"] - c_m * y, None, z["p"], None, z["b"])

    y = np.zeros_like(v)
    exact = exchange.flow_by_mesh_velocity(el, fields(y), c_m).reshape(len(y), -1, y[0].size)
    difference = central_difference(lambda y: joined(el, fields(y)), y)
    if convection:
        assert relative(exact, difference) < FD_TOLERANCE
    else:
        assert not exact.any() and not difference.any()


@pytest.mark.parametrize("convection", [False, True])
@pytest.mark.parametrize("mu", [0.0, 0.7])
@pytest.mark.parametrize("name", SHAPES)
def test_shape_tangent_is_the_derivative(name, mu, convection):
    """By the nodal positions at given nodal values, stabilization parameters and body force
    frozen.
    """
    element = SHAPES[name]
    el, z = free_chunk(element, np.random.default_rng(16), mu, convection)
    x = distorted(element, np.random.default_rng(16))
    rule = Rule.of(element, 2 * element.order)
    fields = flow.FlowFields(z["v"], z["a"], z["v"] - z["v_m"], None, z["p"], None, z["b"])

    def residual(x):
        current = geometry(rule, x)
        second = SecondDerivatives.at(rule, x, current, None) if el.second is not None else None
        return joined(replace(el, geometry=current, second=second), fields)

    exact = shape.flow_by_geometry(el, fields, None).reshape(len(x), -1, x[0].size)
    assert relative(exact, central_difference(residual, x)) < FD_TOLERANCE


def _linear(name):
    """Return the mesh of the vertices, and the element."""
    shape, _, dim = name.partition(" ")
    if shape == "mixed":
        mesh = one_mesh(*cut(unit_grid(int(dim), 2)))
        return mesh, mesh.element
    d = ELEMENTS[name].dim
    axis = SimpleNamespace(points=[0.0, 1.0], cells=[3 if d == 2 else 2], ratios=None)
    return grid(name, [axis] * d, order=1), ELEMENTS[name]


class Patch:
    """A small mesh of straight-sided elements with moved vertices, or of parallelograms, on which
    the quadrature of all terms is exact.

    x (N, d), cells (E, A), el: a free fluid on it, all coefficients at the given values
    """

    def __init__(self, name, mu, rho=1.2):
        """Take the name of an element, or "mixed 2" or "mixed 3" for linear cells of all shapes."""
        rng = np.random.default_rng(12)
        mesh, self.element = _linear(name)
        element = self.element
        d = element.dim
        if mesh.element.is_affine:
            self.x = mesh.points + 0.05 * rng.standard_normal(mesh.points.shape)
        else:  # parallelograms, on which gradients are polynomials
            self.x = mesh.points @ (np.eye(d) + 0.2 * rng.standard_normal((d, d)))
        self.cells = mesh.cells
        cell, local = boundary_facets(mesh.cells, mesh.element)
        self.x, self.cells = add_midside_nodes(self.x, self.cells, element)
        self.facets = cell_facets(self.cells, element)[cell, local]
        rule = Rule.of(element, 2 * element.order + 1)
        current = geometry(rule, self.x[self.cells])
        points = (len(self.cells), len(rule.weights))
        second = (
            SecondDerivatives.at(rule, self.x[self.cells], current, None)
            if not element.is_affine
            else None
        )

        def random():
            return 0.5 + rng.random(points)

        self.el = flow.FlowElements(
            N=rule.N,
            geometry=current,
            n=np.ones(points),
            rho=np.full(points, rho),
            drag=None,
            mu=mu,
            tau=random(),
            tau_supg=random(),
            nu_lsic=random(),
            tau_u=None,
            second=second,
            grad_n=None,
            convection=True,
            order=element.order,
            free=True,
        )

    def residual(self, el, v, p, a):
        """Return the nodal residual, (N, d + 1), of nodal fields on a fixed mesh, the skeleton at
        rest.
        """
        v = v[self.cells]
        p = p[self.cells]
        a = a[self.cells]
        values = joined(
            el, flow.FlowFields(v, a, v, 0 * v, p, None, np.zeros((*el.n.shape, self.element.dim)))
        )
        total = np.zeros((len(self.x), values.shape[-1]))
        np.add.at(total, self.cells, values)
        return total

    def traction(self, stress):
        """Return the nodal forces ∮ N_a σ n dA on the whole boundary, (N, d), of a stress at points
        (..., d) -> (..., d, d).
        """
        facet = self.element.facet
        rule = Rule.of(facet, 2 * self.element.order + 1)
        x = self.x[self.facets]
        normal = facet_normal(rule.dN, rule.weights, x)
        force = (stress(rule.N @ x) @ normal[..., None])[..., 0]
        total = np.zeros_like(self.x)
        np.add.at(total, self.facets, surface_load(rule.N, np.ones(normal.shape[:2]), force))
        return total


@pytest.mark.parametrize("name", ELEMENTS)
def test_free_form_is_the_porous_one_without_skeleton_where_boundary_integrals_vanish(name):
    """∮ p w·n = ∮ q v·n = 0 for fields that vanish on the boundary; then every row agrees to
    round-off.
    """
    patch = Patch(name, mu=0.7)
    rng = np.random.default_rng(13)
    inside = np.ones(len(patch.x), dtype=bool)
    inside[patch.facets] = False
    v, p, a = (
        rng.standard_normal((len(patch.x), k)) * inside[:, None]
        for k in (patch.element.dim, 1, patch.element.dim)
    )
    no_skeleton = np.zeros((*patch.el.n.shape, patch.element.dim))
    grad_n = None if patch.el.second is None else no_skeleton
    free = patch.residual(patch.el, v, p[:, 0], a)
    porous = patch.residual(
        replace(patch.el, free=False, drag=Drag(np.zeros_like(patch.el.n)), grad_n=grad_n),
        v,
        p[:, 0],
        a,
    )
    assert np.abs(free[:, -1]).max() > 1e-3  # there is something to compare
    assert relative(free, porous) < 1e-13


@pytest.mark.parametrize("name", [*ELEMENTS, "mixed 2", "mixed 3"])
def test_exact_shear_flow_leaves_the_exact_traction_on_the_boundary(name):
    """v = e (s m·x + κ (m·x)²), p = p_0 + 2 κ μ e·x, e and m unit vectors, e·m = 0; κ = 0 (Couette)
    on linear elements.
    """
    mu = 0.7
    slope = 1.5
    p_0 = 0.4
    patch = Patch(name, mu)
    kappa = 0.9 if patch.element.order == 2 else 0.0
    e, m = np.linalg.qr(np.random.default_rng(14).standard_normal((patch.element.dim, 2)))[0].T

    def stress(x):
        shear = mu * (slope + 2 * kappa * (x @ m))
        pressure = p_0 + 2 * kappa * mu * (x @ e)
        return shear[..., None, None] * (np.outer(e, m) + np.outer(m, e)) - pressure[
            ..., None, None
        ] * np.eye(len(e))

    along = patch.x @ m
    v = (slope * along + kappa * along**2)[:, None] * e
    p = p_0 + 2 * kappa * mu * (patch.x @ e)
    residual = patch.residual(patch.el, v, p, np.zeros_like(v))
    traction = patch.traction(stress)
    scale = np.abs(traction).max()
    assert scale > 0.01
    # round-off of stresses of order one, and of the strong residual times τ of order one
    assert np.abs(residual[:, :-1] - traction).max() < 1e-12 * scale
    assert np.abs(residual[:, -1]).max() < 1e-12 * scale


@pytest.mark.parametrize("name", RINGS)
def test_the_viscous_force_around_an_axis_has_its_hoop_part(name):
    """div(2 μ sym ∇v) of v = (r, 3 r), and of second order v = (r + r z + 0.4 r², 3 r), in the
    strong residual, which has nothing else: [∂_r τ_rr + ∂_z τ_rz + (τ_rr - τ_θθ)/r, ∂_r τ_rz + ∂_z
    τ_zz + τ_rz/r].
    """
    element = RINGS[name]
    quadratic = element.order == 2
    el, z = free_chunk(element, np.random.default_rng(17), 0.7, False)
    X = element.node_coordinates[None] * [1.0, 0.8] + [0.3, 0.2]
    rule = Rule.of(element, 2 * element.order)
    current = geometry(rule, X)
    chunk = replace(
        el,
        **{name: getattr(el, name)[:1] for name in ("n", "rho", "tau", "tau_supg", "nu_lsic")},
        geometry=current,
        second=SecondDerivatives.at(rule, X, current, None),
    )
    x, y = X[0].T
    v = np.column_stack([x + quadratic * x * y + 0.4 * x**2 * quadratic, 3 * x])[None]
    nothing = np.zeros_like(v)
    fields = flow.FlowFields(
        v, nothing, v, None, nothing[..., 0], None, np.zeros((1, len(rule.weights), 2))
    )
    found = flow.flow_points(chunk, fields).residual[0]
    r = rule.N @ x
    exact = -0.7 * np.column_stack([quadratic * (1.6 + 0.8) + 0 * r, 3 / r + quadratic * 2.0])
    assert np.abs(found - exact).max() < 1e-12 * np.abs(exact).max()
