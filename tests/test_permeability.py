"""Permeability laws and their drag, against fractions worked out by hand from the formulas of their
papers.
"""

from fractions import Fraction
from math import exp
from types import SimpleNamespace

import numpy as np
import pytest

from porofsi_petsc.materials import ELASTIC, PERMEABILITY
from porofsi_petsc.materials.porous import PorousMaterial
from porofsi_petsc.registry import examples, parameters

ROUND_OFF = 1e-14
# law -> (n_s0, exponent and slope, ((J, k/k0), …)): one state in compression, one in extension
BY_HAND = {
    "constant": (
        Fraction(1, 4),
        3,
        ((Fraction(7, 10), Fraction(1)), (Fraction(8, 5), Fraction(1))),
    ),
    # Markert, Transp. Porous Media 70 (2007) 427: [(J - n)/(1 - n)]^kappa = (9/20 : 3/4)^3, (27/20
    # : 3/4)^3
    "markert": (
        Fraction(1, 4),
        3,
        ((Fraction(7, 10), Fraction(27, 125)), (Fraction(8, 5), Fraction(729, 125))),
    ),
    # Ehlers & Eipper, Transp. Porous Media 34 (1999) 179: (n_f/n_f0)^kappa = (1/2 : 3/5)^2, (4/5 :
    # 3/5)^2
    "ehlers_eipper": (
        Fraction(2, 5),
        2,
        ((Fraction(4, 5), Fraction(25, 36)), (Fraction(2), Fraction(16, 9))),
    ),
    # Kozeny-Carman, n_f^3/(1 - n_f)^2: (5/6)^3 (4/5)^2 and (4/3)^3 2^2; it has no exponent
    "kozeny_carman": (
        Fraction(2, 5),
        7,
        ((Fraction(4, 5), Fraction(10, 27)), (Fraction(2), Fraction(256, 27))),
    ),
    # Holmes & Mow, J. Biomech. 23 (1990) 1145: that of Markert times exp(M (J² - 1)/2)
    "holmes_mow": (
        Fraction(1, 4),
        3,
        ((Fraction(7, 10), 0.216 * exp(-0.765)), (Fraction(8, 5), 5.832 * exp(2.34))),
    ),
    # Lai & Mow, Biorheology 17 (1980) 111: exp(M e), e = J - 1
    "exponential": (Fraction(1, 4), 3, ((Fraction(7, 10), exp(-0.9)), (Fraction(8, 5), exp(1.8)))),
    # Xie & Leo, Comput. Geotech. 31 (2004) 301: k/k0 = J^2; it knows neither n nor an exponent
    "xie_leo": (
        Fraction(2, 5),
        7,
        ((Fraction(4, 5), Fraction(16, 25)), (Fraction(3, 2), Fraction(9, 4))),
    ),
}


def permeability(law):
    number = BY_HAND[law][1]
    return PERMEABILITY[law](**dict.fromkeys(parameters(PERMEABILITY[law]), number))


def material(law, **changes):
    n_s0 = BY_HAND[law][0]
    elastic = ELASTIC["neo_hookean"](lam=3.0, mu=2.0, n_s0=float(n_s0))
    given = dict(rho_sR=2000.0, rho_fR=1000.0, drag0=1e4, permeability=permeability(law))
    return PorousMaterial(elastic=elastic, n_s0=float(n_s0), **given, **changes)


@pytest.mark.parametrize("law", PERMEABILITY)
def test_factor_is_that_of_the_paper(law):
    n_s0, _, states = BY_HAND[law]
    J, expected = (
        np.array([float(entry) for entry in column]) for column in zip(*states, strict=True)
    )
    assert permeability(law).factor(J, float(n_s0)) == pytest.approx(expected, rel=ROUND_OFF)
    assert permeability(law).factor(np.ones(1), float(n_s0)) == pytest.approx(1.0, rel=ROUND_OFF)


@pytest.mark.parametrize("variable", [False, True], ids=["constant porosity", "variable porosity"])
@pytest.mark.parametrize("law", PERMEABILITY)
def test_drag_is_the_squared_fluid_fraction_over_the_permeability(law, variable):
    """S = n_f² γ/k(J), n_f = 1 - n_s0/J or 1 - n_s0, in exact fractions."""
    n_s0, _, states = BY_HAND[law]
    for J, factor in states:
        n_f = 1 - n_s0 / J if variable else 1 - n_s0
        drag = material(law, variable_porosity=variable).drag(np.array([float(J)]))
        assert drag.scale == pytest.approx(float(10_000 * n_f**2 / factor), rel=ROUND_OFF)


