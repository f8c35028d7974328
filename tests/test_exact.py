"""Exact solutions: published values, limits, and the equations they solve by differences."""

import numpy as np
import pytest
from scipy.special import jvp, yvp

from porofsi_petsc.exact import (
    Cryer,
    DynamicColumn,
    Mandel,
    Ring,
    Seabed,
    Selfweight,
    StripFooting,
    Terzaghi,
    UnconfinedCylinder,
    UnconfinedStrip,
    XieLeo,
    confined_ratio,
)
from porofsi_petsc.materials import ELASTIC
from porofsi_petsc.registry import examples

LAM, MU, N_S = 8.375e6, 5.583e6, 0.67  # set A of the literature [Pa], [Pa], [-]
E_C = LAM + 2 * MU
COLUMN = DynamicColumn(10.0, LAM, MU, N_S, 2000.0, 1000.0, 1e-2, 1e4)
DEPTHS = np.array([0.5, 1.0, 5.0, 10.0])


@pytest.mark.parametrize("t, u", [(0.025, 6.06462e-5), (0.05, 2.27348e-4)])
def test_the_harmonic_column_gives_the_published_values(t, u):
    assert COLUMN.harmonic(3000.0, 20 * np.pi, np.zeros(1), t)[0] == pytest.approx(
        u, rel=1e-5
    )  # digits of the table


@pytest.mark.parametrize("t, u", [(0.01, 7.05821e-5), (0.05, 1.688708e-4), (0.1, 2.405084e-4)])
def test_the_bessel_form_gives_the_published_values(t, u):
    assert COLUMN.step_surface(3000.0, t) == pytest.approx(u, rel=1e-6)  # digits of the table


@pytest.mark.parametrize(
    "t, u, p",
    [
        (0.01, 0.0, (1737.2, 2981.7, 2981.7, 2981.7)),
        (0.05, 5.69730e-5, (834.15, 1576.92, 3000.00, 3000.00)),
        (0.4, 3.45361e-4, (301.65, 598.57, 2384.18, 2936.34)),
    ],
)
def test_the_modal_sum_of_the_step_gives_the_published_values(t, u, p):
    found_u, found_p = COLUMN.step(3000.0, DEPTHS, t)
    # digits of the table; ahead of the front, which is a jump, the sum rings by 1/modes of it (0.01
    # s)
    assert found_p == pytest.approx(p, abs=1.0 if t == 0.01 else 0.01)
    assert found_u[1] == pytest.approx(u, rel=1e-5, abs=1e-9)


def test_the_step_of_low_permeability():
    column = DynamicColumn(10.0, LAM, MU, N_S, 2000.0, 1000.0, 1e-5, 1e4)
    assert [column.step_surface(3000.0, t) for t in (0.01, 0.1)] == pytest.approx(
        [2.42144e-6, 7.65773e-6], rel=2e-6
    )  # digits
    assert column.step(3000.0, DEPTHS, 0.1)[1] == pytest.approx(3000.0, rel=1e-5)


def test_terzaghi_solves_the_diffusion_equation_and_settles_by_its_pressure():
    layer = Terzaghi(1e4, 2.0, 1e7, 1e-2)
    z = np.linspace(0.1, 1.9, 7)
    t = 20.0
    h = 1e-3
    rate = (layer.pressure(z, t + h) - layer.pressure(z, t - h)) / (2 * h)
    curvature = (
        layer.pressure(z + h, t) - 2 * layer.pressure(z, t) + layer.pressure(z - h, t)
    ) / h**2
    assert rate == pytest.approx(
        1e-2 * curvature, abs=1e-4 * np.abs(rate).max()
    )  # differences of h = 1e-3, of 1e4 Pa
    strain = (layer.settlement(z + h, t) - layer.settlement(z - h, t)) / (2 * h)
    assert strain == pytest.approx(-(1e4 - layer.pressure(z, t)) / 1e7, rel=1e-5)  # h²
    assert layer.settlement(0.0, 1e9) == pytest.approx(1e4 * 2.0 / 1e7, rel=1e-12)
    assert layer.pressure(np.array([2.0]), 1e-3)[0] == pytest.approx(1e4, rel=1e-6)


@pytest.mark.parametrize(
    "t, settlement", [(0.1, 0.0502762), (0.5, 0.1124206), (1.0, 0.1588392), (2.0, 0.2202346)]
)
def test_xie_and_leo_gives_the_published_values(t, settlement):
    layer = XieLeo(7.5e6, 1.0, 19.541e6, 1e-4 * 19.541e6 / 1e4)
    assert layer.settlement(0.0, t) == pytest.approx(settlement, rel=1e-6)  # digits of the table


