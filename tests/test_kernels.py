"""Every element residual against its tangent by central differences, in 2-D and 3-D, for every
element and every material.
"""

import numpy as np
import pytest
from kernel_states import (
    FD_STEP,
    FD_TOLERANCE,
    ON_ELEMENTS,
    SHAPES,
    TURNED,
    central_difference,
    distorted,
    flow_chunk,
    relative,
)

from porofsi_petsc.fem.geometry import Rule, SecondDerivatives, geometry
from porofsi_petsc.kernels import exchange, flow, solid
from porofsi_petsc.materials import ELASTIC
from porofsi_petsc.registry import examples

TURNED_SHAPES = "T3", "Q4", "T4", "ring of T3"


def elastic(law, lam=1.7, mu=0.8, n_s0=0.4):
    """Return a law with admissible parameters."""
    return ELASTIC[law](lam, mu, n_s0, **examples(ELASTIC[law]))


@pytest.mark.parametrize("name, law", ON_ELEMENTS)
def test_stress_tangent_is_the_derivative(name, law):
    rng = np.random.default_rng(1)
    element = SHAPES[name]
    material = elastic(law)
    X = distorted(element, rng)
    rule = Rule.of(element, max(2 * element.gradient_degree, 1))
    reference = geometry(rule, X)
    u = 0.05 * rng.standard_normal(X.shape)
    hoop = reference.hoop
    exact = solid.stress_tangent(reference.G, reference.dV, material, u, hoop=hoop).reshape(
        len(X), X[0].size, X[0].size
    )
    difference = central_difference(
        lambda z: solid.stress_residual(reference.G, reference.dV, material, z, hoop), u
    )
    assert relative(exact, difference) < FD_TOLERANCE


@pytest.mark.parametrize("law", ELASTIC)
@pytest.mark.parametrize("dim", [2, 3])
def test_stress_is_the_derivative_of_the_energy_and_objective(dim, law):
    rng = np.random.default_rng(2)
    material = elastic(law)
    H = 0.1 * rng.standard_normal((4, dim, dim))
    difference = central_difference(lambda z: material.energy(z), H).reshape(H.shape)
    assert relative(material.stress(H), difference) < FD_TOLERANCE
    tangent = central_difference(lambda z: material.stress(z), H).reshape(4, dim, dim, dim, dim)
    assert relative(material.tangent(H), tangent) < FD_TOLERANCE
    if material.small_strain:
        return
    Q = np.linalg.qr(rng.standard_normal((dim, dim)))[0]
    Q[:, 0] *= np.sign(np.linalg.det(Q))
    F = np.eye(dim) + H
    identity = np.eye(dim)
    # round-off of stresses of order one
    assert np.allclose(
        material.stress(Q @ F - identity), Q @ material.stress(H), rtol=0, atol=1e-13
    )
    assert np.abs(material.stress(np.broadcast_to(Q - identity, F.shape))).max() < 1e-14


WITHOUT = [
    "linear_elastic",
    "transversely_isotropic",
    "drucker_prager",
    "holmes_mow",
]  # a mixed tangent: nothing is stiff in volume


@pytest.mark.parametrize("law", [name for name in ELASTIC if name not in WITHOUT])
@pytest.mark.parametrize("dim", [2, 3])
def test_the_mixed_tangent_has_the_stress_of_the_iterate_before_made_linear(dim, law):
    """In its geometric part: that of a law with the same tangent whose P grows linearly; the error
    is of second order.
    """
    rng = np.random.default_rng(3)
    material = elastic(law)
    errors = []
    H = 0.05 * rng.standard_normal((4, dim, dim))
    change = 0.1 * rng.standard_normal((4, dim, dim))
    for factor in (1.0, 0.5, 0.25):
        errors.append(
            np.abs(material.mixed_tangent(H, H - factor * change) - material.tangent(H)).max()
        )
    assert np.allclose(material.mixed_tangent(H, H), material.tangent(H), rtol=1e-14)
    assert errors[0] > 1e-5
    assert np.divide(errors[:-1], errors[1:]).min() > 3.5  # 4 and terms of third order


