"""Regions that a stage places: columns built in lifts, stress-free placing at large strain, pore
pressure of a lift, plastic lifts, backfill, restart, ranks, what is refused.
"""

import numpy as np
import pytest
from mpi4py import MPI

from porofsi_petsc import Simulation, load_scene
from porofsi_petsc.config import scene_to_toml
from porofsi_petsc.config.toml import tomllib
from porofsi_petsc.errors import ConvergenceError, InputError
from porofsi_petsc.materials import ELASTIC

pytestmark = pytest.mark.usefixtures("petsc")
LIFT, LIFTS = 2.0, 4  # height [m] and number of the lifts, the first of which is the ground
WEIGHT, MODULUS = 2e4, 2e7  # of the lifts [N/m³], [Pa]
ELASTIC_SOLID = {"law": "linear_elastic", "lambda": 0.0, "mu": MODULUS / 2, "density": 2000.0}
SOFT = {"law": "neo_hookean", "lambda": 5e4, "mu": 5e4, "density": 2000.0}


def solid(law, region="all"):
    return {"region": region, "solid": law}


def column(order=2, law=ELASTIC_SOLID, lifts=LIFTS, **sections):
    """Return a column of a solid that is built in lifts of two elements, one each second."""
    levels = [LIFT * k for k in range(lifts + 1)]
    names = [f"lift_{k}" for k in range(1, lifts)]
    regions = zip(names, levels[1:], levels[2:], strict=False)
    return {
        "title": "column",
        "mesh": {
            "kind": "rectangle",
            "x": {"points": [0.0, 1.0], "cells": [1]},
            "y": {"points": levels, "cells": [2] * lifts},
            "order": order,
            "regions": [{"name": name, "y": [a, b]} for name, a, b in regions],
        },
        "model": {"solid_inertia": False},
        "time": {"end": 1.0, "step": 1.0},
        "material": [solid(law)],
        "boundary": [
            {"on": ["left", "right"], "displacement": {"x": 0.0}},
            {"on": "bottom", "displacement": {"x": 0.0, "y": 0.0}},
            {"on": "top", "traction": {"y": 0.0}},
        ],
        "body_force": {"solid": {"y": -10.0}},
        "probe": [
            {"name": f"top_{k}", "at": [0.5, z], "quantities": ["u_y"]}
            for k, z in enumerate(levels[1:])
        ],
        "stage": [
            {"name": name, "active": [name], "time": {"end": 2.0 + k, "step": 1.0}}
            for k, name in enumerate(names)
        ],
    } | sections


def solved(scene, comm=MPI.COMM_SELF):
    with Simulation.from_scene(scene, comm) as simulation:
        simulation.run()
        return simulation.history


def settlements(lifts):
    """Return the displacement of the top of each lift after each of them, (lifts, lifts): a lift is
    compressed by half of its own weight and by that of those above it, as far as they come not
    before the top.
    """
    own, others = (-WEIGHT * LIFT**2 / MODULUS * factor for factor in (0.5, 1.0))
    found = np.full((lifts, lifts), np.nan)
    for after in range(lifts):
        for top in range(after + 1):
            found[after, top] = own + top * others + (after - top) * (top + 1) * others
    return found


@pytest.mark.mpi
@pytest.mark.parametrize("scheme", [None, "steady"])
def test_a_column_that_is_built_in_lifts_settles_most_at_mid_height(scheme):
    """Exact in quadratic elements, but for round-off; a node counts from its placing."""
    scene = column()
    if scheme:
        scene["model"] = {}
        scene["time"]["scheme"] = scheme
    history = solved(scene, MPI.COMM_WORLD)
    found = np.column_stack([history[f"top_{k}.u_y"][1:] for k in range(LIFTS)])
    np.testing.assert_allclose(found, settlements(LIFTS), rtol=1e-9)


def test_many_lifts_settle_as_a_column_that_grows():
    """u = γ z (H - z)/M of the continuous construction, and the compression of what was placed as a
    whole, γ h (z - h/2)/M.
    """
    lifts = 16
    history = solved(column(lifts=lifts))
    H = LIFT * lifts
    z = LIFT * np.arange(1, lifts + 1)
    exact = -WEIGHT / MODULUS * (z * (H - z) + LIFT * (z - LIFT / 2))
    last = [history[f"top_{k}.u_y"][-1] for k in range(lifts)]
    np.testing.assert_allclose(last, exact, rtol=1e-9)


