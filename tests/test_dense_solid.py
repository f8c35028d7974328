"""A solid without pores and without any fluid: patch test, exact stretches, free vibration, large
strain in time.
"""

import re
from math import log, pi, sin, sqrt

import numpy as np
import pytest
import sympy as sp
from manufactured import distorted, orders, steps_to_end, t, y
from mpi4py import MPI
from running import SCENES, Job, history, run_here

from porofsi_petsc import load_scene
from porofsi_petsc.coupling.convergence import Convergence
from porofsi_petsc.errors import ConvergenceError
from porofsi_petsc.fem.distribute import distribute
from porofsi_petsc.linalg.options import start
from porofsi_petsc.simulation.build import serial_mesh
from porofsi_petsc.simulation.simulation import Simulation

BAR = str(SCENES / "bar.toml")
LAMBDA, MU, RHO, E_C = 6.0, 5.0, 2.0, 16.0  # of the scene [Pa], [kg/m³]
STEADY = ("time.scheme=steady", "model.solid_inertia=false", "model.fluid_inertia=false")
SLACK = 0.25  # between two steps the leading term of the error is not alone yet


def law(name):
    return f"material.0.solid.law={name}"


@pytest.fixture(scope="module", autouse=True)
def petsc():
    start()


def assert_no_fluid(summary):
    """Nothing of a fluid, of a mesh in motion or of both together was assembled, factored or
    solved.
    """
    for block in ("fluid", "mesh", "monolithic"):
        assert (
            summary["assemblies"][block]
            == summary["factorizations"][block]
            == summary["linear_iterations"][block]["max"]
            == 0
        )
    assert summary["unknowns"]["fluid_velocity"] == summary["unknowns"]["pressure"] == 0


@pytest.mark.parametrize(
    "name", ["linear_elastic", "saint_venant_kirchhoff", "neo_hookean", "neo_hookean_j2"]
)
@pytest.mark.parametrize("order", [1, 2])
def test_patch(name, order):
    """An affine displacement of the boundary is one of the whole body, on a distorted mesh, at 30 %
    strain.
    """
    sides = (
        "boundary=[{on=['left','right','bottom','top'], displacement={x='t*(0.3*x + 0.2*y)',"
        " y='-t*(0.1*x + 0.25*y)'}}]"
    )
    square = (
        "mesh.x.points=[0.0, 1.0]",
        "mesh.x.cells=[5]",
        "mesh.y.cells=[5]",
        f"mesh.order={order}",
        "time.step=0.2",
    )
    scene = load_scene(BAR, (sides, law(name), *square, *STEADY, "coupling.tangent=newton"))
    mesh = distorted(serial_mesh(scene))
    mesh = distribute(MPI.COMM_SELF, mesh, np.zeros(len(mesh.points), dtype=int))
    coupling = Simulation(scene, mesh=mesh).coupling
    for step, (time, schemes, rates) in enumerate(
        steps_to_end(scene), 1
    ):  # the boundary moves by less than an element in each
        coupling.step(schemes, rates, time, step)
        coupling.accept()
    X = mesh.X
    u = coupling.solid.u
    error = np.abs(
        u - np.column_stack([0.3 * X[:, 0] + 0.2 * X[:, 1], -0.1 * X[:, 0] - 0.25 * X[:, 1]])
    ).max()
    print(f"P{order} {name}: {coupling.iterations} iterations, error {error:.1e}")
    assert error < 1e-10  # the tolerance of the residual, 1e-10 of the largest force


STRESS = {  # P of a stretch F at fixed sides
    "saint_venant_kirchhoff": lambda F: E_C / 2 * (F**3 - F),
    "neo_hookean": lambda F: MU * (F - 1 / F) + LAMBDA * log(F) / F,
    "neo_hookean_j2": lambda F: MU * (F - 1 / F) + LAMBDA * (F - 1),
}