def test_xie_and_leo_is_terzaghi_at_small_strain():
    large = XieLeo(1.0, 1.0, 1e7, 0.1)
    small = Terzaghi(1.0, 1.0, 1e7, 0.1)
    z = np.linspace(0, 1, 5)
    assert large.settlement(z, 2.0) == pytest.approx(
        small.settlement(z, 2.0), rel=1e-6
    )  # the strain of 1e-7
    assert large.pressure(z, 2.0) == pytest.approx(small.pressure(z, 2.0), abs=1e-6)


END_STATES = [
    ("neo_hookean", (-0.278528, -0.133870, -0.048829, -0.024990)),
    ("neo_hookean_j2", (-0.335436, -0.146354, -0.050410, -0.025398)),
]


def elastic(law):
    return ELASTIC[law](LAM, MU, N_S, **examples(ELASTIC[law]))


def drained_ratio(law, load):
    return confined_ratio(elastic(law).confined, load, elastic(law).lowest_ratio)


@pytest.mark.parametrize("law, settlements", END_STATES)
def test_end_states_are_the_published_ones(law, settlements):
    found = [drained_ratio(law, q) - 1 for q in (7.5e6, 3e6, 1e6, 0.5e6)]
    assert found == pytest.approx(settlements, abs=6e-7)  # half of the last digit
    assert drained_ratio("linear_elastic", 7.5e6) - 1 == pytest.approx(-0.383808, abs=6e-7)


@pytest.mark.parametrize("law", [name for name, law in ELASTIC.items() if not law.anisotropic])
def test_the_uniaxial_stress_is_that_of_the_law(law):
    """Two independent formulas: the closed form of one dimension and the tensor law of the
    package.
    """
    J = np.linspace(0.72, 1.2, 9)
    H = np.zeros((len(J), 3, 3))
    H[:, 2, 2] = J - 1
    stress = elastic(law).stress(H)[:, 2, 2]
    assert elastic(law).confined(J) == pytest.approx(
        stress, rel=1e-12, abs=1e-8
    )  # round-off of 1e6


def test_a_law_that_cannot_carry_the_load_is_refused():
    with pytest.raises(ValueError):
        drained_ratio("saint_venant_kirchhoff", 7.5e6)
    assert N_S < drained_ratio("ehlers_eipper", 1e12) < N_S + 1e-5  # approached, never crossed


def test_the_selfweight_column_settles_as_published():
    weight = N_S * 1000.0 * 10.0
    column = Selfweight(weight, 10.0, LAM + 2 * MU, 19.541, elastic("neo_hookean").confined)
    assert column.end_settlement(0.0) == pytest.approx(
        0.0171071, abs=5e-8
    )  # half of the last digit
    z = np.linspace(0, 10, 5)
    assert column.pressure(z, 1e-4) == pytest.approx(
        weight * z, abs=weight * 0.05
    )  # the layer at the base, √(c_v t)
    linear = Selfweight(weight, 10.0, LAM + 2 * MU, 19.541, elastic("linear_elastic").confined)
    assert linear.end_settlement(0.0) == pytest.approx(0.0171434, abs=5e-8)
    assert linear.settlement(z, 1e3) == pytest.approx(linear.end_settlement(z), rel=1e-9, abs=1e-15)


def slab(nu):
    """Return Mandel's slab of unit sizes."""
    mu = 1.0
    lam = 2 * mu * nu / (1 - 2 * nu)
    return Mandel(1.0, 1.0, lam, mu, 1.0)


def test_mandel_overshoots():
    assert slab(0.2).pressure(np.zeros(1), 0.05)[0] == pytest.approx(
        0.54944, abs=5e-6
    )  # published, above F/2a = 0.5
    x = np.linspace(0, 0.9, 5)
    assert slab(0.2).pressure(x, 1e-5) == pytest.approx(0.5, rel=2e-3)  # p(x, 0+), but for √T