@pytest.mark.parametrize("law", ["saint_venant_kirchhoff", "neo_hookean", "neo_hookean_j2"])
def test_a_change_that_keeps_the_volume_to_first_order_leaves_no_pressure_in_the_mixed_tangent(law):
    """A rotation by 0.1, made linear, grows the volume by 1e-2: its stress λ/100 is in the tangent,
    and not in the mixed one.

    What the geometric part adds to a turned material stiffness is seen where the material part has
    nothing: in ∂P_xx/∂F_xx less what λ + 2μ give; the sizes are those of λ θ² and of μ.
    """
    material = ELASTIC[law](lam=1e4, mu=1.0)
    theta = 0.1
    H = np.array([[[0.0, -theta], [theta, 0.0]]])
    skew = np.array(
        [[1.0, 0.0], [0.0, -1.0]]
    )  # a stretch that keeps the volume: λ enters by the geometric part alone
    energy = [
        np.einsum("ij,ijkl,kl->", skew, A[0], skew)
        for A in (material.tangent(H), material.mixed_tangent(H, 0 * H))
    ]
    assert abs(energy[0]) > 50  # ± 2 λ θ²/2 and more
    assert energy[1] == pytest.approx(4 * material.mu, rel=0.1)


ISOTROPIC = [name for name, law in ELASTIC.items() if not law.anisotropic]


@pytest.mark.parametrize("law", ISOTROPIC)
@pytest.mark.parametrize("dim", [2, 3])
def test_stress_of_a_tiny_strain_keeps_its_digits(dim, law):
    """At |H| = 1e-10 the laws agree with linear elasticity up to terms of order |H|; by way of F
    they would lose to 1e-6.
    """
    H = 1e-10 * np.random.default_rng(7).standard_normal((4, dim, dim))
    material = elastic(law)
    linear = ELASTIC["linear_elastic"](lam=1.7, mu=0.8, n_s0=0.4)
    assert relative(material.stress(H), linear.stress(H)) < 1e-8


CURVED = [name for name, element in SHAPES.items() if not element.is_affine]


@pytest.mark.parametrize("name", CURVED)
def test_second_derivatives_are_those_of_curved_elements(name):
    """Of shape functions, of a field and of the volume ratio, against differences of the first ones
    between points; of a ring those of a field in space are part of its tangents.
    """
    rng = np.random.default_rng(8)
    element = SHAPES[name]
    X = distorted(element, rng)
    xi = rng.dirichlet(np.ones(element.dim + 1), 4)[:, 1:]
    x = X + 0.06 * rng.standard_normal(X.shape)

    def at(points):
        """Return the geometries of x and X and the `SecondDerivatives` of x at reference points (Q,
        d).
        """
        rule = Rule.at(element, points, np.ones(len(points)))
        current = geometry(rule, x)
        reference = geometry(rule, X)
        slope = SecondDerivatives.at(rule, X, reference, None).volume_slope
        return current, reference, SecondDerivatives.at(rule, x, current, slope)

    dG = []
    d_ln_J = []
    for step in FD_STEP * np.eye(element.dim):
        (plus, plus_0, _), (minus, minus_0, _) = at(xi + step), at(xi - step)
        dG.append((plus.G - minus.G) / (2 * FD_STEP))
        d_ln_J.append(np.log(plus.dV / plus_0.dV * minus_0.dV / minus.dV) / (2 * FD_STEP))
    current, _, second = at(xi)
    inverse = np.linalg.inv(np.einsum("eak,qam->eqkm", x, element.gradient(xi)))
    shapes = np.einsum("meqai,eqmj->eqaij", dG, inverse)
    assert relative(second.shapes, shapes) < FD_TOLERANCE
    assert (
        relative(second.volume_gradient, np.einsum("meq,eqmj->eqj", d_ln_J, inverse)) < FD_TOLERANCE
    )
    if element.axisymmetric:
        return
    U = rng.standard_normal(X.shape)
    gradient = np.einsum("eak,eqaj->eqkj", U, current.G)
    field = np.einsum("eak,eqaij->eqkij", U, shapes)
    assert relative(second.field(U, gradient), field) < FD_TOLERANCE
    viscous = np.einsum("eqkii->eqk", field) + np.einsum("eqiki->eqk", field)
    assert relative(second.viscous(U, gradient), viscous) < FD_TOLERANCE


@pytest.mark.parametrize("convection", [False, True])
@pytest.mark.parametrize("mu", [0.0, 0.7])
@pytest.mark.parametrize("name", SHAPES)
def test_flow_tangent_is_the_derivative(name, mu, convection):
    compare_flow_tangent(name, mu, convection, None)


