"""A porous medium around an axis: the exact sphere and cylinder, the plane answer of a column, all
coupling schemes, restart and ranks.
"""

import numpy as np
import pytest
from running import Job, fields, history, needs_mpirun, run_here, run_on, summary

from porofsi_petsc import load_scene
from porofsi_petsc.config.fields import Cells
from porofsi_petsc.exact import Cryer
from porofsi_petsc.simulation.simulation import Simulation

pytestmark = pytest.mark.usefixtures("petsc")
PLANE = ("mesh.x.cells=[2]", "mesh.cell_type=quadrilateral", "mesh.order=1")
DISC = (*PLANE, "mesh.axisymmetric=true")


def test_cryers_sphere_rises_before_it_falls(tmp_path):
    """Half of the scene, with its bounds; its peak is that of the exact solution."""
    scene = load_scene("cryer_axisymmetric")
    law = scene.material[0].elastic_law()
    diffusivity = scene.material[0].mobility_at(Cells.none()) * law.oedometer_modulus
    exact = Cryer(1e3, 1.0, law.lam, law.mu, diffusivity)
    (peak,) = (expect for expect in scene.expect if expect.quantity == "centre.p")
    assert exact.pressure(np.zeros(1), peak.at)[0] == pytest.approx(peak.value, rel=1e-6)
    found = run_here(Job("cryer_axisymmetric", str(tmp_path), ("time.end=0.5",)))
    early, late = found["errors"]
    assert early["u"] < 0.025 and early["p"] < 0.02
    assert late["u"] < 0.003 and late["p"] < 0.0025
    assert history(tmp_path)["centre.p"].max() == pytest.approx(peak.value, rel=0.004)
    assert found["energy"]["balance_error_relative"] < 1e-6


@pytest.mark.parametrize("scheme", ["partitioned", "quasi_direct"])
def test_a_disc_settles_as_a_plane_column(scheme):
    """What depends on y alone is the same in both, and on quadrilaterals, products of functions of
    x and y, to the tolerance of the iteration; forces are those on the area π R².
    """
    short = ("time.end=0.02", f"coupling.scheme={scheme}", "coupling.tolerance=1e-12")
    states = []
    for changes in (PLANE, DISC):
        simulation = Simulation(load_scene("terzaghi", (*changes, *short, "expect=[]")))
        simulation.run()
        states.append(simulation)
    one, other = (simulation.coupling for simulation in states)
    for name in ("u", "v", "p"):
        phases = [c.fluid if name == "p" else c.solid for c in (one, other)]
        a, b = (getattr(phase, name) for phase in phases)
        assert np.abs(a - b).max() < 1e-9 * np.abs(a).max()
    work = [simulation.energy.external_work for simulation in states]
    assert work[1] / work[0] == pytest.approx(np.pi * 0.1**2 / 0.1, rel=1e-8)


def test_a_disc_between_plates_bulges_as_armstrong_lai_and_mow():
    """The radial consolidation of the scene of that name, in the plane of r and z."""
    scene = load_scene("unconfined_compression").model_dump(
        mode="json", by_alias=True, exclude_none=True
    )
    radius = scene["reference"]["length"]
    scene["mesh"] = {
        "kind": "rectangle",
        "axisymmetric": True,
        "order": 2,
        "x": {"points": [0.0, radius], "cells": [8], "ratios": [0.25]},
        "y": {"points": [0.0, 5e-4], "cells": [1]},
    }
    scene["boundary"] = [
        {"on": "bottom", "displacement": {"y": 0.0}},
        {"on": "top", "displacement": {"y": -5e-6}},
        {"on": "right", "pressure": 0.0},
    ]
    scene["probe"] = []
    scene["expect"] = []
    scene["reference"]["times"] = [10.0, 100.0]
    scene["time"]["end"] = 100.0
    simulation = Simulation(load_scene(scene))
    simulation.run()
    early, late = simulation.measures.comparison.errors()
    assert early["u"] < 0.002 and early["p"] < 0.01  # the bounds of the scene in space
    assert late["u"] < 0.0015 and late["p"] < 0.003


CRYER = (
    "time.end=0.008",
    "time.growth=1.0",
    "reference.times=[]",
    "coupling.tolerance=1e-10",
    "output.checkpoint_every=2",
)


def test_a_restart_continues_identically(tmp_path):
    whole, half = tmp_path / "whole", tmp_path / "half"
    run_here(Job("cryer_axisymmetric", str(whole), CRYER))
    run_here(Job("cryer_axisymmetric", str(half), (*CRYER, "time.end=0.004")))
    run_here(Job("cryer_axisymmetric", str(half), CRYER, restart=str(half / "checkpoint.h5")))
    one, other = (fields(folder / "checkpoint.h5") for folder in (whole, half))
    assert all(np.array_equal(one[name], other[name]) for name in one)


@needs_mpirun
def test_two_ranks_find_what_one_does(tmp_path):
    run_on(2, [Job("cryer_axisymmetric", str(tmp_path / "two"), CRYER)], tmp_path)
    run_here(Job("cryer_axisymmetric", str(tmp_path / "one"), CRYER))
    one, two = (fields(tmp_path / name / "checkpoint.h5") for name in ("one", "two"))
    for name in one:  # the tolerance of the iteration, and round-off of sums
        assert np.abs(one[name] - two[name]).max() <= 1e-8 * np.abs(one[name]).max(initial=0.0)
    assert summary(tmp_path / "two")["ranks"] == 2
