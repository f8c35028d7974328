"""Surfaces that meet in a node: one value holds there, by priority and not by the order of entries,
or the scene is refused.
"""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI
from running import SCENES, Job, needs_mpirun, run_here, run_on, state

from porofsi_petsc import load_scene
from porofsi_petsc.config.expressions import Expression
from porofsi_petsc.errors import InputError
from porofsi_petsc.fem.distribute import distribute
from porofsi_petsc.fem.essential import Dirichlet
from porofsi_petsc.linalg.partition import coordinate_bisection
from porofsi_petsc.mesh import rectangle
from porofsi_petsc.simulation import check
from porofsi_petsc.simulation.simulation import Simulation

pytestmark = pytest.mark.usefixtures("petsc")
COMM = MPI.COMM_WORLD
FREE = str(SCENES / "free_fluid.toml")


def square():
    """Return a square of 3 x 3 cells on all ranks."""
    axis = SimpleNamespace(points=[0.0, 1.0], cells=[3], ratios=None)
    mesh = rectangle(axis, axis)
    owner = coordinate_bisection(mesh.points, COMM.size) if COMM.rank == 0 else None
    return distribute(COMM, mesh if COMM.rank == 0 else None, owner)


def entry(tag, value, precedence=0.0, component=0):
    return tag, component, Expression(value), precedence, f"{tag}.key"


def on_node(mesh, field, place):
    """Return the value at a place, from the rank that owns it."""
    here = np.flatnonzero((np.abs(mesh.X[: mesh.n_owned] - place) < 1e-9).all(axis=1))
    return max(COMM.allgather(float(field[here[0], 0]) if len(here) else -np.inf))


@pytest.mark.mpi
@pytest.mark.parametrize("order", list(itertools.permutations(range(3))))
def test_the_highest_precedence_holds_in_any_order(order):
    """Beside it the lower ones may differ: none of them holds at the node."""
    mesh = square()
    given = [entry("left", 3.0, 2.0), entry("bottom", 5.0), entry("right", 7.0, -1.0)]
    dirichlet = Dirichlet(mesh, 1, [given[i] for i in order], times=[0.0])
    field = np.zeros((mesh.n_local, 1))
    dirichlet.apply(field, 1.0)
    assert [on_node(mesh, field, place) for place in ((0, 0), (1, 0), (1, 1))] == [3.0, 5.0, 7.0]


@pytest.mark.mpi
@pytest.mark.parametrize("order", [1, -1])
def test_two_values_on_a_node_are_refused_with_place_and_advice(order):
    given = [entry("left", "1 + y"), entry("bottom", "2*x")][::order]
    place = r"\[left\.key\]: received 1 on 'left' at the node \(0, 0\) m at t = 0\.5 s"
    sentence = place + r", where bottom\.key gives 0 on 'bottom'.*`priority`"
    with pytest.raises(InputError, match=sentence):
        Dirichlet(square(), 1, given, times=[0.5])


@pytest.mark.mpi
def test_values_that_agree_to_round_off_are_one():
    mesh = square()
    field = np.zeros((square().n_local, 1))
    given = [
        entry("left", "0.1 + 0.2 + y"),
        entry("bottom", "0.3 + x"),
        entry("top", "1.3*cos(x)"),
        entry("right", "1.3*cos(1)", 1.0),
    ]
    Dirichlet(mesh, 1, given, times=[0.0, 1.0]).apply(field, 0.5)
    assert on_node(mesh, field, (0, 0)) == pytest.approx(0.3, rel=1e-15)


@pytest.mark.mpi
@pytest.mark.parametrize("times", [[0.5], [1.0, 0.5]])
def test_equal_formulas_agree_where_both_pass_zero(times):
    """At t = 1 they are 1e-16 and -6e-17: of the values of that time all, of those looked at
    before nothing.
    """
    mesh, field = square(), np.zeros((square().n_local, 1))
    given = [entry("left", "sin(pi*t)"), entry("bottom", "cos(pi*t - pi/2)")]
    Dirichlet(mesh, 1, given, times=times).apply(field, 1.0)
    assert np.abs(field).max() < 1e-15
    with pytest.raises(InputError, match="at t = "):
        Dirichlet(
            mesh,
            1,
            [entry("left", "sin(pi*t)"), entry("bottom", "sin(pi*t) + 1e-6*t")],
            times=times,
        )


@pytest.mark.mpi
def test_values_that_part_later_are_refused_when_they_do():
    """On all ranks, so that the run ends in one sentence."""
    mesh = square()
    dirichlet = Dirichlet(
        mesh, 1, [entry("left", "where(t > 0.7, 1, 0)"), entry("bottom", 0.0)], times=[0.0, 0.5]
    )
    dirichlet.apply(np.zeros((mesh.n_local, 1)), 0.6)
    with pytest.raises(
        InputError, match=r"received 1 on 'left' at the node \(0, 0\) m at t = 0\.8 s"
    ):
        dirichlet.apply(np.zeros((mesh.n_local, 1)), 0.8)


def test_other_components_are_no_conflict():
    Dirichlet(square(), 2, [entry("left", 1.0), entry("bottom", 2.0, component=1)], times=[0.0])


# -- scenes ----------------------------------------------------------------------------------------

SMALL = (
    "mesh.x.cells=[3]",
    "mesh.y.cells=[4]",
    "mesh.y.ratios=[1.0]",
    "expect=[]",
    "reference.times=[]",
    "time.end=4e-3",
)
LEFT = "{on=['left', 'right'], displacement={x=0, y=0}}"
BOTTOM = "{on='bottom', displacement={y=1e-4}}"
TOP = "{on='top', pressure=0.0, traction={y=-1e4}}"


