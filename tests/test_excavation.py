"""Regions that a stage takes away: heave, pore pressure, surfaces by their names, restart, ranks,
what is refused.
"""

from dataclasses import replace

import numpy as np
import pytest
from mpi4py import MPI

from porofsi_petsc import Simulation, load_scene
from porofsi_petsc.config import scene_to_toml
from porofsi_petsc.config.toml import tomllib
from porofsi_petsc.errors import InputError
from porofsi_petsc.mesh.excerpt import with_inner
from porofsi_petsc.simulation.build import tagged_mesh
from porofsi_petsc.simulation.excavation import remaining_mesh
from porofsi_petsc.simulation.run import check

pytestmark = pytest.mark.usefixtures("petsc")
HEIGHT, FLOOR = 10.0, 6.0  # of the column and of what is left of it [m]
GRAVITY = 10.0  # [m/s²]
YOUNG, DENSITY = 2e7, 2000.0  # of the solid, ν = 0 [Pa], [kg/m³]
MODULUS = 2e7  # λ + 2μ of the skeleton [Pa]
GRAINS, WATER, PORES = 2500.0, 1000.0, 0.4  # [kg/m³], [kg/m³], [-]
BUOYANT = (1 - PORES) * (GRAINS - WATER) * GRAVITY  # [N/m³]
SATURATED = BUOYANT + WATER * GRAVITY  # [N/m³]
LONG = 1e6  # [s], until which the column is consolidated
GONE = {"name": "dig", "inactive": ["upper"]}


def column(order=2, **second):
    """Return a column of a solid under its weight, whose upper part is taken away at 1 s."""
    return {
        "title": "column",
        "mesh": {
            "kind": "rectangle",
            "x": {"points": [0.0, 1.0], "cells": [1]},
            "y": {"points": [0.0, FLOOR, HEIGHT], "cells": [3, 2]},
            "order": order,
            "regions": [{"name": "upper", "y": [FLOOR, HEIGHT]}],
        },
        "model": {"solid_inertia": False},
        "time": {"end": 1.0, "step": 1.0},
        "material": [
            {
                "region": "all",
                "solid": {
                    "law": "linear_elastic",
                    "lambda": 0.0,
                    "mu": YOUNG / 2,
                    "density": DENSITY,
                },
            }
        ],
        "boundary": [
            {"on": ["left", "right"], "displacement": {"x": 0.0}},
            {"on": "bottom", "displacement": {"x": 0.0, "y": 0.0}},
            {"on": "top", "traction": {"y": 0.0}},
        ],
        "body_force": {"solid": {"y": -GRAVITY}},
        "probe": [
            {"name": "floor", "at": [0.5, FLOOR], "quantities": ["u_y"]},
            {"name": "above", "at": [0.5, FLOOR + 1.0], "quantities": ["u_y"]},
        ],
        "stage": [GONE | {"time": {"end": 2.0, "step": 0.5}} | second],
    }


def ground(order=2, drained=True, scheme="partitioned"):
    """Return a saturated column of the same shape, drained at its top and at its new surface."""
    scene = column(order)
    scene["model"] |= {"fluid_inertia": False}
    scene["material"][0] |= {
        "porosity": PORES,
        "solid": {"law": "linear_elastic", "lambda": 4e6, "mu": 8e6, "density": GRAINS},
        "fluid": {"density": WATER, "specific_weight": WATER * GRAVITY},
        "permeability": {"law": "constant", "k": 1e-3},
    }
    scene["time"] = {"end": LONG, "step": LONG / 4, "rho_inf": 0.0}
    scene["body_force"]["fluid"] = {"y": -GRAVITY}
    sides, bottom, top = scene["boundary"]
    sides["velocity"] = {"x": 0.0}
    bottom["velocity"] = {"x": 0.0, "y": 0.0}
    top.pop("traction")
    top["pressure"] = 0.0
    scene["coupling"] = {"scheme": scheme}
    scene["stage"][0]["time"] = {"end": 2 * LONG, "step": LONG / 4}
    if drained:
        scene["stage"][0]["boundary"] = [{"on": "upper", "pressure": 0.0}]
    scene["probe"].append({"name": "base", "at": [0.5, 0.0], "quantities": ["p"]})
    return scene


def solved(scene, comm=MPI.COMM_WORLD):
    with Simulation.from_scene(scene, comm) as simulation:
        simulation.run()
        return simulation.history


def settled(weight, modulus, height, load=0.0):
    """Return the displacement at FLOOR of a column of a height under weight [N/m³] and load."""
    return -(weight * (height * FLOOR - FLOOR**2 / 2) + load * FLOOR) / modulus


