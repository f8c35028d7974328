"""At 0+ a boundary that jumps goes there in the first step; initial data that contradict the
boundary are refused.
"""

import numpy as np
import pytest
from mpi4py import MPI
from running import SCENES, Job, history, needs_mpirun, run_here, run_on, state, summary

from porofsi_petsc import load_scene
from porofsi_petsc.errors import InputError
from porofsi_petsc.linalg.options import start
from porofsi_petsc.simulation import check
from porofsi_petsc.simulation.loop import Clock
from porofsi_petsc.simulation.simulation import Simulation

pytestmark = pytest.mark.usefixtures("petsc")
PISTON, FREE, BAR = (str(SCENES / name) for name in ("piston.toml", "free_fluid.toml", "bar.toml"))
# Mandel's slab as a strip under a step of strain, T = 0.16 t/s; plane strain, u_x = ε x and p = 2 μ
# ε at 0+.
REFERENCE = "reference={solution='unconfined', strain=1e-4, length=1.0, times=[0.0625, 0.3125]}"
STRAIN = 1e-4
MU = 6e6
UNDRAINED = 2 * MU * STRAIN
STRIP = (
    "boundary.3={on='top', displacement={y=-5e-5}}",
    REFERENCE,
    "expect=[]",
    "time.end=0.3125",
)


@pytest.mark.parametrize("scheme", ["partitioned", "direct"])
def test_a_strip_that_is_squeezed_at_once_bulges_by_its_volume(scheme, tmp_path):
    """Before, the plate was where it goes already at t = 0, and the volume that it takes was lost:
    u was that of the drained end.

    The bounds are those of the scene `mandel`, whose mesh and steps these are.
    """
    run_here(Job("mandel", str(tmp_path), (*STRIP, f"coupling.scheme={scheme}")))
    rows = history(tmp_path)
    errors = summary(tmp_path)["errors"]
    print(rows["side.u_x"][1], rows["centre.p"][1], errors)
    assert rows["side.u_x"][0] == rows["centre.p"][0] == 0  # the state before
    # after a first step of 1e-3 s a layer of √(c t) = 0.013 of the half width has drained
    assert rows["side.u_x"][1] == pytest.approx(STRAIN, rel=0.03) and rows["centre.p"][
        1
    ] == pytest.approx(UNDRAINED, rel=0.01)
    assert all(error["u"] < 5e-4 and error["p"] < 2e-3 for error in errors)


@pytest.mark.parametrize("order", ["mesh.order=1", "mesh.order=2"])
@pytest.mark.parametrize("time", [("time.rho_inf=0.5",), ("time.scheme=backward_euler",)])
def test_every_scheme_takes_the_jump_in_its_first_step(order, time, tmp_path):
    """An undrained strip cannot do anything but u_x = ε x, whatever a scheme makes of the velocity
    of the jump.
    """
    slow = (
        "material.0.permeability.k=1e-12",
        "time.end=5e-3",
        "time.growth=1.0",
        "reference.times=[]",
    )
    run_here(Job("mandel", str(tmp_path), (*STRIP, *slow, order, *time)))
    u = history(tmp_path)["side.u_x"][1:]
    assert (
        len(u) == 5 and np.abs(u / STRAIN - 1).max() < 0.03
    )  # linear elements and the stabilization yield at the side


def test_a_constant_is_the_step_function(tmp_path):
    short = (*STRIP, "time.end=5e-3", "reference.times=[]")
    run_here(Job("mandel", str(tmp_path / "constant"), short))
    step = "boundary.3.displacement.y='where(t > 0, -5e-5, 0)'"
    run_here(Job("mandel", str(tmp_path / "step"), (*short, step)))
    texts = [(tmp_path / name / "history.csv").read_text() for name in ("constant", "step")]
    assert texts[0] == texts[1]


def built(scene, *changes):
    """Return the coupling of a scene in its initial state, and the scene."""
    start()
    loaded = load_scene(scene, changes)
    return Simulation(loaded, MPI.COMM_SELF).coupling, loaded


