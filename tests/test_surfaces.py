"""What the history records of surfaces: reactions of porous media, flows, means of free fluids."""

from dataclasses import replace

import numpy as np
import pytest
from running import SCENES, Job, history, needs_mpirun, run_here, run_on

from porofsi_petsc import Simulation, load_scene
from porofsi_petsc.errors import InputError
from porofsi_petsc.simulation.build import serial_mesh

COLUMN, POISEUILLE, BAR, FLAP = (
    str(SCENES / f"{name}.toml") for name in ("confined_column", "poiseuille", "bar", "flap")
)
TIGHT = "coupling.tolerance=1e-12"
SIDES = (
    "force=["
    + ", ".join(f"{{name='on_{s}', on='{s}'}}" for s in ("bottom", "top", "left", "right"))
    + "]"
)
OUT = "surface=[{name='out', on='top', quantities=['flow_rate', 'volume']}]"
WIDTH, HEIGHT = 0.25, 1.0  # of the column [m]
# What is left is the tolerance of the iteration, 1e-12 of the largest volume rate or force, times
# the condition of the system.
EXACT = 1e-8


def rows(scene, *overrides):
    """Return column -> rows of the history of a run in this process."""
    with Simulation.from_scene(scene, overrides=["expect=[]", *overrides]) as simulation:
        simulation.run()
        return simulation.history


def balance(found, axis):
    """Return the sum of the forces on all four sides of a scene."""
    return sum(found[f"on_{side}.f_{axis}"][1:] for side in ("bottom", "top", "left", "right"))


def small_strain(*more):
    """Return the changes of the column to that of Terzaghi."""
    law = "material.0.solid={law='linear_elastic', lambda=8.375e6, mu=5.583e6, density=2000.0}"
    return (
        law,
        "model.moving_mesh=false",
        "limits.mesh_displacement='report'",
        "limits.strain='report'",
        TIGHT,
        *more,
    )


# -- reactions -------------------------------------------------------------------------------------


@pytest.mark.parametrize("scheme", ["partitioned", "direct"])
def test_the_base_of_a_column_takes_its_load_at_all_times(scheme):
    """At finite strain on a moving mesh; pore pressure and skeleton share it."""
    surface = "surface=[{name='foot', on='bottom', quantities=['skeleton_force', 'pore_force']}]"
    choice = f"coupling.scheme='{scheme}'"
    found = rows(COLUMN, SIDES, surface, TIGHT, choice, "time.end=0.2")
    load = 1e6 * WIDTH
    assert np.allclose(found["on_bottom.f_y"][1:], -load, rtol=0, atol=EXACT * load)
    assert np.allclose(found["on_top.f_y"][1:], load, rtol=0, atol=EXACT * load)
    assert np.abs([balance(found, "x"), balance(found, "y")]).max() < EXACT * load
    both = found["foot.fs_y"] + found["foot.fp_y"]
    assert np.allclose(both, found["on_bottom.f_y"], rtol=0, atol=EXACT * load)
    assert np.allclose(found["foot.fp_y"], -found["base.p"] * WIDTH, rtol=1e-12)


# name -> (changes of the mesh, of the boundary, area of the base over that of the plane column)
BODIES = {
    "triangles": ((), (), 1.0),
    "serendipity": (("mesh.order=2", "mesh.cell_type='serendipity'"), (), 1.0),
    "around an axis": (("mesh.axisymmetric=true",), (), np.pi * WIDTH),
    "box": (
        (
            "mesh={kind='box', x={points=[0.0, 0.25], cells=[1]}, y={points=[0.0, 0.5], cells=[1]},"
            " z={points=[0.0, 1.0], cells=[4]}}",
        ),
        (
            "boundary=[{on=['left', 'right'], displacement={x=0.0}}, {on=['front', 'back'],"
            " displacement={y=0.0}}, {on='bottom', displacement={z=0.0}}, {on='top',"
            " pressure=0.0}]",
        ),
        0.5,
    ),
}