@pytest.mark.parametrize("tangent", ["newton", "lagged"])
@pytest.mark.parametrize("name", STRESS)
@pytest.mark.parametrize("F", [0.7, 1.5])
def test_a_stretch_at_fixed_sides_carries_its_stress(name, F, tangent, tmp_path):
    """Steady, the load in five steps: every step is a state of its own, also with tangents that are
    kept.
    """
    load = f"boundary.2.traction={{y='{STRESS[name](F)}*t'}}", "time.step=0.2"
    summary = run_here(
        Job(BAR, str(tmp_path / "run"), (law(name), *load, *STEADY, f"coupling.tangent={tangent}"))
    )
    computed = history(tmp_path / "run")["A.u_y"][-1]
    print(
        f"{name} {tangent}: computed {computed:.12f}, exact {F - 1},"
        f" {summary['coupling_iterations']['total']} iterations"
    )
    assert abs(computed - (F - 1)) < 1e-9  # the tolerance of the residual through the stiffness
    assert summary["steps"] == 5 and summary["energy"]["kinetic"] == 0
    assert_no_fluid(summary)


@pytest.mark.parametrize("rho_inf", [0.0, 0.5, 1.0])
def test_the_free_vibration_has_its_exact_frequency_to_second_order(rho_inf, tmp_path):
    """u = sin(π y/2) sin(ω t), ω = π/2 √(E_c/ρ); 40 and 80 steps a period.

    The wave is held to 1e-5 by four quadratic elements, the error of the time scheme is (ω Δt)²
    times 1/12 to 5/12.
    """
    omega = pi / 2 * sqrt(E_C / RHO)
    found = []
    period = 2 * pi / omega
    for steps in (40, 80):
        start = f"initial={{solid_velocity={{y='{omega * 1e-3}*sin(pi*y/2)'}}}}"
        times = f"time.end={period}", f"time.step={period / steps}", f"time.rho_inf={rho_inf}"
        directory = tmp_path / str(steps)
        summary = run_here(Job(BAR, str(directory), (start, *times)))
        rows = history(directory)
        exact = {
            "A.u_y": 1e-3 * np.sin(omega * rows["t"]),
            "A.v_y": 1e-3 * omega * np.cos(omega * rows["t"]),
        }
        found.append(
            {name: np.abs(rows[name] - e).max() / np.abs(e).max() for name, e in exact.items()}
        )
        assert_no_fluid(summary)
        assert (
            summary["assemblies"]["solid"] == summary["factorizations"]["solid"] == 1
        )  # linear: one matrix for the whole run
        assert summary["energy"]["balance_error_relative"] < 1e-9  # the tolerance of the residuals
        if rho_inf == 1:
            assert (
                abs(summary["energy"]["time_scheme_dissipation"])
                < 1e-9 * summary["energy"]["kinetic"]
            )
    table = orders(found)
    for name, (error, rate) in table.items():
        print(f"rho_inf = {rho_inf}: {name} errors {error}, order {rate[-1]:.2f}, theory 2")
        assert rate[-1] > 2 - SLACK and error[-1] < 0.02


@pytest.mark.parametrize("rho_inf", [0.0, 0.5, 1.0])
def test_saint_venant_kirchhoff_at_large_strain_is_of_second_order_in_time(rho_inf, tmp_path):
    """u = a(t) y² with a sudden turn of strain up to 40 %, held by a body force and a traction
    derived here.
    """
    u = (1 - sp.cos(3 * t)) / 10 * y**2
    F = 1 + u.diff(y)
    stress = E_C / 2 * (F**3 - F)
    force = u.diff(t, 2) - stress.diff(y) / RHO
    given = (
        f"boundary.2.traction={{y='{stress.subs(y, 1)}'}}",
        f"body_force={{solid={{y='{sp.expand(force)}'}}}}",
    )
    found = []
    for step in (0.025, 0.0125):
        times = "time.end=0.6", f"time.step={step}", f"time.rho_inf={rho_inf}", "mesh.y.cells=[6]"
        consistent = "time.consistent_start=true", "coupling.tolerance=1e-8"
        run_here(
            Job(
                BAR,
                str(tmp_path / str(step)),
                (law("saint_venant_kirchhoff"), *given, *times, *consistent),
            )
        )
        rows = history(tmp_path / str(step))
        exact = {"A.u_y": (1 - np.cos(3 * rows["t"])) / 10, "A.v_y": 0.3 * np.sin(3 * rows["t"])}
        found.append(
            {name: np.abs(rows[name] - e).max() / np.abs(e).max() for name, e in exact.items()}
        )
    for name, (error, rate) in orders(found).items():
        print(f"rho_inf = {rho_inf}: {name} errors {error}, order {rate[-1]:.2f}, theory 2")
        assert rate[-1] > 2 - SLACK and error[-1] < 0.01