@pytest.mark.parametrize("t", [0.02, 0.3])
def test_mandel_keeps_its_force_and_its_balances(t):
    slab_02 = slab(0.2)
    x = np.linspace(0, 1, 2001)
    h = 1e-5
    e = np.gradient(slab_02.displacement_x(x, t), x, edge_order=2) + slab_02.displacement_y(1.0, t)
    sigma = (
        slab_02.lam * e + 2 * slab_02.mu * slab_02.displacement_y(1.0, t) - slab_02.pressure(x, t)
    )
    force = ((sigma[1:] + sigma[:-1]) / 2 * np.diff(x)).sum()
    assert force == pytest.approx(-1.0, rel=1e-5)  # the trapezoidal rule, dx²
    horizontal = (
        slab_02.lam * e
        + 2 * slab_02.mu * (e - slab_02.displacement_y(1.0, t))
        - slab_02.pressure(x, t)
    )
    assert np.abs(horizontal[1:-1]).max() < 1e-4  # no traction at the sides, so none anywhere (dx²)
    x = np.linspace(0.1, 0.9, 5)
    rate = (slab_02.pressure(x, t + h) - slab_02.pressure(x, t - h)) / (2 * h)
    curvature = (
        slab_02.pressure(x + 1e-3, t) - 2 * slab_02.pressure(x, t) + slab_02.pressure(x - 1e-3, t)
    ) / 1e-6
    p_rate_of_force = (
        rate - curvature
    )  # p_t = c p_xx + the rate of the stress, which depends on time only
    assert np.ptp(p_rate_of_force) < 1e-4 * np.abs(rate).max()


NU = 0.125  # of cartilage, E = 0.675 MPa, K/μ_f = 7.6e-15 m⁴/(N s)
SHEAR = 0.675e6 / 2 / (1 + NU)
LAMBDA = 0.675e6 * NU / (1 + NU) / (1 - 2 * NU)
BULGING = LAMBDA, SHEAR, (LAMBDA + 2 * SHEAR) * 7.6e-15
R = 3.175e-3
STRAIN = 0.01


def test_the_unconfined_cylinder_bulges_as_published():
    """Armstrong, Lai & Mow 1984, their u_r(R) = R ε [ν + (1-2ν)(1-ν) Σ e^(-a² T)/(a² (1-ν)² -
    (1-2ν))] summed here by itself.
    """
    cylinder = UnconfinedCylinder(STRAIN, R, *BULGING)
    for t, listed in ((10.0, 0.464), (100.0, 0.382), (600.0, 0.217)):
        a = cylinder.roots
        T = BULGING[2] * t / R**2
        published = (
            NU
            + (1 - 2 * NU)
            * (1 - NU)
            * (np.exp(-(a**2) * T) / (a**2 * (1 - NU) ** 2 - (1 - 2 * NU))).sum()
        )
        found = cylinder.displacement(np.array([R]), t)[0] / (R * STRAIN)
        assert found == pytest.approx(published, rel=1e-12) and found == pytest.approx(
            listed, abs=5e-4
        )  # half of the last digit


BODIES = {"cylinder": (UnconfinedCylinder, 1), "strip": (UnconfinedStrip, 0)}


@pytest.mark.parametrize("body", BODIES)
@pytest.mark.parametrize("t", [20.0, 300.0])
def test_unconfined_compression_keeps_its_balances(body, t):
    """σ_r' + (σ_r - σ_θ)/r = 0, Darcy's law against the rate of the volume, a free drained side; by
    differences.
    """
    (kind, curved), (lam, mu, c) = BODIES[body], BULGING
    exact = kind(STRAIN, R, lam, mu, c)
    r = np.linspace(0.2, 0.9, 8) * R
    h = 1e-4 * R

    def slope(f, r):
        return (f(r + h) - f(r - h)) / (2 * h)

    def u(r):
        return exact.displacement(r, t)

    def p(r):
        return exact.pressure(r, t)

    def dilation(r):
        return slope(u, r) + curved * u(r) / r

    stiff = lam + 2 * mu
    assert slope(p, r) == pytest.approx(
        stiff * slope(dilation, r), abs=1e-4 * stiff * STRAIN / R
    )  # h² and round-off of h
    rate = (exact.displacement(r, t + 1e-3) - exact.displacement(r, t - 1e-3)) / 2e-3
    assert rate == pytest.approx(c / stiff * slope(p, r), rel=1e-4)
    side = np.array([R])
    inward = (u(side) - u(side - h)) / h
    radial = stiff * inward + lam * (curved * u(side) / R - STRAIN) - p(side)
    assert radial == pytest.approx(0.0, abs=1e-3 * stiff * STRAIN)  # the one-sided difference, h/R


@pytest.mark.parametrize("body", BODIES)
def test_unconfined_compression_starts_undrained_and_ends_with_poissons_ratio(body):
    kind, curved = BODIES[body]
    exact = kind(STRAIN, R, *BULGING)
    r = np.linspace(0.1, 0.8, 5) * R
    start = STRAIN * r / (1 + curved)
    end = (NU if curved else NU / (1 - NU)) * STRAIN * r
    pressure = SHEAR * STRAIN * (1 if curved else 2)
    assert exact.displacement(r, 0.01) == pytest.approx(
        start, rel=2e-3
    )  # the skin at the side, √T of it
    assert exact.pressure(r, 0.01) == pytest.approx(pressure, rel=5e-3)
    assert exact.displacement(r, 1e5) == pytest.approx(end, rel=1e-9)
    assert np.abs(exact.pressure(r, 1e5)).max() < 1e-9 * pressure


