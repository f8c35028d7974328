"""What the history records of surfaces: reactions of porous media, flows, means of free fluids."""

from dataclasses import replace

import numpy as np
import pytest
from running import SCENES, Job, history, needs_mpirun, run_here, run_on

from porofsi_petsc import Simulation, load_scene
from porofsi_petsc.errors import InputError
from porofsi_petsc.simulation.build import serial_mesh

COLUMN, POISEUILLE, BAR = (
    str(SCENES / f"{name}.toml") for name in ("confined_column", "poiseuille", "bar")
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


def test_the_base_of_a_saturated_column_takes_its_weight():
    """In the end the pore water its own, and the skeleton what is left of its weight in it."""
    weight = "body_force={solid={y=-10.0}, fluid={y=-10.0}}"
    surface = "surface=[{name='foot', on='bottom', quantities=['skeleton_force', 'pore_force']}]"
    time = "time={end=1e4, step=1e3, scheme='backward_euler'}"
    found = rows(COLUMN, *small_strain(SIDES, surface, weight, time, "boundary.2.traction={y=0.0}"))
    total = 10.0 * (0.67 * 2000.0 + 0.33 * 1000.0) * WIDTH * HEIGHT
    buoyant = 10.0 * 0.67 * (2000.0 - 1000.0) * WIDTH * HEIGHT
    assert np.allclose(found["on_bottom.f_y"][1:], -total, rtol=EXACT)
    assert found["foot.fp_y"][-1] == pytest.approx(-10.0 * 1000.0 * WIDTH * HEIGHT, rel=1e-6)
    assert found["foot.fs_y"][-1] == pytest.approx(-buoyant, rel=1e-6)
    assert np.abs(balance(found, "x")).max() < EXACT * total


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


@needs_mpirun
@pytest.mark.parametrize("ranks", [2, 3])
def test_several_ranks_record_the_same(ranks, tmp_path):
    jobs = [
        porous_run(tmp_path / "porous", TIGHT, "time.end=0.05"),
        Job(POISEUILLE, str(tmp_path / "channel"), CHANNEL),
    ]
    run_on(ranks, jobs, tmp_path)
    run_here(replace(jobs[0], directory=str(tmp_path / "serial")))
    one, several = history(tmp_path / "serial"), history(tmp_path / "porous")
    for column in one:
        scale = np.abs(one[column]).max()
        assert np.allclose(several[column], one[column], rtol=0, atol=1e-7 * scale + 1e-6), column
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