def test_a_steady_beam_under_its_weight_bends_as_the_theory_of_slender_beams(tmp_path):
    """Clamped on the left, plane strain: w = ρ g A L⁴/(8 E' I), E' = E/(1 - ν²); shear adds 0.8
    (H/L)², here 3e-4.

    It turns by much more than it is strained: its tolerance of 1e-10 is below the round-off of its
    residual.
    """
    length = 1.0
    height = 0.02
    weight = 1e-4
    young = 1000.0
    poisson = 0.3
    mesh = (
        f"mesh.x.points=[0.0, {length}]",
        f"mesh.y.points=[0.0, {height}]",
        "mesh.x.cells=[40]",
        "mesh.y.cells=[2]",
    )
    solid = (
        f"material.0.solid={{law='saint_venant_kirchhoff', young={young}, poisson={poisson},"
        " density=1.0}"
    )
    sides = "boundary=[{on='left', displacement={x=0, y=0}}, {on=['right','bottom','top']}]"
    load = (
        f"body_force={{solid={{y={-weight}}}}}",
        f"probe.0.at=[{length}, {height / 2}]",
        "time.step=1.0",
    )
    run_here(
        Job(
            BAR,
            str(tmp_path / "run"),
            (*mesh, solid, sides, *load, *STEADY, "coupling.tangent=newton"),
        )
    )
    computed = history(tmp_path / "run")["A.u_y"][-1]
    exact = -weight * height * length**4 / (8 * young / (1 - poisson**2) * height**3 / 12)
    print(
        f"tip: computed {computed:.6e}, slender beam {exact:.6e}, error"
        f" {abs(computed / exact - 1):.1e}"
    )
    assert (
        abs(computed / exact - 1) < 5e-3
    )  # the clamp hinders the lateral strain over a part H/L of the length, 0.2 ... 0.4 H/L
    assert sin(abs(exact)) == pytest.approx(abs(exact), rel=1e-3)  # small enough for the theory


def test_an_inverted_solid_is_refused(tmp_path):
    """A law without ln J has equilibria of inverted elements; the step that finds one fails, and
    smaller ones go around it.
    """
    sides = (
        "boundary=[{on='bottom', displacement={x=0, y=0}}, {on='top', displacement={x=0,"
        " y='-1.3*t'}}, {on=['left','right']}]"
    )
    alone = "mesh.order=1", "mesh.y.cells=[1]", "coupling.on_failure=stop"
    given = law("saint_venant_kirchhoff"), sides, *STEADY, "time.step=1.0", *alone
    with pytest.raises(
        ConvergenceError,
        match=r"element of the solid is inverted at t = .* s, element at \(.*\) m.*smaller step",
    ):
        run_here(Job(BAR, str(tmp_path / "run"), given))


def test_a_tolerance_below_round_off_is_named():
    convergence = Convergence(1e-12)
    convergence.start_step()
    for residual in (1.0, 1e-4, 1e-9, 3e-10, 4e-10, 3e-10, 5e-10, 3e-10):
        assert not convergence.reached(
            {"solid momentum": (residual, 1.0), "volume": (0.0, 0.0)}, 0.0, {}
        )
    assert re.search(
        r"round-off; raise coupling.tolerance above 3e-10$", str(convergence.failure(1.0, 2, "try"))
    )
    convergence.start_step()
    for residual in (1.0, 0.5, 0.9, 0.5):
        convergence.reached({"solid momentum": (residual, 1.0), "volume": (0.0, 0.0)}, 0.0, {})
    assert str(convergence.failure(1.0, 2, "try less")).endswith("try less")