@pytest.mark.mpi
@pytest.mark.parametrize("scheme", [None, "steady"])
@pytest.mark.parametrize("load", [0.0, 3e4])
def test_a_solid_heaves_by_the_weight_that_is_taken_away(load, scheme):
    """Exact in quadratic elements, but for round-off; the terms of a steady scene are "auto"."""
    boundary = [{"on": "upper", "traction": {"y": -load}}] if load else []
    scene = column(boundary=boundary)
    if scheme:
        scene["model"] = {}
        scene["time"]["scheme"] = scheme
    u = solved(scene)["floor.u_y"]
    weight = DENSITY * GRAVITY
    assert u[1] == pytest.approx(settled(weight, YOUNG, HEIGHT), rel=1e-9)
    assert u[-1] == pytest.approx(settled(weight, YOUNG, FLOOR, load), rel=1e-9)


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("order", "scheme"), [(2, "partitioned"), (1, "partitioned"), (2, "direct")]
)
def test_drained_ground_heaves_by_its_buoyant_weight(order, scheme):
    """Nodes of linear elements are exact in one dimension; 1e-6: the tolerance of the coupling."""
    history = solved(ground(order, scheme=scheme))
    u, p = history["floor.u_y"], history["base.p"]
    assert u[4] == pytest.approx(settled(BUOYANT, MODULUS, HEIGHT), rel=1e-6)
    assert u[-1] == pytest.approx(settled(BUOYANT, MODULUS, FLOOR), rel=1e-6)
    assert p[4] == pytest.approx(WATER * GRAVITY * HEIGHT, rel=1e-6)
    assert p[-1] == pytest.approx(WATER * GRAVITY * FLOOR, rel=1e-6)
    assert np.isnan(history["above.u_y"][5:]).all()
    assert np.isfinite(history["above.u_y"][:5]).all()


def test_a_new_surface_is_sealed_until_a_stage_drains_it():
    """Undrained the water bears all that is taken away, and nothing heaves."""
    scene = ground(drained=False)
    time = {"end": 3 * LONG, "step": LONG / 4}
    scene["stage"].append(
        {"name": "drain", "time": time, "boundary": [{"on": "upper", "pressure": 0.0}]}
    )
    history = solved(scene, MPI.COMM_SELF)
    u, p = history["floor.u_y"], history["base.p"]
    undrained = WATER * GRAVITY * HEIGHT - SATURATED * (HEIGHT - FLOOR)
    np.testing.assert_allclose(u[4:9], settled(BUOYANT, MODULUS, HEIGHT), rtol=1e-6)
    np.testing.assert_allclose(p[5:9], undrained, rtol=1e-6)
    assert u[-1] == pytest.approx(settled(BUOYANT, MODULUS, FLOOR), rel=1e-6)
    assert p[-1] == pytest.approx(WATER * GRAVITY * FLOOR, rel=1e-6)


@pytest.mark.mpi
@pytest.mark.parametrize("scheme", [None, "steady"])
def test_a_gradual_stage_takes_a_part_of_the_weight_in_each_step(scheme):
    """The floor heaves in proportion to time; what is placed afterwards comes like that too."""
    scene = column(gradual=True)
    if scheme:
        scene["model"] = {}
        scene["time"]["scheme"] = scheme
    fill = {"name": "fill", "active": ["upper"], "gradual": True, "time": {"end": 3.0}}
    scene["stage"].append(fill)
    history = solved(scene)
    weight = DENSITY * GRAVITY
    ends = [settled(weight, YOUNG, height) for height in (HEIGHT, FLOOR, HEIGHT)]
    exact = np.interp(history["t"][1:], [1.0, 2.0, 3.0], ends)
    np.testing.assert_allclose(history["floor.u_y"][1:], exact, rtol=1e-9)


@pytest.mark.parametrize("scheme", ["partitioned", "direct"])
def test_a_gradual_stage_takes_a_part_of_the_pressure_of_sealed_ground(scheme):
    """Undrained the water bears all of it, a part in each step, and nothing heaves."""
    scene = ground(drained=False, scheme=scheme)
    scene["stage"][0] |= {"gradual": True}
    history = solved(scene, MPI.COMM_SELF)
    gone = SATURATED * (HEIGHT - FLOOR) * np.linspace(0.25, 1.0, 4)
    np.testing.assert_allclose(history["base.p"][5:], WATER * GRAVITY * HEIGHT - gone, rtol=1e-6)
    np.testing.assert_allclose(
        history["floor.u_y"][4:], settled(BUOYANT, MODULUS, HEIGHT), rtol=1e-6
    )


