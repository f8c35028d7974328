"""Stress and pressure of the ground at the start: rest under weight, surcharge, tangents,
objectivity, refusals, restart, ranks.
"""

import re

import numpy as np
import pytest
from running import Job, history, needs_mpirun, run_here, run_on

from porofsi_petsc import Simulation, load_scene
from porofsi_petsc.errors import InputError
from porofsi_petsc.materials import ELASTIC
from porofsi_petsc.materials.prestressed import Prestressed
from porofsi_petsc.simulation.preview import preview

HEIGHT = 10.0  # [m]
GRAVITY = 10.0  # [m/s²]
BUOYANT = 0.67 * (2000.0 - 1000.0) * GRAVITY  # γ' = n_s (ρ_sR - ρ_fR) g [N/m³]
MODULUS = 8.375e6 + 2 * 5.583e6  # [Pa]
K0 = {"vertical": f"{-BUOYANT}*({HEIGHT} - Y)", "k0": 0.5}
COMPONENTS = {
    "yy": f"{-BUOYANT}*({HEIGHT} - y)",
    "xx": f"{-BUOYANT / 2}*({HEIGHT} - y)",
    "zz": f"{-BUOYANT / 2}*({HEIGHT} - y)",
}
HYDROSTATIC = f"{1000 * GRAVITY}*({HEIGHT} - Y)"


def ground(dim=2, order=2, load=0.0, stress=K0, law="linear_elastic", **changes):
    """Return a layer under its weight with rigid sides and base, drained at its top, which has a
    load [Pa] from 0+ on; it ends consolidated.
    """
    up = "xyz"[dim - 1]
    across = "xyz"[: dim - 1]
    size = {axis: {"points": [0.0, 1.0], "cells": [1]} for axis in across}
    sides = {"x": ["left", "right"], "y": ["front", "back"]}
    scene = {
        "title": "ground",
        "mesh": size
        | {
            "kind": "rectangle" if dim == 2 else "box",
            up: {"points": [0.0, HEIGHT], "cells": [3]},
            "order": order,
        },
        "model": {"solid_inertia": False, "fluid_inertia": False},
        "time": {"end": 2e7, "step": 1e7, "rho_inf": 0.0},
        "material": [
            {
                "region": "body",
                "porosity": 0.33,
                "solid": {"law": law, "lambda": 8.375e6, "mu": 5.583e6, "density": 2000.0},
                "fluid": {"density": 1000.0, "specific_weight": 1e4},
                "permeability": {"law": "constant", "k": 1e-2},
            }
        ],
        "boundary": [
            *(
                {"on": sides[axis], "displacement": {axis: 0.0}, "velocity": {axis: 0.0}}
                for axis in across
            ),
            {"on": "bottom", "displacement": {up: 0.0}, "velocity": {up: 0.0}},
            {"on": "top", "pressure": 0.0, "traction": {up: -load}},
        ],
        "body_force": {"solid": {up: -GRAVITY}, "fluid": {up: -GRAVITY}},
        "initial": {
            "pressure": HYDROSTATIC.replace("Y", up),
            "stress": {
                k: v.replace("Y", up) if isinstance(v, str) else v for k, v in stress.items()
            },
        },
        "probe": [
            {"name": "top", "at": [0.5] * (dim - 1) + [HEIGHT], "quantities": [f"u_{up}"]},
            {
                "name": "base",
                "at": [0.5] * (dim - 1) + [0.0],
                "quantities": ["p", "stress_xx", f"stress_{up}{up}"],
            },
        ],
        "surface": [{"name": "foot", "on": "bottom", "quantities": ["skeleton_force"]}],
    }
    return scene | changes


def solved(scene):
    """Return the simulation and the columns of the history of a scene."""
    simulation = Simulation(load_scene(scene))
    simulation.run()
    return simulation, {name: np.array(column) for name, column in simulation.history.items()}


@pytest.mark.parametrize("law", ["linear_elastic", "neo_hookean"])
@pytest.mark.parametrize(("dim", "order"), [(2, 1), (2, 2), (3, 1)])
def test_the_ground_stays_where_it_is(dim, order, law):
    """u below 1e-9 of γ' H²/(2 E_c), the settlement by the weight without the stress."""
    found = solved(ground(dim, order, law=law))[1]
    settlement = BUOYANT * HEIGHT**2 / (2 * MODULUS)
    up = "xyz"[dim - 1]
    assert np.abs(found[f"top.u_{up}"]).max() < 1e-9 * settlement
    assert found["base.p"] == pytest.approx(1e5, rel=1e-9)
    assert found[f"base.stress_{up}{up}"] == pytest.approx(-BUOYANT * HEIGHT, rel=1e-9)
    assert found["base.stress_xx"] == pytest.approx(-BUOYANT * HEIGHT / 2, rel=1e-9)


