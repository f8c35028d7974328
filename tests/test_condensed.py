"""The solid's answer condensed to the interface: what it is, how it enters the matrix, and the
sweeps that are left.
"""

import numpy as np
import pytest
from manufactured import steps_to_end
from mpi4py import MPI
from petsc4py import PETSc
from running import SCENES

from porofsi_petsc import load_scene
from porofsi_petsc.coupling.condensed import CondensedCoupling
from porofsi_petsc.coupling.interface import InterfaceCoupling
from porofsi_petsc.errors import InputError
from porofsi_petsc.linalg.dense_block import DenselyCoupled
from porofsi_petsc.linalg.options import start
from porofsi_petsc.phases.condensed import CondensedSolid
from porofsi_petsc.simulation import interface
from porofsi_petsc.simulation.simulation import Simulation
from porofsi_petsc.studies.trial import attempt

FLAP = str(SCENES / "flap.toml")
SMALL = ("mesh.x.cells=[2, 2, 2]", "mesh.y.cells=[2, 2]")


def coupling_of(name, *changes, options=""):
    """Return the coupling of a scene of the tests."""
    start(options)
    scene = load_scene(str(SCENES / name), changes)
    return scene, Simulation(scene, MPI.COMM_SELF).coupling


# -- the operator ----------------------------------------------------------------------------------


def test_the_answer_is_the_schur_complement_of_the_tangent():
    """S = K_ΓΓ - K_ΓI K_II⁻¹ K_IΓ by dense algebra of the solid's matrix; to round-off times its
    condition, 1e4.
    """
    scene, coupling = coupling_of("flap.toml", *SMALL)
    solid = coupling.solid
    fluid = coupling.fluid
    time, schemes, rates = next(steps_to_end(scene))
    coupling.step(schemes, rates, time, 1)
    answer = CondensedSolid(solid, fluid)
    answer.renew()
    node, component = fluid.interface_unknowns.T
    on = solid.domain.numbering[node] * 2 + component
    K = solid.block.matrix.mat[:, :]
    inside = np.setdiff1d(np.arange(len(K)), on)
    schur = K[np.ix_(on, on)] - K[np.ix_(on, inside)] @ np.linalg.solve(
        K[np.ix_(inside, inside)], K[np.ix_(inside, on)]
    )
    assert len(on) == answer.size > 8
    assert np.abs(answer.stiffness - schur).max() < 1e-9 * np.abs(schur).max()
    u = np.random.default_rng(1).normal(size=(solid.mesh.n_owned, 2))
    force = answer.force(u)
    assert np.allclose(force[node, component], schur @ u[node, component], rtol=1e-8)
    force[node, component] = 0.0
    assert not force.any()


def test_a_dense_block_is_added_to_the_present_values_of_a_matrix():
    """In any order of its unknowns, again after the matrix has changed, over entries that it has
    already.
    """
    rng = np.random.default_rng(2)
    dense = np.diag(rng.normal(size=9)) + np.diag(rng.normal(size=8), 1)
    unknowns = np.array([7, 1, 4, 5])
    matrix = PETSc.Mat().createAIJ((9, 9), comm=PETSc.COMM_SELF)
    matrix.setUp()
    coupled = None
    for factor in (1.0, -3.0):
        for i, j in np.argwhere(dense):
            matrix.setValue(i, j, factor * dense[i, j])
        matrix.assemble()
        block = rng.normal(size=(4, 4))
        coupled = coupled or DenselyCoupled(matrix, unknowns)
        coupled.assemble(block)
        expected = factor * dense
        expected[np.ix_(unknowns, unknowns)] += block
        assert np.allclose(coupled.mat[:, :], expected, rtol=1e-14)


# -- sweeps ----------------------------------------------------------------------------------------

# The bar of the partitioned iteration, by defaults. Measured over ten steps: 3.7 to 6.2 on average,
# 9 at most.
BAR = 12


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("ratio", [1.0, 0.1])
@pytest.mark.parametrize("poisson", [0.3, 0.49, 0.4999])
def test_neither_a_light_nor_an_incompressible_solid_takes_many_sweeps(poisson, ratio, order):
    """A flap in the jump of a flow, density ρ_s/ρ_f; Dirichlet-Neumann with IQN-ILS fails at ν =
    0.4999 in the fourth step.
    """
    changes = [f"material.1.solid.poisson={poisson}", f"material.1.solid.density={1000 * ratio}"]
    outcome = attempt(
        load_scene(
            FLAP, [*changes, f"mesh.order={order}", "limits.locking=report", "time.end=0.05"]
        )
    )
    print(f"nu = {poisson}, rho_s/rho_f = {ratio}, order {order}: sweeps {outcome.iterations}")
    assert not outcome.failure
    assert max(outcome.iterations) <= BAR


def test_a_closed_fluid_takes_its_pressure_from_the_solid():
    """Told the velocity all around it would have no level of pressure; the flap gives it one."""
    closed = (
        "boundary=[{on=['left','right','bottom','top'], velocity={x=0, y=0}, displacement={x=0,"
        " y=0}}]"
    )
    outcome = attempt(load_scene(FLAP, [closed, "body_force.solid.x=1.0", "time.end=0.03"]))
    assert not outcome.failure
    assert max(outcome.iterations) <= BAR


# -- where it is taken -----------------------------------------------------------------------------


def test_it_is_what_a_scene_in_the_plane_gets():
    assert isinstance(coupling_of("flap.toml")[1], CondensedCoupling)


@pytest.mark.parametrize(
    ("scene", "changes", "options", "reason"),
    [
        ("block_in_channel3d.toml", (), "", "with iterative solvers"),
        ("flap.toml", (), "-fluid_ksp_type gmres -fluid_pc_type ilu", "with iterative solvers"),
        ("flap.toml", (), "-solid_ksp_type cg", "with iterative solvers"),
    ],
)
def test_elsewhere_it_is_refused_and_not_taken_by_itself(scene, changes, options, reason):
    assert isinstance(coupling_of(scene, *changes, options=options)[1], InterfaceCoupling)
    with pytest.raises(
        InputError, match=rf"\[coupling\.interface\]: received 'condensed' {reason}.*; take"
    ):
        coupling_of(scene, *changes, "coupling.interface=condensed", options=options)
    start()


def test_a_long_interface_is_left_to_sweeps(monkeypatch):
    monkeypatch.setattr(interface, "CONDENSED", 10)
    assert isinstance(coupling_of("flap.toml")[1], InterfaceCoupling)
    with pytest.raises(
        InputError,
        match="received 'condensed' with 22 unknowns on the interface, expected 10 at most",
    ):
        coupling_of("flap.toml", "coupling.interface=condensed")


@pytest.mark.parametrize("scheme", ["weak", "one_way"])
def test_a_scheme_that_does_not_see_the_trial_solid_cannot_have_its_answer(scheme):
    with pytest.raises(
        InputError,
        match=rf"received 'condensed', expected 'dirichlet_neumann' with scheme = '{scheme}'",
    ):
        load_scene(FLAP, [f"coupling.scheme={scheme}", "coupling.interface=condensed"])
