"""Forces on surfaces that end where another boundary begins: a node there has the traction of
both.
"""

from dataclasses import replace

import numpy as np
import pytest
from manufactured import steps_to_end
from mpi4py import MPI
from running import SCENES, Job, history, needs_mpirun, run_here, run_on
from scipy.integrate import trapezoid

from porofsi_petsc import Simulation, load_scene
from porofsi_petsc.errors import InputError
from porofsi_petsc.fem.distribute import distribute
from porofsi_petsc.linalg.options import start
from porofsi_petsc.phases.surface_force import FluidForce, State
from porofsi_petsc.simulation.build import serial_mesh
from porofsi_petsc.simulation.forces import InterfaceForces

POISEUILLE, BAR, FLAP = (str(SCENES / f"{name}.toml") for name in ("poiseuille", "bar", "flap"))
# The flow is in the space of the elements.  What is left is the tolerance of the iteration, 1e-12
# of the largest force, times the condition of the system.
EXACT = 1e-9
# 2 μ 4 L/H; Δp/2 H, where the pressure has zero mean, Δp = 8 μ L/H² = 24 Pa [N/m]
WALLS = 24.0
END = 12.0
ENDS = "{on='left', traction={x=24.0}, velocity={y=0.0}}, {on='right', velocity={y=0.0}}"
NO_SLIP = "{on=['bottom', 'top'], velocity={x=0.0, y=0.0}}"
PROFILE = "{on=['left', 'right'], velocity={x='4*y*(1 - y)', y=0.0}}"
SYMMETRIC = "{on='bottom', velocity={x=0.0, y=0.0}}, {on='top', velocity={y=0.0}}"
RISEN = (
    "{on=['left', 'right'], velocity={x='4*y*(1 - y)', y=0.0}, displacement={x=0.0, y='y/2'}},"
    " {on='bottom', velocity={x=0.0, y=0.0}}, {on='top', velocity={x=0.0, y=0.0},"
    " displacement={x=0.0, y=0.5}}"
)
BOX = (
    "mesh.kind='box'",
    "mesh.z={points=[0.0, 0.5], cells=[2]}",
    "mesh.x.cells=[2]",
    "mesh.y.cells=[2]",
)
DUCT_WALLS = "{on=['front', 'back'], velocity={x=0.0, y=0.0, z=0.0}}"
DUCT_ENDS = "{on=['left', 'right'], velocity={x='4*y*(1 - y)', y=0.0, z=0.0}}"
DUCT_CLOSED = "{on=['left', 'right', 'bottom', 'top'], velocity={x='4*y*(1 - y)', y=0.0, z=0.0}}"
DUCT_FORCES = (
    "force.0.on=['front', 'back']",
    "force.1.on='front'",
    "force.3.on=['front', 'back', 'left', 'right', 'bottom', 'top']",
)
DUCT_EXACT = {"walls.f_x": WALLS / 2, "bottom.f_x": WALLS / 4, "left.f_x": -END / 2}
# name -> (changes of the scene, columns of the history and their values)
CHANNELS = {
    "prescribed ends": (
        (),
        {
            "walls.f_x": WALLS,
            "bottom.f_x": WALLS / 2,
            "bottom.f_y": 0.0,
            "left.f_x": -END,
            "all.f_x": 0.0,
        },
    ),
    "given tractions": (  # the pressure is 24 (1 - x) Pa
        (f"boundary=[{ENDS}, {NO_SLIP}]",),
        {
            "walls.f_x": WALLS,
            "bottom.f_x": WALLS / 2,
            "bottom.f_y": -12.0,
            "left.f_x": -24.0,
            "all.f_x": 0.0,
            "all.f_y": 0.0,
        },
    ),
    "lower half": (  # no traction along the plane of symmetry
        ("mesh.y.points=[0.0, 0.5]", f"boundary=[{PROFILE}, {SYMMETRIC}]"),
        {"walls.f_x": WALLS / 2, "bottom.f_x": WALLS / 2, "left.f_x": -END / 2, "all.f_x": 0.0},
    ),
    "risen top": (  # height H = 1.5 after the motion
        ("model.moving_mesh=true", "limits.mesh_displacement='report'", f"boundary=[{RISEN}]"),
        {"walls.f_x": WALLS / 1.5, "bottom.f_x": WALLS / 3, "left.f_x": -END / 1.5, "all.f_x": 0.0},
    ),
    "duct": (
        (
            *BOX,
            *DUCT_FORCES,
            f"boundary=[{DUCT_ENDS}, {DUCT_WALLS}, {{on=['bottom', 'top'], velocity={{z=0.0}}}}]",
        ),
        DUCT_EXACT,
    ),
    "duct with prescribed sides": (
        (*BOX, *DUCT_FORCES, f"boundary=[{DUCT_CLOSED}, {DUCT_WALLS}]"),
        DUCT_EXACT,
    ),
}


