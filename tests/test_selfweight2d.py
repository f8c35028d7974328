"""The block under its own weight: volume and mass are kept, and the drained end is the static
solution of the skeleton alone.
"""

import numpy as np
import pytest
from mpi4py import MPI
from running import Job, history, largest_difference, run_here, state

from porofsi_petsc import load_scene
from porofsi_petsc.clock import backward_euler
from porofsi_petsc.config.catalogue import find_scene
from porofsi_petsc.exact.selfweight import Selfweight
from porofsi_petsc.fem.domain import Configuration
from porofsi_petsc.materials import ELASTIC
from porofsi_petsc.phases.coupling_data import Flow, Rates
from porofsi_petsc.simulation.loop import Clock
from porofsi_petsc.simulation.simulation import Simulation

pytestmark = pytest.mark.usefixtures("petsc")
VARIANTS = {
    "as it is": (),
    "2 g": ('body_force.solid.y="-9.81*minimum(t, 1)"',),
    "variable porosity": ("model.porosity=variable", "material.0.solid.law=ehlers_eipper"),
    "rolling sides": ("boundary.1.displacement.x=0", "boundary.1.velocity.x=0"),
}
COARSE = ("mesh.x.cells=[2, 2]", "mesh.y.cells=[2, 2]")
WEIGHT = 0.67 * 2000 * 4.905  # [N/m³]


def test_the_scene_names_its_variants():
    text = find_scene("selfweight2d").read_text()
    assert [
        change
        for changes in VARIANTS.values()
        for change in changes
        if f"--set '{change}'" not in text
    ] == []


def build(*overrides):
    """Return scene and medium on this rank alone."""
    scene = load_scene("selfweight2d", (*COARSE, *overrides))
    return scene, Simulation(scene, MPI.COMM_SELF).coupling


def static_solution(*overrides):
    """Return u in the natural order of the skeleton alone under its weight, Newton's iteration in
    ten steps of the weight.
    """
    still = ("model.solid_inertia=false", "model.fluid_inertia=false")
    _, medium = build(*overrides, *still)
    solid = medium.solid
    rates = Rates(0.0, 1.0, 0.0)
    weight = load_scene("selfweight2d", overrides).body_force.solid.y(1.0, np.zeros((1, 2)))
    _, medium = build(*overrides, *still, f"body_force.solid.y={weight.item()!r}*t")
    solid = medium.solid
    for step in range(10):
        solid.begin_step(backward_euler(0.1), 0.1 * step)
        for _ in range(20):
            residual = solid.residual(Flow(solid.velocity, np.zeros(solid.mesh.n_local)))
            if residual.norms()[0] < 1e-12 * residual.norms()[1]:
                break
            solid.renew_tangent(rates)
            solid.correct(residual.total)
        else:
            raise AssertionError("Newton's iteration did not converge")
        solid.accept()
    u = np.empty_like(solid.u)
    u[solid.mesh.natural] = solid.u
    return u


TO_THE_END = (
    "time.end=300",
    "time.growth=1.3",
    "time.max_step=20.0",
    "output.checkpoint_every=1000",
    "output.fields_every=1000",
)


@pytest.mark.parametrize("variant", VARIANTS)
def test_the_drained_end_is_the_static_solution_of_the_skeleton_alone(tmp_path, variant):
    run_here(Job("selfweight2d", str(tmp_path / "run"), (*COARSE, *VARIANTS[variant], *TO_THE_END)))
    end = state(tmp_path / "run/checkpoint.h5")
    u = static_solution(*VARIANTS[variant])
    largest = np.abs(u).max()
    # p falls by e every 10 s: what is left of it over the initial pressure bounds what is left of
    # the settlement
    assert np.abs(end["fluid.p"]).max() / WEIGHT < 1e-9 and largest > 0.07
    assert np.abs(end["solid.u"] - u).max() < 1e-9 * largest


def test_rolling_sides_make_the_column(tmp_path):
    """The history is that of a column one element wide, the end the exact one of large strain."""
    fine = (*VARIANTS["rolling sides"], *TO_THE_END, "time.growth=1.4", "mesh.y.cells=[3, 3]")
    for name, cells in (("block", "[2, 2]"), ("column", "[1, 1]")):
        run_here(Job("selfweight2d", str(tmp_path / name), (*fine, f"mesh.x.cells={cells}")))
    block = history(tmp_path / "block")
    column = history(tmp_path / "column")
    exact = -Selfweight(
        WEIGHT, 1.0, 4e4, 0.04, ELASTIC["neo_hookean"](2e4, 1e4, 0.67).confined
    ).end_settlement(np.zeros(1))[0]
    # six elements over the height: what the pattern of the triangles makes of u and, right after
    # the jump of the load, of p
    assert largest_difference(block["T.u_y"], column["T.u_y"]) < 3e-4
    assert largest_difference(block["P2.p"], column["P2.p"]) < 0.02
    assert np.abs(block["P3.u_x"]).max() < 1e-9 * abs(
        exact
    )  # the tolerance of the coupling, times the width of an element
    assert abs(block["T.u_y"][-1] / exact - 1) < 1e-4  # discretization: 2.9e-5 on this mesh


