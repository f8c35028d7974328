"""Seepage faces: fluid leaves at the pressure outside, and none comes in."""

import numpy as np
import pytest
from running import Job, history, needs_mpirun, run_here, run_on

from porofsi_petsc import load_scene
from porofsi_petsc.errors import InputError

SCENE = "seepage_column"
SHORT = (
    "expect=[]",
    "mesh.y.cells=[6]",
    "time.end=5",
    "time.step=0.5",
    "boundary.2.traction.y='where(t < 2.6, -1e4, -1e3)'",
)
SPLIT = "patches=[{name='open', side='top', x=[0.0, 1.0]}, {name='under', side='left', y=[-2, -1]}]"
SIDES = (
    "{on=['left', 'under', 'right'], displacement={x=0}}, {on='bottom', displacement={x=0, y=0}},"
)
PILE = f"boundary=[{SIDES} {{on='under', pressure=1e3}}, "


def columns(folder, *changes, scene=SCENE, short=SHORT, **more):
    """Return the history of a run."""
    run_here(Job(scene, str(folder), (*short, *changes), **more))
    return history(folder)


@pytest.mark.parametrize(
    "changes",
    [
        ("coupling.scheme='quasi_direct'",),
        ("coupling.tangent='newton'",),
        ("coupling.accelerator='aitken'",),
    ],
)
def test_every_scheme_finds_the_same(tmp_path, changes):
    """As the direct scheme, over the switch, to the tolerance of the iteration."""
    direct = columns(tmp_path / "direct", "coupling.scheme='direct'")
    found = columns(tmp_path / "other", *changes)
    assert direct["top.p"][-1] < -1e3  # sealed
    for name in ("top.u_y", "base.p", "face.volume"):
        scale = np.abs(direct[name]).max()
        assert np.abs(found[name] - direct[name]).max() < 1e-5 * scale


def test_nothing_flows_in_and_the_penalty_is_small(tmp_path):
    found = columns(tmp_path / "run")
    loaded = (found["t"] > 0) & (found["t"] < 2.6)
    assert (found["face.flow_rate"][loaded] > 0).all()
    # 1e-6 of the drop of the pressure across an element
    assert np.abs(found["top.p"][loaded]).max() < 1e-6 * 1e4
    largest = found["face.flow_rate"].max()
    assert np.abs(found["face.flow_rate"][~loaded]).max() < 1e-6 * largest  # of the iteration


def test_it_drains_like_a_prescribed_pressure(tmp_path):
    """Under a load that stays; the penalty adds 1e-6 of an element to the drainage path."""
    load = "boundary.2.traction.y=-1e4"
    given = "boundary.2={on='top', pressure=200.0, traction={y=-1e4}}"
    face = columns(tmp_path / "face", load, "boundary.2.seepage=200.0", "time.end=2")
    drained = columns(tmp_path / "drained", given, "time.end=2")
    np.testing.assert_allclose(face["base.p"], drained["base.p"], rtol=1e-5)
    np.testing.assert_allclose(
        face["face.flow_rate"], drained["face.flow_rate"], rtol=1e-4, atol=1e-12
    )


def test_a_part_that_is_sealed_is_as_one_of_its_own(tmp_path):
    """Steady flow under a sheet pile to a bed of which only the part x < 1 m drains."""
    short = ("expect=[]", "time.end=2e4", "time.scheme=backward_euler")
    surface = "surface=[{name='under', on='under', quantities=['flow_rate']}]"
    face = "{on='top', seepage='where(x < 1, 0, 1e6)'}]"
    split = "{on='open', pressure=0}, {on='top', displacement={}}]"
    one = columns(tmp_path / "1", PILE + face, surface, scene="sheet_pile", short=short)
    two = columns(
        tmp_path / "2", f"mesh.{SPLIT}", PILE + split, surface, scene="sheet_pile", short=short
    )
    flow = "under.flow_rate"
    assert one[flow][-1] == pytest.approx(two[flow][-1], rel=1e-4)


def test_a_restart_is_the_whole_run(tmp_path):
    every = "output.checkpoint_every=1"
    whole = columns(tmp_path / "whole", every)
    for end in (2.0, 3.0):  # before and after the switch
        columns(tmp_path / f"half{end}", every, f"time.end={end}")
        point = str(tmp_path / f"half{end}/checkpoint.h5")
        again = columns(tmp_path / f"again{end}", every, restart=point)
        for name in ("top.p", "base.p", "top.u_y", "face.flow_rate", "face.volume"):
            assert again[name][-1] == whole[name][-1]


@needs_mpirun
@pytest.mark.parametrize("ranks", [2, 3])
def test_ranks_solve_like_one(tmp_path, ranks):
    one = columns(tmp_path / "one")
    run_on(ranks, [Job(SCENE, str(tmp_path / "some"), SHORT)], tmp_path)
    some = history(tmp_path / "some")
    for name in ("top.p", "base.p", "face.volume"):
        scale = np.abs(one[name]).max()
        assert np.abs(some[name] - one[name]).max() < 1e-5 * scale  # of the iteration


def test_a_split_whose_iterates_stray_is_refused(tmp_path):
    """The plain split took 120 iterations, and what they strayed to as the scale of its test."""
    with pytest.raises(InputError, match=r"boundary.2.seepage\]: received the plain split"):
        columns(tmp_path / "run", "coupling.split='plain'")


def test_a_step_of_all_of_the_consolidation_lets_out_what_the_load_presses_out(tmp_path):
    """The face opens in the first step and closes in the second, u = -q H/E_c after both."""
    steps = ("time.step=1e4", "time.end=3e4", "boundary.2.traction.y=-1e4")
    found = columns(tmp_path / "run", *steps)
    settled = -1e4 * 10.0 / (8.375e6 + 2 * 5.583e6)
    # Euler's step of T = c_v Δt/H² = 195 leaves 8/π² of 1/(1 + (π/2)² T) = 1.7e-3 of it
    np.testing.assert_allclose(found["top.u_y"][1:], settled, rtol=2e-3)
    np.testing.assert_allclose(found["top.u_y"][-1], settled, rtol=1e-5)


def test_rates_that_are_not_those_at_the_end_of_a_step_are_refused():
    words = "'generalized_alpha' with boundary.2.seepage .* expected 'backward_euler'"
    with pytest.raises(InputError, match=words):
        load_scene(SCENE, ("time.scheme=generalized_alpha",))


def test_a_pressure_beside_it_is_refused():
    with pytest.raises(InputError, match="which excludes"):
        load_scene(SCENE, ("boundary.2.pressure=0",))