@pytest.mark.parametrize("law", PERMEABILITY)
def test_volume_derivatives_are_those_of_drag_and_fluid_fraction(law):
    body = material(law, variable_porosity=True)
    J = np.array([0.9, 1.3])
    step = 1e-6

    def slope(function):
        """Return J times the central difference, whose truncation is of order step² = 1e-12."""
        return J * (function(J + step) - function(J - step)) / (2 * step)

    fraction, density, drag = body.volume_derivatives(J)
    assert fraction == pytest.approx(slope(body.fluid_fraction), rel=1e-8)
    assert drag.scale == pytest.approx(slope(lambda J: body.drag(J).scale), rel=1e-8)
    through = body.pore_fluid
    fraction, of_density, drag = through.volume_derivatives(J)
    assert not fraction.any() and (through.flow_fraction(J) == 1).all()
    expected = slope(through.fluid_density) / through.fluid_density(J)
    assert (of_density, density) == (pytest.approx(expected, rel=1e-8),) * 2
    assert drag.scale == pytest.approx(slope(lambda J: through.drag(J).scale), rel=1e-8)


def test_fractions_and_densities_of_the_limits():
    """A free fluid has no skeleton, a dense solid no fluid; a porous one flows through with the
    averaged velocity n_f v_f.
    """
    body = material("markert", variable_porosity=True)
    J = np.array([0.5, 2.0])
    assert body.rho_s == 500.0
    assert body.fluid_fraction(J) == pytest.approx([0.5, 0.875], rel=ROUND_OFF)
    assert body.fluid_fraction_slope(J) == pytest.approx([0.5, 0.125], rel=ROUND_OFF)
    averaged = body.drag(J).scale / body.fluid_fraction(J) ** 2
    assert body.immersed.drag(J).scale == pytest.approx(averaged, rel=ROUND_OFF)
    assert body.pore_fluid.drag(J).scale == pytest.approx(averaged, rel=ROUND_OFF)
    assert body.pore_fluid.fluid_density(J) == pytest.approx([500.0, 875.0], rel=ROUND_OFF)
    assert body.pore_fluid.drag0 == body.drag0
    constant = material("markert")
    assert constant.viscosity == 0.0
    second = SimpleNamespace(G=np.ones((1, 2, 3, 2)), volume_gradient=np.ones((1, 2, 2)))
    assert not constant.flow_fraction_gradient(np.ones((1, 2)), second).any()
    assert body.flow_fraction_gradient(np.full((1, 2), 0.5), second) == pytest.approx(
        np.full((1, 2, 2), 0.5)
    )
    free = PorousMaterial.free_fluid(1000.0, 1e-3)
    assert (free.drag0, free.viscosity, free.rho_s) == (0.0, 1e-3, 0.0)
    assert free.is_free_fluid and free.fluid_fraction(J).tolist() == [1.0, 1.0]
    dense = PorousMaterial.dense_solid(body.elastic, 7800.0)
    assert (
        not dense.is_free_fluid
        and dense.rho_s == 7800.0
        and dense.fluid_fraction(J).tolist() == [0.0, 0.0]
    )


@pytest.mark.parametrize(
    "law, elastic, variable, closed",
    [
        ("constant", "neo_hookean", False, False),
        ("xie_leo", "neo_hookean", False, False),
        ("constant", "neo_hookean", True, True),
        ("markert", "neo_hookean", False, True),
        ("ehlers_eipper", "neo_hookean", False, True),
        ("kozeny_carman", "neo_hookean", False, True),
        ("constant", "ehlers_eipper", False, True),
    ],
)
def test_pores_close_at_the_initial_solid_fraction_where_something_depends_on_them(
    law, elastic, variable, closed
):
    given = dict(n_s0=0.25, rho_sR=2000.0, rho_fR=1000.0, drag0=1.0)
    given["permeability"] = PERMEABILITY[law](**examples(PERMEABILITY[law]))
    body = PorousMaterial(ELASTIC[elastic](3.0, 2.0, 0.25), variable_porosity=variable, **given)
    assert body.open_pores(np.array([0.25, 0.2501])).tolist() == [not closed, True]