@pytest.mark.parametrize("body", BODIES)
def test_the_base_of_a_saturated_column_takes_its_weight(body):
    """In the end the pore water its own, and the skeleton what is left of its weight in it."""
    mesh, boundary, area = BODIES[body]
    up = "z" if body == "box" else "y"
    more = (
        f"body_force={{solid={{{up}=-10.0}}, fluid={{{up}=-10.0}}}}",
        "surface=[{name='foot', on='bottom', quantities=['force', 'skeleton_force',"
        " 'pore_force']}]",
        "time={end=1e4, step=5e3, scheme='backward_euler'}",
        "probe=[]",
        "boundary.2.traction={y=0.0}",
    )
    found = rows(COLUMN, *small_strain(*mesh, *more, *boundary))
    volume = WIDTH * HEIGHT * area
    total = 10.0 * (0.67 * 2000.0 + 0.33 * 1000.0) * volume
    buoyant = 10.0 * 0.67 * (2000.0 - 1000.0) * volume
    assert np.allclose(found[f"foot.f_{up}"][1:], -total, rtol=EXACT)
    assert found[f"foot.fp_{up}"][-1] == pytest.approx(-10.0 * 1000.0 * volume, rel=1e-6)
    assert found[f"foot.fs_{up}"][-1] == pytest.approx(-buoyant, rel=1e-6)


def test_the_forces_on_all_sides_carry_the_inertia():
    """Of a dynamic column in free fall: no force on its sides but what holds it."""
    moving = "model={solid_inertia=true, fluid_inertia=true, moving_mesh=true}"
    time = "time={end=0.02, step=0.01, rho_inf=0.8}"
    weight = "body_force={solid={y=-10.0}, fluid={y=-10.0}}"
    free = "boundary=[{on=['left', 'right', 'bottom', 'top'], pressure=0.0, displacement={x=0.0}}]"
    found = rows(
        COLUMN, SIDES, moving, time, weight, free, TIGHT, "limits.porosity_change='report'"
    )
    total = 10.0 * (0.67 * 2000.0 + 0.33 * 1000.0) * WIDTH * HEIGHT
    assert np.abs([balance(found, "x"), balance(found, "y")]).max() < EXACT * total


def test_so_it_does_when_the_mesh_begins_to_move():
    """A model that grows in the run goes on with the forces and volumes of the one before."""
    load = "boundary.2.traction={y='-1e6*minimum(t/0.1, 1)'}"
    grows = ("model.moving_mesh='auto'", "limits.mesh_displacement=0.02", "time.end=0.3", load)
    with Simulation.from_scene(COLUMN, overrides=[SIDES, OUT, TIGHT, *grows]) as simulation:
        simulation.run()
        found = simulation.history
        assert simulation.coupling.switched[0]["step"] > 1
    wanted = -1e6 * WIDTH * np.minimum(found["t"] / 0.1, 1.0)
    assert np.allclose(found["on_bottom.f_y"], wanted, rtol=0, atol=EXACT * 1e6)
    assert np.abs([balance(found, "x"), balance(found, "y")]).max() < EXACT * 1e6
    # ∫ div v_s of the small and the large model, the latter to the error of time
    assert found["out.volume"][-1] == pytest.approx(-WIDTH * found["top.u_y"][-1], rel=0.02)


def test_the_plate_on_mandels_slab_carries_its_load():
    """At all times; the middle plane, which is held, too."""
    found = rows("mandel", SIDES, "time.end=0.02")
    assert np.allclose(found["on_top.f_y"][1:], 1e4, rtol=1e-5)
    assert np.allclose(found["on_bottom.f_y"][1:], -1e4, rtol=1e-5)
    assert np.abs(balance(found, "x")).max() < 1e-5 * 1e4


