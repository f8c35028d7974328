"""Conditions on an interface: impedances, first relaxation, and that all pairs end in the same
step.
"""

from dataclasses import replace
from math import sqrt

import numpy as np
import pytest

from porofsi_petsc.config import Scene
from porofsi_petsc.coupling.robin import (
    InterfaceConditions,
    InterfaceMeans,
    fluid_impedance,
    solid_impedance,
)
from porofsi_petsc.phases.coupling_data import Rates
from porofsi_petsc.simulation.simulation import Simulation
from porofsi_petsc.studies.trial import attempt

RATES = Rates(c_f=200.0, c_v=200.0, c_a=4e4)
LAYER = InterfaceMeans(
    modulus=1e6, rho_s=1200.0, rho_f=1000.0, thickness=1e-3, extent=0.1, facet=1e-3
)
HELD = {"x": 0.0, "y": 0.0}


def test_a_thin_layer_is_its_mass_and_a_thick_one_a_wave():
    """tanh(x) = x - x³/3: a layer of 1/100 of the way of a wave within the step differs by 3e-5
    from its mass.
    """
    way = sqrt(1e6 / (1200.0 * RATES.c_a))
    thin = solid_impedance(1e6, 1200.0, way / 100, RATES)
    assert thin == pytest.approx(1200.0 * way / 100 * RATES.c_a / RATES.c_v, rel=1e-4)
    assert solid_impedance(1e6, 1200.0, 20 * way, RATES) == pytest.approx(
        sqrt(1e6 * 1200.0 * RATES.c_a) / RATES.c_v, rel=1e-12
    )


def test_the_first_relaxation_balances_the_waves_with_and_without_added_mass():
    factor = InterfaceConditions("dirichlet_neumann", LAYER, "auto", None, None).first_factor
    ratio = LAYER.mass_ratio
    assert ratio * LAYER.rho_s * LAYER.thickness * RATES.c_f == pytest.approx(
        fluid_impedance(1000.0, 0.1 / np.pi, RATES)
    )
    assert abs(1 - factor * (1 + ratio)) == pytest.approx(1 - factor, rel=1e-12)
    assert (
        InterfaceConditions(
            "dirichlet_neumann", replace(LAYER, rho_f=0.0), "auto", None, None
        ).first_factor
        == 1
    )
    assert InterfaceConditions("robin_neumann", LAYER, "auto", None, None).first_factor is None


def channel(pair, **changes):
    """Return a channel with an elastic wall that is clamped at its ends, pushed by a pressure at
    its inlet, both ends open.
    """
    axes = {
        "x": {"points": [0.0, 0.1], "cells": [8]},
        "y": {"points": [0.0, 0.02, 0.022], "cells": [3, 1]},
    }
    patches = [
        {"name": f"wall_{side}", "side": side, "y": [0.02, 0.022]} for side in ("left", "right")
    ]
    regions = [{"name": "wall", "y": [0.02, 0.022]}]
    tables = {
        "title": "channel with an elastic wall",
        "mesh": {"kind": "rectangle", "order": 2, **axes, "patches": patches, "regions": regions},
        "model": {"convection": True, "viscosity": True, "moving_mesh": True},
        "time": {"step": 1e-3, "end": 2e-3},
        "material": [
            {"region": "body", "fluid": {"density": 1000.0, "viscosity": 1e-2}},
            {
                "region": "wall",
                "solid": {"law": "neo_hookean", "young": 1e6, "poisson": 0.3, "density": 1200.0},
            },
        ],
        "boundary": [
            {"on": "left", "traction": {"x": 100.0}},
            {"on": ["right", "top"]},
            {"on": ["wall_left", "wall_right"], "displacement": HELD},
            {"on": "bottom", "velocity": HELD},
        ],
        "coupling": {
            "interface": pair,
            "accelerator": "iqn_ils",
            "tolerance": 1e-11,
            "max_iterations": 80,
        },
    }
    return Scene.model_validate(tables | changes)


def end_state(scene):
    """Return u of the solid, v_f and p at the end of a run, in one vector per field."""
    found = {}

    def watcher(coupling):
        def watch(clock, coupling, energy):
            found["u"] = np.where(coupling.solid.domain.holds[:, None], coupling.solid.u, 0.0)
            found["v"] = coupling.fluid.v.copy()
            found["p"] = coupling.fluid.p.copy()

        return watch

    outcome = attempt(scene, watcher)
    assert outcome.failure == ""
    return found


