"""The phases: assembled tangents against differences of their residuals; states that must not feel
a force.
"""

import numpy as np
import pytest
from small_media import (
    BRINKMAN,
    DARCY,
    FD_STEP,
    FD_TOLERANCE,
    MESHES,
    VARIABLE,
    dense,
    in_motion,
    medium,
)

from porofsi_petsc.phases.coupling_data import Flow

pytestmark = pytest.mark.usefixtures("petsc")


def difference(phase, residual, scales):
    """Return the derivative of a residual (n_owned, k) by the unknowns on the collocation level,
    dense.
    """
    base = phase.unknowns.copy()
    columns = []
    for node, component in np.ndindex(base.shape):
        values = []
        for sign in (1, -1):
            increment = np.zeros_like(base)
            increment[node, component] = sign * FD_STEP * scales[component]
            phase.unknowns = base
            phase.add(increment)
            values.append(residual().ravel())
        columns.append((values[0] - values[1]) / (2 * FD_STEP * scales[component]))
    phase.unknowns = base
    return np.column_stack(columns)


def assert_blocks_agree(matrix, expected, free, fields):
    """Compare the free rows and columns of two matrices field by field, each on the scale of its
    own block.
    """
    for rows in fields:
        for columns in fields:
            block = np.ix_(np.flatnonzero(free & rows), np.flatnonzero(free & columns))
            scale = np.abs(expected[block]).max()
            assert scale > 0
            assert np.abs(matrix[block] - expected[block]).max() < FD_TOLERANCE * scale