def yielding(load=0.0):
    """Return a column of a soft solid that its lower part compresses by its own weight; a
    weightless lift is placed on it, and loaded.
    """
    scene = column(law=SOFT, lifts=2)
    scene["mesh"]["cell_type"] = "quadrilateral"
    scene["body_force"] = [{"on": "body", "solid": {"y": -10.0}}]
    top = {"on": "top", "traction": {"y": -load}}
    loaded = {"name": "load", "time": {"end": 3.0, "step": 0.5}, "boundary": [top]}
    return scene | {"coupling": {"tolerance": 1e-11}, "stage": [*scene["stage"], loaded]}


def test_a_lift_at_large_strain_is_free_of_stress_where_it_is_placed():
    """The ground has been compressed by 10 %; on the lift acts the load alone, whose stretch J of
    the confined body has the stress μ (J - 1/J) + U'(J).
    """
    load = 3e4
    with Simulation.from_scene(yielding(load), MPI.COMM_SELF) as simulation:
        simulation.run(until=2.0)
        ground = simulation.history["top_0.u_y"]
        assert ground[1] < -0.1 * LIFT
        assert ground[2] == pytest.approx(ground[1], rel=1e-9)
        assert abs(simulation.history["top_1.u_y"][-1]) < 1e-9 * LIFT
        lifted = simulation.fields.points[:, 1] > LIFT + 0.1
        stress = simulation.fields["stress"]
        assert np.abs(stress[lifted]).max() < 1e-9 * np.abs(stress).max()
        simulation.run()
        history = simulation.history
    law = ELASTIC["neo_hookean"](SOFT["lambda"], SOFT["mu"])
    shortened = history["top_1.u_y"][-1] - (history["top_0.u_y"][-1] - ground[2])
    assert law.confined(1 + shortened / LIFT) == pytest.approx(-load, rel=1e-6)


PORES, GRAINS, WATER = 0.4, 2500.0, 1e4  # [-], [kg/m³], weight of the water [N/m³]
SATURATED = (1 - PORES) * GRAINS * 10.0 + PORES * WATER  # [N/m³]
PERMEABILITY = 1e-3  # [m/s]
GROUND, HEIGHT = 6.0, 10.0  # [m]


def porous(order=2, scheme="partitioned", **model):
    """Return a saturated column, at rest under its weight, on which a lift is placed at 1e6 s."""
    scene = column(order, lifts=2)
    scene["mesh"]["y"] = {"points": [0.0, GROUND, HEIGHT], "cells": [9, 12], "ratios": [1.0, 0.1]}
    scene["mesh"]["regions"][0]["y"] = [GROUND, HEIGHT]
    scene["model"] = {"solid_inertia": False, "fluid_inertia": False} | model
    scene["coupling"] = {"scheme": scheme}
    scene["material"] = [
        {
            "region": "all",
            "porosity": PORES,
            "solid": {"law": "linear_elastic", "lambda": 4e6, "mu": 8e6, "density": GRAINS},
            "fluid": {"density": 1000.0, "specific_weight": WATER},
            "permeability": {"law": "constant", "k": PERMEABILITY},
        }
    ]
    sides, bottom, _ = scene["boundary"]
    sides["velocity"] = {"x": 0.0}
    bottom["velocity"] = {"x": 0.0, "y": 0.0}
    scene["boundary"] = [sides, bottom, {"on": ["top", "lift_1"], "pressure": 0.0}]
    scene["body_force"]["fluid"] = {"y": -10.0}
    scene["time"] = {"end": 1e6, "step": 2.5e5, "rho_inf": 0.0}
    scene["stage"][0]["time"] = {"end": 1e6 + 25.0, "step": 0.005, "growth": 1.1}
    heights = {"base": 0.0, "floor": GROUND, "inside": 8.0, "top": HEIGHT}
    scene["probe"] = [
        {"name": name, "at": [0.5, z], "quantities": ["p", "u_y"]} for name, z in heights.items()
    ]
    return scene


