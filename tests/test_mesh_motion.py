"""The motion of a free fluid's mesh: affine motions, periods, inverted elements, stiffening, and
the solid's velocity on it.
"""

import itertools

import numpy as np
import pytest
import sympy as sp
from free_flow import SCENE, Flow, at
from manufactured import functions, square, steps_to_end, t, x, y
from mpi4py import MPI
from running import SCENES, Job, run_here

from porofsi_petsc import load_scene
from porofsi_petsc.clock import second_order
from porofsi_petsc.elements.simplex import Simplex
from porofsi_petsc.errors import ConvergenceError
from porofsi_petsc.fem.geometry import shape_quality
from porofsi_petsc.linalg.options import start
from porofsi_petsc.simulation.loop import Clock
from porofsi_petsc.simulation.simulation import Simulation

LAWS = ("harmonic", "linear_elastic", "neo_hookean", "distortion")
LINEAR = LAWS[:2]
AFFINE = (t * (x / 3 + y / 5), t * (-x / 6 + y / 4))
SWING = (
    4 * t * (1 - t) * (x / 4 + sp.sin(3 * y + 2 * x) / 6),
    16 * t * (1 - t) * (0.5 - t) * (-y / 5 + sp.cos(4 * x + y) / 7),
)


def mesh_moved_by(displacement, *options):
    """Return the coupling of a fluid at rest whose boundary moves by a formula of X and t."""
    start()
    scene = load_scene(SCENE, (*Flow(0 * x, 0 * x, displacement).overrides(), *options))
    return Simulation(scene, mesh=square(scene)).coupling


def move(coupling, time, step=0.05):
    """Move the mesh by a step that ends at a time, and accept it."""
    motion = coupling.motion
    motion.begin_step(second_order(0.5, step), time - step)
    motion.follow(coupling.solid.end_displacement)
    motion.accept()
    return motion


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("law", LAWS)
def test_an_affine_motion_of_the_boundary_is_one_of_the_whole_mesh(law, order):
    """Without stiffening its stress is uniform, with every law; 1e-14: round-off of one
    solution.
    """
    motion = move(
        mesh_moved_by(AFFINE, f"mesh_motion.law={law}", f"mesh.order={order}"), 1.0, step=1.0
    )
    error = np.abs(motion.u - at(functions(AFFINE), 1.0, motion.mesh.X)).max()
    print(f"P{order} {law}: largest displacement {np.abs(motion.u).max():.2f}, error {error:.1e}")
    assert error < 1e-14 and np.abs(motion.u).max() > 0.3


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("law", LAWS)
def test_the_mesh_is_a_function_of_its_boundary(law, order):
    """After a motion forth and back the mesh is where it was, and half way where a single step
    would have put it.
    """
    options = f"mesh_motion.law={law}", f"mesh.order={order}", "mesh_motion.stiffening=1.5"
    coupling = mesh_moved_by(SWING, *options)
    for number in range(1, 21):
        motion = move(coupling, number / 20)
        if number == 14:
            on_the_way = motion.u
    at_once = move(mesh_moved_by(SWING, *options), 0.7, step=0.7).u
    boundary = motion.setup.mask.all(axis=1)
    exact = at(functions(SWING), 0.7, motion.mesh.X)
    print(
        f"P{order} {law}: min J {motion.smallest_ratio:.2f}, back {np.abs(motion.u).max():.1e},"
        f" {motion.block.assemblies} matrices"
    )
    assert (
        np.abs(on_the_way[boundary] - exact[boundary]).max() < 1e-16
    )  # the formula, evaluated twice
    assert np.abs(motion.u).max() < 1e-15 and motion.smallest_ratio < 0.7
    assert np.abs(on_the_way - at_once).max() < (
        1e-15 if law in LINEAR else 1e-11
    )  # tolerance of the nonlinear increments
    assert (motion.block.assemblies == 1) == (law in LINEAR)


@pytest.mark.parametrize("law", LAWS)
def test_a_motion_that_inverts_an_element_says_where_and_what_to_do(law):
    """The right side is pushed beyond the left one."""
    coupling = mesh_moved_by((-1.2 * t * x, 0 * x), f"mesh_motion.law={law}")
    before = coupling.motion.u.copy()
    with pytest.raises(
        ConvergenceError,
        match=r"mesh of the fluid is inverted at t = 1 s, .* \(.*\) m.*smaller step",
    ) as error:
        move(coupling, 1.0, step=1.0)
    assert "\n" not in str(error.value) and np.array_equal(coupling.motion.u, before)
    coupling.reset()
    assert move(coupling, 0.5, step=0.5).smallest_ratio == pytest.approx(
        0.4, rel=1e-10
    )  # 1 - 1.2/2, increments of 1e-11