def test_a_porous_body_and_a_solid_without_pores_hold_the_same():
    """Drained, with its corners held: the split between two supports is that of the solid."""
    support = (
        "boundary=[{on='bottom', displacement={x=0.0, y=0.0}}, {on='left', displacement={x=0.0}},"
        " {on=['right', 'top'], traction={x=-2e3, y=-1e3}}]"
    )
    solid = "solid={law='linear_elastic', lambda=8e6, mu=5e6, density=2000.0}"
    dry = (f"material=[{{region='body', {solid}}}]", "model={}", "limits={}", "probe=[]", support)
    dry = rows(COLUMN, SIDES, TIGHT, "time={scheme='steady', end=1.0, step=1.0}", *dry)
    drained = support.replace("displacement={x=0.0}}", "displacement={x=0.0}, pressure=0.0}")
    drained = drained.replace("traction", "pressure=0.0, traction")
    late = "time={end=1e4, step=5e3, scheme='backward_euler'}"
    wet = rows(COLUMN, *small_strain(SIDES, drained, late), f"material.0.{solid}")
    for column in ("on_bottom.f_x", "on_bottom.f_y", "on_left.f_x", "on_left.f_y"):
        assert wet[column][-1] == pytest.approx(dry[column][-1], rel=1e-6, abs=1e-3), column


def test_the_corner_of_a_compressible_body_is_split_by_the_pressure_that_it_bears():
    """A uniform undrained state: nothing along the base, which holds both components."""
    boundary = (
        "boundary=[{on='bottom', displacement={x=0.0, y=0.0}}, {on=['left', 'right'],"
        " displacement={x=0.0}}, {on='top', traction={y=-1e6}}]"
    )
    biot = ("material.0.biot_coefficient=0.7", "material.0.fluid.bulk_modulus=1e7")
    found = rows(COLUMN, *small_strain(SIDES, boundary, *biot, "time.end=0.05"))
    last = {column: values[-1] for column, values in found.items()}
    assert last["base.p"] > 1e5
    total = 8.375e6 * last["top.u_y"] - 0.7 * last["base.p"]  # σ_xx, ε_yy = u_y/H
    assert last["on_left.f_x"] == pytest.approx(total * HEIGHT, rel=EXACT)
    assert last["on_bottom.f_x"] == pytest.approx(0.0, abs=EXACT * 1e6)
    assert last["on_bottom.f_y"] == pytest.approx(-1e6 * WIDTH, rel=EXACT)


# -- flows -----------------------------------------------------------------------------------------


def settlement(t):
    """Return that of a layer under a sudden load of 1e6 Pa after a time (Terzaghi 1923) [m]."""
    E_c = 8.375e6 + 2 * 5.583e6
    T = 1e-2 / 1e4 * E_c * t / HEIGHT**2
    m = (2 * np.arange(2000) + 1) * np.pi
    return 1e6 * HEIGHT / E_c * (1 - (8 / m**2 * np.exp(-(m**2) * T / 4)).sum())


@pytest.mark.parametrize("rho_inf", [0.0, 0.7])
def test_what_has_left_a_layer_is_what_its_pores_have_lost(rho_inf):
    """Exactly in the scheme of time, and Terzaghi's series in space and time."""
    fine = "mesh.y={points=[0.0, 1.0], cells=[16], ratios=[0.1]}"
    time = f"time={{end=2e-3, step=1e-5, growth=1.15, rho_inf={rho_inf}}}"
    found, change = run_with_change(OUT, time, fine, "mesh.order=2")
    assert found["out.volume"][-1] == pytest.approx(-change, rel=EXACT)
    t = found["t"][-1]
    print("volume over Terzaghi's", found["out.volume"][-1] / (WIDTH * settlement(t)))
    assert found["out.volume"][-1] == pytest.approx(WIDTH * settlement(t), rel=2e-3)
    rate = WIDTH * (settlement(t + 1e-6) - settlement(t - 1e-6)) / 2e-6
    print("rate over Terzaghi's", found["out.flow_rate"][-1] / rate)
    assert found["out.flow_rate"][-1] == pytest.approx(rate, rel=2e-2)


def run_with_change(*more):
    """Return the history of a column at small strain, and ∫ div u dV of its skeleton in the end
    [m²].
    """
    overrides = ["expect=[]", *small_strain(*more)]
    with Simulation.from_scene(COLUMN, overrides=overrides) as simulation:
        simulation.run()
        domain = simulation.coupling.solid.domain
        u = domain.gather(simulation.coupling.solid.u)
        divergence = np.einsum("eqai,eai->eq", domain.reference.G, u)
        return simulation.history, float((divergence * domain.reference.dV).sum())