def rows(scene, directory, *overrides):
    """Return dict column -> rows of the history of a run."""
    run_here(Job(scene, str(directory), overrides))
    return history(directory)


def require_exact(name, directory):
    """Compare the last row of a history with the exact forces."""
    found = history(directory)
    for column, value in CHANNELS[name][1].items():
        print(f"{name}: {column} {found[column][-1]:.12g}, exact {value:g}")
        assert found[column][-1] == pytest.approx(value, abs=EXACT * WALLS)


@pytest.mark.parametrize("name", CHANNELS)
def test_the_force_on_the_walls_of_a_channel_is_exact(name, tmp_path):
    run_here(Job(POISEUILLE, str(tmp_path / "run"), CHANNELS[name][0]))
    require_exact(name, tmp_path / "run")


@needs_mpirun
@pytest.mark.parametrize("ranks", [2, 3])
def test_so_it_is_on_several_ranks(ranks, tmp_path):
    names = "prescribed ends", "given tractions", "duct"
    run_on(
        ranks,
        [Job(POISEUILLE, str(tmp_path / name), CHANNELS[name][0]) for name in names],
        tmp_path,
    )
    for name in names:
        require_exact(name, tmp_path / name)


@pytest.mark.parametrize(
    "boundary", [PROFILE.replace("(1 - y)'", "(1 - y)*t'"), ENDS.replace("24.0", "'24*t'")]
)
def test_the_force_is_that_of_the_end_of_the_step(boundary, tmp_path):
    """A flow without inertia that grows with t; before the first step there is none, and the second
    has a line through two.
    """
    time = "time={scheme='generalized_alpha', end=1.0, step=0.25}"
    found = rows(POISEUILLE, tmp_path / "run", time, f"boundary=[{boundary}, {NO_SLIP}]")
    print("walls:", found["walls.f_x"])
    assert found["walls.f_x"][0] == 0.0
    assert np.allclose(found["walls.f_x"][2:], WALLS * found["t"][2:], rtol=0, atol=EXACT * WALLS)


# The stress of elements of order k has an error of order k, and the rim is one element wide: k + 1,
# less what the mesh is too coarse for.  Measured 1.66, 2.96 and 2.66; the undivided residual of the
# rim has 1.0.  Along the left side linear elements have 1.3 with either.
@pytest.mark.parametrize(
    ("order", "least"), [(1, {"top.f_x": 1.5}), (2, {"left.f_y": 2.4, "top.f_x": 2.4})]
)
def test_the_force_converges_by_one_order_more_than_the_stress(order, least, tmp_path):
    """Kovasznay's flow in a part of its period; the shear does not know of the level of the
    pressure.
    """
    errors = []
    exact = kovasznay_shear()
    for n in (8, 16):
        mesh = (
            "mesh.y.points=[-0.5, 0.25]",
            f"mesh.x.cells=[{3 * n // 2}]",
            f"mesh.y.cells=[{n}]",
            f"mesh.order={order}",
        )
        force = "force=[{name='left', on='left'}, {name='top', on='top'}]"
        found = rows("kovasznay", tmp_path / str(n), *mesh, force)
        errors.append([abs(found[name][-1] / exact[name] - 1) for name in least])
    rates = np.log2(np.divide(*errors))
    print(f"P{order}: errors {errors}, rates {rates}")
    assert (rates > list(least.values())).all()


def test_the_force_on_the_curved_walls_of_a_pipe():
    """v_x = 1 - r² in a quarter of 0.5 < r < 1, prescribed all around; quadratic elements of curved
    sides.

    Measured: 0.11, 0.01 and 0.19 % at most; the undivided residual has 8, 17 and 0.5 %.
    """
    start()
    box = (
        "mesh.kind='box'",
        "mesh.x.cells=[2]",
        "mesh.y.cells=[4]",
        "mesh.z={points=[0.5, 1.0], cells=[2]}",
    )
    sides = (
        "boundary=[{on=['left', 'right', 'bottom', 'top', 'front', 'back'], velocity={x='1 - y**2 -"
        " z**2', y=0.0, z=0.0}}]"
    )
    force = "force=[{name='outer', on='top'}, {name='inner', on='bottom'}, {name='end', on='left'}]"
    scene = load_scene(POISEUILLE, (*box, sides, force))
    mesh = serial_mesh(scene)
    x, turn, r = mesh.points.T
    mesh = replace(
        mesh,
        points=np.column_stack([x, r * np.sin(np.pi / 2 * turn), r * np.cos(np.pi / 2 * turn)]),
    )
    coupling = Simulation(
        scene, mesh=distribute(MPI.COMM_SELF, mesh, np.zeros(len(x), dtype=int))
    ).coupling
    for step, (time, schemes, rates) in enumerate(steps_to_end(scene), 1):
        coupling.step(schemes, rates, time, step)
        coupling.accept()
    outer, inner, end = InterfaceForces(coupling, [force.on for force in scene.force]).at(1.0)
    mu, moment = 3.0, (1 - 0.5**3) / 3  # ∫ y dA = ∫ z dA of the end
    found = np.array([outer[0], inner[0], end[1], end[2]])
    errors = found / (mu * np.array([np.pi, -np.pi / 4, -2 * moment, -2 * moment])) - 1
    print("pipe: errors", errors)
    assert np.abs(errors).max() < 0.003