def excess(z, t):
    """Return the excess pressure of a column whose upper part is placed at once, and how far it has
    left z behind: γ' b cos(α a)/(b α²) 2/H for each α = (2 m + 1) π/2H.
    """
    buoyant = (SATURATED - WATER) * (HEIGHT - GROUND)
    alpha = (2 * np.arange(400) + 1) * np.pi / (2 * HEIGHT)
    modes = 2 * buoyant * np.cos(alpha * GROUND) / (HEIGHT * (HEIGHT - GROUND) * alpha**2)
    left = np.exp(-(alpha**2) * PERMEABILITY / WATER * MODULUS * t)
    return (modes * left * np.cos(alpha * z)).sum(), (
        modes * left * np.sin(alpha * z) / alpha
    ).sum()


@pytest.mark.mpi
@pytest.mark.parametrize("scheme", ["partitioned", "direct"])
def test_a_saturated_lift_is_borne_by_the_water_at_first(scheme):
    """At once the pressure rises by the weight of the lift; it leaves as Terzaghi says.

    The mesh and the steps, of second order, leave 1e-3 of the pressure of the lift.
    """
    history = solved(porous(scheme=scheme), MPI.COMM_WORLD)
    t, base = history["t"] - 1e6, history["base.p"]
    assert base[4] == pytest.approx(WATER * GROUND, rel=1e-6)
    weight = SATURATED * (HEIGHT - GROUND)
    assert base[5] - base[4] == pytest.approx(weight, rel=1e-6)
    assert np.isnan(history["inside.p"][:5]).all()
    for row in (-20, -10, -1):
        pressure, _ = excess(0.0, t[row])
        assert base[row] - WATER * HEIGHT == pytest.approx(pressure, abs=1e-3 * weight)
        pressure, _ = excess(8.0, t[row])
        inside = history["inside.p"][row] - WATER * (HEIGHT - 8.0)
        assert inside == pytest.approx(pressure, abs=1e-3 * weight)
        bearing = (SATURATED - WATER) * (HEIGHT - GROUND) * GROUND - excess(GROUND, t[row])[1]
        settled = history["floor.u_y"][4] - history["floor.u_y"][row]
        assert settled == pytest.approx(bearing / MODULUS, rel=1e-3)


def test_a_dry_lift_on_saturated_ground_is_a_load():
    """Terzaghi: of a load from the placing on, on a column that drains below; probes of the lift
    have no water.
    """
    scene = porous()
    scene["mesh"]["y"] |= {"cells": [16, 2], "ratios": [10.0, 1.0]}  # fine where the water leaves
    scene["stage"][0]["time"] |= {"end": 1e6 + 10.0, "growth": 1.05}
    scene["material"][0]["region"] = "body"
    scene["material"].append(solid(ELASTIC_SOLID, "lift_1"))
    sides, bottom, _ = scene["boundary"]
    sides.pop("velocity")
    bottom |= {"pressure": WATER * GROUND}
    bottom.pop("velocity")
    lid = {"on": ["top"], "traction": {"y": 0.0}}
    scene["boundary"] = [sides, bottom, lid, {"on": ["lift_1"], "pressure": 0.0}]
    inside = scene["probe"].pop(2)
    scene["probe"][-1]["quantities"] = ["u_y"]
    history = solved(scene)
    load = WEIGHT * (HEIGHT - GROUND)
    assert history["floor.p"][5] == pytest.approx(load, rel=1e-6)
    odd = (2 * np.arange(400) + 1) * np.pi / (2 * GROUND)
    t = history["t"][-1] - 1e6
    left = np.exp(-(odd**2) * PERMEABILITY / WATER * MODULUS * t)
    pressure = (2 * load / (GROUND * odd) * np.sin(odd * GROUND) * left).sum()
    assert history["floor.p"][-1] == pytest.approx(pressure, abs=1e-3 * load)
    scene["probe"].append(inside)
    with pytest.raises(InputError, match=r"\[probe.3\]: received p at \(0.5, 8\) m in the solid"):
        Simulation.from_scene(scene, MPI.COMM_SELF)


