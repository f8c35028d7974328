"""Whole runs against states that are known: drained and undrained columns, conserved volumes,
pressure without checkerboard.
"""

import numpy as np
import pytest
from running import SCENES, Job, history, largest_difference, run_here, state

from porofsi_petsc import load_scene
from porofsi_petsc.simulation.build import serial_mesh

CONFINED = str(SCENES / "confined_column.toml")

# u of the top of a confined column of 1 m, drained: ψ'(J) = -q, uniaxial, λ = 8.375e6, μ = 5.583e6
# Pa; published to six digits.
DRAINED = [
    ("neo_hookean", 7.5e6, -0.278528),
    ("neo_hookean", 3e6, -0.133870),
    ("neo_hookean", 1e6, -0.048829),
    ("neo_hookean_j2", 7.5e6, -0.335436),
    ("neo_hookean_j2", 1e6, -0.050410),
    ("linear_elastic", 7.5e6, -0.383808),
]


@pytest.mark.parametrize("law, load, u", DRAINED)
def test_drained_end_state_of_a_confined_column(tmp_path, law, load, u):
    linear = (
        ("limits.strain=report", "limits.mesh_displacement=report", "model.moving_mesh=false")
        if law == "linear_elastic"
        else ()
    )
    overrides = (f"material.0.solid.law={law}", f"boundary.2.traction.y={-load}", *linear)
    run_here(Job(CONFINED, str(tmp_path / "run"), overrides))
    rows = history(tmp_path / "run")
    assert rows["t"][-1] == 1.0
    # half of the last digit published; what is left of the consolidation at T = c_v t/H² = 20 is
    # e^-48, the rule damps it less
    assert abs(rows["top.u_y"][-1] - u) < 6e-7
    assert (
        abs(rows["middle.u_y"][-1] / rows["top.u_y"][-1] - 0.5) < 1e-5
    )  # uniform strain, to ten coupling tolerances
    assert abs(rows["base.p"][-1]) < 1e-5 * load < 0.5 * load < rows["base.p"].max()


def undrained(law, *overrides):
    """Return the changes that close the top of the confined column under a load of 0.1 MPa."""
    moving = f"model.moving_mesh={'false' if law == 'linear_elastic' else 'true'}"
    closed = "boundary.2={ on = 'top', traction = { y = -1e5 } }"
    return (closed, f"material.0.solid.law={law}", moving, "time.growth=1.0", *overrides)


STILL = 1e-6 * 1e5 / (8.375e6 + 2 * 5.583e6)  # the coupling tolerance of the drained settlement [m]


@pytest.mark.parametrize("law", ["linear_elastic", "neo_hookean"])
def test_an_impermeable_loaded_surface_is_carried_by_the_fluid(tmp_path, law):
    """Nothing can leave or compress: p is the whole traction of the mixture at once, and nothing
    moves.
    """
    run_here(Job(CONFINED, str(tmp_path / "run"), undrained(law, "time.end=0.01")))
    rows = history(tmp_path / "run")
    assert [rows["base.p"][-1], rows["middle.p"][-1]] == pytest.approx(
        [1e5, 1e5], rel=1e-6
    )  # the coupling tolerance
    assert np.abs(rows["top.u_y"]).max() < STILL


@pytest.mark.parametrize("law", ["linear_elastic", "neo_hookean"])
@pytest.mark.parametrize("rho_inf", [0.0, 0.3, 1.0])
def test_the_undrained_pressure_of_generalized_alpha_takes_the_load_at_once(tmp_path, law, rho_inf):
    """No part of it rings on as (-ρ∞)^n: p = q from the first step on, with inertia."""
    inertia = ("model.solid_inertia=true", "model.fluid_inertia=true")
    dynamic = (*inertia, 'time.scheme="generalized_alpha"', f"time.rho_inf={rho_inf}")
    run_here(Job(CONFINED, str(tmp_path / "run"), undrained(law, *dynamic, "time.end=0.05")))
    rows = history(tmp_path / "run")
    assert rows["base.p"][1:] == pytest.approx(1e5, rel=1e-5)  # ten coupling tolerances
    assert np.abs(rows["top.u_y"]).max() < 10 * STILL


