"""The values that the scenes of tissue expect, worked out from the formulas of their sources."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from porofsi_petsc import load_scene
from porofsi_petsc.exact import Terzaghi, UnconfinedCylinder

WIDTH = 0.2e-3  # of the strips in the plane [m]


def expected(name, quantity):
    """Return at -> value of a scene."""
    return {e.at: e.value for e in load_scene(name).expect if e.quantity == quantity}


def test_relaxation_after_a_ramp():
    """Mow, Kuei, Lai & Armstrong 1980: u_t = H k u_xx between u = V t at the drained surface and 0
    at the base; σ = H u_x at the surface, to which the series of the steady profile belongs.
    """
    H, k, h, end, strain = 0.7e6, 7.6e-16, 1e-3, 100.0, 0.05
    rate = H * k / h**2
    n = np.arange(1, 4000)

    def series(t):
        return 2 / np.pi**2 * np.sum(np.exp(-((n * np.pi) ** 2) * rate * t) / n**2) / rate

    for t, value in expected("cartilage_relaxation", "foot.f_y").items():
        late = series(t - end) if t > end else 1 / (3 * rate)
        stress = H * strain / end * (min(t, end) + late - series(t))
        assert value == pytest.approx(-WIDTH * stress, rel=1e-5)


def test_large_confined_compression():
    H, beta, J = 0.4e6, 0.35, 0.8
    stress = H / 2 * (J**2 - 1) / J ** (2 * beta + 1) * np.exp(beta * (J**2 - 1))
    (value,) = expected("cartilage_confined", "foot.f_y").values()
    assert value == pytest.approx(WIDTH * stress, rel=1e-5)


def test_permeation():
    """Balance P_J J_X = p_X and the flux q = -(k/J) p_X; H ln J = -70 kPa at the filter."""
    H, k, M, p, h = 0.7e6, 1e-15, 4.3, 7e4, 1e-3

    def flow(J):
        return k * np.exp(M * (J - 1)) / J * (H / J)

    lowest = np.exp(-p / H)
    flux = quad(flow, lowest, 1)[0] / h
    settlement = quad(lambda J: (1 - J) * flow(J) / flux, lowest, 1)[0]
    (value,) = expected("cartilage_permeation", "filter.flow_rate").values()
    assert value == pytest.approx(WIDTH * flux, rel=1e-5)
    (value,) = expected("cartilage_permeation", "top.u_y").values()
    assert value == pytest.approx(-settlement, rel=1e-5)


def test_unconfined_with_an_axis():
    """Cohen, Lai & Mow 1998: u - s r is that of an isotropic disc with λ = C12, H = C11 under ε - 2
    s, s = ε (C13 - C12)/(C11 - C12), since s r has no gradient of its divergence.
    """
    C = load_scene("cartilage_unconfined").material[0].elastic_law().stiffness(3)
    C11, C12, C13 = C[0, 0, 0, 0], C[0, 0, 2, 2], C[0, 0, 1, 1]
    R, strain, k = 3e-3, 0.01, 1e-15
    s = strain * (C13 - C12) / (C11 - C12)
    disc = UnconfinedCylinder(strain - 2 * s, R, C12, (C11 - C12) / 2, C11 * k)
    for t, value in expected("cartilage_unconfined", "side.u_x").items():
        exact = disc.displacement(np.array([R]), t)[0] + s * R
        assert value == pytest.approx(exact, rel=1e-5)
    for t, value in expected("cartilage_unconfined", "centre.p").items():
        assert value == pytest.approx(disc.pressure(np.zeros(1), t)[0], rel=1e-5)


def indentation(nu, aspect):
    """Return κ of P = 4 G a d/(1 - ν) κ, a flat cylinder of radius a without friction on a layer
    of thickness h = a/aspect bonded to a rigid base.

    φ(t) - 2/π ∫_0^1 φ(s) ∫_0^∞ (1 - L(u h/a)) cos(ut) cos(us) du ds = 1, κ = ∫ φ dt; L the answer
    of the surface to a pressure of one wave number over that of a half space (Lebedev & Ufliand
    1958).
    """
    k = 3 - 4 * nu
    u, step = np.linspace(1e-9, 40 * (1 + aspect), 8001, retstep=True)
    x = u / aspect
    e = np.exp(-2 * x)
    L = (k * (1 - e * e) - 4 * x * e) / (k * (1 + e * e) + (1 + k * k + 4 * x * x) * e)
    simpson = step / 3 * np.where(np.arange(len(u)) % 2, 4.0, 2.0)
    simpson[[0, -1]] = step / 3
    nodes, weights = np.polynomial.legendre.leggauss(30)
    cosines = np.cos(np.multiply.outer((nodes + 1) / 2, u))
    kernel = (cosines * (simpson * (1 - L))) @ cosines.T
    phi = np.linalg.solve(np.eye(30) - kernel * weights / np.pi, np.ones(30))
    return phi @ weights / 2


def test_indentation_of_a_layer():
    assert indentation(0.3, 0.01) == pytest.approx(1.0, abs=0.01)  # the half space
    G, nu, a, depth = 0.3e6, 0.125, 1e-3, 1e-5
    force = 4 * G * a * depth / (1 - nu) * indentation(nu, 1.0)
    (value,) = expected("cartilage_indentation", "indenter.f_y").values()
    assert value == pytest.approx(force, rel=1e-5)


def test_an_artery_stretched_in_two_directions():
    lam, mu, k1, k2 = 50e3, 3e3, 2363.2, 0.8393
    direction = np.array([np.cos(np.radians(29)), np.sin(np.radians(29)), 0.0])

    def nominal(third):
        stretch = np.array([1.3, 1.2, third])
        E = (direction * stretch) @ (direction * stretch) - 1
        fibres = 4 * k1 * E * np.exp(k2 * E**2) * stretch * direction**2
        return mu * (stretch - 1 / stretch) + lam * np.log(stretch.prod()) / stretch + fibres

    third = brentq(lambda z: nominal(z)[2], 0.3, 1.2, xtol=1e-15)
    stress = nominal(third) / (1.3 * 1.2 * third) * (1.3, 1.2, third)
    for quantity, exact in (
        ("u_z", 1e-3 * (third - 1)),
        ("stress_xx", stress[0]),
        ("stress_yy", stress[1]),
    ):
        (value,) = expected("artery_biaxial", f"patch.{quantity}").values()
        assert value == pytest.approx(exact, rel=1e-5)


def test_a_layered_soil():
    modulus = 10e6 * 0.8 / (1 - 0.2 - 2 * 0.1**2 * 3)
    column = Terzaghi(1e4, 10.0, modulus, modulus * 1e-7)
    for t, value in expected("layered_column", "top.u_y").items():
        assert value == pytest.approx(-column.settlement(np.zeros(1), t)[0], rel=1e-5)
    for t, value in expected("layered_column", "base.p").items():
        assert value == pytest.approx(column.pressure(np.array([10.0]), t)[0], rel=1e-5)
