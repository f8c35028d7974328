"""What the stabilization of a free fluid costs on coarse linear elements, and that runs say so."""

import numpy as np
import pytest

from porofsi_petsc import Simulation
from porofsi_petsc.errors import LimitError

# A pressure difference 1 drives the flow along a square duct of side 1 and length 2, μ = 1:
# 0.0351443 Δp/(μ L) (White, Viscous Fluid Flow, 3-48), of which a quarter is computed.
FLOW = 0.0351443 / 2 / 4


def duct(cells, bound=0.15):
    """Return the simulation of a quarter of the duct with some cells across."""
    walls = {"x": 0.0, "y": 0.0, "z": 0.0}
    across = {"points": [0, 0.5], "cells": [cells]}
    scene = {
        "title": "flow along a square duct",
        "mesh": {
            "kind": "box",
            "order": 1,
            "x": {"points": [0, 2], "cells": [4 * cells]},
            "y": across,
            "z": across,
        },
        "model": {
            "fluid_inertia": False,
            "convection": False,
            "viscosity": True,
            "moving_mesh": False,
            "solid_inertia": False,
        },
        "limits": {"stabilization": bound},
        "time": {"scheme": "steady", "end": 1.0, "step": 1.0},
        "material": [{"region": "all", "fluid": {"density": 1.0, "viscosity": 1.0}}],
        "boundary": [
            {"on": "left", "traction": {"x": 1.0}, "velocity": {"y": 0.0, "z": 0.0}},
            {"on": "right", "velocity": {"y": 0.0, "z": 0.0}},
            {"on": ["back", "top"], "velocity": walls},
            {"on": "bottom", "velocity": {"z": 0.0}},
            {"on": "front", "velocity": {"y": 0.0}},
        ],
        "surface": [{"name": "out", "on": "right", "quantities": ["flow_rate"]}],
    }
    return Simulation.from_scene(scene)


def test_a_viscous_flow_on_linear_tetrahedra_converges_with_order_two():
    """An element's leg of a quarter and an eighth of half the side leaves 3.1 and 0.8 %: h² with
    the factor that the interpolation of the profile has, 1 % at the second.
    """
    errors = []
    for cells in (2, 4):
        with duct(cells, "report") as simulation:
            simulation.run()
            errors.append(abs(simulation.history["out.flow_rate"][-1] / FLOW - 1))
            share = simulation.energy.stabilization_share
        print(cells, errors[-1], share)
    assert errors[1] < 0.01
    assert np.log2(errors[0] / errors[1]) > 1.75


def test_a_mesh_on_which_the_stabilization_takes_the_work_is_refused_at_the_end():
    with duct(1) as simulation, pytest.raises(LimitError, match=r"\[limits\] stabilization"):
        simulation.run()
    with duct(1, "report") as simulation:
        simulation.run()
        assert simulation.energy.stabilization_share > 0.15
        assert simulation.energy.report()["stabilization_share"] > 0.15
