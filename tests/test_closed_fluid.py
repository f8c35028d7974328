"""A free fluid that rigid walls close: the level of its pressure, data that do not balance, every
solver and number of ranks.
"""

from pathlib import Path

import numpy as np
import pytest
import sympy as sp
from free_flow import Flow, errors, solved
from manufactured import orders, steps_to_end, x, y
from mpi4py import MPI
from running import SCENES, Job, needs_mpirun, run_here, run_on

from porofsi_petsc import load_scene
from porofsi_petsc.errors import IncompatibleData
from porofsi_petsc.fem.closed import closed_nodes
from porofsi_petsc.fem.domain import Domain
from porofsi_petsc.linalg.options import start
from porofsi_petsc.output.history import read_history
from porofsi_petsc.simulation.build import local_mesh
from porofsi_petsc.simulation.simulation import Simulation

SCENE = str(SCENES / "free_fluid.toml")
STEADY = (
    "time.scheme=steady",
    "model.fluid_inertia=false",
    "model.solid_inertia=false",
    "time.end=1.0",
    "time.step=1.0",
)
AT_REST = ("model.moving_mesh=false", "coupling.tolerance=1e-9")
ITERATIVE = ("-fluid_ksp_type", "fgmres", "-fluid_ksp_rtol", "1e-6", "-fluid_pc_type", "fieldsplit")
ITERATIVE += ("-fluid_pc_fieldsplit_type", "schur", "-fluid_pc_fieldsplit_schur_fact_type", "upper")
ITERATIVE += ("-fluid_fieldsplit_v_pc_type", "lu", "-fluid_fieldsplit_p_ksp_type", "preonly")
ITERATIVE += ("-fluid_fieldsplit_v_ksp_type", "preonly", "-fluid_fieldsplit_p_pc_type", "python")
ITERATIVE += (
    "-fluid_fieldsplit_p_compliance_pc_type",
    "gamg",
    "-fluid_fieldsplit_p_laplacian_pc_type",
    "gamg",
)
WAVE = sp.sin(1.5 * x - y + 0.2) / 2
PRESSURE = sp.cos(1.2 * x + 0.7 * y)
MEAN = float(sp.integrate(sp.integrate(PRESSURE, (x, 0, 1)), (y, 0, 1)))
CLOSED = Flow(WAVE, PRESSURE - MEAN, open=())


def sides(**velocity):
    """Return the change that prescribes velocities on the sides of the square, a fluid at rest on
    the others.
    """
    given = {"left": "0", "right": "0", "bottom": "0", "top": "0"} | velocity
    vectors = {
        side: {"x": v, "y": "0"} if side in ("left", "right") else {"x": "0", "y": v}
        for side, v in given.items()
    }
    entries = [
        f"{{on='{side}', velocity={{x='{v['x']}', y='{v['y']}'}}}}" for side, v in vectors.items()
    ]
    return f"boundary=[{', '.join(entries)}]"


def built(*options):
    start()
    scene = load_scene(SCENE, (*AT_REST, *options))
    return Simulation(scene, MPI.COMM_WORLD).coupling


@pytest.mark.parametrize("order", [1, 2])
def test_a_closed_flow_converges_with_the_order_of_its_elements_and_zero_mean_pressure(order):
    """The exact velocity all around has no net flux, its values at the nodes have a small one: no
    obstacle, no loss of order.
    """
    found = []
    for cells in {1: (16, 32), 2: (8, 16)}[order]:
        mesh = f"mesh.order={order}", f"mesh.x.cells=[{cells}]", f"mesh.y.cells=[{cells}]"
        coupling = solved(CLOSED, *mesh, *STEADY, *AT_REST)
        (part,) = coupling.fluid.setup.closed
        assert abs(part.mean(coupling.fluid.p)) < 1e-13
        found.append(errors(CLOSED, coupling, 1.0))
    table = orders(found)
    # k + 1 and k in theory; as with an open side, tests/test_free_fluid.py
    assert table["v"][1][-1] > order + 0.75
    assert table["p"][1][-1] > order - 0.25


RUN = (
    *AT_REST,
    "mesh.x.cells=[6]",
    "mesh.y.cells=[6]",
    "time.end=0.1",
    "mesh.order=2",
    "coupling.tolerance=1e-8",
)
LID = sides().replace("{x='0', y='0'}}]", "{x='16*(x*(1-x))**2*sin(9*t)', y='0'}}]")
PROBES = "probe=[{name='a', at=[0.3, 0.7], quantities=['vf_x', 'vf_y', 'p']}]"
CASES = {"transient": (), "steady": (*STEADY, "time.end=0.1", "time.step=0.1")}


def closed_runs(folder, case):
    """Return the jobs of a case with each solver."""
    solvers = {"direct": (), "iterative": ITERATIVE}
    changes = (*RUN, LID, PROBES, *CASES[case])
    return [
        Job(SCENE, str(folder / f"{case}-{name}"), changes, petsc_options=options)
        for name, options in solvers.items()
    ]


def final(job):
    history = read_history(Path(job.directory) / "history.csv")
    return np.array([history[f"a.{quantity}"][-1] for quantity in ("vf_x", "vf_y", "p")])