@pytest.mark.parametrize("law", LAWS)
def test_a_mesh_that_was_squeezed_before_says_how_and_names_keys_instead_of_a_smaller_step(law):
    """The side has come to 0.1 of the width, J = 1 - 1.2 t, when it passes the other one; here with
    increments of 1e-11.
    """
    coupling = mesh_moved_by((-1.2 * t * x, 0 * x), f"mesh_motion.law={law}")
    for end in (0.25, 0.5, 0.75):
        motion = move(coupling, end, step=0.25)
    assert motion.squeezed and motion.memory()["trail"] == [
        [0.5, pytest.approx(0.4)],
        [0.75, pytest.approx(0.1)],
    ]
    with pytest.raises(
        ConvergenceError, match="fell to 0.4 at 0.5 s, 0.1 at 0.75 s; a smaller step hardly helps"
    ) as error:
        move(coupling, 1.0, step=0.25)
    assert ('mesh_motion.law = "distortion"' in str(error.value)) == (law != "distortion")
    assert "mesh_motion.stiffening than 0 (1 to 2)" in str(error.value)


REGULAR = {
    2: [[0, 0], [1, 0], [0.5, np.sqrt(0.75)]],
    3: [[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]],
}


@pytest.mark.parametrize("dim", REGULAR)
def test_the_shape_of_an_element_is_its_mean_ratio(dim):
    """1 for a regular simplex of any size and place; stretched by s along an axis d s^(2/d)/(s² + d
    - 1).
    """
    regular = np.array(REGULAR[dim], dtype=float)
    stretch = np.eye(dim)
    stretch[0, 0] = 3.0
    elements = np.array(
        [regular, 1e-3 * regular + 7.0, regular @ stretch, 5.0 * regular[::-1] @ stretch]
    )
    stretched = dim * 3.0 ** (2 / dim) / (9.0 + dim - 1)
    # digits left of 1e-3 at a distance of 7
    assert shape_quality(Simplex(dim), elements) == pytest.approx(
        [1.0, 1.0, stretched, stretched], rel=1e-12
    )


# A mesh that is fine at its lower side, where a dent is pressed into it.
GRADED = "mesh.y.points=[0.0, 0.1, 1.0]", "mesh.y.cells=[4, 8]", "mesh.x.cells=[12]"


def dent(depth):
    """Return the motion of the boundary that ends with a dent of a depth [m] at t = 1."""
    return 0 * x, depth * t * sp.exp(-40 * (x - 0.5) ** 2) * (1 - y)


@pytest.mark.parametrize("law", LAWS)
def test_stiffening_keeps_small_elements(law):
    """The smallest volume ratio under a dent as deep as the fine part of the mesh."""
    ratios = {}
    for stiffening in (0.0, 1.5):
        coupling = mesh_moved_by(
            dent(0.1), *GRADED, f"mesh_motion.law={law}", f"mesh_motion.stiffening={stiffening}"
        )
        ratios[stiffening] = move(coupling, 1.0, step=1.0).smallest_ratio
    print(f"{law}: smallest J {ratios}")
    assert ratios[1.5] > 1.2 * ratios[0.0]


def test_the_neo_hookean_mesh_takes_more_than_the_linear_one():
    deep = {}
    for law in ("linear_elastic", "neo_hookean"):
        coupling = mesh_moved_by(
            dent(0.3), *GRADED, f"mesh_motion.law={law}", "mesh_motion.stiffening=1.0"
        )
        deep[law] = min(
            move(coupling, number / 4, step=0.25).smallest_ratio for number in range(1, 5)
        )
    print(f"smallest J {deep}")
    assert deep["neo_hookean"] > 1.5 * deep["linear_elastic"]