def test_the_components_are_those_of_k0():
    one, other = (solved(ground(stress=stress))[1] for stress in (K0, COMPONENTS))
    for name in ("base.stress_xx", "base.stress_yy", "top.u_y"):
        np.testing.assert_allclose(one[name], other[name], rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("dim", [2, 3])
def test_the_weight_above_is_that_of_the_formula(dim):
    one, other = (
        solved(ground(dim, 1, load=2e4, stress=stress))[1]
        for stress in (K0, {"vertical": "weight", "k0": 0.5})
    )
    for name in one:
        scale = np.abs(one[name]).max()
        np.testing.assert_allclose(other[name], one[name], rtol=0, atol=1e-9 * scale)


def layers():
    """Return saturated ground with a dry fill on it, in which a pit of 2 m is to be dug; the fill
    rests on sand, that on clay.
    """
    scene = ground(stress={"vertical": "weight", "k0": 0.5})
    scene["mesh"] |= {
        "x": {"points": [0.0, 1.0], "cells": [1]},
        "y": {"points": [0.0, 4.0, 8.0, 10.0], "cells": [2, 2, 1]},
        "regions": [
            {"name": "clay", "y": [0.0, 4.0]},
            {"name": "sand", "y": [4.0, 8.0]},
            {"name": "fill", "y": [8.0, HEIGHT]},
        ],
    }
    clay = scene["material"][0] | {"region": "clay", "porosity": 0.5}
    sand = scene["material"][0] | {"region": "sand"}
    dry = {"region": "fill", "solid": clay["solid"] | {"density": 1800.0}}
    scene["material"] = [clay, sand, dry]
    sides, bottom, top = scene["boundary"]
    sides.pop("velocity")
    bottom.pop("velocity")
    bottom["pressure"] = 8e4
    scene["boundary"] = [sides, bottom, {"on": "top", "traction": {"y": 0.0}}]
    scene["initial"]["pressure"] = "1e4*(8 - y)"
    scene["probe"] = [
        {"name": "base", "at": [0.5, 0.0], "quantities": ["stress_xx", "stress_yy", "u_y"]},
        {"name": "sand", "at": [0.5, 4.0], "quantities": ["stress_yy", "u_y"]},
        {"name": "floor", "at": [0.5, 8.0], "quantities": ["u_y"]},
    ]
    return scene | {"surface": []}


def test_layers_rest_under_the_weight_above_until_some_is_taken_away():
    """γ' = 6.7 kN/m³ of the sand, 5 of the clay, γ = 18 of the dry fill; then the floor heaves by
    what stood on it, as if there had been no stress.
    """
    scene = layers()
    scene["stage"] = [
        {
            "name": "dig",
            "inactive": ["fill"],
            "boundary": [{"on": "fill", "pressure": 0.0}],
            "time": {"end": 1e8},
        }
    ]
    history = solved(scene)[1]
    fill, sand = 2 * 18e3, 4 * BUOYANT
    vertical = fill + sand + 4 * 0.5 * 1e3 * GRAVITY
    rest = slice(1, 3)
    np.testing.assert_allclose(history["base.stress_yy"][rest], -vertical, rtol=1e-9)
    np.testing.assert_allclose(history["base.stress_xx"][rest], -vertical / 2, rtol=1e-9)
    np.testing.assert_allclose(history["floor.u_y"][rest], 0.0, atol=1e-12)
    assert history["floor.u_y"][-1] == pytest.approx(fill * 8.0 / MODULUS, rel=1e-6)
    assert history["base.stress_yy"][-1] == pytest.approx(fill - vertical, rel=1e-6)


def test_check_tells_that_layers_are_in_balance():
    simulation = Simulation(load_scene(layers()))
    text = preview(simulation.present, simulation.coupling, simulation.measures)
    assert float(re.search(r"out of balance .* by (\S+) of", text)[1]) < 1e-12


def beside(scene):
    """Put clay beside the sand."""
    scene["mesh"]["x"] = {"points": [0.0, 0.5, 1.0], "cells": [1, 1]}
    scene["mesh"]["regions"][1]["x"] = [0.5, 1.0]
    scene["material"][0]["region"] = ["clay", "body"]


def shaken(scene):
    scene["body_force"]["solid"]["y"] = "-10 + x"


def graded(scene):
    scene["material"][0]["solid"] = scene["material"][0]["solid"] | {"density": "2000 - 10*y"}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (beside, "'body' and 'sand' at the same height 6 m, of 15000 and 16700 N/m³"),
        (shaken, "a body force that is a formula"),
        (graded, "a density or porosity of 'clay' that is a field"),
    ],
)
def test_what_has_not_one_weight_at_a_height_is_refused(change, words):
    scene = layers()
    change(scene)
    with pytest.raises(InputError, match=rf"\[initial.stress.vertical\].*{words}"):
        Simulation(load_scene(scene))


