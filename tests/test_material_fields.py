"""Coefficients of a material that are fields: exact states of graded columns and tubes, orders,
tangents, refusals, restart, ranks.
"""

import re
from math import log

import numpy as np
import pytest
from running import Job, history, needs_mpirun, run_here, run_on

from porofsi_petsc import Simulation, load_scene
from porofsi_petsc.errors import InputError
from porofsi_petsc.materials import ELASTIC
from porofsi_petsc.materials.graded import graded
from porofsi_petsc.materials.viscoelastic import Branch
from porofsi_petsc.registry import examples, parameters
from porofsi_petsc.simulation.preview import preview

YOUNG = {"young": "1e7*(1 + y)", "poisson": 0.0}
LAME = {"lambda": "2e6*(1 + y)", "mu": "4e6 + 4e6*y"}  # λ + 2μ = 1e7 (1 + y)
LAYERS = "where(y < 0.5, 1e-3, 4e-3)"


def column(cells=8, order=2, solid=YOUNG, k="1e-3*(1 + y)", law="linear_elastic", **changes):
    """Return a drained column of height 1 m, pressed by 10 kPa and by 1 kPa of pore pressure at its
    top, after a step in which all of it has consolidated.
    """
    material = {
        "region": "body",
        "porosity": 0.4,
        "solid": {"law": law, "density": 2000.0} | solid,
        "fluid": {"density": 1000.0, "specific_weight": 1e4},
        "permeability": {"law": "constant", "k": k},
    }
    scene = {
        "title": "graded column",
        "mesh": {
            "kind": "rectangle",
            "x": {"points": [0.0, 0.1], "cells": [1]},
            "y": {"points": [0.0, 1.0], "cells": [cells]},
            "order": order,
        },
        "model": {"solid_inertia": False, "fluid_inertia": False},
        "time": {"end": 1e6, "step": 1e6, "rho_inf": 0.0},
        "material": [material | changes.pop("material", {})],
        "boundary": [
            {"on": ["left", "right"], "displacement": {"x": 0.0}, "velocity": {"x": 0.0}},
            {"on": "bottom", "displacement": {"y": 0.0}, "pressure": 0.0},
            {"on": "top", "pressure": 1e3, "traction": {"y": -1e4}},
        ],
        "probe": [
            {"name": "top", "at": [0.05, 1.0], "quantities": ["u_y", "stress_yy"]},
            {"name": "middle", "at": [0.05, 0.5], "quantities": ["p"]},
        ],
        "surface": [{"name": "base", "on": "bottom", "quantities": ["flow_rate"]}],
    }
    return scene | changes


def final(scene):
    """Return the last row of the history of a scene."""
    simulation = Simulation(load_scene(scene))
    simulation.run()
    return {name: values[-1] for name, values in simulation.history.items()}


def settlement():
    """Return ∫ (-1e4 + p)/E dy, p = 1e3 ln(1 + y)/ln 2, E = 1e7 (1 + y) [m]."""
    return (-1e4 * log(2) + 1e3 * log(2) / 2) / 1e7


@pytest.mark.parametrize("solid", [YOUNG, LAME], ids=["young", "lame"])
def test_a_graded_column_settles_as_its_integral_with_second_order(solid):
    """A value for each cell is the rule of its midpoint."""
    errors = [abs(final(column(n, solid=solid))["top.u_y"] / settlement() - 1) for n in (4, 8, 16)]
    assert errors[-1] < 2e-4
    assert np.log2(errors[0] / errors[1]) > 1.85
    assert np.log2(errors[1] / errors[2]) > 1.85


@pytest.mark.parametrize("scheme", ["partitioned", "direct"])
def test_layers_in_series_have_the_harmonic_mean_of_their_permeabilities(scheme):
    """Darcy: 1.6e-3 m/s of 1e-3 and 4e-3 [m/s], 4/5 of the pressure in the lower layer.

    The elements have the exact solution but for what is left of the settlement, 3e-6 of the flow.
    """
    even = {"young": 1e7, "poisson": 0.0}
    found = final(column(4, k=LAYERS, solid=even, coupling={"scheme": scheme}))
    assert found["base.flow_rate"] == pytest.approx(1.6e-3 * 1e3 / 1e4 * 0.1, rel=1e-5)
    assert found["middle.p"] == pytest.approx(800, rel=1e-5)