@needs_mpirun
def test_every_solver_finds_the_same_closed_flow_on_every_number_of_ranks(tmp_path):
    """A factorization with one pressure fixed, and an iteration that takes the constants out;
    transient and steady.
    """
    folders = {ranks: tmp_path / str(ranks) for ranks in (1, 3)}
    jobs = {
        ranks: [job for case in CASES for job in closed_runs(folder, case)]
        for ranks, folder in folders.items()
    }
    for job in jobs[1]:
        run_here(job)
    run_on(3, jobs[3], tmp_path)
    for here, there in zip(*jobs.values(), strict=True):
        np.testing.assert_allclose(
            final(there), final(here), rtol=1e-6
        )  # the iterations of both end at 1e-8 of the forces
    for direct, iterative in (jobs[1][:2], jobs[1][2:]):
        np.testing.assert_allclose(final(iterative), final(direct), rtol=1e-6)
        assert np.abs(final(direct)).min() > 1e-3


@pytest.mark.parametrize(
    "data, net",
    [
        ({"left": "1.8*y*(1-y)"}, "0.3 m²/s into"),  # quadratic elements hold a parabola
        ({"left": "6*y*(1-y)", "right": "6.3*y*(1-y)"}, "0.05 m²/s out of"),
        (
            {"left": "6*y*(1-y)*sin(t)", "bottom": "-6*x*(1-x)*t"},
            "2.08307e-05",
        ),  # t - sin t after the first step
    ],
)
def test_data_with_a_net_flux_are_refused_with_the_number(data, net):
    with pytest.raises(
        IncompatibleData,
        match=rf"\[\[boundary\]\]: received velocities that carry {net}.* closed all around",
    ):
        built(sides(**data), "mesh.order=2")


def test_a_net_flux_that_only_a_step_meets_ends_the_run(tmp_path):
    """Before a run its data are looked at in sixteenths of it; the end of step 3 lies between."""
    pulse = sides(left="6*y*(1-y)*where(abs(t-0.15)<1e-3, 1, 0)")
    with pytest.raises(IncompatibleData, match="carry 1 m²/s into .* at t = 0.15 s"):
        run_here(
            Job(SCENE, str(tmp_path / "run"), (*AT_REST, "mesh.order=2", "time.end=0.5", pulse))
        )
    assert len(read_history(tmp_path / "run" / "history.csv")["t"]) == 3


def test_a_closed_box_in_motion_is_no_net_flux_and_a_piston_in_it_is_one():
    """The data of a moving mesh are judged where the mesh is: all walls move by 3 t², or one of
    them alone.
    """
    wall = "displacement={x='3*t**2', y='0'}, velocity={x='6*t', y='0'}"
    box = f"boundary=[{{on=['left', 'right', 'bottom', 'top'], {wall}}}]"
    rest = "displacement={x='0', y='0'}, velocity={x='0', y='0'}"
    piston = (
        f"boundary=[{{on='left', {wall}, priority=1}}, {{on=['right', 'bottom', 'top'], {rest}}}]"
    )
    run_moving(box)
    with pytest.raises(IncompatibleData, match="into a fluid closed all around at t = 0.05 s"):
        run_moving(piston)


def run_moving(boundary):
    """Advance a fluid with a moving mesh by two steps."""
    start()
    scene = load_scene(SCENE, (boundary, "time.end=0.1"))
    coupling = Simulation(scene, MPI.COMM_WORLD).coupling
    for step, (time, schemes, rates) in enumerate(steps_to_end(scene), 1):
        coupling.step(schemes, rates, time, step)
        coupling.accept()
    return coupling


def test_what_interpolation_makes_of_balanced_data_is_no_net_flux():
    """A parabola through 4 linear facets and the same flux as a sine through others differ by what
    the facets miss.
    """
    coupling = built(sides(left="6*y*(1-y)", right="pi/2*sin(pi*y)"), *STEADY)
    ((t, schemes, rates),) = steps_to_end(load_scene(SCENE, STEADY))
    coupling.step(schemes, rates, t, 1)
    source = coupling.residuals[1][1].terms["source"]
    # facets of 1/4 miss 6 h² y(1-y)/(12 y(1-y)) = 3 % of the parabola, half the sine's curvature
    # less
    assert 0.005 < abs(source.sum()) < 0.03


@pytest.mark.mpi
def test_each_chamber_of_a_fluid_is_closed_by_itself():
    """Two regions of a square with another between them: both closed, one of them, or none, on any
    number of ranks.
    """
    start()
    regions = "mesh.regions=[{name='wall', x=[0.25, 0.5]}, {name='second', x=[0.5, 1.0]}]"
    fluid = "fluid={density=1.0, viscosity=1.0}"
    materials = f"material=[{{region='all', {fluid}}}]"
    mesh = local_mesh(load_scene(SCENE, (regions, materials)), MPI.COMM_WORLD)
    first = next(name for name in mesh.regions if name not in ("wall", "second"))
    domain = Domain(mesh, (first, "second"))
    x, y = mesh.X.T
    around = np.isin(x, (0.0, 0.25, 0.5, 1.0)) | np.isin(y, (0.0, 1.0))
    held = np.repeat(around[:, None], 2, axis=1)
    parts = closed_nodes(domain, held)
    assert [mesh.comm.allreduce(int(part[: mesh.n_owned].sum())) for part in parts] == [10, 15]
    held[(x == 1.0) & (y == 0.5), 0] = False
    assert len(closed_nodes(domain, held)) == 1
    held[(x == 0.0) & (y == 0.5), 1] = False  # along the wall: nothing leaves
    assert len(closed_nodes(domain, held)) == 1
    held[(x == 0.25) & (y == 0.5), 0] = False
    assert closed_nodes(domain, held) == []