@pytest.mark.parametrize("inertia", ["true", "false"])
def test_so_it_is_with_inertia_and_through_several_surfaces(inertia):
    """Two drained sides meet at a corner, and a flux is given on a third one."""
    boundary = (
        "boundary=[{on=['left', 'bottom'], displacement={x=0.0, y=0.0}}, {on='bottom', flux=-1e-5},"
        " {on=['top', 'right'], pressure=0.0}, {on='top', traction={y=-1e5}}]"
    )
    surfaces = (
        "surface=[{name='a', on='top', quantities=['volume', 'flow_rate']}, {name='b', on='right',"
        " quantities=['volume']}, {name='c', on='bottom', quantities=['volume']}, {name='ab',"
        " on=['top', 'right'], quantities=['volume']}]"
    )
    model = f"model={{solid_inertia={inertia}, fluid_inertia={inertia}}}"
    time = "time={end=0.01, step=1e-3, rho_inf=0.6}"
    found, change = run_with_change(boundary, surfaces, model, time)
    out = found["a.volume"][-1] + found["b.volume"][-1] + found["c.volume"][-1]
    print("volume out", out, "change of pores", change)
    assert out == pytest.approx(-change, rel=EXACT)
    assert found["ab.volume"][-1] == pytest.approx(found["a.volume"][-1] + found["b.volume"][-1])
    # given from 0+ on: from a rate of zero, as that of the skeleton, the scheme is a part of the
    # first step late
    assert found["c.volume"][-1] == pytest.approx(-1e-5 * WIDTH * 0.01, rel=0.02)


def test_the_flow_under_a_sheet_pile_is_that_of_harr():
    found = rows("sheet_pile")
    assert found["under.flow_rate"][-1] == pytest.approx(-found["bed.flow_rate"][-1], rel=1e-6)
    assert found["bed.flow_rate"][-1] == pytest.approx(1e-5, rel=3e-3)  # measured 2.3e-3


# -- free fluids -----------------------------------------------------------------------------------

CHANNEL = (
    "force=[]",
    "surface=[{name='l', on='left', quantities=['flow_rate', 'pressure', 'area']}, {name='r',"
    " on='right', quantities=['flow_rate', 'pressure', 'force']}, {name='w', on=['bottom', 'top'],"
    " quantities=['wall_shear', 'wall_shear_max', 'area', 'flow_rate']}]",
)
# Poiseuille, v = 4 y (1 - y), μ = 3: flow 2/3, pressure drop 8 μ, shear 4 μ
IN_A_CHANNEL = {
    "l.flow_rate": -2 / 3,
    "l.pressure": 12.0,
    "l.area": 1.0,
    "r.flow_rate": 2 / 3,
    "r.pressure": -12.0,
    "r.f_x": -12.0,
    "r.f_y": 0.0,
    "w.wall_shear": 12.0,
    "w.wall_shear_max": 12.0,
    "w.area": 2.0,
    "w.flow_rate": 0.0,
}


def test_flow_pressure_drop_and_wall_shear_of_poiseuille_are_exact():
    found = rows(POISEUILLE, *CHANNEL)
    for column, value in IN_A_CHANNEL.items():
        assert found[column][-1] == pytest.approx(value, abs=1e-9), column


def test_so_are_those_of_a_pipe_around_its_axis():
    """v = 1 - r², μ = 3, of length 1: flow π/2, pressure drop 4 μ, shear 2 μ."""
    found = rows(
        POISEUILLE,
        "mesh.axisymmetric=true",
        "boundary=[{on=['bottom', 'top'], velocity={x=0.0, y='1 - x**2'}}, {on='right',"
        " velocity={x=0.0, y=0.0}}]",
        "force=[]",
        "surface=[{name='a', on='bottom', quantities=['flow_rate', 'pressure', 'area']}, {name='b',"
        " on='top', quantities=['flow_rate', 'pressure', 'area']}, {name='w', on='right',"
        " quantities=['wall_shear', 'wall_shear_max', 'force']}]",
    )
    last = {column: values[-1] for column, values in found.items()}
    assert last["b.flow_rate"] == pytest.approx(np.pi / 2, rel=1e-9)
    assert last["a.flow_rate"] == pytest.approx(-np.pi / 2, rel=1e-9)
    assert last["a.area"] == pytest.approx(np.pi, rel=1e-9)
    assert last["a.pressure"] - last["b.pressure"] == pytest.approx(12.0, rel=1e-6)
    assert last["w.wall_shear"] == pytest.approx(6.0, rel=1e-6)
    assert last["w.wall_shear_max"] == pytest.approx(6.0, rel=1e-5)
    assert last["w.f_y"] == pytest.approx(6.0 * 2 * np.pi, rel=1e-6)