def test_a_lift_on_a_mesh_that_moves_has_the_porosity_of_its_material():
    """A weightless lift on ground that has lost more than a hundredth of its pores."""
    scene = porous(moving_mesh=True, porosity="variable")
    scene["material"][0]["solid"] |= {"law": "neo_hookean", "lambda": 4e5, "mu": 8e5}
    scene["body_force"] = [
        {"on": "body", "solid": {"y": -10.0}, "fluid": {"y": -10.0}},
        {"on": "lift_1", "fluid": {"y": -10.0}},
    ]
    scene["stage"][0]["time"] = {"end": 1e6 + 0.02, "step": 0.01}
    with Simulation.from_scene(scene, MPI.COMM_SELF) as simulation:
        simulation.run()
        y = simulation.fields.points[:, 1]
        n_f = simulation.fields["porosity"][:, 0]
        assert n_f[y < 1.0].max() < PORES - 0.01
        np.testing.assert_allclose(n_f[y > GROUND + 1.0], PORES, atol=1e-4)


LIFTED = {"lift_1": 6.0, "lift_2": 4.0}  # half widths of the lifts of an embankment [m]
PLASTIC = {
    "law": "drucker_prager",
    "friction_angle": 30.0,
    "cohesion": 2e3,
    "dilatancy_angle": 0.0,
    "match": "plane_strain",
    "lambda": 4e6,
    "mu": 4e6,
    "density": 2000.0,
}


def embankment(law=PLASTIC, ground=ELASTIC_SOLID, **sections):
    """Return half of an embankment of two lifts on ground of 12 m x 4 m; what is beside the lifts
    is not in the mesh.
    """
    regions = [
        {"name": name, "x": [0.0, width], "y": [4.0 + k, 5.0 + k]}
        for k, (name, width) in enumerate(LIFTED.items())
    ]
    ground_region = {"name": "ground", "y": [0.0, 4.0]}
    scene = column()
    return (
        scene
        | {
            "mesh": {
                "kind": "rectangle",
                "x": {"points": [0.0, 4.0, 6.0, 12.0], "cells": [3, 2, 3]},
                "y": {"points": [0.0, 4.0, 6.0], "cells": [2, 2]},
                "order": 2,
                "regions": [ground_region, *regions],
                "keep": ["ground", *LIFTED],
            },
            "material": [solid(ground, "ground"), solid(law, [*LIFTED])],
            "boundary": [
                {"on": ["left", "right"], "displacement": {"x": 0.0}},
                {"on": "bottom", "displacement": {"x": 0.0, "y": 0.0}},
                {"on": ["top", "body"], "traction": {"y": 0.0}},
            ],
            "probe": [
                {"name": "middle", "at": [0.0, 4.0], "quantities": ["u_y"]},
                {"name": "crest", "at": [4.0, 6.0], "quantities": ["u_x", "u_y"]},
            ],
            "surface": [{"name": "base", "on": "bottom", "quantities": ["force"]}],
            "stage": [
                {"name": name, "active": [name], "time": {"end": 2.0 + k, "step": 0.5}}
                for k, name in enumerate(LIFTED)
            ],
        }
        | sections
    )


@pytest.mark.mpi
def test_an_embankment_of_plastic_lifts_weighs_what_was_placed():
    """On ground without memory; to the tolerance of the coupling."""
    history = solved(embankment(), MPI.COMM_WORLD)
    widths = np.cumsum([12.0 * 4.0, *LIFTED.values()])
    np.testing.assert_allclose(history["base.f_y"][[1, 3, 5]], -2e4 * widths, rtol=1e-6)


@pytest.mark.mpi
def test_an_embankment_on_ground_that_gives_way_is_the_same_on_several_ranks():
    """At large strain below, where lifts have the shape in which they are placed; to the tolerance
    of the coupling.
    """
    ground = SOFT | {"lambda": 4e5, "mu": 4e5}
    scene = embankment(ground=ground, limits={"strain": "report"})
    history, one = solved(scene, MPI.COMM_WORLD), solved(scene, MPI.COMM_SELF)
    for name in ("middle.u_y", "crest.u_x", "crest.u_y"):
        scale = np.nanmax(np.abs(one[name]))
        np.testing.assert_allclose(history[name], one[name], rtol=0, atol=1e-5 * scale)