def test_a_first_step_that_is_given_up_leaves_the_jump_to_the_next():
    found = []
    for attempts in ([1e-3, 5e-4], [5e-4]):
        coupling, scene = built("mandel", *STRIP, "mesh.x.cells=[4]", "coupling.tolerance=1e-10")
        for dt in attempts:
            coupling.reset()
            coupling.step(*Clock(scene.time).schemes(scene.model, dt), 0.0, 1)
        coupling.accept()
        found.append((coupling.solid.u.copy(), coupling.fluid.p.copy()))
    (u, p), (expected_u, expected_p) = found
    # the tolerance of the coupling times the condition of a step
    assert (
        np.abs(u - expected_u).max() < 1e-7 * STRAIN
        and np.abs(p - expected_p).max() < 1e-5 * UNDRAINED
    )


RESTART = (
    *STRIP,
    "reference.times=[]",
    "time.end=4e-3",
    "time.growth=1.0",
    "output.checkpoint_every=1",
)


def test_a_run_that_is_continued_after_the_jump_is_the_whole_one(tmp_path):
    run_here(Job("mandel", str(tmp_path / "whole"), RESTART))
    run_here(Job("mandel", str(tmp_path / "half"), (*RESTART, "time.end=1e-3")))
    run_here(
        Job("mandel", str(tmp_path / "half"), RESTART, restart=str(tmp_path / "half/checkpoint.h5"))
    )
    assert (tmp_path / "whole/history.csv").read_text() == (
        tmp_path / "half/history.csv"
    ).read_text()
    expected, computed = (state(tmp_path / name / "checkpoint.h5") for name in ("whole", "half"))
    assert all(np.array_equal(computed[name], expected[name]) for name in expected)


@needs_mpirun
def test_two_ranks_take_the_same_jump(tmp_path):
    run_here(Job("mandel", str(tmp_path / "1"), (*RESTART, "coupling.tolerance=1e-10")))
    run_on(
        2, [Job("mandel", str(tmp_path / "2"), (*RESTART, "coupling.tolerance=1e-10"))], tmp_path
    )
    one, two = (history(tmp_path / name) for name in "12")
    for name in ("side.u_x", "centre.p"):
        # the tolerance of the coupling times the condition of a step
        assert np.abs(two[name][1:] / one[name][1:] - 1).max() < 1e-6, name


# -- refused ---------------------------------------------------------------------------------------

