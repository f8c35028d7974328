"""Viscoelastic solids: closed forms of the generalized Maxwell body, order in time, restart."""

from dataclasses import replace

import mpmath
import numpy as np
import pytest
from numpy.testing import assert_allclose
from running import SCENES, Job, fields, largest_difference, needs_mpirun, run_here, run_on
from scipy.linalg import expm

from porofsi_petsc import load_scene
from porofsi_petsc.errors import InputError
from porofsi_petsc.linalg.options import start
from porofsi_petsc.materials import ELASTIC
from porofsi_petsc.materials.viscoelastic import Branch
from porofsi_petsc.registry import examples
from porofsi_petsc.simulation.simulation import Simulation

BAR = str(SCENES / "bar.toml")
MU, E_C = 5.0, 16.0  # of the scene [Pa]
G, TAU = 0.5, 0.4  # of the branch of most tests [-], [s]
PRONY = f"material.0.solid.prony=[{{modulus={G}, time={TAU}}}]"
TWO = "material.0.solid.prony=[{modulus=0.5, time=0.4}, {modulus=0.25, time=2.0}]"
QUASI_STATIC = (
    "model.solid_inertia=false",
    "model.fluid_inertia=false",
    "limits.inertia=report",
)
STRESS = "probe.0.quantities=['u_y', 'stress_yy', 'stress_xx']"
LAW = {name: law(6.0, MU, 0.4, **examples(law)) for name, law in ELASTIC.items() if not law.plastic}


@pytest.fixture(scope="module", autouse=True)
def petsc():
    start()


def moved(motion):
    """Return the change of the scene by which its top moves, without a load."""
    return f"boundary.2.displacement={{x=0.0, y='{motion}'}}"


def probed(*changes):
    """Return the history of the bar."""
    simulation = Simulation(load_scene(BAR, (*QUASI_STATIC, STRESS, *changes)))
    simulation.run()
    return simulation.history


# -- the law ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", LAW)
@pytest.mark.parametrize("d", [2, 3])
def test_the_stress_at_the_end_is_that_of_the_variables_there(name, d):
    law = replace(LAW[name], prony=(Branch(0.7, 0.3), Branch(0.2, 4.0)))
    random = np.random.default_rng(3)
    before, H = 0.05 * random.standard_normal((2, 4, d, d))
    internal = law.updated(np.zeros((4, law.memory)), 0.2, before)
    end = law.after(law.updated(internal, 0.1, H), 0.0).stress(H)
    assert_allclose(law.after(internal, 0.1).stress(H), end, atol=1e-12 * E_C)


@pytest.mark.parametrize("name", LAW)
@pytest.mark.parametrize("d", [2, 3])
def test_the_tangent_is_the_slope_of_the_stress(name, d):
    law = replace(LAW[name], prony=(Branch(0.7, 0.3), Branch(0.2, 4.0)))
    random = np.random.default_rng(1)
    before, H = 0.05 * random.standard_normal((2, 4, d, d))
    internal = law.updated(np.zeros((4, law.memory)), 0.2, before)
    body = law.after(internal, 0.1)
    step = 1e-5
    slope = np.zeros((4, d, d, d, d))
    for k, L in np.ndindex(d, d):
        change = np.zeros((d, d))
        change[k, L] = step
        slope[..., k, L] = (body.stress(H + change) - body.stress(H - change)) / (2 * step)
    assert_allclose(body.tangent(H), slope, atol=1e-7 * E_C)
    assert_allclose(body.mixed_tangent(H, H), slope, atol=1e-7 * E_C)


def test_the_stress_turns_with_the_body():
    law = replace(LAW["neo_hookean"], prony=(Branch(0.7, 0.3),))
    random = np.random.default_rng(2)
    first, second = 0.1 * random.standard_normal((2, 3, 3))
    Q = np.linalg.qr(random.standard_normal((3, 3)))[0]
    Q *= np.linalg.det(Q)
    stresses = []
    for turn in (np.eye(3), Q):
        internal = law.updated(np.zeros(law.memory), 0.2, first)
        stresses.append(law.after(internal, 0.1).stress(turn @ (second + np.eye(3)) - np.eye(3)))
    assert_allclose(stresses[1], Q @ stresses[0], atol=1e-13)


def test_complex_modulus():
    """A harmonic strain has the stress E_c (1 + Σ g iωτ/(1 + iωτ)) times it."""
    branches = Branch(0.7, 0.3), Branch(0.4, 3.0)
    law = replace(LAW["linear_elastic"], prony=branches)
    omega = 2.0
    n = 200  # steps in a period
    dt = 2 * np.pi / omega / n
    strain = np.sin(omega * dt * np.arange(12 * n + 1))
    internal = np.zeros(law.memory)
    stresses = []
    for value in strain[1:]:
        H = np.diag([0.0, value, 0.0])
        internal = law.updated(internal, dt, H)
        stresses.append(law.after(internal, 0.0).stress(H)[1, 1])
    phase = np.exp(-1j * omega * dt * np.arange(1, n + 1))
    measured = 2j * (stresses[-n:] * phase).mean()
    modulus = 1 + sum(g * 1j * omega * tau / (1 + 1j * omega * tau) for g, tau in branches)
    assert abs(measured / (E_C * modulus) - 1) < 2e-4  # (ω Δt)²/12 = 8e-5