@pytest.mark.parametrize("name", TURNED_SHAPES)
def test_flow_tangent_of_a_drag_with_axes_is_the_derivative(name):
    compare_flow_tangent(name, 0.7, True, TURNED[SHAPES[name].dim])


def compare_flow_tangent(name, mu, convection, anisotropy):
    """Compare the tangent with central differences of the residual."""
    rng = np.random.default_rng(3)
    element = SHAPES[name]
    d = element.dim
    c_f = 1.3
    el, z = flow_chunk(element, rng, mu, convection, anisotropy)

    def fields(unknowns):
        v = unknowns[..., :d]
        p = unknowns[..., d]
        a = z["a"] + c_f * (v - z["v"])
        return flow.FlowFields(v, a, v - z["v_m"], z["v_s"], p, p - z["p_n"], z["b"])

    def residual(unknowns):
        momentum, volume = flow.flow_residual(el, fields(unknowns))
        return np.concatenate([momentum.sum(axis=0), volume.sum(axis=0)[..., None]], axis=-1)

    unknowns = np.concatenate([z["v"], z["p"][..., None]], axis=-1)
    size = unknowns[0].size
    exact = flow.flow_tangent(el, fields(unknowns), c_f).reshape(-1, size, size)
    assert relative(exact, central_difference(residual, unknowns)) < FD_TOLERANCE


@pytest.mark.parametrize("name", SHAPES)
def test_inertia_and_drag_tangents_are_the_derivatives(name):
    rng = np.random.default_rng(4)
    element = SHAPES[name]
    X = distorted(element, rng)
    rule = Rule.of(element, 2 * element.order)
    dV = geometry(rule, X).dV
    a = rng.standard_normal(X.shape)
    exact = solid.mass_tangent(rule.N, 1.9 * dV, element.dim).reshape(len(X), a[0].size, a[0].size)
    assert (
        relative(exact, central_difference(lambda z: solid.inertia_residual(rule.N, dV, 1.9, z), a))
        < FD_TOLERANCE
    )


@pytest.mark.parametrize("name", SHAPES)
def test_pressure_terms_of_the_phases_are_adjoint_to_the_volume_balance(name):
    """∫ p-terms of solid · v_s + of fluid · v = -(volume balance · p): the pressure does no net
    work.
    """
    from porofsi_petsc.materials.porous import PorousMaterial

    rng = np.random.default_rng(5)
    element = SHAPES[name]
    el, z = flow_chunk(element, rng, 0.0, False)
    material = PorousMaterial(
        elastic("neo_hookean", 1.0, 1.0), 0.6, 1.0, 1.0, 1.0, variable_porosity=True
    )
    J = 1 + 0.1 * rng.random(el.n.shape)
    el = flow.FlowElements(**{**el.__dict__, "n": material.fluid_fraction(J)})
    fields = flow.FlowFields(z["v"], z["a"], z["v"], z["v_s"], z["p"], z["p"] - z["p_n"], z["b"])
    momentum, volume = flow.flow_residual(el, fields)
    solid_pressure, _ = solid.coupling_residual(
        el.N, el.geometry, material, J, z["p"], z["v"] - z["v_s"]
    )
    power = (
        (solid_pressure * z["v_s"]).sum()
        + (momentum[1] * z["v"]).sum()
        + (volume[:2].sum(axis=0) * z["p"]).sum()
    )
    assert abs(power) < 1e-12 * np.abs(momentum[1] * z["v"]).sum()


@pytest.mark.parametrize("moving_mesh", [False, True])
@pytest.mark.parametrize("convection", [False, True])
@pytest.mark.parametrize("name", SHAPES)
def test_exchange_tangents_are_the_derivatives(name, convection, moving_mesh):
    compare_exchange_tangents(name, convection, moving_mesh, None)


@pytest.mark.parametrize("name", TURNED_SHAPES)
def test_exchange_tangents_of_a_drag_with_axes_are_the_derivatives(name):
    compare_exchange_tangents(name, True, True, TURNED[SHAPES[name].dim])


