"""Plasticity of Drucker and Prager: the law, samples at failure against closed forms, collapse."""

from math import cos, radians, sin, sqrt, tan

import numpy as np
import pytest
from numpy.testing import assert_allclose
from running import SCENES, Job, fields, largest_difference, needs_mpirun, run_here, run_on

from porofsi_petsc import load_scene
from porofsi_petsc.errors import ConvergenceError, InputError
from porofsi_petsc.linalg.options import start
from porofsi_petsc.materials import ELASTIC
from porofsi_petsc.materials.drucker_prager import MATCHES
from porofsi_petsc.phases.line_search import shorten
from porofsi_petsc.simulation.simulation import Simulation

SAMPLE = str(SCENES / "plastic_sample.toml")
POROUS = str(SCENES / "footing_porous.toml")
C, PHI, PSI, YOUNG = 1e4, radians(30), radians(10), 1e7  # of the sample [Pa]
SIDE = 2e4  # its confining pressure [Pa]
SOLID = "material.0.solid."
ROUND_OFF = 1e-9  # of stresses at the tolerance of the iteration, over the strength


@pytest.fixture(scope="module", autouse=True)
def petsc():
    start()


def body(friction=30.0, dilatancy=10.0, hardening=0.0, match="plane_strain"):
    return ELASTIC["drucker_prager"](
        6.0,
        5.0,
        cohesion=0.3,
        friction_angle=friction,
        dilatancy_angle=dilatancy,
        hardening=hardening,
        match=match,
    )


def history(scene, *changes):
    simulation = Simulation(load_scene(scene, changes))
    simulation.run()
    return simulation.history


# -- the law ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("hardening", [0.0, 2.0])
@pytest.mark.parametrize(
    "friction, dilatancy", [(0.0, 0.0), (30.0, 0.0), (30.0, 10.0), (30.0, 30.0)]
)
@pytest.mark.parametrize("d", [2, 3])
def test_the_tangent_is_the_slope_of_the_stress(d, friction, dilatancy, hardening):
    """Inside the cone, on it and at its apex; symmetric where the law says so."""
    law = body(friction, dilatancy, hardening)
    random = np.random.default_rng(1)
    before, H = 0.05 * random.standard_normal((2, 60, d, d))
    H += 0.08 * random.standard_normal((60, 1, 1)) * np.eye(d)
    H[::4] = 0.95 * before[::4]  # unloaded
    step = law.after(law.updated(np.zeros((60, law.memory)), 0.0, before), 0.0)
    change = 1e-7
    slope = np.zeros((60, d, d, d, d))
    for k, L in np.ndindex(d, d):
        e = np.zeros((d, d))
        e[k, L] = change
        slope[..., k, L] = (step.stress(H + e) - step.stress(H - e)) / (2 * change)
    end = step.returned(H)
    assert end.elastic.any() and not end.elastic.all()
    assert end.apex.any() == (friction > 0)
    # truncation and round-off of the differences, 1e-8, over moduli of 16
    assert_allclose(step.tangent(H), slope, atol=1e-6)
    if law.symmetric:
        A = step.tangent(H)
        assert_allclose(A, np.moveaxis(A, (1, 2), (3, 4)), atol=1e-13)


@pytest.mark.parametrize("d", [2, 3])
def test_the_stress_at_the_end_is_that_of_the_variables_there(d):
    law = body(hardening=2.0)
    before, H = 0.1 * np.random.default_rng(3).standard_normal((2, 40, d, d))
    internal = law.updated(np.zeros((40, law.memory)), 0.0, before)
    end = law.after(law.updated(internal, 0.0, H), 0.0)
    assert_allclose(law.after(internal, 0.0).stress(H), end.stress(H), atol=1e-13)
    assert end.returned(H).elastic.all()
    assert_allclose(end.energy(H), law.after(internal, 0.0).energy(H), atol=1e-14)


@pytest.mark.parametrize("match", MATCHES)
def test_cones_meet_the_pyramid_where_they_say(match):
    """√J2 + α I1 = κ c on principal stresses at the yield stress of Mohr and Coulomb."""
    N = (1 + sin(PHI)) / (1 - sin(PHI))
    other, least = SIDE, SIDE * N + 2 * C * sqrt(N)  # pressures
    cone = MATCHES[match](PHI, PHI)
    middle = {"compression": other, "extension": least}.get(match)
    if middle is None:  # s_zz = -2 ᾱ √J2 of a flow in the plane
        tau = (least - other) / 2
        middle = (least + other) / 2 + 3 * cone.slope * tau / sqrt(1 - 3 * cone.slope**2)
    stress = -np.array([least, middle, other])
    s = stress - stress.mean()
    root = sqrt(s @ s / 2)
    assert root + cone.slope * stress.sum() == pytest.approx(cone.strength * C, rel=1e-12)