def test_a_constant_formula_is_the_number():
    numbers = column(solid={"young": 1e7, "poisson": 0.0}, k=1e-3)
    formulas = column(solid={"young": "2*5e6", "poisson": 0.0}, k="1e-3")
    assert final(numbers) == final(formulas)


def test_a_field_of_equal_values_is_the_number():
    """To round-off, for all fields at once and every kind of modulus."""
    wanted = final(column(solid={"young": 1e7, "poisson": 0.25}, k=1e-3))
    everywhere = {"porosity": "0.4 + 0*y"}
    for solid in (
        {"young": "1e7 + 0*y", "poisson": 0.25},
        {"young": 1e7, "poisson": "0.25 + 0*x"},
        {"lambda": "4e6 + 0*y", "mu": 4e6},
    ):
        found = final(
            column(solid=solid | {"density": "2000 + 0*x"}, k="1e-3 + 0*x", material=everywhere)
        )
        for name, value in wanted.items():
            assert found[name] == pytest.approx(value, rel=1e-9, abs=1e-12), name


def test_a_table_over_space_gives_values_at_the_centres(tmp_path):
    path = tmp_path / "k.csv"
    path.write_text("y,k\n" + "".join(f"{y},{1e-3 * (1 + y)}\n" for y in (0.0, 0.5, 1.0)))
    table = {"table": str(path), "over": "y", "column": "k"}
    assert final(column(k=table))["middle.p"] == pytest.approx(
        final(column())["middle.p"], rel=1e-9
    )


NEAR = {"lam": np.array([[1.0], [2.0]]), "mu": np.array([[0.8], [0.3]])}