# -- runs ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("scheme", ["rho_inf=0.0", "rho_inf=1.0"])
def test_order_in_time_under_a_smooth_motion(scheme):
    """σ = E_c (ε + g ∫ exp(-(t - s)/τ) ε' ds) with ε = 0.1 sin 2t, at t = 1."""
    lag = 1 / TAU
    rate = 0.2 * (lag * np.cos(2) + 2 * np.sin(2) - lag * np.exp(-lag)) / (lag**2 + 4)
    exact = E_C * (0.1 * np.sin(2) + G * rate)
    errors = [
        probed(PRONY, moved("0.1*sin(2*t)"), f"time.step={1 / n}", f"time.{scheme}")["A.stress_yy"][
            -1
        ]
        - exact
        for n in (8, 16, 32)
    ]
    assert abs(errors[-1]) < 1e-3 * exact
    assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), 2, atol=0.1)


def test_creep():
    """A load that lasts: ε = σ/E_c [1 - g/(1 + g) exp(-t/((1 + g) τ))]."""
    load = "boundary.2.traction={y=0.01}"
    found = probed(PRONY, load, "time.rho_inf=0.0", "time.step=0.005", "time.end=2.0")
    retarded = (1 + G) * TAU
    exact = 0.01 / E_C * (1 - G / (1 + G) * np.exp(-found["t"][1:] / retarded))
    # The jump of the load is a ramp over the first step, Δt/(2 τ) of g/(1 + g)²; it fades.
    assert largest_difference(found["A.u_y"][1:], exact) < 2e-3
    assert abs(found["A.u_y"][-1] / exact[-1] - 1) < 1e-4


def test_free_vibration_is_damped():
    """Of the mode sin(πy/2), k = π/2: u' = v, ρ v' = -k² E_c (u + q), q' = g v - q/τ, from rest;
    second order with inertia.
    """
    stiffness = (np.pi / 2) ** 2 * E_C / 2.0  # over the density of the scene
    rates = np.array([[0, 1, 0], [-stiffness, 0, -stiffness], [0, G, -1 / TAU]])
    exact = 0.01 * expm(rates)[0, 0]
    changes = (
        PRONY,
        "initial.displacement={x=0.0, y='0.01*sin(pi*y/2)'}",
        "mesh.y.cells=[8]",
        "time.consistent_start=true",
        "coupling.tolerance=1e-8",
    )
    errors = []
    for n in (20, 40):
        simulation = Simulation(load_scene(BAR, (*changes, f"time.step={1 / n}")))
        simulation.run()
        errors.append(simulation.history["A.u_y"][-1] - exact)
    assert abs(np.log2(errors[0] / errors[1]) - 2) < 0.1
    assert abs(4 * errors[1] - errors[0]) / 3 < 1e-4 * 0.01


@pytest.mark.parametrize("name", ["neo_hookean", "saint_venant_kirchhoff", "mooney_rivlin"])
def test_relaxation_at_large_strain_tends_to_the_elastic_law(name):
    """Of a stretch that is held after the first step the overstress fades by exp(-t/τ)."""
    changes = PRONY, moved("0.3"), "time.step=0.2", "time.end=8.0", "coupling.tangent=newton"
    more = ("material.0.solid.share=0.3",) if name == "mooney_rivlin" else ()
    law = f"material.0.solid.law={name}", *more
    history = probed(*changes, *law, "time.rho_inf=0.0")
    t, found = (history[column][1:] for column in ("t", "A.stress_yy"))
    H = np.diag([0.0, 0.3, 0.0])
    elastic = LAW[name].stress(H)[1, 1]  # the area that bears it is that at rest
    first = G * TAU / 0.2 * (1 - np.exp(-0.2 / TAU))
    assert_allclose(found, elastic * (1 + first * np.exp((0.2 - t) / TAU)), rtol=1e-6)
    assert abs(found[-1] / elastic - 1) < 1e-8