def test_the_associated_cone_of_plane_strain_is_that_of_drucker_and_prager():
    root = sqrt(9 + 12 * tan(PHI) ** 2)
    assert_allclose(MATCHES["plane_strain"](PHI, PHI), (tan(PHI) / root, 3 / root), rtol=1e-14)


def test_pure_shear():
    """Without dilatancy τ = κ (c + h ε̄), beyond μ γ: dτ/dγ = 1/(1/μ + √3/(κ h))."""
    law = body(friction=20.0, dilatancy=0.0, hardening=2.0)
    kappa = cos(radians(20.0))
    first = kappa * 0.3 / law.mu
    slope = 1 / (1 / law.mu + sqrt(3) / (kappa * 2.0))
    internal = np.zeros(law.memory)
    for gamma in (0.5 * first, 2 * first, 5 * first):
        H = np.array([[0.0, gamma], [0.0, 0.0]])
        tau = law.after(internal, 0.0).stress(H)[0, 1]
        exact = law.mu * min(gamma, first) + slope * max(gamma - first, 0.0)
        assert tau == pytest.approx(exact, rel=1e-13)
        internal = law.updated(internal, 0.0, H)


@pytest.mark.parametrize("match", MATCHES)
@pytest.mark.parametrize("dilatancy", [0.0, 30.0])
def test_isotropic_extension_ends_at_the_apex(match, dilatancy):
    """At c cot φ of every cone, with or without dilatancy."""
    law = body(dilatancy=dilatancy, hardening=2.0, match=match)
    for strain in (1e-3, 0.1):
        stress = law.after(np.zeros(law.memory), 0.0).stress(strain * np.eye(3))
        pressure = min(3 * law.bulk * strain, 0.3 / tan(PHI))
        assert_allclose(stress, pressure * np.eye(3), atol=1e-15)


# -- samples ---------------------------------------------------------------------------------------


def test_triaxial_compression_fails_as_mohr_and_coulomb_say():
    """Around an axis, under a confining pressure; with hardening at the slope of the law."""
    N = (1 + sin(PHI)) / (1 - sin(PHI))
    found = history(SAMPLE, "mesh.axisymmetric=true")
    strength = SIDE * N + 2 * C * sqrt(N)
    assert found["A.stress_yy"][-1] == pytest.approx(-strength, rel=ROUND_OFF)
    assert_allclose(found["A.stress_xx"][-1], -SIDE, rtol=ROUND_OFF)
    # dε^p = dλ (-1/√3 + ᾱ) along the axis, dε̄ = dλ/√3
    flow = MATCHES["compression"](PSI, PSI).slope
    elastic = (strength - 2 * 0.3 * SIDE) / YOUNG
    plastic = -found["A.u_y"][-1] - elastic
    assert found["A.plastic_strain"][-1] == pytest.approx(
        plastic / (1 / sqrt(3) - flow) / sqrt(3), rel=1e-8
    )


def test_hardening_slope_of_triaxial_compression():
    """dσ/dε = 1/(1/E + (1/√3 - ᾱ)(1/√3 - α) √3/(κ h)) under a constant pressure at the side."""
    h = 1e5
    found = history(SAMPLE, "mesh.axisymmetric=true", f"{SOLID}hardening={h}")
    (alpha, kappa), flow = MATCHES["compression"](PHI, PSI), MATCHES["compression"](PSI, PSI).slope
    root = 1 / sqrt(3)
    exact = 1 / (1 / YOUNG + (root - flow) * (root - alpha) * sqrt(3) / (kappa * h))
    slope = np.diff(found["A.stress_yy"])[-2:] / np.diff(found["A.u_y"])[-2:]
    assert_allclose(slope, exact, rtol=1e-7)  # differences of stresses at ROUND_OFF


@pytest.mark.parametrize("psi", [0.0, 10.0, 30.0])
def test_plane_strain_compression_fails_as_mohr_and_coulomb_say(psi):
    """With the cone of plane strain, whatever the dilatancy; the stress across is that of a flow in
    the plane.
    """
    N = (1 + sin(PHI)) / (1 - sin(PHI))
    stiff = f"{SOLID}young=1e9"  # the state of flow is approached with the plastic strain
    found = history(SAMPLE, stiff, f"{SOLID}match=plane_strain", f"{SOLID}dilatancy_angle={psi}")
    strength = SIDE * N + 2 * C * sqrt(N)
    assert found["A.stress_yy"][-1] == pytest.approx(-strength, rel=1e-6)  # approached by s_zz
    flow = MATCHES["plane_strain"](radians(psi), radians(psi)).slope
    tau = (strength - SIDE) / 2
    across = -(strength + SIDE) / 2 - 3 * flow * tau / sqrt(1 - 3 * flow**2)
    assert found["A.stress_zz"][-1] == pytest.approx(across, rel=1e-4)