def pit(**changes):
    """Return ground of 8 m x 8 m of which a quarter is taken away in two lifts."""
    scene = ground(**changes)
    scene["mesh"] |= {
        "x": {"points": [0.0, 4.0, 8.0], "cells": [2, 2]},
        "y": {"points": [0.0, 4.0, 6.0, 8.0], "cells": [2, 1, 1]},
        "regions": [
            {"name": "lift_1", "x": [0.0, 4.0], "y": [6.0, 8.0]},
            {"name": "lift_2", "x": [0.0, 4.0], "y": [4.0, 6.0]},
        ],
    }
    scene["stage"] = [
        {
            "name": f"dig_{n}",
            "inactive": [f"lift_{n}"],
            "time": {"end": (1 + n / 2) * LONG, "step": LONG / 4},
            "boundary": [{"on": f"lift_{n}", "pressure": 0.0}],
        }
        for n in (1, 2)
    ]
    scene["probe"] = [{"name": "corner", "at": [4.0, 4.0], "quantities": ["u_x", "u_y", "p"]}]
    scene["surface"] = [{"name": "base", "on": "bottom", "quantities": ["force"]}]
    return scene


@pytest.mark.mpi
def test_the_base_of_a_pit_bears_what_is_left():
    """To 1e-6 of the coupling; on several ranks what a run on one gives."""
    history = solved(pit())
    volumes = np.array([64.0, 56.0, 48.0])  # [m²]
    steps = [4, 6, 8]
    np.testing.assert_allclose(history["base.f_y"][steps], -SATURATED * volumes, rtol=1e-6)
    one = solved(pit(), MPI.COMM_SELF)
    for name in ("corner.u_x", "corner.u_y"):
        scale = np.abs(one[name]).max()
        np.testing.assert_allclose(history[name], one[name], rtol=0, atol=1e-6 * scale)


def test_a_restart_in_an_excavation_is_the_same_run(tmp_path):
    """With a skeleton that has internal variables."""
    scene = pit()
    scene["material"][0]["solid"] |= {
        "law": "drucker_prager",
        "friction_angle": 20.0,
        "cohesion": 2e4,
        "dilatancy_angle": 0.0,
        "match": "plane_strain",
    }
    with Simulation.from_scene(scene, MPI.COMM_SELF) as whole:
        whole.run(until=1.25 * LONG)
        paths = [whole.checkpoint(tmp_path / "1")]
        whole.run(until=1.75 * LONG)
        paths.append(whole.checkpoint(tmp_path / "2"))
        whole.run()
    assert whole.fields["plastic_strain"].max() > 1e-5
    for path in paths:
        with Simulation.from_scene(scene, MPI.COMM_SELF, restart=path) as rest:
            rest.run()
            for name in whole.fields:
                np.testing.assert_array_equal(rest.fields[name], whole.fields[name])
    scene["stage"][0]["inactive"] += scene["stage"][1].pop("inactive")
    with pytest.raises(InputError, match=r"\[stage.0.inactive\]"):
        Simulation.from_scene(scene, MPI.COMM_SELF, restart=paths[1])


def test_a_restart_in_a_gradual_stage_is_the_same_run(tmp_path):
    scene = pit()
    for stage in scene["stage"]:
        stage["gradual"] = True
    with Simulation.from_scene(scene, MPI.COMM_SELF) as whole:
        whole.run(until=1.75 * LONG)
        path = whole.checkpoint(tmp_path)
        whole.run()
    with Simulation.from_scene(scene, MPI.COMM_SELF, restart=path) as rest:
        rest.run()
        for name in whole.fields:
            np.testing.assert_array_equal(rest.fields[name], whole.fields[name])
    scene["stage"][1]["time"]["end"] = 3 * LONG
    with pytest.raises(InputError, match=r"\[stage.1.time.end\]"):
        Simulation.from_scene(scene, MPI.COMM_SELF, restart=path)


def test_an_excavation_may_follow_a_run_at_its_end(tmp_path):
    """The surfaces toward regions do not belong to what a checkpoint knows of the mesh."""
    scene = ground()
    with Simulation.from_scene(scene | {"stage": []}, MPI.COMM_SELF) as first:
        first.run()
        path = first.checkpoint(tmp_path)
    with Simulation.from_scene(scene, MPI.COMM_SELF, restart=path) as rest:
        rest.run()
        u = rest.history["floor.u_y"][-1]
    assert u == pytest.approx(settled(BUOYANT, MODULUS, FLOOR), rel=1e-6)