def test_the_strip_pressure_starts_as_the_undrained_one_and_obeys_the_load():
    strip = StripFooting(2.0, 1.5, 1.0, 1.0, 1.0)
    x = np.array([0.0, 1.0, 3.0])
    z = np.array([1.0, 2.0, 3.0])
    undrained = 2.0 / np.pi * (np.arctan((1.5 - x) / z) + np.arctan((1.5 + x) / z))
    assert strip.pressure(x, z, 1e-4) == pytest.approx(
        undrained, rel=0.02
    )  # the skin at the surface, √T of it
    assert strip.pressure(x, np.zeros(3), 0.1) == pytest.approx(
        0.0, abs=1e-6
    )  # digits of the inversion
    assert np.abs(strip.pressure(x, z, 1e4)).max() < 1e-3


def test_the_strip_settles_by_the_difference_of_its_elastic_states_and_by_its_outflow():
    """Volume: the surface sinks by what has flown out through it, ∫ w dx = ∫∫ k/γ dp/dz; here by
    the transform of the load.
    """
    strip = StripFooting(1.0, 1.0, 1.0, 1.0, 1.0)  # η = 3/2
    x = np.linspace(-40, 40, 801)
    sunk = [strip.settlement_increment(x, t).sum() * (x[1] - x[0]) for t in (0.3, 0.5)]
    h = 1e-4
    times = 0.3 + 0.2 * (np.arange(10) + 0.5) / 10
    flux = [
        strip.pressure(x, np.full(x.shape, h), t).sum() * (x[1] - x[0]) / h / 3.0 for t in times
    ]  # k/γ = c_v/E_c
    assert np.diff(sunk)[0] == pytest.approx(
        np.mean(flux) * 0.2, rel=2e-3
    )  # what lies beyond x = 40, differences of h


RING = Ring(0.95, 1.05, 1.5, 1e6 * 0.3 / (1.3 * 0.4), 1e6 / 2.6, 1000.0)  # E = 1e6 Pa, ν = 0.3


@pytest.mark.parametrize(
    "fluid_density, omega",
    [(0.0, 2.555042), (14.0, 2.435615), (140.0, 1.804513), (1400.0, 0.768654)],
)
def test_the_ring_vibrates_at_the_published_frequencies(fluid_density, omega):
    assert RING.frequency(fluid_density) == pytest.approx(omega, rel=1e-6)  # digits of the table


def characteristic_sign(ring, omega, fluid_density):
    """Return the sign of the determinant of the tractions of ∇(B_n(ω r/c_p) cos nθ) + curl(B_n(ω
    r/c_s) sin nθ), B = J, Y.
    """
    n = ring.mode
    m = fluid_density * ring.added_length * omega**2
    p = omega * np.sqrt(ring.density / (ring.lam + 2 * ring.mu))
    q = omega * np.sqrt(ring.density / ring.mu)
    rows = np.zeros((4, 4))
    for side, r in enumerate((ring.inner, ring.outer)):
        for i, bessel in enumerate((jvp, yvp)):
            for j, k in enumerate((p, q)):
                B, B1, B2 = (k**order * bessel(n, k * r, order) for order in range(3))
                U, dU = (B1, B2) if j == 0 else (n * B / r, n * (B1 / r - B / r**2))
                V, dV = (-n * B / r, -n * (B1 / r - B / r**2)) if j == 0 else (-B1, -B2)
                normal = (
                    ring.lam * (dU + (U + n * V) / r) + 2 * ring.mu * dU - side * m * U
                )  # σ_rr = -p = ρ_f m ω² U
                rows[2 * side : 2 * side + 2, 2 * i + j] = normal, ring.mu * (dV - (n * U + V) / r)
    return np.linalg.slogdet(rows / np.abs(rows).max(axis=0))[0]


@pytest.mark.parametrize("mode", [2, 3])
@pytest.mark.parametrize("outer", [1.05, 1.9])
@pytest.mark.parametrize("fluid_density", [0.0, 140.0])
def test_the_frequency_of_the_ring_is_a_zero_of_the_bessel_determinant(mode, outer, fluid_density):
    ring = Ring(0.95, outer, 2.5, RING.lam, RING.mu, 1000.0, mode)
    omega = ring.frequency(fluid_density)
    below, above = (
        characteristic_sign(ring, omega * (1 + shift), fluid_density) for shift in (-1e-7, 1e-7)
    )
    assert below == -above  # 1e-7: the digits of the polynomials


