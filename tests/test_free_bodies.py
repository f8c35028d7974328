"""Several solids in one fluid, and a solid that only its inertia and the fluid hold."""

import numpy as np
import pytest
from running import SCENES, Job, history, largest_difference, needs_mpirun, run_here, run_on, state

from porofsi_petsc import load_scene
from porofsi_petsc.errors import InputError
from porofsi_petsc.exact import FallingCylinder
from porofsi_petsc.simulation.build import serial_mesh

SHORT = ("time.end=1e-3", "time.step=2.5e-4")
FALLING = {
    density: FallingCylinder(0.01, 0.02, density, 1000.0, 1e-4, 9.81) for density in (500.0, 2000.0)
}


def run(folder, *overrides, scene="rising_disk"):
    """Return the history of a run."""
    run_here(Job(str(scene), str(folder), overrides))
    return history(folder)


def test_the_exact_motion_begins_with_the_added_mass_and_is_the_integral_of_its_velocity():
    cylinder = FALLING[500.0]
    # viscous layers are felt by √(νt)/a = 1e-5 of a mass
    assert cylinder.velocity(1e-10) == pytest.approx(cylinder.acceleration * 1e-10, rel=1e-4)
    assert cylinder.acceleration == pytest.approx(-9.81 * 500 / (500 + 5 / 3 * 1000), rel=1e-12)
    t, weight = np.polynomial.legendre.leggauss(8)
    middle = [cylinder.velocity(0.015 + 0.005 * s) for s in t]
    moved = cylinder.displacement(0.02) - cylinder.displacement(0.01)
    assert 0.005 * weight @ middle == pytest.approx(moved, rel=1e-8)  # digits of the inversion


@pytest.mark.parametrize("density", FALLING)
def test_a_light_and_a_heavy_disk_move_as_the_exact_one(density, tmp_path):
    h = run(tmp_path, f"material.0.solid.density={density}", "time.step=1e-3")
    # ten steps: 1.5e-4 in the run of `rising_disk`, of which the layers of the fluid are √t
    exact = -FALLING[density].displacement(0.01)
    print(h["centre.u_y"][-1] / exact - 1)
    assert h["centre.u_y"][-1] == pytest.approx(exact, rel=1e-3)
    assert abs(h["centre.u_x"]).max() < 1e-12 * abs(exact)


@pytest.mark.parametrize(
    "way",
    [
        "coupling.scheme=direct",
        "coupling.scheme=quasi_direct",
        "coupling.interface=robin_neumann",
        "coupling.interface=robin_robin",
    ],
)
def test_all_strong_schemes_move_it_alike(way, tmp_path):
    exactly = *SHORT, "coupling.tolerance=1e-10"
    a = run(tmp_path / "a", *exactly)
    b = run(tmp_path / "b", *exactly, way)
    for name in ("centre.u_y", "centre.v_y"):
        # the tolerance of the iteration
        assert largest_difference(b[name], a[name]) < 1e-8


def test_told_its_velocity_by_the_fluid_it_moves_alike_in_short_steps(tmp_path):
    """Where no step is cut: what differs in longer ones is the time step."""
    short = "time.end=3.125e-5", "time.step=1.5625e-5", "coupling.tolerance=1e-10"
    a = run(tmp_path / "a", *short)
    way = "coupling.interface=neumann_dirichlet", "coupling.max_iterations=100"
    b = run(tmp_path / "b", *short, *way)
    assert len(a["t"]) == len(b["t"]) == 3
    assert largest_difference(b["centre.v_y"], a["centre.v_y"]) < 1e-8


def test_a_disk_of_the_density_of_the_fluid_stays_at_rest(tmp_path):
    """The pressure of the fluid at rest is its initial stress."""
    stress = ", ".join(f'{name}="9810*y"' for name in ("xx", "yy", "zz"))
    rest = f'initial={{pressure="-9810*y", stress={{{stress}}}}}'
    h = run(tmp_path, *SHORT, "material.0.solid.density=1000.0", rest)
    # round-off of the weights, of which the velocity after 1 ms would be 1e-2 m/s
    assert abs(h["centre.v_y"]).max() < 1e-15


def test_in_a_steady_scene_it_is_refused():
    scene = load_scene(
        "rising_disk", ("time.scheme=steady", "time.consistent_start=false", "expect=[]")
    )
    with pytest.raises(InputError, match="nothing holds the solid in x and y: region 'disk'"):
        serial_mesh(scene)