def test_a_restart_between_lifts_is_the_same_run(tmp_path):
    scene = embankment()
    with Simulation.from_scene(scene, MPI.COMM_SELF) as whole:
        paths = []
        for until in (1.0, 1.5, 2.5):
            whole.run(until=until)
            paths.append(whole.checkpoint(tmp_path / f"{until}"))
        whole.run()
    assert whole.fields["plastic_strain"].max() > 1e-6
    for path in paths:
        with Simulation.from_scene(scene, MPI.COMM_SELF, restart=path) as rest:
            rest.run()
            for name in whole.fields:
                np.testing.assert_array_equal(rest.fields[name], whole.fields[name])
    scene["stage"][0]["active"] += scene["stage"][1].pop("active")
    with pytest.raises(InputError, match=r"\[stage.0.active\]"):
        Simulation.from_scene(scene, MPI.COMM_SELF, restart=paths[2])
    scene["stage"] = []
    with pytest.raises(InputError, match=r"\[stage.active\]"):
        Simulation.from_scene(scene, MPI.COMM_SELF, restart=paths[0])


def test_a_backfill_brings_the_floor_back():
    """Linear: ground bears again what it bore; the fill is free of stress but for its own weight,
    and counts from its placing.
    """
    scene = column(lifts=2)
    times = [{"end": 2.0 + k, "step": 1.0} for k in range(2)]
    scene["stage"] = [
        {"name": "dig", "inactive": ["lift_1"], "time": times[0]},
        {"name": "fill", "active": ["lift_1"], "time": times[1]},
    ]
    history = solved(scene)
    own, whole = -WEIGHT * LIFT**2 / (2 * MODULUS), settlements(2)[1, 0]
    np.testing.assert_allclose(history["top_0.u_y"][1:], [whole, own, whole], rtol=1e-9)
    heaved = whole - own
    assert history["top_1.u_y"][1] == pytest.approx(whole + own, rel=1e-9)
    assert np.isnan(history["top_1.u_y"][2])
    assert history["top_1.u_y"][3] == pytest.approx(heaved + own, rel=1e-9)


def test_a_pit_in_porous_ground_may_be_filled_with_another_kind_of_material():
    """A dry one with a memory: its weight alone is what the floor bears at last.

    1e-6 is the tolerance of the coupling.
    """
    scene = porous()
    fill = solid(PLASTIC | {"cohesion": 1e6, "density": 1000.0}, "lift_1")
    scene["material"][0]["region"] = ["body", "lift_1"]
    times = [{"end": end, "step": 2.5e5, "growth": 1.0} for end in (2e6, 3e6)]
    scene["stage"] = [
        {"name": "dig", "inactive": ["lift_1"], "time": times[0]},
        {"name": "fill", "active": ["lift_1"], "material": [fill], "time": times[1]},
    ]
    sides, bottom, top = scene["boundary"]
    sides.pop("velocity")
    bottom.pop("velocity")
    bottom["pressure"] = WATER * GROUND
    scene["stage"][0]["boundary"] = [{"on": "lift_1", "pressure": 0.0}]
    scene["stage"][1]["boundary"] = [{"on": "top", "traction": {"y": 0.0}}]
    scene["boundary"] = [sides, bottom, {"on": "top", "pressure": 0.0}]
    scene["probe"] = [{"name": "floor", "at": [0.5, GROUND], "quantities": ["p", "u_y"]}]
    scene["probe"].append({"name": "inside", "at": [0.5, 8.0], "quantities": ["p", "u_y"]})
    history = solved(scene)
    assert np.isfinite(history["inside.p"][:5]).all() and np.isnan(history["inside.p"][5:]).all()
    assert np.isfinite(history["inside.u_y"][9:]).all()
    buoyant = (SATURATED - WATER) * GROUND**2 / 2
    loads = np.array([0.0, 1e4 * (HEIGHT - GROUND)])
    exact = -(buoyant + loads * GROUND) / MODULUS
    np.testing.assert_allclose(history["floor.u_y"][[8, 12]], exact, rtol=1e-6)
    assert history["floor.p"][-1] == pytest.approx(0.0, abs=1e-6 * WATER * HEIGHT)