def test_a_step_in_which_an_element_is_inverted_is_cut(tmp_path, monkeypatch):
    """The nonlinear mesh does not take the whole dent at once, but it does in parts: of the step,
    or of the motion in it.
    """
    given = *Flow(0 * x, 0 * x, dent(0.3)).overrides(), *GRADED, "time.end=1.0", "time.step=1.0"
    whole = run_here(Job(SCENE, str(tmp_path / "whole"), given))
    monkeypatch.setattr("porofsi_petsc.phases.mesh_motion.PARTS", np.ones(1))
    with pytest.raises(ConvergenceError, match="inverted"):
        run_here(Job(SCENE, str(tmp_path / "stopped"), (*given, "coupling.on_failure=stop")))
    cut = run_here(Job(SCENE, str(tmp_path / "cut"), (*given, "coupling.on_failure=cut_step")))
    assert (
        whole["time_end"] == cut["time_end"] == 1.0
        and cut["step_cuts"] >= 1
        and cut["steps"] == 2 ** cut["step_cuts"]
    )
    ratios = [done["mesh_motion"]["smallest_volume_ratio"] for done in (whole, cut)]
    assert ratios[0] == pytest.approx(
        ratios[1], rel=1e-9
    )  # the mesh is a function of its boundary, to increments of 1e-11


def piston(*options):
    """Return the coupling of the piston."""
    start()
    scene = load_scene(PISTON, options)
    return Simulation(scene, MPI.COMM_SELF).coupling, scene


@pytest.mark.parametrize("law", LAWS)
def test_the_mesh_of_a_moving_solid_starts_with_its_velocity(law):
    """Inside too: it is the rate of the mesh when the solid goes on."""
    shifted = (
        "initial={displacement={y='0.2*y'}, solid_velocity={y='0.3*y'}, fluid_velocity={y=0.3}}"
    )
    coupling, _ = piston(
        shifted, f"mesh_motion.law={law}", "mesh.x.cells=[3]", "mesh_motion.stiffening=1.0"
    )
    motion = coupling.motion
    tiny = 1e-4
    velocity = motion.v.copy()
    before = motion.u.copy()
    motion.begin_step(second_order(0.5, tiny), 0.0)
    motion.follow(coupling.solid.u + tiny * coupling.solid.v)
    here = motion.domain.holds
    rate = ((motion.end_displacement - before) / tiny)[here]
    error = np.abs(rate - velocity[here]).max() / np.abs(rate).max()
    print(f"{law}: largest rate {np.abs(rate).max():.2f}, error {error:.1e}")
    assert error < (
        1e-10 if law in LINEAR else 1e-3
    )  # digits of the quotient; tiny times the curvature of the motion


def test_a_consistent_start_leaves_mesh_and_solid_where_they_are():
    shifted = "initial={displacement={y='0.2*y'}}"
    coupling, scene = piston(shifted, "time.consistent_start=true", "coupling.tolerance=1e-7")
    solid = coupling.solid
    motion = coupling.motion
    u = coupling.motion.u.copy()
    coupling.start(*Clock(scene.time).starting_schemes(scene.model))
    here = solid.domain.holds & motion.domain.holds
    assert np.abs(motion.u - u)[motion.domain.holds].max() < 1e-15  # extended twice
    for name in ("u", "v", "a"):
        assert np.array_equal(getattr(solid, name)[here], getattr(motion, name)[here]), name
    assert motion.a[here, 1].max() < -1.0  # pulled back by the layer


PISTON = str(SCENES / "piston.toml")
START = "initial={solid_velocity={y='0.3*y'}, fluid_velocity={y=0.3}}"


@pytest.mark.parametrize("scheme", ["partitioned", "weak", "direct"])
@pytest.mark.parametrize("law", LAWS)
def test_the_mesh_has_the_velocity_of_the_solid_on_the_interface(law, scheme):
    """To the last digit, at the end of every step and between: displacement, velocity and
    acceleration by one time scheme.
    """
    light = "material.0.fluid.density=0.01"  # which the weak scheme needs
    coupling, scene = piston(START, f"mesh_motion.law={law}", f"coupling.scheme={scheme}", light)
    for step, (time, schemes, rates) in enumerate(itertools.islice(steps_to_end(scene), 5), 1):
        coupling.step(schemes, rates, time, step)
        coupling.accept()
        solid = coupling.solid
        motion = coupling.motion
        here = solid.domain.holds & motion.domain.holds
        for name in ("u", "v", "a"):
            assert np.array_equal(getattr(solid, name)[here], getattr(motion, name)[here]), name
        if scheme == "partitioned":
            assert np.array_equal(coupling.fluid.v[here], solid.v[here])
    assert here.sum() == 3 and np.abs(solid.v[here]).max() > 0.1