def test_it_goes_on_from_a_checkpoint_identically(tmp_path):
    every = "output.checkpoint_every=2"
    run(tmp_path / "whole", *SHORT, every)
    run(tmp_path / "half", *SHORT, every, "time.end=5e-4")
    half = str(tmp_path / "half")
    # a force that the run before had not
    further = 'force=[{name="disk", on="interface"}]'
    run_here(Job("rising_disk", half, (*SHORT, every, further), f"{half}/checkpoint.h5"))
    a, b = (state(tmp_path / name / "checkpoint.h5") for name in ("whole", "half"))
    assert all(np.array_equal(a[name], b[name]) for name in a)


@needs_mpirun
@pytest.mark.parametrize("ranks", [2, 3])
def test_ranks_do_not_matter(ranks, tmp_path):
    exactly = *SHORT, "coupling.tolerance=1e-10"
    a = run(tmp_path / "1", *exactly)
    run_on(ranks, [Job("rising_disk", str(tmp_path / "n"), (*exactly, "expect=[]"))], tmp_path)
    assert largest_difference(history(tmp_path / "n")["centre.v_y"], a["centre.v_y"]) < 1e-8


TWO = {
    2: (
        SCENES / "flap.toml",
        "mesh={kind='rectangle', x={points=[0, 1, 1.2, 2, 2.2, 4], cells=[2, 1, 2, 1, 4]},"
        " y={points=[0, 0.5, 1], cells=[2, 2]}, regions=[{name='a', x=[1, 1.2], y=[0, 0.5]},"
        " {name='b', x=[2, 2.2], y=[0, 0.5]}]}",
    ),
    3: (
        SCENES / "block_in_channel3d.toml",
        "mesh={kind='box', order=1, x={points=[0, 0.5, 0.75, 1.25, 1.5, 2], cells=[2, 1, 2, 1, 2]},"
        " y={points=[0, 0.25, 0.75, 1], cells=[1, 2, 1]}, z={points=[0, 0.5, 1], cells=[2, 2]},"
        " regions=[{name='a', x=[0.5, 0.75], y=[0.25, 0.75], z=[0, 0.5]},"
        " {name='b', x=[1.25, 1.5], y=[0.25, 0.75], z=[0, 0.5]}]}",
    ),
}
EACH = (
    "force=[{name='a', on='interface of a'}, {name='b', on='interface of b'},"
    " {name='both', on='interface'}]"
)


def two(dim):
    """Return scene and changes of two solids of different stiffness in a channel."""
    scene, mesh = TWO[dim]
    still = ", ".join(f"{axis}=0.0" for axis in "xyz"[:dim])
    sides = ["bottom", "top", "front", "back"][: 2 * (dim - 1)]
    law = "law='saint_venant_kirchhoff', poisson=0.3, density=1500.0"
    solid = "{{region='{}', solid={{" + law + ", young={}}}}}"
    solids = ", ".join(solid.format(*given) for given in (("a", 1e5), ("b", 1e6)))
    return str(scene), (
        mesh,
        "material=[{region='body', fluid={density=1000.0, viscosity=1.0}}, " + solids + "]",
        f"boundary=[{{on='left', velocity={{{still.replace('x=0.0', 'x=0.1')}}}}}, {{on='right'}},"
        f" {{on={sides}, velocity={{{still}}}, displacement={{{still}}}}}]",
        "probe=[]",
        EACH,
        "limits={stabilization='report'}",  # the meshes are coarse
        "time.step=0.01",
        "time.end=0.02",
    )


@pytest.mark.parametrize("dim", [2, 3])
def test_each_of_two_solids_has_a_force_of_its_own(dim, tmp_path):
    scene, overrides = two(dim)
    h = run(tmp_path, *overrides, scene=scene)
    for axis in "xyz"[:dim]:
        of_each = h[f"a.f_{axis}"] + h[f"b.f_{axis}"]
        scale = abs(h["both.f_x"]).max()
        assert abs(of_each - h[f"both.f_{axis}"]).max() < 1e-11 * scale  # round-off
    assert abs(h["a.f_x"] - h["b.f_x"]).max() > 0.01 * scale


def test_tags_of_single_solids_make_no_other_mesh():
    """A restart may ask for forces that the run before it had not."""
    scene, overrides = two(2)
    tagged = serial_mesh(load_scene(scene, overrides))
    plain = serial_mesh(load_scene(scene, (*overrides, "force=[]")))
    assert {"interface of a", "interface of b"} <= set(tagged.facets) - set(plain.facets)
    assert tagged.hash == plain.hash


def test_a_region_that_touches_no_fluid_has_no_such_tag():
    scene, overrides = two(2)
    wrong = "force=[{name='c', on='interface of body'}]"
    with pytest.raises(InputError, match=r"\[force\.0\.on\].*'interface of body'"):
        serial_mesh(load_scene(scene, (*overrides, wrong)))