def test_the_shape_of_the_ring_bends_it_without_stretch():
    angle = np.linspace(0, np.pi / 2, 9)
    step = 1e-5
    middle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    along = np.stack([-np.sin(angle), np.cos(angle)], axis=1)
    strain = (
        (RING.shape(middle + step * along) - RING.shape(middle - step * along)) / (2 * step) * along
    ).sum(axis=1)
    assert (
        np.abs(strain).max() < 0.1**2 / 12
    )  # of the radius, the part of h²/12R² that theories of thin rings leave out
    thinning = (
        0.3 / 0.7 * 3 * 0.1**2 / 8
    )  # ν/(1 - ν) ∫ (n² - 1) z/R² dz from the middle to the outer surface, where u_r = 1
    ends = RING.shape(np.array([[1.05, 0.0], [1.0, 0.0], [0.0, 1.0]]))
    assert ends == pytest.approx(
        np.array([[1, 0], [1 + thinning, 0], [0, -1 - thinning]]), abs=0.1 * thinning
    )  # h/R


@pytest.mark.parametrize("nu, peak", [(0.0, 1.5573), (0.1, 1.4663), (0.25, 1.3075)])
def test_cryers_sphere_has_the_published_peak_and_keeps_its_balances(nu, peak):
    """The sphere of unit sizes: T = t; peaks by the sum of Cryer (1963) as Cheng (Poroelasticity,
    2016) writes it.
    """
    lam = 2 * 0.5 * nu / (1 - 2 * nu)
    mu = 0.5
    sphere = Cryer(1.0, 1.0, lam, mu, 1.0)
    assert sphere.pressure(np.zeros(1), 0.05)[0] == pytest.approx(
        peak, abs=5e-5
    )  # digits of the value
    assert sphere.displacement(np.ones(1), 10.0)[0] == pytest.approx(
        -1 / (3 * lam + 2 * mu), rel=1e-9
    )  # drained
    r = np.linspace(0.2, 0.8, 7)
    t = 0.05
    h = 1e-3
    e = sphere.displacement(r + h, t) * (r + h) ** 2 - sphere.displacement(r - h, t) * (r - h) ** 2
    e /= 2 * h * r**2
    p = sphere.pressure(r, t)
    assert np.ptp((lam + 2 * mu) * e - p) < 1e-5 * np.ptp(p)  # E_c e' = p'; differences, h²
    u, inside, deeper = sphere.displacement(1 - h * np.arange(3), t)
    stretch = (3 * u - 4 * inside + deeper) / (2 * h)
    assert lam * (stretch + 2 * u) + 2 * mu * stretch == pytest.approx(
        -1.0, abs=1e-5
    )  # the load, p = 0


def test_the_seabed_keeps_its_volume_and_its_balances():
    bed = Seabed(2.0, 7.0, 1.0, 0.5)
    x = np.array([0.3, 1.1, 2.9])
    z = np.array([0.4, 1.0, 2.0])
    t = 0.7
    h = 1e-4

    def slopes(component):
        """Return the derivatives by x and by the height of a component."""
        along = (
            bed.displacement(x + h, z, t)[component] - bed.displacement(x - h, z, t)[component]
        ) / (2 * h)
        up = (
            bed.displacement(x, z - h, t)[component] - bed.displacement(x, z + h, t)[component]
        ) / (2 * h)
        return along, up

    def laplacian(field, step=1e-2):
        near = field(x + step, z) + field(x - step, z) + field(x, z + step) + field(x, z - step)
        return (near - 4 * field(x, z)) / step**2

    (u_x, u_x_up), (u_y_along, u_y) = slopes(0), slopes(1)
    assert u_x + u_y == pytest.approx(0.0, abs=1e-7)  # no change of volume
    assert laplacian(lambda x, z: bed.pressure(x, z, t)) == pytest.approx(
        0.0, abs=1e-4
    )  # no flow but of a harmonic p
    force = (bed.pressure(x, z - h, t) - bed.pressure(x, z + h, t)) / (2 * h)
    assert bed.mu * laplacian(lambda x, z: bed.displacement(x, z, t)[1]) == pytest.approx(
        force, rel=1e-3
    )  # μ Δu = ∇p
    z = np.full(3, h)  # no effective traction on the surface: σ_yy = 2 μ u_y' and the shear stress
    (_, u_x_up), (u_y_along, u_y) = slopes(0), slopes(1)
    assert np.abs([u_y, u_x_up + u_y_along]).max() < 2 * h * bed.wavenumber * np.abs(u_x).max() * 5