def test_the_friction_factor_of_a_square_duct_is_the_published_one():
    """f Re = 14.227 of the mean shear f ρ V²/2 (Shah & London 1978); a quarter by symmetry, fully
    developed under a pressure drop of 1 Pa over one cell of 1 m.
    """
    across = "{points=[0.0, 0.5], cells=[4]}"
    found = rows(
        POISEUILLE,
        f"mesh={{kind='box', order=2, cell_type='hexahedron', x={{points=[0.0, 1.0], cells=[1]}},"
        f" y={across}, z={across}}}",
        "material.0.fluid={density=1.0, viscosity=1.0}",
        "boundary=[{on=['front', 'bottom'], velocity={x=0.0, y=0.0, z=0.0}}, {on='back',"
        " velocity={y=0.0}}, {on='top', velocity={z=0.0}}, {on='left', traction={x=1.0},"
        " velocity={y=0.0, z=0.0}}, {on='right', velocity={y=0.0, z=0.0}}]",
        "force=[]",
        "surface=[{name='out', on='right', quantities=['flow_rate', 'area']}, {name='w',"
        " on=['front', 'bottom'], quantities=['wall_shear', 'wall_shear_max']}]",
    )
    mean_velocity = found["out.flow_rate"][-1] / found["out.area"][-1]
    shear = found["w.wall_shear"][-1]
    print("f Re", 2 * shear / mean_velocity, "shear over that of the balance", shear / 0.25)
    assert shear == pytest.approx(0.25, rel=0.02)  # of the balance of forces, D_h/4 Pa
    assert 2 * 0.25 / mean_velocity == pytest.approx(14.227, rel=1e-3)
    assert 2 * shear / mean_velocity == pytest.approx(14.227, rel=0.02)  # measured 1.8e-2


def test_a_piston_pushes_out_what_it_displaces():
    """A fluid on a moving mesh between a floor that rises and an open top."""
    found = rows(
        POISEUILLE,
        "model.moving_mesh=true",
        "limits.mesh_displacement='report'",
        "time={scheme='generalized_alpha', end=1.0, step=0.25}",
        "boundary=[{on='bottom', velocity={x=0.0, y=0.2}, displacement={x=0.0, y='0.2*t'}},"
        " {on=['left', 'right'], velocity={x=0.0}, displacement={x=0.0}}, {on='top',"
        " displacement={x=0.0, y=0.0}}]",
        "force=[]",
        "surface=[{name='out', on='top', quantities=['flow_rate', 'volume']}, {name='floor',"
        " on='bottom', quantities=['flow_rate']}]",
    )
    print(found["out.flow_rate"], found["out.volume"], found["floor.flow_rate"])
    assert np.allclose(found["out.flow_rate"][1:], 0.2, rtol=1e-9)
    assert np.allclose(np.diff(found["out.volume"])[1:], 0.05, rtol=1e-9)


def test_the_volume_of_a_growing_flow_is_its_integral():
    """A flow without inertia that grows with t: 2/3 t through the channel, 1/3 t² in all."""
    grows = "boundary.0.velocity={x='4*y*(1 - y)*t', y=0.0}"
    found = rows(
        POISEUILLE,
        "time={scheme='generalized_alpha', end=1.0, step=0.25}",
        grows,
        "force=[]",
        "surface=[{name='r', on='right', quantities=['flow_rate', 'volume']}]",
    )
    assert np.allclose(found["r.volume"], found["t"] ** 2 / 3, rtol=0, atol=1e-9)


# -- ranks, restart, input -------------------------------------------------------------------------