def of_example(name):
    """Return a law by its moduli, with the parameters of its example."""
    law = ELASTIC[name]
    return lambda lam, mu: law(lam, mu, 0.4, (), **examples(law))


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("name", sorted(ELASTIC))
def test_a_graded_law_is_that_of_each_cell(name, dim):
    """Energy, stress, tangent and mixed tangent; a law that is not linear takes one field."""
    if any(entry.unit == "Pa" for entry in parameters(ELASTIC[name]).values()):
        return  # refused: its further moduli are numbers
    of_moduli = of_example(name)
    H = 0.05 * np.random.default_rng(dim).standard_normal((2, 3, dim, dim))
    before = 0.5 * H
    try:
        law = graded(of_moduli, **NEAR, ratio=6.7, poisson=None)
        lam, mu = NEAR["lam"], NEAR["mu"]
    except ValueError:
        assert name == "holmes_mow"
        mu = np.array([[0.8], [0.3]])
        lam = mu * 0.6 / 0.7
        law = graded(of_moduli, lam, mu, 0.6 / 0.7, 0.3 / 1.3)
        lam = mu * 2 * (0.3 / 1.3) / (1 - 0.6 / 1.3)
    for e in range(2):
        one = of_moduli(float(lam[e, 0]), float(mu[e, 0]))
        for method in ("energy", "stress", "tangent"):
            found = getattr(law, method)(H)[e]
            np.testing.assert_allclose(found, getattr(one, method)(H[e]), rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(
            law.mixed_tangent(H, before)[e],
            one.mixed_tangent(H[e], before[e]),
            rtol=1e-9,
            atol=1e-9,
        )


def test_a_graded_law_remembers_as_that_of_each_cell():
    branches = (Branch(0.4, 2.0),)
    law = ELASTIC["neo_hookean"]
    whole = graded(lambda lam, mu: law(lam, mu, 0.0, branches), **NEAR, ratio=6.7, poisson=None)
    H = 0.05 * np.random.default_rng(3).standard_normal((2, 3, 3, 3))
    internal = np.random.default_rng(4).standard_normal((2, 3, whole.memory))
    for e in range(2):
        one = law(float(NEAR["lam"][e, 0]), float(NEAR["mu"][e, 0]), 0.0, branches)
        np.testing.assert_allclose(
            whole.after(internal, 0.5).stress(H)[e], one.after(internal[e], 0.5).stress(H[e])
        )
        np.testing.assert_allclose(
            whole.updated(internal, 0.5, H)[e], one.updated(internal[e], 0.5, H[e])
        )


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"solid": {"young": "1e7*(y - 0.5)", "poisson": 0.0}}, "material.0.solid.young"),
        ({"solid": {"young": 1e7, "poisson": "0.6*y"}}, "material.0.solid.poisson"),
        ({"k": "1e-3*(0.3 - y)"}, "expected a number > 0"),
        ({"material": {"porosity": "1.2*y"}}, "material.0.porosity"),
        ({"k": "1e-3*(1 + t)"}, "expected a function of position only"),
        ({"k": "1e-3*(1 + z)"}, "expected no z"),
        ({"solid": LAME | {"stiffening": 0.5}, "law": "holmes_mow"}, "not linear in λ and μ"),
        ({"solid": YOUNG | {"poisson": 0.45, "stiffening": 0.5}, "law": "holmes_mow"},
         "expected λ/μ of at most 2"),
        ({"law": "ehlers_eipper", "material": {"porosity": "0.4 + 0.1*y"}}, "compaction point"),
        (
            {"solid": YOUNG | {"young_along": 1e7, "poisson_along": 0.1, "shear_along": 4e6,
                               "axis": [0.0, 1.0, 0.0]}, "law": "transversely_isotropic"},
            "whose 'young_along' is a number",
        ),
        ({"reference": {"solution": "terzaghi", "load": 1e4, "length": 1.0, "times": [1.0]}},
         "whose material is uniform"),
    ],
)  # fmt: skip
def test_what_is_no_coefficient_is_refused(changes, words):
    with pytest.raises(InputError, match=words):
        Simulation(load_scene(column(4, **changes)))


def test_the_place_of_a_wrong_value_is_told():
    with pytest.raises(InputError, match=r"received -2.* at the point \(0\.06.*, 0\.08"):
        Simulation(load_scene(column(4, k="1e-4*(y - 0.375)")))


EVOLVING = dict(
    mesh={
        "kind": "rectangle",
        "x": {"points": [0.0, 0.2], "cells": [2]},
        "y": {"points": [0.0, 1.0], "cells": [6]},
        "order": 2,
    },
    model={"moving_mesh": True, "porosity": "variable", "convection": True},
    time={"end": 4e-3, "step": 1e-3},
    material={"porosity": "0.4 + 0.1*y"},
    solid=LAME | {"density": "2000 + 100*y"},
    law="neo_hookean",
    output={"checkpoint_every": 2},
)


def written(folder, **changes):
    """Return the path of a scene that moves at large strain, with fields of all kinds."""
    import tomli_w

    path = folder / "graded.toml"
    path.write_text(tomli_w.dumps(column(**(EVOLVING | changes))))
    return str(path)


@pytest.mark.parametrize("scheme", ["partitioned", "quasi_direct"])
def test_the_schemes_agree_with_direct(scheme):
    """To the tolerance of the iteration, inertia and large strain included."""
    direct, found = (
        final(column(**EVOLVING, coupling={"scheme": name, "tolerance": 1e-9}))
        for name in ("direct", scheme)
    )
    for name in ("top.u_y", "top.stress_yy", "middle.p"):
        assert found[name] == pytest.approx(direct[name], rel=1e-6)