def kovasznay_shear():
    """Return the exact forces along the left and the upper side of -0.5 < x < 1, -0.5 < y < 0.25.

    They are ±∫ μ (∂_y v_x + ∂_x v_y) ds.
    """
    decay = 20 - np.sqrt(400 + 4 * np.pi**2)
    size = 0.025 * (2 * np.pi + decay**2 / (2 * np.pi))  # times e^(κx) sin 2πy
    left, right = np.exp(decay * np.array([-0.5, 1.0]))
    return {"left.f_y": -size * left / (2 * np.pi), "top.f_x": -size * (right - left) / decay}


def test_a_surface_without_a_rim_has_the_sum_over_its_nodes():
    scene = load_scene("schaefer_turek_2d1")
    coupling = Simulation(scene, MPI.COMM_SELF).coupling
    fluid = coupling.fluid
    residual = np.random.default_rng(1).standard_normal(fluid.force.shape)
    state = State(residual, 1.0, fluid.v, fluid.v, fluid.v, fluid.p)
    nodes = np.unique(fluid.mesh.facets["cylinder"].nodes)
    assert (
        FluidForce.on(fluid.setup, ["cylinder"]).on_rank(state) == residual[nodes].sum(axis=0)
    ).all()


# -- of a solid: on what holds it ------------------------------------------------------------------

LAMBDA, MU, RHO = 6.0, 5.0, 2.0  # of the bar [Pa], [kg/m³]; it is 0.25 m wide and 1 m high
STEADY = (
    "time.scheme=steady",
    "model.solid_inertia=false",
    "model.fluid_inertia=false",
    "time.step=1.0",
)
ON_BAR = "force=[{name='foot', on='bottom'}, {name='side', on='left'}]"


def test_a_support_feels_the_weight(tmp_path):
    """Of a body that leans on its foot alone, bent to one side by its weight."""
    free = "boundary=[{on='bottom', displacement={x=0.0, y=0.0}}, {on=['left', 'right', 'top']}]"
    weight = "body_force={solid={x=0.01, y=-0.1}}"
    law = "material.0.solid.law='saint_venant_kirchhoff'"
    found = rows(
        BAR, tmp_path / "run", free, weight, law, ON_BAR, *STEADY, "coupling.tangent=newton"
    )
    assert found["foot.f_x"][-1] == pytest.approx(
        RHO * 0.25 * 0.01, rel=1e-8
    )  # the tolerance is 1e-10 of the largest force
    assert found["foot.f_y"][-1] == pytest.approx(-RHO * 0.25 * 0.1, rel=1e-8)


