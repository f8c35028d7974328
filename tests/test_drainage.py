"""What is prescribed for the pore fluid on one surface: a pressure, a flux or a wall, and nothing
that contradicts it.
"""

import numpy as np
import pytest

from porofsi_petsc import Simulation, load_scene
from porofsi_petsc.errors import InputError
from porofsi_petsc.simulation import check

pytestmark = pytest.mark.usefixtures("petsc")
SMALL = ("mesh.y.cells=[4]", "mesh.y.ratios=[1.0]", "expect=[]", "reference.times=[]")
SIDES = "{on=['left', 'right'], displacement={x=0}, velocity={x=0}}"
BASE = "{on='bottom', displacement={y=0}, pressure=0}"
DRAINED = (
    r"\[boundary\.2\.velocity\]: tag 'top' has boundary\.2\.pressure, which .* beside the normal"
    r" velocity; remove one"
)
WALL = (
    r"\[boundary\.2\.velocity\]: tag 'top': received a velocity of .* m/s through the wall .*`flux`"
)


def scene(top, *changes):
    return load_scene(
        "terzaghi", (*SMALL, f"boundary=[{SIDES}, {BASE}, {{on='top', {top}}}]", *changes)
    )


@pytest.mark.parametrize(
    "top, sentence",
    [
        ("pressure=0, velocity={y=0}", DRAINED),
        ("pressure='1e3*t', velocity={x=0, y=-1e-3}", DRAINED),
        (
            "velocity={y=-1e-3}",
            WALL,
        ),  # flowed along the nodes of the top, and through it nothing: no inflow, exit code 0
        ("velocity={y=0}, displacement={y='-1e-3*t'}", WALL),
        ("velocity={y=0}, displacement={y=-1e-3}", WALL),  # in the first step
        ("velocity={y=0}, displacement={y='-1e-3*sin(t)'}", WALL),
        ("velocity={y='-1e-3*sin(t)'}, displacement={y='-1e-3*sin(t)'}", WALL),
        ("velocity={y='-2e-3*t'}, displacement={y='-1e-3*t**3'}", WALL),
        ("velocity={y='where(t > 15, 1e-3, 0)'}, displacement={y=0}", WALL),
    ],
)
def test_a_normal_velocity_that_contradicts_is_refused(top, sentence):
    with pytest.raises(InputError, match=sentence):
        check(scene(top))


@pytest.mark.parametrize(
    "top",
    [
        "pressure=0, velocity={x=0}",
        "flux=1e-3",
        "velocity={y='-1e-3*cos(t)'}, displacement={y='-1e-3*sin(t)'}",
        "velocity={y='1e-3*cos(100*t)'}, displacement={y='1e-5*sin(100*t)'}",  # 0.1 in a step
        # turns at a time that is looked at: the rate is round-off there
        "velocity={y='2e-3*pi*sin(2*pi*t)'}, displacement={y='1e-3*(1 - cos(2*pi*t))'}",
        "velocity={y='2e-3*t'}, displacement={y='1e-3*t**2'}",
        "velocity={y='3e-3*t**2'}, displacement={y='1e-3*t**3'}",
        "velocity={y='5e-4/sqrt(t)'}, displacement={y='1e-3*sqrt(t)'}",
        "velocity={y='where(t < 0.25, 4e-3, 0)'}, displacement={y='1e-3*minimum(4*t, 1)'}",
        "velocity={y=0}",
    ],
)
def test_a_normal_velocity_of_the_wall_is_accepted(top):
    check(scene(top, "time.step=1e-3", "time.end=1.0"))


def test_a_drained_wall_without_slip_is_refused():
    with pytest.raises(
        InputError, match="tag 'top' has boundary.2.pressure already, which excludes no_slip"
    ):
        scene("pressure=0, no_slip=true", "model.viscosity=true", "material.0.fluid.viscosity=1e-3")


@pytest.mark.parametrize("scheme", ["partitioned", "quasi_direct", "direct"])
def test_a_sealed_body_under_a_load_stays_as_it_is(scheme):
    """Skempton: the pressure is the load from the first step on, and nothing moves; without weight
    the volume balance has nothing but the round-off of a uniform pressure.
    """
    material = {
        "region": "body",
        "porosity": 0.4,
        "solid": {"law": "linear_elastic", "lambda": 4e6, "mu": 8e6, "density": 2500.0},
        "fluid": {"density": 1000.0, "specific_weight": 1e4},
        "permeability": {"law": "constant", "k": 1e-3},
    }
    sealed = {
        "title": "sealed column",
        "mesh": {
            "kind": "rectangle",
            "order": 2,
            "x": {"points": [0.0, 1.0], "cells": [1]},
            "y": {"points": [0.0, 10.0], "cells": [6]},
        },
        "model": {"solid_inertia": False, "fluid_inertia": False},
        "time": {"end": 1e4, "step": 1e3},
        "material": [material],
        "boundary": [
            {"on": ["left", "right"], "displacement": {"x": 0.0}},
            {"on": "bottom", "displacement": {"y": 0.0}},
            {"on": "top", "traction": {"y": -1e5}},
        ],
        "probe": [{"name": "top", "at": [0.5, 10.0], "quantities": ["u_y", "p"]}],
        "coupling": {"scheme": scheme},
    }
    with Simulation.from_scene(sealed) as simulation:
        simulation.run()
        assert np.abs(simulation.history["top.p"][1:] / 1e5 - 1).max() < 1e-9
        assert np.abs(simulation.history["top.u_y"]).max() < 1e-9 * 10.0 * 1e5 / 2e7