ALL = (
    SIDES,
    "surface=[{name='out', on=['top', 'right'], quantities=['flow_rate', 'volume', 'force',"
    " 'skeleton_force', 'pore_force', 'area', 'pressure']}]",
    "boundary=[{on=['left', 'bottom'], displacement={x=0.0, y=0.0}}, {on=['top', 'right'],"
    " pressure=0.0}, {on='top', traction={y=-1e5}}]",
    "output.checkpoint_every=4",
)


END = "time={{end={}, step=0.01, rho_inf=0.5}}"


def porous_run(directory, *more, restart=None):
    return Job(COLUMN, str(directory), (*ALL, *more), restart=restart)


# The interface is inside of the mesh: a rank may have the solid behind a facet alone.
WET = (
    "surface=[{name='wet', on='interface', quantities=['area', 'pressure', 'wall_shear',"
    " 'wall_shear_max']}, {name='in', on='left', quantities=['flow_rate', 'volume']}]",
    "time.end=0.02",
    "coupling.tolerance=1e-10",
)


def test_the_area_of_an_interface_is_that_of_the_fluids_side():
    found = rows(FLAP, *WET, "time.end=0.01")
    assert found["wet.area"][0] == pytest.approx(0.2 + 0.1 + 0.2)
    assert found["wet.wall_shear_max"][-1] > found["wet.wall_shear"][-1] > 0
    # ∫ 20 y (0.4 - y) t/0.1 dy over the height of 0.4 m at t = 0.01 s, linear between the nodes
    assert found["in.flow_rate"][-1] == pytest.approx(-20 * 0.4**3 / 6 * 0.1, rel=0.02)


@needs_mpirun
def test_three_ranks_record_the_same(tmp_path):
    jobs = [
        porous_run(tmp_path / "porous", TIGHT, "time.end=0.05"),
        Job(POISEUILLE, str(tmp_path / "channel"), CHANNEL),
        Job(FLAP, str(tmp_path / "flap"), WET),
    ]
    run_on(3, jobs, tmp_path)
    for job in jobs[::2]:
        run_here(replace(job, directory=f"{job.directory}_alone"))
        one, several = history(f"{job.directory}_alone"), history(job.directory)
        for column in set(one) - {"coupling_iterations"}:
            scale = np.abs(one[column]).max()
            assert np.allclose(several[column], one[column], rtol=0, atol=1e-6 * scale + 1e-6)
    for column, value in IN_A_CHANNEL.items():
        assert history(tmp_path / "channel")[column][-1] == pytest.approx(value, abs=1e-9), column


def test_a_restart_goes_on_with_the_same_numbers(tmp_path):
    run_here(porous_run(tmp_path / "whole", END.format(0.08)))
    run_here(porous_run(tmp_path / "part", END.format(0.04)))
    run_here(
        porous_run(
            tmp_path / "rest", END.format(0.08), restart=str(tmp_path / "part/checkpoint.h5")
        )
    )
    whole, rest = history(tmp_path / "whole"), history(tmp_path / "rest")
    same = np.isin(whole["t"], rest["t"])
    assert len(rest["t"]) > 2
    for column in whole:
        assert np.array_equal(whole[column][same], rest[column]), column


@pytest.mark.parametrize(
    ("scene", "surface", "words"),
    [
        (
            COLUMN,
            "{name='a', on='top', quantities=['wall_shear']}",
            "received 'wall_shear' on 'top'",
        ),
        (BAR, "{name='a', on='right', quantities=['pressure']}", "received 'pressure' on 'right'"),
        (COLUMN, "{name='a', on='roof', quantities=['area']}", "'roof'"),
        (COLUMN, "{name='base', on='top', quantities=['area']}", "the name of another probe"),
        (COLUMN, "{name='a', on='top', quantities=['weight']}", "received 'weight'"),
        (COLUMN, "{name='a', on='top', quantities=['area', 'area']}", "each quantity once"),
        (POISEUILLE, "{name='a', on='left', quantities=['volume']}", "which has no time"),
    ],
)
def test_what_a_surface_has_not_is_refused(scene, surface, words):
    with pytest.raises(InputError, match=words):
        serial_mesh(load_scene(scene, [f"surface=[{surface}]"]))