def test_a_scene_with_an_excavation_loads_again():
    scene = load_scene(pit())
    assert load_scene(tomllib.loads(scene_to_toml(scene))) == scene
    assert [part.inactive for part in scene.stages] == [(), ("lift_1",), ("lift_1", "lift_2")]


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"inactive": ["roof"]}, r"\[stage.0.inactive\]: the mesh has no region 'roof'"),
        ({"inactive": ["body", "upper"]}, r"received all regions"),
        ({"inactive": ["body"]}, r"(?i)rigid"),
        (
            {"gradual": True, "model": {"solid_inertia": True}},
            r"\[stage.0.gradual\]: received true with inertia",
        ),
        (
            {"inactive": ["upper", "upper"]},
            r"\[stage.0.inactive\]: received 'upper', which is taken",
        ),
        (
            {"boundary": [{"on": "uper", "traction": {"y": 0.0}}]},
            r"\[stage.0.boundary.0.on\]: the mesh has no boundary tag 'uper'",
        ),
        (
            {"load": [{"at": [0.5, 8.0], "force": {"y": -1.0}}]},
            r"\[load.0\]: received the point.*\(in the stage 'dig'\)",
        ),
        (
            {"boundary": [{"on": "top", "traction": {"y": -1.0}}]},
            r"\[stage.0.boundary.0.on\]: received 'top', of which in the stage 'dig' and after it",
        ),
        (
            {"body_force": [{"on": "upper", "solid": {"y": -1.0}}]},
            r"\[stage.0.body_force.0.on\]: received 'upper', of which in the stage 'dig' and",
        ),
        (
            {"body_force": [{"on": "uper", "solid": {"y": -1.0}}]},
            r"\[stage.0.body_force.0.on\]: the mesh has no region 'uper'; choose from body, upper",
        ),
    ],
)
def test_what_cannot_be_taken_away_is_refused(changes, text):
    with pytest.raises(InputError, match=text):
        Simulation.from_scene(column(**changes), MPI.COMM_SELF)


def test_a_material_of_what_is_taken_away_is_refused():
    """Nor is one of a region that the mesh has not; a typo has the key that was written."""
    scene = column()
    material = scene["material"][0] | {"region": ["body", "upper"]}
    for region, text in (("upper", r"'upper', of which in"), ("uper", r"no region 'uper'; choose")):
        second = scene["stage"][0] | {"material": [material | {"region": region}]}
        with pytest.raises(InputError, match=rf"\[stage.0.material.0.region\]: .*{text}"):
            Simulation.from_scene(
                scene | {"material": [material], "stage": [second]}, MPI.COMM_SELF
            )


def test_check_says_what_a_stage_changes():
    scene = column(boundary=[{"on": "upper", "traction": {"y": -1.0}}], reset_displacement=True)
    fill = {"name": "fill", "active": ["upper"], "load": [], "time": {"end": 3.0}}
    fill["gradual"] = True
    said = check(load_scene(scene | {"stage": [*scene["stage"], fill]}))
    assert (
        "'dig': to t = 2 s in 2 steps of 0.5 s; takes away upper; changes [[boundary]] of" in said
    )
    assert "upper; resets displacements" in said
    assert "'fill': to t = 3 s in 2 steps of 0.5 s; places upper; ends [[load]]; all of it" in said


def test_a_surface_that_is_taken_away_is_refused():
    scene = column()
    scene["surface"] = [{"name": "lid", "on": "top", "quantities": ["area"]}]
    with pytest.raises(InputError, match=r"\[surface.0.*'top'.*in the stage 'dig'"):
        Simulation.from_scene(scene, MPI.COMM_SELF)


def test_a_name_of_a_boundary_is_none_of_its_surface():
    scene = column(inactive=["top"])
    scene["mesh"]["regions"][0]["name"] = "top"
    with pytest.raises(InputError, match=r"'top', which is the name of a boundary"):
        Simulation.from_scene(scene, MPI.COMM_SELF)


def test_a_boundary_inside_of_the_mesh_is_none_of_its_surface():
    """As a mesh file may have one."""
    scene = load_scene(column())
    mesh = tagged_mesh(scene)
    cut = with_inner(mesh, ["upper"]).inner["upper"]
    with pytest.raises(InputError, match=r"the boundary 'cut' lies on the surface of an inactive"):
        remaining_mesh(scene.stages[1], replace(mesh, facets=mesh.facets | {"cut": cut}))