def closed_block(rho):
    """Return the changes of pulse2d that close its surface, with porosity n_s0/J and a load that
    stays.
    """
    return (
        "mesh.order=1",
        "mesh.x.cells=[4, 2, 4]",
        "mesh.y.cells=[4]",
        "model.porosity=variable",
        "boundary.2={ on = ['top'] }",
        "boundary.3.traction.y=-1e6*sin(25*pi*t)",
        "time.end=0.01",
        f"time.rho_inf={rho}",
        "coupling.tolerance=1e-8",
        'coupling.accelerator="anderson"',
        "coupling.max_iterations=300",
        "output.checkpoint_every=100",
        "output.fields_every=100",
    )


def mesh_of(directory):
    """Return the serial mesh of a run, whose node order is that of its checkpoint."""
    return serial_mesh(load_scene(directory / "scene.toml"))


def volume(directory):
    """Return the initial and the final volume of the mesh of a run [m³ per m], and its largest
    displacement [m].
    """
    mesh = mesh_of(directory)
    u = state(directory / "checkpoint.h5")["solid.u"]
    before, after = ((mesh.points + s * u)[mesh.cells] for s in (0, 1))
    return (
        *(np.linalg.det(x[:, 1:3] - x[:, :1]).sum() / 2 for x in (before, after)),
        np.abs(u).max(),
    )


def test_a_closed_block_keeps_the_volume_of_its_constituents(tmp_path):
    """n_s = n_s0/J keeps the skeleton; with nothing leaving, the fluid is kept when the volume of
    the mesh is.

    The midpoint rule (rho_inf = 1) integrates the rate of the volume, quadratic in the positions in
    2-D, exactly.
    """
    run_here(Job("pulse2d", str(tmp_path / "run"), closed_block(1.0)))
    before, after, largest = volume(tmp_path / "run")
    assert before == pytest.approx(210.0, rel=1e-14) and largest > 1e-3  # round-off of the sum
    assert (
        abs(after - before) < 1e-6 * largest
    )  # of the displacement times a length of 1 m: ten steps of the coupling tolerance


def oscillation(directory, undrained):
    """Return |p - p̄| over |p| at the nodes below the middle of the block, p̄ the average over the
    elements of a node.
    """
    coarse = (
        "mesh.order=1",
        "mesh.x.cells=[10, 1, 10]",
        "mesh.x.ratios=[1.0, 1.0, 1.0]",
        "mesh.y.cells=[10]",
        "mesh.y.ratios=[1.0]",
    )
    patient = (
        "coupling.accelerator=anderson",
        "coupling.max_iterations=400",
        "coupling.tolerance=1e-4",
    )
    run = (
        *coarse,
        *patient,
        "time.end=0.004",
        "output.checkpoint_every=100",
        f"stabilization.undrained={undrained}",
    )
    run_here(Job("pulse2d_low_permeability", str(directory), run))
    mesh = mesh_of(directory)
    p = state(directory / "checkpoint.h5")["fluid.p"]
    mean, count = (np.zeros(len(p)) for _ in range(2))
    for column in mesh.cells.T:  # elements of one size
        np.add.at(mean, column, p[mesh.cells].mean(axis=1))
        np.add.at(count, column, 1.0)
    x, y = mesh.points.T
    inside = (x > 0) & (x < 21) & (y > 0) & (y < 5)
    return np.linalg.norm((p - mean / count)[inside]) / np.linalg.norm(p[inside])


def test_the_undrained_stabilization_removes_the_checkerboard(tmp_path):
    """A pressure that changes its sign from node to node differs from its average by about itself;
    a smooth one by h²/6 |Δp|.
    """
    with_it = oscillation(tmp_path / "with", "true")
    without = oscillation(tmp_path / "without", "false")
    assert with_it < 0.45, (with_it, without)
    assert without > 1.5 * with_it, (with_it, without)


def test_runs_of_two_splits_agree(tmp_path):
    """Two ways through the coupling iteration end in one answer: the residuals are the same."""
    base = (
        "mesh.order=1",
        "mesh.x.cells=[4, 2, 4]",
        "mesh.y.cells=[4]",
        "time.end=0.005",
        "coupling.tolerance=1e-9",
    )
    ways = {
        "corrected": ("coupling.accelerator=aitken",),
        "anderson": ("coupling.accelerator=anderson",),
        "newton": ("coupling.tangent=newton",),
    }
    for name, way in ways.items():
        run_here(Job("pulse2d", str(tmp_path / name), (*base, *way)))
    reference = history(tmp_path / "corrected")
    for name in ("anderson", "newton"):
        rows = history(tmp_path / name)
        for column in ("A.u_y", "B.p", "C.u_y"):
            assert largest_difference(rows[column], reference[column]) < 1e-7, (
                name,
                column,
            )  # 1e-9 of the force, per step