@pytest.mark.parametrize(
    "options",
    [DARCY, BRINKMAN, BRINKMAN + VARIABLE],
    ids=["Darcy", "Brinkman", "variable porosity"],
)
@pytest.mark.parametrize("mesh", MESHES)
def test_fluid_tangent_is_the_derivative_of_its_residual(mesh, options):
    coupling, rates = in_motion(mesh, *options)
    fluid = coupling.fluid
    d = coupling.solid.mesh.dim
    mesh_state = coupling.solid.mesh_state()

    def residual():
        momentum, volume = fluid.residual(mesh_state)
        return np.column_stack([momentum.total, volume.total])

    fluid.renew_tangent(rates, mesh_state)
    expected = difference(fluid, residual, [0.3] * d + [1e4])
    free = ~fluid.setup.mask.ravel()
    pressure = np.tile(np.arange(d + 1) == d, len(free) // (d + 1))
    assert_blocks_agree(dense(fluid.block.matrix.mat), expected, free, [~pressure, pressure])


@pytest.mark.parametrize(
    "law", ["linear_elastic", "saint_venant_kirchhoff", "neo_hookean", "neo_hookean_j2"]
)
@pytest.mark.parametrize("mesh", MESHES)
def test_solid_tangent_is_the_derivative_of_its_residual(mesh, law):
    """On the fixed mesh: on a moving one the change of the pressure term with the configuration is
    left to the iteration.
    """
    fixed = (
        "model.moving_mesh=false",
        f"material.0.solid.law={law}",
        "limits.mesh_displacement=report",
        "limits.strain=report",
    )
    coupling, rates = in_motion(mesh, *fixed)
    solid = coupling.solid
    flow = coupling.fluid.flow()
    solid.renew_tangent(rates)
    expected = difference(solid, lambda: solid.residual(flow).total, [0.02] * solid.mesh.dim)
    free = ~solid.setup.dirichlet.mask.ravel()
    assert_blocks_agree(
        dense(solid.block.matrix.mat), expected, free, [np.ones(len(free), dtype=bool)]
    )


def test_a_term_left_out_of_the_tangent_would_be_seen():
    """The corrected split's fluid tangent has a term that its residual lacks: the comparison must
    notice it.
    """
    coupling, rates = in_motion("T3", *DARCY, "coupling.split=corrected")
    fluid = coupling.fluid
    mesh_state = coupling.solid.mesh_state()
    fluid.renew_tangent(rates, mesh_state)
    m = fluid.components
    n = fluid.mesh.n_owned
    matrix = dense(fluid.block.matrix.mat).reshape(n, m, n, m)[:, :3, :, :3].reshape(3 * n, 3 * n)
    expected = difference(
        fluid,
        lambda: np.column_stack([r.total for r in fluid.residual(mesh_state)]),
        [0.3, 0.3, 1e4],
    )
    free = ~fluid.setup.mask[:, :3].ravel()
    with pytest.raises(AssertionError):
        assert_blocks_agree(
            matrix,
            expected,
            free,
            [np.ones(len(free), dtype=bool), np.tile([False, False, True], n)],
        )


# -- rigid motion and uniform flow -----------------------------------------------------------------


def rotation(dim, angle):
    Q = np.eye(dim)
    c = np.cos(angle)
    s = np.sin(angle)
    Q[:2, :2] = [[c, -s], [s, c]]
    return Q


@pytest.mark.parametrize("law", ["saint_venant_kirchhoff", "neo_hookean", "neo_hookean_j2"])
@pytest.mark.parametrize("mesh", MESHES)
def test_a_rigid_motion_has_no_stress_and_no_energy(mesh, law):
    coupling, (scheme, _), _ = medium(mesh, f"material.0.solid.law={law}")
    solid = coupling.solid
    d = coupling.solid.mesh.dim
    X = solid.mesh.X
    u = X @ rotation(d, 0.7).T - X + np.arange(1.0, d + 1)
    solid.begin_step(scheme, 0.0)
    solid.u[:] = u
    solid.unknowns = u
    at_rest = Flow(np.zeros_like(solid.u), np.zeros(solid.mesh.n_local))
    terms = solid.residual(at_rest).terms
    # round-off of P = O(1e7 Pa) integrated over faces of O(100 m^2), 1e-16 each
    assert np.abs(terms["stress"]).max() < 1e-6
    assert np.abs(terms["pressure"]).max() == np.abs(terms["drag"]).max() == 0
    assert abs(solid.energies()[1]) < 1e-6
    solid.unknowns = 1.001 * u
    assert np.abs(solid.residual(at_rest).terms["stress"]).max() > 1e3


@pytest.mark.parametrize("options", [DARCY, BRINKMAN], ids=["Darcy", "Brinkman"])
@pytest.mark.parametrize("mesh", MESHES)
def test_a_uniform_flow_on_a_moving_mesh_stays_uniform(mesh, options):
    """However the nodes move through it, a uniform flow has no inertia, no pressure and no viscous
    force: only the drag.
    """
    coupling, (solid_scheme, fluid_scheme), rates = medium(mesh, *options)
    solid = coupling.solid
    fluid = coupling.fluid
    rng = np.random.default_rng(5)
    d = solid.mesh.dim
    solid.u[:] = 0.02 * rng.standard_normal(solid.u.shape)
    solid.v[:] = 0.3 * rng.standard_normal(solid.v.shape)
    uniform = np.arange(1.0, d + 1)
    fluid.v[:] = uniform
    for phase in (solid, fluid):
        phase.reset()
    fluid.begin_step(fluid_scheme, rates, 0.0, solid.accepted_mesh_state())
    solid.begin_step(solid_scheme, 0.0)
    fluid.unknowns = np.column_stack(
        [np.tile(uniform, (fluid.mesh.n_owned, 1)), np.zeros(fluid.mesh.n_owned)]
    )
    momentum, volume = fluid.residual(solid.mesh_state())
    drag = np.abs(momentum.terms["drag"]).max()
    for name in ("inertia", "pressure", "viscous", "body"):
        assert np.abs(momentum.terms[name]).max() < 1e-12 * drag, (
            name
        )  # round-off beside the drag, the one true force
    fluid.unknowns = fluid.unknowns * (1 + 1e-6 * rng.standard_normal(fluid.unknowns.shape))
    moved, _ = fluid.residual(solid.mesh_state())
    assert np.abs(moved.terms["inertia"]).max() > 1e-9 * drag