def test_a_surcharge_settles_as_without_the_weight():
    """q H/E_c, and the base bears γ' H + q: the system is linear."""
    q = 2e4
    found = solved(ground(load=q))[1]
    assert found["top.u_y"][-1] == pytest.approx(-q * HEIGHT / MODULUS, rel=1e-6)
    assert found["base.stress_yy"][-1] == pytest.approx(-BUOYANT * HEIGHT - q, rel=1e-6)
    assert found["foot.fs_y"][-1] == pytest.approx(-BUOYANT * HEIGHT - q, rel=1e-6)


def test_the_energy_is_balanced():
    """That of the initial stress is σ_0:ε, which the weight works against."""
    simulation, _ = solved(ground(load=2e4))
    assert abs(simulation.energy.balance_error) < 1e-6 * simulation.energy.largest_work


def test_hydrostatic_pressure_alone_is_at_rest():
    """A skeleton that weighs what its fluid does bears nothing: the initial pressure is that of
    t = 0 and of all later times.
    """
    scene = ground(stress={})
    scene["material"][0]["solid"]["density"] = 1000.0
    found = solved(scene)[1]
    assert found["base.p"] == pytest.approx(1e5, rel=1e-9)
    assert np.abs(found["top.u_y"]).max() < 1e-12


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("name", ["linear_elastic", "neo_hookean", "saint_venant_kirchhoff"])
def test_stress_and_tangent_are_slopes(name, dim):
    """Of the energy and of the stress, by central differences."""
    rng = np.random.default_rng(dim)
    H = 0.05 * rng.standard_normal((2, 3, dim, dim))
    initial = rng.standard_normal((2, 3, 3, 3))
    law = Prestressed(ELASTIC[name](1.7, 0.8), initial + np.swapaxes(initial, -1, -2))
    P, A = law.stress(H), law.tangent(H)
    step = 1e-6
    for i, j in np.ndindex(dim, dim):
        change = np.zeros((dim, dim))
        change[i, j] = step
        slope = (law.energy(H + change) - law.energy(H - change)) / (2 * step)
        np.testing.assert_allclose(P[..., i, j], slope, atol=1e-8)
        slope = (law.stress(H + change) - law.stress(H - change)) / (2 * step)
        np.testing.assert_allclose(A[..., i, j], slope, atol=1e-8)


def test_at_large_strain_it_is_cauchys_at_rest_and_turns_with_the_body():
    rng = np.random.default_rng(2)
    S = rng.standard_normal((1, 1, 3, 3))
    S = S + np.swapaxes(S, -1, -2)
    law = Prestressed(ELASTIC["neo_hookean"](1.7, 0.8), S)
    Q = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    Q *= np.sign(np.linalg.det(Q))
    rest = np.zeros((1, 1, 3, 3))
    np.testing.assert_allclose(law.stress(rest), S)
    turned = law.stress(rest + Q - np.eye(3)) @ Q.T  # Cauchy's, J = 1
    np.testing.assert_allclose(turned, Q @ S @ Q.T, atol=1e-14)


@pytest.mark.parametrize(
    ("stress", "words"),
    [
        ({"vertical": "-1e4*y"}, "expected vertical and k0 together"),
        ({"k0": 0.5}, "expected vertical and k0 together"),
        (K0 | {"xx": -1e3}, "expected one of the two ways"),
        ({"xz": 1.0}, "two-dimensional"),
        ({"xx": "1e3*t"}, "expected a function of position only"),
        ({"vertical": "-1e4*y", "k0": -1.0}, "k0"),
    ],
)
def test_what_is_no_stress_is_refused(stress, words):
    with pytest.raises(InputError, match=words):
        load_scene(ground(stress=stress))


MOVING = {
    "law": "neo_hookean",
    "load": 1e5,
    "model": {"solid_inertia": False, "fluid_inertia": False, "moving_mesh": True},
    "time": {"end": 4.0, "step": 1.0, "rho_inf": 0.0},
    "output": {"checkpoint_every": 2},
}


