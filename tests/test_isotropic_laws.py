"""Laws of Ogden and of Holmes & Mow against their published stresses."""

import numpy as np
import pytest

from porofsi_petsc import Simulation, load_scene
from porofsi_petsc.errors import InputError
from porofsi_petsc.materials import ELASTIC

# Ogden 1972: rubber of Treloar's tests, three terms μ_p [Pa] and α_p
RUBBER = np.array([6.3e5, 0.012e5, -0.1e5]), np.array([1.3, 5.0, -2.0])


def rubber():
    moduli, exponents = RUBBER
    mu = moduli @ exponents / 2
    shares = tuple(moduli * exponents / (2 * mu))
    return ELASTIC["ogden"](1e8, mu, exponents=tuple(exponents), shares=shares)


def test_the_rubber_of_ogden_has_its_small_shear_modulus():
    assert rubber().mu == pytest.approx(4.225e5)


@pytest.mark.parametrize("kind, power", [("uniaxial", -0.5), ("equibiaxial", -2.0), ("shear", -1)])
def test_the_rubber_of_ogden_is_stretched_as_published(kind, power):
    """At constant volume the difference of two principal Kirchhoff stresses knows no pressure: Σ
    μ_p (λ^α_p - λ_3^α_p) with λ_3 = λ^power.
    """
    moduli, exponents = RUBBER
    for stretch in (1.2, 3.0, 6.0):
        second = {"uniaxial": stretch**-0.5, "equibiaxial": stretch, "shear": 1.0}[kind]
        F = np.diag([stretch, second, stretch**power])
        tau = np.diag(rubber().stress((F - np.eye(3))[None])[0]) * np.diag(F)
        expected = moduli @ (stretch**exponents - stretch ** (power * exponents))
        assert tau[0] - tau[2] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("dim", [2, 3])
def test_with_the_exponent_two_ogden_is_neo_hooke_whatever_stretches_coincide(dim):
    H = 0.2 * np.random.default_rng(0).standard_normal((7, dim, dim))
    H[0] = 0.0
    H[1] = 0.3 * np.eye(dim)
    H[2] = np.diag([0.2, 0.2, -0.1][:dim])
    H[3:6] = H[2] + np.array([1e-15, 1e-12, 1e-7])[:, None, None] * H[3:6]
    found = ELASTIC["ogden"](1.7, 0.8, exponents=(2.0,))
    expected = ELASTIC["neo_hookean"](1.7, 0.8)
    for quantity in "energy", "stress", "tangent":
        a, b = (getattr(law, quantity)(H) for law in (found, expected))
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-13)  # round-off of numbers of order one


def test_two_coincident_stretches_have_the_limit_of_the_tangent():
    """A law that is not a polynomial: the tangent at equal stretches is that beside them."""
    law = ELASTIC["ogden"](1.7, 0.8, exponents=(7.0, -3.0), shares=(0.4, 0.6))
    H = np.diag([0.2, 0.2, -0.1])
    turn = np.random.default_rng(1).standard_normal((3, 3))
    beside = np.stack([H + step * turn for step in (0.0, 1e-6, -1e-6)])
    at, plus, minus = law.tangent(beside)
    np.testing.assert_allclose(at, (plus + minus) / 2, rtol=0, atol=1e-9)  # step², round-off


def test_the_stress_of_holmes_and_mow_is_the_published_one():
    """σ = e^Q/(2J) [(2μ + λ (I1 - 1)) B - λ B² - E_c I], e^Q = exp(β ((2μ - λ)(I1 - 3) + λ (I2 -
    3))/E_c)/J^(2β) (Holmes & Mow 1990).
    """
    lam, mu, beta = 0.1, 0.45, 0.35
    F = np.eye(3) + 0.25 * np.random.default_rng(2).standard_normal((3, 3))
    B = F @ F.T
    J = np.linalg.det(F)
    first = np.trace(B)
    second = (first**2 - np.trace(B @ B)) / 2
    modulus = lam + 2 * mu
    growth = np.exp(beta * ((2 * mu - lam) * (first - 3) + lam * (second - 3)) / modulus)
    growth /= J ** (2 * beta)
    sigma = (2 * mu + lam * (first - 1)) * B - lam * B @ B - modulus * np.eye(3)
    sigma *= growth / (2 * J)
    law = ELASTIC["holmes_mow"](lam, mu, stiffening=beta)
    P = law.stress((F - np.eye(3))[None])[0]
    np.testing.assert_allclose(P @ F.T / J, sigma, rtol=0, atol=1e-13)


@pytest.mark.parametrize(
    "change, message",
    [
        ("exponents=[2.0, 0.0]", r"exponents: received \[2.0, 0.0\], expected one to three"),
        ("exponents=[2.0, 3.0]", r"shares: received \[1.0\], expected one of each of the 2"),
        ("exponents=[]", r"exponents: received \[\], expected one to three"),
        ("exponents=2.0", r"exponents\]: received 2.0, expected"),
    ],
)
def test_terms_that_are_no_law_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        load_scene("ehlers_eipper", ("material.0.solid.law=ogden", f"material.0.solid.{change}"))


def test_a_scene_gives_the_terms_as_lists():
    terms = "material.0.solid.exponents=[3.0, -2.0]", "material.0.solid.shares=[0.7, 0.3]"
    scene = load_scene("ehlers_eipper", ("material.0.solid.law=ogden", *terms))
    law = scene.material[0].elastic_law()
    assert (law.exponents, law.shares) == ((3.0, -2.0), (0.7, 0.3))


@pytest.mark.parametrize(
    "moduli, key",
    [
        ("young=1e6,poisson=0.45", r"solid.poisson\]: received 0.45 .* at most 0.333333"),
        ("mu=4e5,lambda=1e7", r"solid.lambda\]: received 1e\+07 .* at most 2 mu"),
    ],
)
def test_moduli_with_which_a_law_has_no_stiffness_in_tension_are_refused(moduli, key):
    """Holmes and Mow: from λ > 2μ on a body pushes where it is pulled."""
    solid = f"{{law='holmes_mow',density=1000.0,stiffening=1.0,{moduli}}}"
    with pytest.raises(InputError, match=key):
        Simulation(load_scene("ehlers_eipper", (f"material.0.solid={solid}",)))