def test_a_steady_scene_has_the_relaxed_stress():
    changes = moved("0.2*t"), "time.scheme=steady", "time.step=0.5"
    relaxed, elastic = (probed(*changes, *more)["A.stress_yy"] for more in ((PRONY,), ()))
    assert_allclose(relaxed, elastic, rtol=1e-12)


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
@pytest.mark.parametrize("order", [1, 2])
def test_stress_and_reaction_of_every_element(cell, order):
    """The stress at the nodes and the force on the foot, which is of the residual, are equal."""
    changes = (
        TWO,
        moved("0.2*t"),
        f"mesh.cell_type={cell}",
        "mesh.diagonal=right",
        f"mesh.order={order}",
        "material.0.solid.law=neo_hookean",
        "surface=[{name='F', on='bottom', quantities=['force']}]",
        "time.step=0.1",
    )
    found = probed(*changes)
    assert found["A.stress_yy"][-1] > 1.2 * LAW["neo_hookean"].stress(np.diag([0, 0.2, 0.0]))[1, 1]
    force = 0.25 * found["A.stress_yy"][-1]
    assert abs(found["F.f_y"][-1] / force - 1) < 2e-3  # the force is on a line in time


@pytest.mark.parametrize("order", [1, 2])
def test_ring_is_stretched_as_the_plane(order):
    """Around an axis the uniform stretch along it has the stress of plane strain."""
    changes = (
        TWO,
        moved("0.2*t"),
        "material.0.solid.law=neo_hookean",
        "time.step=0.1",
        f"mesh.order={order}",
    )
    plane, ring = (
        probed(*changes, *more)["A.stress_yy"] for more in ((), ("mesh.axisymmetric=true",))
    )
    assert_allclose(ring[1:], plane[1:], rtol=1e-8)


def test_reference_solutions_are_of_elastic_soils():
    with pytest.raises(InputError, match=r"reference.solution.*received 'terzaghi' with material"):
        load_scene("terzaghi", ("material.0.solid.prony=[{modulus=1.0, time=1.0}]",))


def test_bad_branches_are_refused():
    with pytest.raises(InputError, match=r"material.0.solid.prony.0.time"):
        load_scene(BAR, ("material.0.solid.prony=[{modulus=1.0, time=0.0}]",))
    with pytest.raises(InputError, match=r"material.0.solid.prony.*at least 1"):
        load_scene(BAR, ("material.0.solid.prony=[]",))


def test_consolidation():
    """Settlement and pressure at the base against Terzaghi's solution in Laplace's variable with
    E_c (1 + s τ/(1 + s τ)).
    """
    changes = "mesh.y.cells=[6]", "time.end=5.0", "output.fields_every=1000", "expect=[]"
    simulation = Simulation(load_scene("viscoelastic_consolidation", changes))
    simulation.run()
    found = simulation.history
    E_c, permeability, load, height, tau = 19.541e6, 1e-7, 1e4, 10.0, 20.0

    def modulus(s):
        return E_c * (1 + s * tau / (1 + s * tau))

    def decay(s):
        return mpmath.sqrt(s / (permeability * modulus(s)))

    settled = mpmath.invertlaplace(
        lambda s: load / s / modulus(s) * mpmath.tanh(decay(s) * height) / decay(s), 5.0
    )
    pressed = mpmath.invertlaplace(
        lambda s: load / s * (1 - 1 / mpmath.cosh(decay(s) * height)), 5.0
    )
    assert abs(found["top.u_y"][-1] / -float(settled) - 1) < 2e-3
    assert abs(found["base.p"][-1] / float(pressed) - 1) < 4e-3


# -- checkpoints and ranks -------------------------------------------------------------------------

SWAY = (
    TWO,
    "boundary.2.traction={x='0.4*sin(3*t)', y='0.5*t'}",
    "material.0.solid.law=neo_hookean",
    "mesh.order=1",
    "mesh.x.cells=[2]",
    "time.end=0.6",
    "output.checkpoint_every=6",
)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    run_here(Job(BAR, str(folder), SWAY))
    return folder


def test_restart_continues_identically(whole, tmp_path):
    half = str(whole / "checkpoint.previous.h5")
    run_here(Job(BAR, str(tmp_path / "rest"), SWAY, restart=half))
    expected, found = (fields(f / "checkpoint.h5") for f in (whole, tmp_path / "rest"))
    assert expected["solid.cell_internal"].shape == (16, 1, 27)
    assert np.abs(expected["solid.cell_internal"]).max() > 0.1
    for name, array in expected.items():
        assert np.array_equal(found[name], array), name


@needs_mpirun
def test_ranks_change_nothing_nor_does_a_restart_on_others(whole, tmp_path):
    run_on(2, [Job(BAR, str(tmp_path / "two"), SWAY)], tmp_path)
    half = str(tmp_path / "two" / "checkpoint.previous.h5")
    run_here(Job(BAR, str(tmp_path / "one"), SWAY, restart=half))
    expected = fields(whole / "checkpoint.h5")
    for name in ("solid.u", "solid.cell_internal"):
        for ranks in ("two", "one"):
            found = fields(tmp_path / ranks / "checkpoint.h5")[name]
            assert largest_difference(found, expected[name]) < 1e-9, name