def march(overrides, dt, end):
    """Yield (medium, time [s], outflow [m²/s], rate of the volume [m²/s]) on the collocation level
    of every step, then accept it.

    The outflow is what holds the pressure on the drained top: the rows of the volume balance there,
    whose sum is -∮ n_f w·n.
    """
    scene, medium = build(
        *overrides,
        f"time.step={dt}",
        f"time.end={end}",
        "time.growth=1.0",
        "coupling.tolerance=1e-9",
    )
    clock = Clock(scene.time)
    while not clock.finished:
        target = clock.next_target()
        size = clock.next_size()
        schemes, rates = clock.schemes(scene.model, size)
        medium.step(schemes, rates, clock.t, clock.step + 1)
        volume = medium.residuals[1][1]
        outflow = (volume.total - sum(volume.terms.values())).sum()
        yield medium, clock.t + schemes[0].alpha_f * size, outflow, volume_rate(medium.solid, size)
        medium.accept()
        clock.advance(size, target)


def volume_of(domain, u):
    """Return the volume of a mesh of curved triangles [m²]."""
    return Configuration.at(domain, domain.mesh.X + u, False).geometry.dV.sum()


def volume_rate(solid, dt):
    """Return the rate of the volume of the trial state: a central difference is exact for what is
    quadratic in the positions.
    """
    mesh_state = solid.mesh_state()
    u = mesh_state.displacement
    v = mesh_state.velocity
    return (volume_of(solid.domain, u + dt * v) - volume_of(solid.domain, u - dt * v)) / (2 * dt)


def lost_volume_and_outflow(rho_inf, dt, end=0.4):
    """Return the volume that the block has lost and the sum of the outflow, by the line through the
    values of the steps [m²].
    """
    steps = list(march((*VARIANTS["2 g"], f"time.rho_inf={rho_inf}"), dt, end))
    times, rates = (np.array([step[i] for step in steps]) for i in (1, 2))
    solid = steps[-1][0].solid
    last = rates[-1] + (end - times[-1]) / (times[-1] - times[-2]) * (rates[-1] - rates[-2])
    t = np.r_[0.0, times, end]
    rate = np.r_[0.0, rates, last]
    return (
        1 - volume_of(solid.domain, solid.u),
        (np.diff(t) * (rate[1:] + rate[:-1]) / 2).sum(),
        dt * rates.sum(),
    )


def test_the_outflow_of_every_step_is_the_rate_of_the_volume():
    """In the discrete sense the balance holds to the tolerance of the coupling."""
    steps = [step[2:] for step in march(VARIANTS["2 g"], 0.05, 0.5)]
    assert len(steps) == 10 and all(outflow > 0 for outflow, _ in steps)
    # 1e-9 of the nodal rates of a step, whose sum over the mesh is up to ten times the outflow
    assert max(abs(outflow + rate) for outflow, rate in steps) < 1e-8 * max(
        outflow for outflow, _ in steps
    )


def test_what_the_block_loses_flows_out_at_the_top():
    """Over a run: to the tolerance with the midpoint rule, which integrates the rate of an area
    exactly, else like Δt².
    """
    lost, _, midpoint = lost_volume_and_outflow(1.0, 0.05)
    assert (
        lost > 4e-4 and abs(midpoint / lost - 1) < 1e-7
    )  # the tolerance of the coupling, eight steps
    errors = [
        sampled / lost - 1
        for lost, sampled, _ in (lost_volume_and_outflow(0.3, dt) for dt in (0.08, 0.04, 0.02))
    ]
    # from 19 % to 0.9 %: the rate grows from zero within the 0.4 s, five steps of the largest size
    assert errors[0] / errors[1] > 3.6 and errors[1] / errors[2] > 3.6 and errors[2] < 0.01


@pytest.mark.parametrize("porosity", ["variable", "constant"])
def test_variable_porosity_keeps_the_mass_of_the_solid(porosity):
    """n_s = n_s0/J over the current volume; a constant one over the same motion does not keep
    it.
    """
    settling = (*VARIANTS["variable porosity"], *VARIANTS["2 g"], f"model.porosity={porosity}")
    solids = []
    for medium, *_ in march(settling, 0.1, 1.0):
        mesh_state = medium.solid.mesh_state()
        material = medium.solid.setup.materials["body"]
        n_s = 1 - material.fluid_fraction(mesh_state.configuration.J)
        solids.append((n_s * mesh_state.configuration.geometry.dV).sum())
    change = np.abs(np.array(solids) / 0.67 - 1).max()
    # round-off of the sum over the elements; the motion changes the volume by 1 %
    assert change < 1e-14 if porosity == "variable" else change > 1e-4