def test_the_field_is_what_the_probe_records():
    simulation = Simulation(load_scene(SAMPLE, ("time.end=1.25",)))
    simulation.run()
    recorded = simulation.history["A.plastic_strain"][-1]
    assert recorded > 1e-3
    assert_allclose(simulation.fields["plastic_strain"], recorded, rtol=1e-8)  # uniform
    elastic = Simulation(load_scene(str(SCENES / "bar.toml")))
    assert "plastic_strain" not in elastic.fields


# -- collapse --------------------------------------------------------------------------------------

FOOTING = (
    "mesh.x.cells=[5, 5]",
    "mesh.y.cells=[6]",
    "mesh.x.ratios=[0.2, 6.0]",
    "mesh.y.ratios=[0.2]",
    "expect=[]",
    "output.fields_every=1000",
)


def loaded(*changes):
    load = "boundary.2={on='footing', traction={y='-6e4*t'}}"
    return Simulation(load_scene("footing_collapse", (*FOOTING, load, *changes)))


def test_the_footing_collapses_near_the_load_of_prandtl():
    """Ten cells across half of it: 5 % too much; `footing_collapse` has the finer mesh."""
    found = history("footing_collapse", *FOOTING)["footing.f_y"]
    assert 1.0 < found[-1] / (C * (2 + np.pi)) < 1.06
    assert found[-1] / found[-3] - 1 < 1e-3  # no more growth


def test_the_footing_on_sand_collapses_near_the_load_of_prandtl_and_reissner():
    """N_c = (N_q - 1) cot φ with the cone of plane strain and associated flow, φ = 30°: from above,
    1.6 % with these cells and 0.8 % with four times as many.
    """
    changes = (
        "mesh.x={points=[0.0, 1.0, 10.0], cells=[6, 9], ratios=[0.15, 30.0]}",
        "mesh.y={points=[-6.0, 0.0], cells=[9], ratios=[0.06]}",
        f"{SOLID}friction_angle=30.0",
        f"{SOLID}dilatancy_angle=30.0",
        f"{SOLID}poisson=0.3",
        "boundary.2.displacement={y='-0.02*t'}",
        "limits.strain=report",
        "time.step=0.2",
        "expect=[]",
    )
    N_q = np.exp(np.pi * tan(PHI)) * (1 + sin(PHI)) / (1 - sin(PHI))
    found = history("footing_collapse", *changes)["footing.f_y"]
    assert 1.0 < found[-1] / (C * (N_q - 1) / tan(PHI)) < 1.02
    assert found[-1] / found[-2] - 1 < 1e-3  # no more growth


@pytest.mark.parametrize(
    "time, after",
    [("time.scheme=steady", "load continuation"), ("time.scheme=backward_euler", "cut")],
)
def test_a_load_beyond_collapse_ends_the_run(time, after):
    simulation = loaded(time)
    with pytest.raises(ConvergenceError, match=after):
        simulation.run()
    reached = simulation.history["footing.f_y"][-1] / (C * (2 + np.pi))
    assert 0.8 < reached < 1.06


def test_tangents_that_are_not_symmetric_have_a_solver_that_takes_them():
    found = {}
    for psi in (10.0, 30.0):
        simulation = Simulation(
            load_scene(SAMPLE, (f"{SOLID}dilatancy_angle={psi}", "time.end=0.5"))
        )
        simulation.run()
        solid = simulation.coupling.solid
        found[psi] = solid.setup.is_symmetric, solid.block.solver.ksp.getPC().getType()
    assert found == {10.0: (False, "lu"), 30.0: (True, "cholesky")}


def test_the_line_search_finds_the_root_of_a_step_that_overshoots():
    """Of δ·R = -1 + 3 x + 2 x² along the step, whose root is 0.28; one that falls short is left."""
    part = [1.0]
    shorten(
        -1.0, lambda: -1 + 3 * part[0] + 2 * part[0] ** 2, lambda p: part.append(part.pop() + p)
    )
    assert abs(-1 + 3 * part[0] + 2 * part[0] ** 2) < 0.8
    assert 0.1 < part[0] < 0.5
    shorten(-1.0, lambda: -0.9, pytest.fail)


# -- porous media ----------------------------------------------------------------------------------


@pytest.mark.parametrize("permeability", [1e-3, 1e-7])
def test_the_split_reaches_the_solution_of_the_monolithic_scheme(permeability):
    changes = (
        f"material.0.permeability.k={permeability}",
        "time.end=0.75",
        "coupling.tolerance=1e-8",
    )
    split, direct = (
        history(POROUS, *changes, f"coupling.scheme={scheme}")
        for scheme in ("partitioned", "direct")
    )
    assert direct["A.plastic_strain"][-1] > 5e-3
    for name in ("A.p", "A.u_y", "A.stress_yy", "A.plastic_strain", "footing.f_y"):
        assert largest_difference(split[name], direct[name]) < 1e-6, name