def test_a_load_goes_into_foot_and_sides(tmp_path):
    """Uniaxial strain under a traction from above: σ_xx = λ/(λ + 2 μ) σ_yy on the sides."""
    sides = (
        "{on='bottom', displacement={x=0.0, y=0.0}}, {on=['left', 'right'], displacement={x=0.0}}"
    )
    found = rows(
        BAR,
        tmp_path / "run",
        f"boundary=[{sides}, {{on='top', traction={{y=-1.0}}}}]",
        ON_BAR,
        *STEADY,
    )
    forces = [found[name][-1] for name in ("foot.f_x", "foot.f_y", "side.f_x", "side.f_y")]
    expected = [0.0, -0.25, -LAMBDA / (LAMBDA + 2 * MU), 0.0]
    print("foot and side:", forces)
    assert np.allclose(forces, expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("order", [1, 2])
def test_a_uniform_stress_is_split_exactly_at_large_strain(order, tmp_path):
    """All sides are prescribed, so that each corner has two reactions."""
    H = np.array([[0.3, 0.2], [-0.1, -0.25]])
    moved = "{x='t*(0.3*x + 0.2*y)', y='-t*(0.1*x + 0.25*y)'}"
    sides = f"boundary=[{{on=['left', 'right', 'bottom', 'top'], displacement={moved}}}]"
    law = (
        "material.0.solid.law='saint_venant_kirchhoff'",
        f"mesh.order={order}",
        "coupling.tangent=newton",
    )
    found = rows(BAR, tmp_path / "run", sides, *law, ON_BAR, *STEADY, "time.step=0.25")
    F = np.eye(2) + H
    E = (F.T @ F - np.eye(2)) / 2
    P = F @ (LAMBDA * np.trace(E) * np.eye(2) + 2 * MU * E)
    exact = np.concatenate([0.25 * P[:, 1], P[:, 0]])  # -P N times the length
    forces = [found[f"{name}.f_{axis}"][-1] for name in ("foot", "side") for axis in "xy"]
    print(f"P{order}: {forces}, exact {exact}")
    assert np.allclose(forces, exact, rtol=0, atol=1e-8)


def test_a_restart_goes_on_with_the_force_of_a_bar_that_falls_on_its_foot(tmp_path):
    """In a period 4 L/c of the bar the foot takes the weight on the average, whose momentum is then
    as before.
    """
    period = 4 / np.sqrt((LAMBDA + 2 * MU) / RHO)
    scene = (
        "body_force={solid={y=-0.1}}",
        f"time.step={period / 200}",
        ON_BAR,
        "output.checkpoint_every=80",
    )
    whole = rows(BAR, tmp_path / "whole", *scene, f"time.end={period}")
    run_here(Job(BAR, str(tmp_path / "part"), (*scene, f"time.end={0.4 * period}")))
    checkpoint = str(tmp_path / "part" / "checkpoint.h5")
    run_here(Job(BAR, str(tmp_path / "part"), (*scene, f"time.end={period}"), restart=checkpoint))
    again = history(tmp_path / "part")["foot.f_y"]
    mean = trapezoid(whole["foot.f_y"], whole["t"]) / period
    print(
        f"mean {mean:.6f}, weight {-RHO * 0.25 * 0.1:.6f}; restart differs by"
        f" {np.abs(again - whole['foot.f_y']).max():.1e}"
    )
    assert np.allclose(again, whole["foot.f_y"], rtol=0, atol=1e-9)
    assert mean == pytest.approx(
        -RHO * 0.25 * 0.1, rel=0.01
    )  # two steps of 200, the last of a wave that is not smooth


def test_a_checkpoint_without_the_force_of_the_solid_is_refused(tmp_path):
    scene = "body_force={solid={y=-0.1}}", "output.checkpoint_every=1", "time.step=0.1"
    run_here(Job(BAR, str(tmp_path / "run"), (*scene, "time.end=0.1")))
    checkpoint = str(tmp_path / "run" / "checkpoint.h5")
    with pytest.raises(
        InputError,
        match=r"received a \[\[force\]\] or a \[\[surface\]\] that the run of the",
    ):
        run_here(
            Job(BAR, str(tmp_path / "more"), (*scene, ON_BAR, "time.end=0.2"), restart=checkpoint)
        )


@pytest.mark.parametrize("ranks", [1, pytest.param(2, marks=needs_mpirun)])
def test_the_foot_of_a_flap_takes_what_the_flow_does_to_the_flap(ranks, tmp_path):
    """In a steady flow; the node between flap and floor has the force on both, of which the floor's
    is none of the foot.
    """
    sides = (
        "{on=['bottom', 'top'], velocity={x=0.0, y=0.0}}, {on='foot', displacement={x=0.0, y=0.0}}"
    )
    inlet = "{on='left', velocity={x='2*y*(0.4 - y)', y=0.0}}"
    scene = (
        f"boundary=[{inlet}, {sides}, {{on='right'}}]",
        "mesh.patches=[{name='foot', side='bottom', x=[0.4, 0.5]}]",
    )
    force = (
        "force=[{name='flap', on='interface'}, {name='foot', on='foot'}]",
        "coupling.tolerance=1e-9",
    )
    coarse = ("limits.stabilization=report",)  # no accuracy is asked for, the forces are split
    options = *scene, *force, *coarse, *STEADY, "time.end=1.0", "coupling.tangent=newton"
    run_on(ranks, [Job(FLAP, str(tmp_path / "run"), options)], tmp_path)
    found = history(tmp_path / "run")
    for axis in "xy":
        flap, foot = (found[f"{name}.f_{axis}"][-1] for name in ("flap", "foot"))
        print(f"f_{axis}: flap {flap:.8f}, foot {foot:.8f} N/m")
        assert foot == pytest.approx(flap, rel=1e-6) and abs(flap) > 0.01