def test_a_restart_continues_and_compares_the_fields(tmp_path):
    scene = written(tmp_path)
    run_here(Job(scene, str(tmp_path / "whole")))
    run_here(Job(scene, str(tmp_path / "first"), ("time.end=2e-3",)))
    checkpoint = str(tmp_path / "first" / "checkpoint.h5")
    run_here(Job(scene, str(tmp_path / "rest"), (), checkpoint))
    whole, rest = history(tmp_path / "whole"), history(tmp_path / "rest")
    assert whole["top.u_y"][-1] == rest["top.u_y"][-1]
    other = Job(scene, str(tmp_path / "other"), ('material.0.porosity="0.4+0.2*y"',), checkpoint)
    with pytest.raises(InputError, match="porosity"):
        run_here(other)


@needs_mpirun
def test_ranks_agree(tmp_path):
    scene = written(tmp_path)
    for ranks in (1, 2, 3):
        run_on(ranks, [Job(scene, str(tmp_path / str(ranks)))], tmp_path)
    one = history(tmp_path / "1")
    for ranks in (2, 3):
        other = history(tmp_path / str(ranks))
        for name in ("top.u_y", "top.stress_yy", "middle.p"):
            np.testing.assert_allclose(other[name], one[name], rtol=1e-7, atol=1e-15)


def test_check_tells_the_range_of_the_coefficient_of_consolidation():
    """c_v = E k/γ from the base to the top, 1 to 4 m²/s but for half a cell at the ends."""
    simulation = Simulation(load_scene(column(32)))
    text = preview(simulation.scene, simulation.coupling, simulation.measures)
    least, largest = map(float, re.search(r"c_v = (\S+) m²/s to (\S+) m²/s", text).groups())
    assert least == pytest.approx(1.0, rel=0.05)
    assert largest == pytest.approx(4.0, rel=0.05)


def tube(cells, power):
    """Return a thick tube, 0.1 < r < 0.2 m, E = 1e9 (r/a)^n Pa, ν = 0.3, held along its axis, under
    1 MPa inside.
    """
    return {
        "title": "graded tube",
        "mesh": {
            "kind": "rectangle",
            "x": {"points": [0.1, 0.2], "cells": [cells]},
            "y": {"points": [0.0, 0.02], "cells": [1]},
            "order": 2,
            "cell_type": "quadrilateral",
            "axisymmetric": True,
        },
        "model": {"solid_inertia": False, "fluid_inertia": False},
        "time": {"scheme": "steady", "end": 1.0, "step": 1.0},
        "material": [
            {
                "region": "body",
                "solid": {
                    "law": "linear_elastic",
                    "young": f"1e9*(x/0.1)**{power}",
                    "poisson": 0.3,
                    "density": 2000.0,
                },
            }
        ],
        "boundary": [
            {"on": ["bottom", "top"], "displacement": {"y": 0.0}},
            {"on": "left", "traction": {"x": 1e6}},
            {"on": "right"},
        ],
        "probe": [{"name": "wall", "at": [0.2, 0.0], "quantities": ["u_x"]}],
    }


def exact_tube(power):
    """Return u_r at r = 0.2 m: u = A r^m + B r^-k of the roots of m² + n m + n ν/(1 - ν) - 1 = 0
    (Horgan & Chan, J. Elasticity 55 (1999) 43).
    """
    nu, a, b = 0.3, 0.1, 0.2
    roots = np.roots([1.0, power, power * nu / (1 - nu) - 1])
    stiffness = 1e9 / ((1 + nu) * (1 - 2 * nu))

    def stress(r):
        return stiffness * (r / a) ** power * ((1 - nu) * roots + nu) * r ** (roots - 1)

    factors = np.linalg.solve(np.array([stress(a), stress(b)]), [-1e6, 0.0])
    return float(factors @ b**roots)


@pytest.mark.parametrize("power", [1.5, -1.0])
def test_a_graded_tube_widens_as_the_exact_one_with_second_order(power):
    errors = [abs(final(tube(n, power))["wall.u_x"] / exact_tube(power) - 1) for n in (4, 8, 16)]
    assert errors[-1] < 1e-3
    assert np.log2(errors[0] / errors[1]) > 1.9
    assert np.log2(errors[1] / errors[2]) > 1.9