def compare_exchange_tangents(name, convection, moving_mesh, anisotropy):
    """Compare both tangents with central differences of the residuals."""
    rng = np.random.default_rng(6)
    element = SHAPES[name]
    d = element.dim
    c_v = 1.7
    el, z = flow_chunk(element, rng, 0.7, convection, anisotropy)

    def flow_residual(y):
        v_s = z["v_s"] + c_v * y
        c = z["v"] - (v_s if moving_mesh else z["v_m"])
        fields = flow.FlowFields(z["v"], z["a"], c, v_s, z["p"], z["p"] - z["p_n"], z["b"])
        momentum, volume = flow.flow_residual(el, fields)
        return np.concatenate([momentum.sum(axis=0), volume.sum(axis=0)[..., None]], axis=-1)

    y = np.zeros_like(z["v_s"])
    c = z["v"] - (z["v_s"] if moving_mesh else z["v_m"])
    fields = flow.FlowFields(z["v"], z["a"], c, z["v_s"], z["p"], z["p"] - z["p_n"], z["b"])
    exact = exchange.flow_by_skeleton(el, fields, c_v, moving_mesh).reshape(len(y), -1, y[0].size)
    assert relative(exact, central_difference(flow_residual, y)) < FD_TOLERANCE

    class Coefficients:
        fluid_fraction = staticmethod(lambda J: el.n)
        drag = staticmethod(lambda J: el.drag)

    def solid_residual(unknowns):
        v = unknowns[..., :d]
        p = unknowns[..., d]
        return sum(solid.coupling_residual(el.N, el.geometry, Coefficients, None, p, v - z["v_s"]))

    unknowns = np.concatenate([z["v"], z["p"][..., None]], axis=-1)
    exact = exchange.solid_by_flow(el.N, el.geometry, el.n, el.drag).reshape(len(y), y[0].size, -1)
    assert relative(exact, central_difference(solid_residual, unknowns)) < FD_TOLERANCE


def test_ehlers_eipper_ends_at_the_compaction_point():
    """Closer to J = n_s0 the stress grows without bound; beyond it there is none."""
    law = ELASTIC["ehlers_eipper"](lam=1.7, mu=0.8, n_s0=0.4)
    n = 0.4
    H = np.zeros((4, 2, 2))
    H[:, 1, 1] = n * (1 + np.array([1e-2, 1e-4, 1e-6, -1e-6])) - 1
    stress = law.stress(H)[:, 1, 1]
    assert np.all(stress[1:3] < 50 * stress[:2]) and stress[2] < -1e5
    assert np.isnan(stress[3])


@pytest.mark.parametrize("law", ["neo_hookean", "xie_leo", "ehlers_eipper"])
@pytest.mark.filterwarnings("error")
def test_an_inverted_trial_state_is_marked_without_a_warning(law):
    """J = -1/2, and J = 0 where the logarithm is infinite."""
    H = np.zeros((2, 2, 2))
    H[:, 1, 1] = -1.5, -1.0
    material = elastic(law)
    for found in (
        material.energy(H),
        material.stress(H)[:, 1, 1],
        material.tangent(H)[:, 1, 1, 1, 1],
    ):
        assert not np.isfinite(found[1])
    assert np.isnan(material.stress(H)[0, 1, 1]) and np.isnan(material.energy(H)[0])


@pytest.mark.parametrize("law", ISOTROPIC)
@pytest.mark.parametrize("dim", [2, 3])
def test_volumetric_compliance_is_that_of_the_stress_of_a_compressed_body(dim, law):
    """Mean of 1/E_c and 1/K_d, both from differences of the stress: of a strain along an axis, of a
    dilation.
    """
    body = elastic(law, 8e6, 5e6, 0.6)
    rng = np.random.default_rng(1)
    step = 1e-6
    H = -0.1 * np.eye(dim) + 0.05 * rng.standard_normal((dim, dim))
    F = H + np.eye(dim)
    identity = np.eye(dim)

    def cauchy(change):
        """Return dP F^T/J of a change of F, a strain times F."""
        return (
            (body.stress(H + step * change) - body.stress(H - step * change))
            @ F.T
            / (2 * step * np.linalg.det(F))
        )

    E_c = np.mean([cauchy(np.outer(axis, axis) @ F)[i, i] for i, axis in enumerate(identity)])
    K_d = np.trace(cauchy(F)) / dim**2
    found = solid.volumetric_compliance(body, H[None, None])[0, 0]
    assert found == pytest.approx((1 / E_c + 1 / K_d) / 2, rel=1e-6)  # differences
    assert solid.volumetric_compliance(body, 0 * H[None, None])[0, 0] == pytest.approx(
        (1 / 18e6 + 1 / (8e6 + 10e6 / dim)) / 2
    )