@pytest.mark.parametrize("first, second", [(LEFT, BOTTOM), (BOTTOM, LEFT)])
def test_two_displacements_at_a_corner_are_refused(first, second, tmp_path):
    changes = (*SMALL, f"boundary=[{first}, {second}, {TOP}]")
    sentence = (
        r"displacement\.y\]: received 0 on 'left' at the node \(0, 0\) m .* gives 0\.0001 on"
        r" 'bottom'"
    )
    with pytest.raises(InputError, match=sentence):
        check(load_scene("terzaghi", changes))
    with pytest.raises(InputError, match=sentence):
        run_here(Job("terzaghi", str(tmp_path), changes))


def end_of(directory, boundary, ranks=None):
    """Return the arrays of the last checkpoint of a run with some [[boundary]] entries."""
    job = Job(
        "terzaghi",
        str(directory),
        (*SMALL, f"boundary=[{boundary}]", "output.checkpoint_every=1", "coupling.scheme=direct"),
    )
    run_here(job) if ranks is None else run_on(ranks, [job], directory.parent)
    return state(directory / "checkpoint.h5")


@needs_mpirun
def test_a_priority_holds_in_any_order_and_on_any_ranks(tmp_path):
    raised = BOTTOM.replace("on=", "priority=1, on=")
    one = end_of(tmp_path / "one", f"{LEFT}, {raised}, {TOP}")
    other = end_of(tmp_path / "other", f"{raised}, {TOP}, {LEFT}")
    assert all(np.array_equal(one[name], other[name]) for name in one)
    two = end_of(tmp_path / "two", f"{raised}, {TOP}, {LEFT}", ranks=2)
    assert np.abs(two["solid.u"] - one["solid.u"]).max() < 1e-9 * np.abs(one["solid.u"]).max()
    corner = np.abs(one["solid.u"][:, 1] - 1e-4) < 1e-12
    assert corner.sum() == 2 * 3 + 1  # all nodes of the base of quadratic elements, the corners too


def test_two_pressures_at_a_corner_are_refused_and_a_hydrostatic_one_is_not():
    sides = "{on=['left', 'right'], displacement={x=0}, pressure='1e4*(10 - y)'}"
    top = "{on='top', pressure=%s, traction={y=-1e4}}"
    base = "{on='bottom', displacement={y=0}}"
    check(load_scene("terzaghi", (*SMALL, f"boundary=[{sides}, {base}, {top % 0.0}]")))
    with pytest.raises(
        InputError,
        match=r"pressure\]: received 5 on 'top' at the node \(0, 10\) m .* gives 0 on 'left'",
    ):
        check(load_scene("terzaghi", (*SMALL, f"boundary=[{top % 5.0}, {base}, {sides}]")))


WALLS = "{on=['left', 'right', 'bottom'], velocity={x=0, y=0}}"
LID = "{on='top', velocity={x=1}}"


@pytest.mark.parametrize("lid, corner", [(LID, 0.0), (LID.replace("on=", "priority=1, on="), 1.0)])
def test_a_wall_goes_before_a_lid_unless_a_priority_says_otherwise(lid, corner):
    found = []
    for boundary in ([WALLS, lid], [lid, WALLS]):
        scene = load_scene(FREE, (f"boundary=[{', '.join(boundary)}]",))
        coupling = Simulation(scene, COMM).coupling
        v = np.full_like(coupling.fluid.v, np.nan)
        coupling.fluid.setup.velocity.apply(v, 1.0)
        found.append(v)
    assert np.array_equal(*found, equal_nan=True)
    X = coupling.fluid.mesh.X
    assert found[0][(X == [0.0, 1.0]).all(axis=1), 0] == corner
    assert (found[0][(X[:, 1] == 1) & (X[:, 0] > 0) & (X[:, 0] < 1), 0] == 1).all()


def test_two_flows_that_meet_are_refused():
    inflow = "{on='left', velocity={x=2}}"
    with pytest.raises(
        InputError,
        match=r"velocity\.x\]: received 1 on 'top' at the node \(0, 1\) m .* gives 2 on 'left'",
    ):
        check(load_scene(FREE, (f"boundary=[{inflow}, {LID}, {{on=['bottom', 'right']}}]",)))


def test_the_prescribed_motion_of_a_mesh_holds_beside_a_surface_without_one():
    moved = "{on='left', displacement={x='0.1*t', y=0}}"
    scene = load_scene(FREE, (f"boundary=[{moved}, {{on=['bottom', 'right', 'top']}}]",))
    coupling = Simulation(scene, COMM).coupling
    field = np.zeros_like(coupling.motion.u)
    coupling.motion.setup.dirichlet.apply(field, 1.0)
    assert (field[coupling.motion.mesh.X[:, 0] == 0, 0] == 0.1).all()


BRINKMAN = ("model.viscosity=true", "material.0.fluid.viscosity=1e-3", *SMALL)


@pytest.mark.parametrize("priority, sticks", [(0, True), (1, False)])
def test_a_wall_without_slip_goes_before_a_velocity_of_the_same_priority(priority, sticks):
    wall = "{on=['left', 'right'], displacement={x=0}, no_slip=true}"
    base = f"{{on='bottom', displacement={{y=0}}, velocity={{x=0, y=0}}, priority={priority}}}"
    scene = load_scene("terzaghi", (*BRINKMAN, f"boundary=[{wall}, {base}, {TOP}]"))
    coupling = Simulation(scene, COMM).coupling
    corner = (coupling.fluid.mesh.X == 0).all(axis=1)
    assert coupling.fluid.setup.no_slip[corner] == sticks
