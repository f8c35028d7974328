"""The tangents of the monolithic schemes against differences of the residuals of both phases, and
what Newton makes of them.
"""

import numpy as np
import pytest
from mpi4py import MPI
from small_media import (
    BRINKMAN,
    DARCY,
    FD_STEP,
    FD_TOLERANCE,
    MESHES,
    RINGS,
    VARIABLE,
    dense,
    in_motion,
)

from porofsi_petsc import load_scene
from porofsi_petsc.simulation.loop import Clock
from porofsi_petsc.simulation.simulation import Simulation

pytestmark = pytest.mark.usefixtures("petsc")
OPTIONS = {
    "Darcy": DARCY,
    "Brinkman": BRINKMAN,
    "variable porosity": DARCY + VARIABLE,
    "Brinkman, variable": BRINKMAN + VARIABLE,
}


def residuals(coupling):
    """Return the residuals of u, v_f and p of the trial state, (n_owned, 2 d + 1)."""
    coupling.fluid.follow(coupling.solid.mesh_state())
    momentum, volume = coupling.fluid.residual(coupling.solid.mesh_state())
    return np.column_stack(
        [coupling.solid.residual(coupling.fluid.flow()).total, momentum.total, volume.total]
    )


def set_unknowns(coupling, values):
    d = coupling.solid.mesh.dim
    coupling.solid.unknowns = values[:, :d]
    coupling.fluid.unknowns = values[:, d:]


def difference(coupling):
    """Return the derivative of `residuals` by the unknowns on the collocation level, dense."""
    d = coupling.solid.mesh.dim
    base = np.column_stack([coupling.solid.unknowns, coupling.fluid.unknowns]).copy()
    steps = FD_STEP * np.array([0.02] * d + [0.3] * d + [1e4])
    columns = []
    for node, component in np.ndindex(base.shape):
        values = []
        for sign in (1, -1):
            increment = np.zeros_like(base)
            increment[node, component] = sign * steps[component]
            set_unknowns(coupling, base)
            coupling.solid.add(increment[:, :d])
            coupling.fluid.add(increment[:, d:])
            values.append(residuals(coupling).ravel())
        columns.append((values[0] - values[1]) / (2 * steps[component]))
    set_unknowns(coupling, base)
    residuals(coupling)
    return np.column_stack(columns)


def in_physical_variables(system, matrix, d):
    """Return the matrix K with K δ = r for increments δ of (y, v, p) and balances r: M x = L r and
    δ = S x.
    """
    unit = np.eye(len(matrix)).reshape(len(matrix), -1, 2 * d + 1)
    L, S = (
        np.column_stack([change(column).ravel() for column in unit])
        for change in (system.combined, system.separated)
    )
    return np.linalg.solve(L, matrix) @ np.linalg.inv(S)