FREE_END = [
    {"on": "left", "traction": {"x": 100.0}},
    {"on": "right", "traction": {"x": -60.0}},
    {"on": ["top", "wall_right"]},
    {"on": "wall_left", "displacement": HELD},
    {"on": "bottom", "velocity": HELD},
]


@pytest.mark.parametrize("pair", ["robin_neumann", "robin_robin", "condensed"])
@pytest.mark.parametrize("changes", [{}, {"boundary": FREE_END}], ids=["clamped", "free end"])
def test_all_pairs_end_in_the_same_step(pair, changes):
    """The fluid sticks to a node that a support holds: the reaction of the support is no part of
    the balance of the two.  Nor is what presses the fluid where the end of the wall is free.
    """
    expected = end_state(channel("dirichlet_neumann", **changes))
    found = end_state(channel(pair, **changes))
    for name, field in expected.items():
        error = np.abs(found[name] - field).max() / np.abs(field).max()
        print(f"{pair} {name}: {error:.1e}")
        assert error < 1e-8  # the tolerance 1e-11 of the forces times the condition of a step
    assert expected["u"].max() > 1e-8


@pytest.mark.parametrize("scheme", ["partitioned", "direct"])
def test_a_pressed_fluid_presses_a_wall_across_alone(scheme):
    """A fluid at rest under a pressure at both ends: the wall beside it, one end free, is squeezed
    evenly, σ_yy = -p and σ_xx = 0, and holds no force along; the tractions on the fluid do not act
    on the ends of the wall.
    """
    pressure, young, poisson = 100.0, 1e12, 0.3  # so stiff that the load does not turn
    boundary = [
        {"on": "left", "traction": {"x": pressure}},
        {"on": "right", "traction": {"x": -pressure}},
        {"on": "wall_left", "displacement": {"x": 0.0}},
        {"on": "wall_right"},
        {"on": "top", "displacement": {"y": 0.0}},
        {"on": "bottom", "velocity": HELD},
    ]
    solid = {"law": "linear_elastic", "young": young, "poisson": poisson, "density": 1200.0}
    scene = channel(
        "auto",
        boundary=boundary,
        material=[
            {"region": "body", "fluid": {"density": 1000.0, "viscosity": 1e-2}},
            {"region": "wall", "solid": solid},
        ],
        time={"scheme": "steady", "step": 1.0, "end": 1.0},
        coupling={"scheme": scheme, "tolerance": 1e-10},
        model={"viscosity": True, "solid_inertia": False, "fluid_inertia": False},
        force=[{"name": "end", "on": "wall_left"}, {"name": "back", "on": "top"}],
    )
    simulation = Simulation(scene)
    simulation.run()
    solid = simulation.coupling.solid
    (x, y), u = solid.mesh.X[solid.domain.holds].T, solid.u[solid.domain.holds]
    strain = pressure * (1 + poisson) / young * np.array([poisson, poisson - 1])
    exact = np.column_stack([strain[0] * x, strain[1] * (y - 0.022)])
    assert np.abs(u - exact).max() < 1e-9 * np.abs(exact).max()
    end, back = (
        simulation.history[f"{name}.f_{axis}"][-1] for name, axis in (("end", "x"), ("back", "y"))
    )
    assert abs(end) < 1e-9 * pressure * 0.1 and abs(back - pressure * 0.1) < 1e-9 * pressure * 0.1


def test_the_fluid_sticks_to_the_solid_from_the_start():
    initial = {"solid_velocity": {"y": "0.01*x*(0.1 - x)"}, "fluid_velocity": {"x": 0.5}}
    start = []

    def watcher(coupling):
        interface = coupling.to_solid(np.ones_like(coupling.fluid.force)).any(axis=1)
        start.append((coupling.fluid.v.copy(), coupling.solid.v.copy(), interface))
        return lambda clock, coupling, energy: None

    attempt(channel("robin_robin", initial=initial, time={"step": 1e-3, "end": 1e-3}), watcher)
    v_f, v_s, interface = start[0]
    assert interface.any() and np.array_equal(v_f[interface], v_s[interface]) and v_f.max() == 0.5