def test_a_lift_has_no_initial_stress():
    """That of the ground is the whole weight of it; the lift is compressed by its own weight."""
    scene = column(lifts=2)
    scene["initial"] = {"stress": {"vertical": f"-{WEIGHT}*({LIFT} - y)", "k0": 0.0}}
    history = solved(scene)
    own = -WEIGHT * LIFT**2 / MODULUS
    assert abs(history["top_0.u_y"][1]) < 1e-9 * abs(own)
    assert history["top_1.u_y"][2] == pytest.approx(1.5 * own, rel=1e-9)


def test_a_lift_around_an_axis_is_free_of_stress_where_it_is_placed():
    """On ground that turns around the axis, which widens it; the hoop strain counts from the
    placing too.
    """
    scene = column(law=SOFT | {"lambda": 2e5, "mu": 2e5}, lifts=2)
    scene["mesh"]["axisymmetric"] = True
    scene["coupling"] = {"tolerance": 1e-10}
    scene["boundary"] = [
        {"on": ["right", "top"], "traction": {"y": 0.0}},
        {"on": "bottom", "displacement": {"y": 0.0}},
    ]
    scene["body_force"] = [{"on": "body", "solid": {"x": "50*x", "y": -10.0}}]
    with Simulation.from_scene(scene, MPI.COMM_SELF) as simulation:
        simulation.run()
        lifted = simulation.fields.points[:, 1] > LIFT + 0.1
        stress, u = simulation.fields["stress"], simulation.coupling.displacement()
        assert np.abs(u[lifted, 0]).max() > 0.01
        assert np.abs(stress[lifted]).max() < 1e-8 * np.abs(stress).max()


def test_a_lift_that_would_be_inverted_is_refused():
    """The surface of the ground is folded, which small strain does not see there."""
    scene = column(lifts=2, limits={"strain": "report"})
    bottom = scene["boundary"][1]
    folded = {"on": "lift_1", "displacement": {"x": "-3*x"}}
    scene["boundary"] = [bottom, folded, {"on": ["left", "right", "top"], "traction": {"y": 0.0}}]
    with Simulation.from_scene(scene, MPI.COMM_SELF) as simulation:
        simulation.run(until=1.0)
        with pytest.raises(ConvergenceError, match="an element of a region to place would be inv"):
            simulation.run()


def test_a_spring_on_a_lift_counts_from_its_placing():
    """The ground has settled before. With its own weight and a spring k above the lift of height h
    on as much ground moves by d = -(3/2 γ h² + 2 k h d)/M.
    """
    k = 1e7
    scene = column(lifts=2)
    scene["boundary"][-1] = {"on": "top", "spring": {"normal": k}}
    d = -1.5 * WEIGHT * LIFT**2 / (MODULUS + 2 * k * LIFT)
    assert solved(scene)["top_1.u_y"][-1] == pytest.approx(d, rel=1e-9)


def test_a_plate_on_ground_and_lift_is_refused():
    """It would strain the lift: the ground has moved with it before."""
    scene = column(lifts=2)
    scene["boundary"][0] = {"on": "left", "equal_displacement": ["x"]}
    scene["boundary"].append({"on": "right", "displacement": {"x": 0.0}})
    with pytest.raises(InputError, match=r"\[stage.0.active\]: received 'lift_1', .* on 'left'"):
        Simulation.from_scene(scene, MPI.COMM_SELF)


def test_a_scene_with_lifts_loads_again():
    scene = load_scene(embankment())
    assert load_scene(tomllib.loads(scene_to_toml(scene))) == scene
    assert [part.inactive for part in scene.stages] == [("lift_1", "lift_2"), ("lift_2",), ()]
    assert [part.placed for part in scene.stages] == [(), ("lift_1",), ("lift_1", "lift_2")]


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"active": ["lift_7"]}, r"\[stage.0.active\]: the mesh has no region 'lift_7'"),
        (
            {"active": ["lift_1", "lift_1"]},
            r"\[stage.0.active\]: received 'lift_1', which is there",
        ),
        ({"inactive": ["lift_1"]}, r"\[stage.0.inactive\]: received 'lift_1', which is taken away"),
        ({"inactive": ["body"]}, r"(?i)rigid"),
    ],
)
def test_what_cannot_be_placed_is_refused(changes, text):
    scene = column(lifts=2)
    scene["stage"][0] |= changes
    with pytest.raises(InputError, match=text):
        Simulation.from_scene(scene, MPI.COMM_SELF)