def block_errors(coupling, rates):
    """Return the largest error of every block (rows, columns among y, v, p) of the system's matrix
    over its largest entry.
    """
    system = coupling.system
    d = coupling.solid.mesh.dim
    expected = difference(coupling)
    system.assemble(rates)
    matrix = in_physical_variables(system, dense(system.block.matrix.mat), d)
    free = ~system.block.mask.ravel()
    component = np.tile(np.arange(2 * d + 1), len(free) // (2 * d + 1))
    fields = {
        "y": component < d,
        "v": (component >= d) & (component < 2 * d),
        "p": component == 2 * d,
    }
    errors = {}
    for row, rows in fields.items():
        for column, columns in fields.items():
            block = np.ix_(np.flatnonzero(free & rows), np.flatnonzero(free & columns))
            errors[row + column] = (
                np.abs(matrix[block] - expected[block]).max() / np.abs(expected[block]).max()
            )
    return errors


@pytest.mark.parametrize("options", OPTIONS.values(), ids=OPTIONS)
@pytest.mark.parametrize("mesh", MESHES)
def test_direct_tangent_is_the_derivative_of_both_residuals(mesh, options):
    errors = block_errors(*in_motion(mesh, *options, "coupling.scheme=direct"))
    assert max(errors.values()) < FD_TOLERANCE, errors


@pytest.mark.parametrize("options", ["Darcy", "Brinkman, variable"])
@pytest.mark.parametrize("mesh", RINGS)
def test_direct_tangent_around_an_axis_is_the_derivative(mesh, options):
    errors = block_errors(*in_motion(mesh, *OPTIONS[options], "coupling.scheme=direct"))
    assert max(errors.values()) < FD_TOLERANCE, errors


@pytest.mark.parametrize("mesh, wall", [("T6", ("1", "y")), ("Q9", ("1", "y")), ("T4", ("2", "z"))])
def test_direct_tangent_takes_walls_without_slip_along(mesh, wall):
    boundary = (
        f"boundary.{wall[0]}={{ on = 'bottom', displacement = {{ {wall[1]} = 0.0 }}, no_slip ="
        " true }"
    )
    errors = block_errors(*in_motion(mesh, *BRINKMAN, "coupling.scheme=direct", boundary))
    assert max(errors.values()) < FD_TOLERANCE, errors


COMPRESSIBLE = ("material.0.biot_coefficient=0.8", "material.0.fluid.bulk_modulus=1e7")


@pytest.mark.parametrize("constituents", [(), COMPRESSIBLE], ids=["incompressible", "compressible"])
@pytest.mark.parametrize("moving, wrong", [("false", ()), ("true", ("yy", "vy", "py"))])
def test_quasi_direct_tangent_lacks_the_moving_mesh_only(moving, wrong, constituents):
    overrides = (
        *DARCY,
        *constituents,
        "coupling.scheme=quasi_direct",
        f"model.moving_mesh={moving}",
        "limits.mesh_displacement=report",
    )
    errors = block_errors(*in_motion("T6", *overrides))
    for block, error in errors.items():
        assert (error > 100 * FD_TOLERANCE) if block in wrong else (error < FD_TOLERANCE), (
            block,
            error,
        )


LARGE = (
    "boundary.3.traction={ y = '-1e7*sin(25*pi*t)' }",
    "model.porosity=variable",
    "material.0.permeability={ law = 'markert', k = 1e-3, exponent = 2.0 }",
    "time.step=5e-3",
    "coupling.tolerance=1e-12",
)


def newton_histories(mesh, scheme, steps=4):
    """Return the largest relative residual of every iteration, step by step, of a scene with
    strains of a tenth.
    """
    name, changes = MESHES[mesh]
    scene = load_scene(name, (*changes, *LARGE, f"coupling.scheme={scheme}"))
    coupling = Simulation(scene, MPI.COMM_SELF).coupling
    clock = Clock(scene.time)
    histories = []
    for step in range(steps):
        coupling.step(*clock.next_schemes(scene.model), clock.t, step + 1)
        coupling.accept()
        clock.advance(scene.time.step, clock.next_target())
        histories.append([max(errors.values()) for errors in coupling.convergence.history])
    return histories


def constants(histories, power):
    """Return e_{k+1}/e_k^power of all iterations but the first, as long as e_{k+1} is above
    round-off, 1e-12 of the forces.
    """
    pairs = [pair for history in histories for pair in zip(history[1:], history[2:], strict=False)]
    return [after / before**power for before, after in pairs if after > 1e-12]


@pytest.mark.parametrize("mesh", ["T3", "T6"])
def test_newton_converges_quadratically_at_finite_strain(mesh):
    """A constant of e_{k+1} <= C e_k²; without the moving mesh the convergence is linear and the
    constant grows like 1/e_k.
    """
    direct, quasi_direct = (newton_histories(mesh, scheme) for scheme in ("direct", "quasi_direct"))
    assert max(constants(direct, 2)) < 1
    assert max(constants(quasi_direct, 2)) > 100
    assert max(map(len, direct)) < max(map(len, quasi_direct))
    for scheme, histories in {"direct": direct, "quasi_direct": quasi_direct}.items():
        print(scheme, *(" ".join(f"{e:.1e}" for e in history) for history in histories), sep="\n")