@pytest.mark.parametrize("permeability, settlement", [(0.1, 5e-3), (1e-8, 1e-3)])
def test_without_friction_the_footing_collapses_alike_drained_and_undrained(
    permeability, settlement
):
    """At (2 + π) c of the total stress, 5 % too much on this mesh; undrained most of it is pressure
    of the pores.
    """
    found = history(
        POROUS,
        "mesh.x={points=[0.0, 1.0, 4.0], cells=[5, 5], ratios=[0.2, 6.0]}",
        "mesh.y={points=[-2.5, 0.0], cells=[6], ratios=[0.2]}",
        f"boundary.2={{on='footing', displacement={{y='-{settlement}*t'}}}}",
        "surface=[{name='F', on='footing', quantities=['pore_force']}]",
        f"material.0.permeability.k={permeability}",
        f"{SOLID}young=1e8",
        f"{SOLID}friction_angle=0.0",
        f"{SOLID}dilatancy_angle=0.0",
        "coupling.scheme=direct",
        "time.step=0.125",
    )
    force = found["footing.f_y"]
    assert 1.0 < force[-1] / (C * (2 + np.pi)) < 1.06
    assert force[-1] / force[-2] - 1 < 5e-3  # hardly more growth
    borne = found["F.fp_y"][-1] / force[-1]
    assert borne > 0.75 if permeability < 0.1 else borne < 1e-2


# -- input -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "change, sentence",
    [
        (f"{SOLID}dilatancy_angle=40.0", r"material.0.solid.*dilatancy_angle: received 40 degrees"),
        (f"{SOLID}cohesion=0.0", r"material.0.solid.cohesion"),
        (f"{SOLID}match=outer", r"match.*one of plane_strain, compression, extension"),
        (f"{SOLID}prony=[{{modulus=1.0, time=1.0}}]", r"prony: received branches"),
        (f"{SOLID}law=linear_elastic", r"material.0.solid"),
    ],
)
def test_bad_parameters_are_refused(change, sentence):
    with pytest.raises(InputError, match=sentence):
        load_scene(SAMPLE, (change,))


def test_linear_elements_are_refused():
    """They lock: the collapse load is far too large."""
    linear = (*FOOTING, "mesh.order=1", "time.end=0.2")
    with pytest.raises(InputError, match=r"material.0.solid.law.*which lock in a plastic flow"):
        Simulation(load_scene("footing_collapse", linear))
    reported = history("footing_collapse", *linear, "limits.locking=report", "time.end=1.0")
    assert reported["footing.f_y"][-1] > 1.15 * C * (2 + np.pi)


def test_what_needs_a_plastic_law_is_refused_without_one():
    with pytest.raises(InputError, match="probe.0.quantities.*without a plastic law"):
        load_scene(str(SCENES / "bar.toml"), ("probe.0.quantities=['plastic_strain']",))
    law = "{law='drucker_prager', young=1e7, poisson=0.3, density=2e3, cohesion=1e4"
    angles = "friction_angle=0.0, dilatancy_angle=0.0, match='plane_strain'}"
    with pytest.raises(InputError, match=r"reference.solution.*with a plastic law"):
        load_scene("terzaghi", (f"material.0.solid={law}, {angles}",))


# -- checkpoints and ranks -------------------------------------------------------------------------

PLASTIC = ("time.end=1.0", "output.checkpoint_every=2", "output.fields_every=4")


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    run_here(Job(POROUS, str(folder), PLASTIC))
    return folder


def test_restart_continues_identically(whole, tmp_path):
    half = str(whole / "checkpoint.previous.h5")
    run_here(Job(POROUS, str(tmp_path / "rest"), PLASTIC, restart=half))
    expected, found = (fields(f / "checkpoint.h5") for f in (whole, tmp_path / "rest"))
    assert expected["solid.cell_internal"][..., -1].max() > 1e-2
    for name, array in expected.items():
        assert np.array_equal(found[name], array), name


@needs_mpirun
def test_ranks_change_nothing(whole, tmp_path):
    run_on(2, [Job(POROUS, str(tmp_path / "two"), PLASTIC)], tmp_path)
    expected, found = (fields(f / "checkpoint.h5") for f in (whole, tmp_path / "two"))
    for name in ("solid.u", "fluid.p", "solid.cell_internal"):
        # of two iterations, each to the tolerance 1e-6
        assert largest_difference(found[name], expected[name]) < 1e-4, name