SMALL = ("mesh.y.cells=[4]", "mesh.y.ratios=[1.0]", "expect=[]", "reference.times=[]")
INERTIA = ("model.solid_inertia=true", "model.fluid_inertia=true")
MOVED = "boundary.2={on='top', displacement={y='%s'}, pressure=0.0}"
PLATE = MOVED % -1e-3
WALL = "boundary.0={on=['left', 'bottom', 'right'], velocity={x=0, y=0}}"
REST = "initial={fluid_velocity={x=0, y=0}}"
RAMPED = "boundary.0={on=['left', 'bottom', 'right'], velocity={x='%s', y=0}}"
REFUSED = {
    "jump with inertia": (
        "terzaghi",
        (PLATE, *INERTIA),
        r"boundary\.2\.displacement\.y\]: received -0\.001 m at 0\+.*minimum",
    ),
    "jump of a step function": (
        "terzaghi",
        (MOVED % "where(t>0, -1e-3, 0)", *INERTIA),
        r"\[boundary\.2\.displacement\.y\]: received -0\.001 m at 0\+",
    ),
    "jump beside a fluid with inertia": (
        PISTON,
        ("boundary.0.displacement.y=0.01",),
        r"\[boundary\.0\.displacement\.y\]: .*jump",
    ),
    "displacement": (
        "terzaghi",
        ("initial={displacement={y='1e-3*(y + 1)'}}",),
        (
            r"\[initial\.displacement\.y\]: received 0\.001 m at the node \(0, 0\) m of 'bottom',"
            r" while boundary\.1\.dis"
        ),
    ),
    "displacement beside a jump": (
        "terzaghi",
        (
            PLATE,
            "boundary.0={on=['left', 'right'], displacement={x=1e-3}}",
            "initial={displacement={y=1e-4}}",
        ),
        r"\[initial\.displacement\.y\]: received 0\.0001 m",
    ),
    "velocity of a fixed base": (
        "terzaghi",
        ("initial={solid_velocity={y=1.0}}", *INERTIA, "time.consistent_start=true"),
        (
            r"\[initial\.solid_velocity\.y\]: received 1 m/s .* of 'bottom', while .* starts with"
            r" 0 m/s"
        ),
    ),
    "velocity of a fixed base without a consistent start": (
        BAR,
        ("initial={solid_velocity={y=1.0}}",),
        r"\[initial\.solid_velocity\.y\]: received 1 m/s .*: then the boundary jumps",
    ),
    "velocity that a consistent start needs": (
        BAR,
        ("boundary.0.displacement={x=0, y='0.1*t'}", "time.consistent_start=true"),
        (
            r"\[initial\.solid_velocity\.y\]: received 0 m/s .*with 0\.1 m/s"
            r" there.*time\.consistent_start"
        ),
    ),
    "linear ramp against a solid at rest": (
        "terzaghi",
        (MOVED % "-1e-3*minimum(t, 1)", "initial={solid_velocity={y=0}}", *INERTIA),
        r"\[initial\.solid_velocity\.y\]: received 0 m/s .*with -0\.001 m/s there",
    ),
    "sine against a solid at rest": (
        "terzaghi",
        (MOVED % "-1e-3*sin(t)", *INERTIA, "time.consistent_start=true"),
        r"\[initial\.solid_velocity\.y\]: received 0 m/s .*with -0\.001 m/s there",
    ),
    "small jump before a ramp": (
        "terzaghi",
        (MOVED % "-1e-3*minimum(t, 1) - 1e-4", *INERTIA),
        r"\[boundary\.2\.displacement\.y\]: received -0\.0001 m at 0\+",
    ),
    "inflow that has half begun": (
        FREE,
        (RAMPED % "0.5 + minimum(t/0.1, 0.5)", REST),
        r"\[initial\.fluid_velocity\]: received a flow of .* through 'left'",
    ),
    "flow through a wall": (
        FREE,
        (WALL, "initial={fluid_velocity={x=1.0}}"),
        r"\[initial\.fluid_velocity\]: received a flow of .* through 'left'",
    ),
    "flow through an interface": (
        PISTON,
        ("initial={fluid_velocity={y=0.3}}",),
        r"\[initial\.fluid_velocity\]: received a flow of -0\.3 m/s through the interface",
    ),
    "pore flow through a wall": (
        "terzaghi",
        ("initial={fluid_velocity={y=1e-3}}",),
        r"\[initial\.fluid_velocity\]: received a flow of -0\.001 m/s through 'bottom'",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_contradicts_is_refused_by_check_and_before_a_run(case, tmp_path):
    scene, changes, sentence = REFUSED[case]
    changes = (*(SMALL if scene == "terzaghi" else ()), *changes)
    with pytest.raises(InputError, match=sentence):
        check(load_scene(scene, changes))
    with pytest.raises(InputError, match=sentence):
        run_here(Job(scene, str(tmp_path / "run"), changes))
    assert not (tmp_path / "run").exists()


# At t = 0 with neither displacement nor velocity.
SMOOTH = {
    "cosine": "1 - cos(3*t)",
    "square": "t**2",
    "cube": "t**3",
    "root of a cube": "t*sqrt(t)",
    "smoothstep": "minimum(t, 1)**2*(3 - 2*minimum(t, 1))",
    "late ramp": "maximum(t - 1, 0)",
    "pulse": "exp(-(t - 6)**2)",  # 2e-16 at t = 0
}
ALLOWED = {
    **{
        f"{name} {kind}": ("terzaghi", (MOVED % f"-1e-4*({formula})", *INERTIA, change))
        for name, formula in SMOOTH.items()
        for kind, change in (
            ("from rest", "initial={solid_velocity={y=0}}"),
            ("in a consistent start", "time.consistent_start=true"),
        )
    },
    **{
        f"inflow of a {name}": (FREE, (RAMPED % formula, REST, "time.end=10.0"))
        for name, formula in {**SMOOTH, "ramp": "minimum(t/0.1, 1)", "root": "sqrt(t)"}.items()
    },
    "inflow of a ramp in a consistent start": (
        FREE,
        (RAMPED % "minimum(t/0.1, 1)", "time.consistent_start=true", "model.solid_inertia=true"),
    ),
    "ramp with inertia": ("terzaghi", (MOVED % "-1e-3*minimum(t, 1)", *INERTIA)),
    "root with inertia": ("terzaghi", (MOVED % "-1e-3*sqrt(t)", *INERTIA)),
    "jump without inertia": ("terzaghi", (PLATE,)),
    "displacement that agrees": (
        "terzaghi",
        (PLATE, "initial={displacement={y='-1e-4*y'}}", *INERTIA),
    ),
    "velocity that agrees": (
        "terzaghi",
        (
            "boundary.2={on='top', displacement={y='-1e-3*sin(t)'}, pressure=0.0}",
            "initial={solid_velocity={y='-1e-4*y'}}",
            *INERTIA,
        ),
    ),
    "jump of a solid alone": (
        BAR,
        ("boundary.0.displacement={x=0, y=1e-3}", "model.solid_inertia=false"),
    ),
    "velocity of a support that turns": (
        BAR,
        (
            "boundary.0.displacement={x=0, y='1e-3*cos(3*t)'}",
            "initial={displacement={y=1e-3}, solid_velocity={y=0}}",
        ),
    ),
    "flow that slips": (
        FREE,
        (
            "boundary.0={on=['bottom', 'top'], velocity={x=0, y=0}}",
            "initial={fluid_velocity={x=1}}",
        ),
    ),
    "flow that starts at once": (
        FREE,
        ("boundary.0={on=['left', 'bottom', 'right'], velocity={x=1, y=0}}",),
    ),
    "first guess of a steady flow": (
        FREE,
        (WALL, "initial={fluid_velocity={x=1.0}}", "time.scheme=steady"),
    ),
}


@pytest.mark.parametrize("case", ALLOWED)
def test_what_does_not_contradict_is_accepted(case):
    scene, changes = ALLOWED[case]
    more = SMALL if scene == "terzaghi" else ()
    if case == "flow that slips":
        more = ("boundary.1={on=['left', 'right']}",)
    if case == "first guess of a steady flow":
        more = ("model.solid_inertia=false", "model.fluid_inertia=false")
    check(load_scene(scene, (*more, *changes)))


def test_a_jump_is_refused_when_inertia_is_switched_on_in_its_step(tmp_path):
    """Without inertia it is a load; with it it has no velocity, and the answer would be that of the
    size of the step.
    """
    auto = (
        "model.solid_inertia=auto",
        "model.fluid_inertia=auto",
        "limits.inertia=1e-12",
        "coupling.scheme=direct",
    )
    with pytest.raises(
        InputError, match=r"\[boundary\.2\.displacement\.y\]: received -0\.001 m at 0\+"
    ):
        run_here(Job("terzaghi", str(tmp_path), (*SMALL, PLATE, *auto)))


# -- pressure and flow -----------------------------------------------------------------------------


@pytest.mark.parametrize("rho_inf", [0.0, 0.5])
def test_an_initial_pressure_is_drained_from_the_first_step_on(rho_inf, tmp_path):
    """The excess pressure of a sudden load may be given or not: Terzaghi's solution within the
    bounds of the scene.

    Before, p at the end of the first step was on the line through the initial pressure, below that
    of the drain.
    """
    short = (
        "expect=[]",
        f"time.rho_inf={rho_inf}",
        "time.end=0.1",
        "reference.times=[]",
        "probe.1.at=[0.05, 9.99]",
    )
    run_here(Job("terzaghi", str(tmp_path), (*short, "initial={pressure=1e4}")))
    p, (error,) = history(tmp_path)["base.p"], summary(tmp_path)["errors"]
    print(p[:3], error)
    assert p[0] == 1e4 and p[1:].min() > 0  # within the first element below the drain
    assert error["u"] < 0.01 and error["p"] < 0.001


def test_a_pressure_that_grows_from_the_initial_one_is_balanced_with_it(tmp_path):
    """At 0+ a ramp is 1e-15 of what it is after a step, which is no load that p = 0 contradicts."""
    texts = []
    for name, formula in (("ramp", "1e4*t"), ("from zero", "where(t > 1e-9, 1e4*t, 0)")):
        top = f"boundary.2={{on='top', pressure='{formula}'}}"
        short = (*SMALL, "time.rho_inf=0.5", "time.end=0.1", "initial={pressure=0}", top)
        run_here(Job("terzaghi", str(tmp_path / name), short))
        texts.append((tmp_path / name / "history.csv").read_text())
    assert texts[0] == texts[1]


def test_a_flow_that_starts_at_once_is_solenoidal_in_every_step():
    """Between two walls along which it slips the flow can only be uniform; before, it rang by
    (-ρ∞)^n about its inflow.
    """
    sides = (
        "boundary=[{on='left', velocity={x=1}}, {on=['bottom', 'top'], velocity={y=0}},"
        " {on='right'}]"
    )
    coupling, scene = built(FREE, sides, "time.rho_inf=0.8")
    clock = Clock(scene.time)
    for step in range(1, 4):
        dt = clock.next_size()
        coupling.step(*clock.next_schemes(scene.model), clock.t, step)
        coupling.accept()
        clock.advance(dt, clock.next_target())
        assert np.abs(coupling.fluid.v - [1.0, 0.0]).max() < 1e-6  # the tolerance of the coupling


def test_a_mesh_starts_where_its_boundary_is():
    """It is the shape of the domain at t = 0, through which no fluid has moved."""
    coupling, _ = built(
        FREE,
        "boundary.1={on='top', displacement={x=0, y=0.1}}",
        "boundary.0.displacement={x=0, y='0.1*y'}",
    )
    assert np.abs(coupling.motion.u[:, 1] - 0.1 * coupling.motion.mesh.X[:, 1]).max() < 1e-12
    assert not coupling.motion.v.any() and not coupling.fluid.v.any()


def test_a_sudden_inflow_pushes_a_solid_by_its_volume():
    """The fluid between inflow and solid can only go along: v_s is the inflow from the first step
    on, u its integral.

    The velocity grows within the first step, so that half a step of the volume is missing, and
    hardly more later.
    """
    inflow = "boundary.3={on='top', velocity={x=0, y=-0.1}}"
    coupling, scene = built(
        PISTON, inflow, "coupling.scheme=direct", "time.step=1e-3", "coupling.tolerance=1e-9"
    )
    clock = Clock(scene.time)
    solid = coupling.solid
    here = np.flatnonzero(solid.domain.holds & coupling.fluid.domain.holds)
    simpson = np.array([1, 4, 1]) / 6 @ np.eye(3)[np.argsort(solid.mesh.X[here, 0]).argsort()]
    for step in range(1, 5):
        dt = clock.next_size()
        target = clock.next_target()
        coupling.step(*clock.next_schemes(scene.model), clock.t, step)
        coupling.accept()
        clock.advance(dt, target)
        missing = simpson @ (solid.u[here, 1] + 0.1 * clock.t) / (0.1 * dt)
        # a wave of one step in coarse elements: the stabilization of p lets 4 % of the flow through
        # the interface
        assert (
            simpson @ coupling.fluid.v[here, 1] == pytest.approx(-0.1, rel=0.05)
            and 0.4 < missing < 0.7
        )