def written(folder):
    """Return the path of a scene at large strain."""
    import tomli_w

    path = folder / "ground.toml"
    path.write_text(tomli_w.dumps(ground(**MOVING)))
    return str(path)


def test_the_schemes_agree():
    one, other = (
        solved(ground(**MOVING, coupling={"scheme": scheme, "tolerance": 1e-10}))[1]
        for scheme in ("partitioned", "direct")
    )
    for name in ("top.u_y", "base.stress_yy", "base.p"):
        np.testing.assert_allclose(one[name], other[name], rtol=1e-6)


def test_a_restart_continues_and_compares_the_stress(tmp_path):
    scene = written(tmp_path)
    run_here(Job(scene, str(tmp_path / "whole")))
    run_here(Job(scene, str(tmp_path / "first"), ("time.end=2.0",)))
    checkpoint = str(tmp_path / "first" / "checkpoint.h5")
    run_here(Job(scene, str(tmp_path / "rest"), (), checkpoint))
    whole, rest = history(tmp_path / "whole"), history(tmp_path / "rest")
    assert whole["top.u_y"][-1] == rest["top.u_y"][-1]
    with pytest.raises(InputError, match=r"initial\.stress\.k0"):
        run_here(Job(scene, str(tmp_path / "other"), ("initial.stress.k0=0.6",), checkpoint))


@needs_mpirun
def test_ranks_agree(tmp_path):
    scene = written(tmp_path)
    for ranks in (1, 3):
        run_on(ranks, [Job(scene, str(tmp_path / str(ranks)))], tmp_path)
    one, other = (history(tmp_path / str(ranks)) for ranks in (1, 3))
    for name in ("top.u_y", "base.stress_yy", "base.p"):
        np.testing.assert_allclose(other[name], one[name], rtol=1e-7, atol=1e-15)


def test_a_law_with_a_yield_limit_is_refused():
    """It would have to see the whole stress."""
    scene = ground()
    scene["material"][0]["solid"] |= {
        "law": "drucker_prager",
        "cohesion": 1e4,
        "friction_angle": 30.0,
        "match": "plane_strain",
        "dilatancy_angle": 0.0,
    }
    with pytest.raises(InputError, match="depends on the whole stress"):
        load_scene(scene)


@pytest.mark.parametrize(("weight", "share"), [(1.0, 0.0), (0.9, 0.1)])
def test_check_tells_what_is_out_of_balance(weight, share):
    """Nine tenths of the stress leave a tenth of it to the weight."""
    stress = {"vertical": f"{-weight * BUOYANT}*({HEIGHT} - Y)", "k0": 0.5}
    simulation = Simulation(load_scene(ground(stress=stress)))
    text = preview(simulation.scene, simulation.coupling, simulation.measures)
    found = float(re.search(r"out of balance .* by (\S+) of", text)[1])
    assert found == pytest.approx(share, rel=0.9, abs=1e-12)
    assert (found > 0.01) == (share > 0)


def test_check_tells_the_balance_of_a_solid_without_pores():
    """A bar under its weight, with the stress that carries it and without."""
    bar = {
        "title": "bar",
        "mesh": {
            "kind": "rectangle",
            "x": {"points": [0.0, 1.0], "cells": [2]},
            "y": {"points": [0.0, 1.0], "cells": [2]},
        },
        "time": {"scheme": "steady", "end": 1.0, "step": 1.0},
        "model": {"solid_inertia": False},
        "material": [
            {
                "region": "body",
                "solid": {
                    "law": "linear_elastic",
                    "young": 1e6,
                    "poisson": 0.3,
                    "density": 1000.0,
                },
            }
        ],
        "body_force": {"solid": {"y": -10.0}},
        "boundary": [
            {"on": ["left", "right"], "displacement": {"x": 0.0}},
            {"on": "bottom", "displacement": {"y": 0.0}},
            {"on": "top"},
        ],
    }
    for vertical, balanced in (("-1e4*(1 - y)", True), ("-2e4*(1 - y)", False)):
        scene = load_scene(bar | {"initial": {"stress": {"vertical": vertical, "k0": 0.5}}})
        with Simulation(scene) as simulation:
            text = preview(scene, simulation.coupling, simulation.measures)
        line = next(line for line in text.splitlines() if line.startswith("initial stress"))
        share = float(re.search(r"first step by (\S+) of", line)[1])
        assert (share < 1e-12) == balanced
