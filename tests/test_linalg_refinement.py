"""Iterations of FieldSplit stay bounded under refinement, for every drag and step; solvers that
fail say why.
"""

import os
import subprocess
import sys

import numpy as np
import pytest
from linalg_model import FluidBlock
from mpi4py import MPI
from running import HELPERS, ROOT

from porofsi_petsc.errors import ConvergenceError, InputError
from porofsi_petsc.linalg import options

options.start()

from petsc4py import PETSc  # noqa: E402

from porofsi_petsc.linalg import fieldsplit  # noqa: E402
from porofsi_petsc.linalg.solver import LinearSolver, direct_defaults  # noqa: E402


def iterations(dim, n, has_auxiliary, **physics):
    """Return the iterations to 1e-6 and the relative error of the pressure."""
    block = FluidBlock(MPI.COMM_SELF, dim, n, has_auxiliary, **physics)
    A = block.matrix("fluid_")
    rhs = block.load()
    exact = LinearSolver(A.mat, "exact_", direct_defaults())
    expected = exact.solve(rhs)[dim :: block.block_size]
    exact.destroy()
    defaults = fieldsplit.fluid_defaults(dim, direct=False) | {"ksp_rtol": 1e-6}
    options.set_defaults("fluid_", defaults)
    fields = fieldsplit.fluid_fields(MPI.COMM_SELF, 0, len(block.X), dim, block.block_size)
    solver = LinearSolver(A.mat, "fluid_", defaults, fields=fields)
    pressure = solver.solve(rhs)[dim :: block.block_size]
    count = solver.iterations_max
    solver.destroy()
    A.destroy()
    return count, np.linalg.norm(pressure - expected) / np.linalg.norm(expected)


@pytest.mark.parametrize("package", ["hypre", "gamg"])
@pytest.mark.parametrize("has_auxiliary", [False, True])
@pytest.mark.parametrize("drag_number", [0.0, 1.0, 1e4, 1e8])
@pytest.mark.parametrize("dim, meshes", [(2, (8, 32)), (3, (4, 8))])
def test_iterations_are_bounded_under_refinement(
    monkeypatch, dim, meshes, drag_number, has_auxiliary, package
):
    if package == "gamg":
        monkeypatch.setattr(fieldsplit, "has_package", lambda name: False)
    elif not options.has_package("hypre"):
        pytest.skip("PETSc without hypre")
    coarse, fine = (iterations(dim, n, has_auxiliary, drag_number=drag_number) for n in meshes)
    assert fine[0] <= min(30, 2 * coarse[0] + 5)
    assert fine[1] < 1e-3  # the pressure is not left to the velocity's rows


@pytest.mark.parametrize("step", [1e-5, 1e-4, 1e-2, 1.0])
def test_iterations_are_bounded_for_every_step(step):
    assert iterations(2, 24, True, step=step)[0] <= 30


@pytest.mark.parametrize("direct", [True, False])
def test_a_solver_recovers_from_a_matrix_that_is_not_finite(direct):
    """As after a step that diverged, where the next one is shorter; MUMPS keeps the error of its
    last factorization.
    """
    block = FluidBlock(MPI.COMM_SELF, 2, 6, False)
    A = block.matrix("fluid_")
    rhs = block.load()
    defaults = fieldsplit.fluid_defaults(2, direct)
    options.set_defaults("fluid_", defaults)
    fields = fieldsplit.fluid_fields(MPI.COMM_SELF, 0, len(block.X), 2, block.block_size)
    solver = LinearSolver(A.mat, "fluid_", defaults, fields=None if direct else fields)
    sound = A.mat.copy()
    A.mat.scale(np.nan)
    with pytest.raises(ConvergenceError):
        solver.solve(rhs)
    sound.copy(A.mat)
    solver.refactor()
    x = solver.solve(rhs)
    residual = sound.createVecRight()
    sound.mult(PETSc.Vec().createWithArray(x, comm=MPI.COMM_SELF), residual)
    assert np.linalg.norm(residual.getArray() - np.ravel(rhs)) < 1e-3 * np.linalg.norm(rhs)
    solver.destroy()


def test_interpreter_exits_cleanly_with_a_living_python_preconditioner():
    pytest.importorskip("pyamg")
    code = """
from porofsi_petsc.linalg import options
options.start("-solid_pc_type python -solid_pc_python_type porofsi_petsc.linalg.pyamg_pc.PyAMG")
from mpi4py import MPI
from linalg_model import ElasticBlock
from porofsi_petsc.linalg.fieldsplit import rigid_body_modes, solid_defaults
from porofsi_petsc.linalg.solver import LinearSolver
block = ElasticBlock(MPI.COMM_SELF, 2, 4)
modes = rigid_body_modes(block.X_owned, MPI.COMM_SELF)
solver = LinearSolver(block.matrix("solid_").mat, "solid_", solid_defaults(2, False), modes)
solver.solve(block.load())
"""
    env = os.environ | {
        "PYTHONPATH": os.pathsep.join([str(HELPERS), str(ROOT)]),
        "OMP_NUM_THREADS": "1",
    }
    done = subprocess.run(
        [sys.executable, "-c", code], env=env, capture_output=True, text=True, timeout=60
    )
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(
    "text, reason",
    [
        ("-odd_pc_type shell", "No apply"),
        ("-odd_pc_type python", "-pc_python_type"),
        ("-odd_pc_type lsc -odd_ksp_type gmres", "seqaij"),
    ],
)
def test_a_solver_that_cannot_work_is_wrong_input(text, reason):
    """PETSc notices it at the set-up or only in the solve."""
    options.start(command_line=text.split())
    A = FluidBlock(MPI.COMM_SELF, 2, 2, False).matrix("odd_")
    solver = LinearSolver(A.mat, "odd_", {"ksp_type": "preonly"})
    with pytest.raises(
        InputError, match=f"a solver -odd_… cannot work: .*{reason}.*; choose another"
    ):
        solver.solve(np.ones(A.mat.getSize()[0]))
    solver.destroy()
    A.destroy()
    options.start()


@pytest.mark.parametrize("stage", ["setUp", "solve"])
@pytest.mark.parametrize("code", [55, 76])
def test_any_other_error_of_petsc_is_a_failed_solve(stage, code):
    """Out of memory, error in an external library."""

    class Failing:
        def __getattr__(self, name):
            return fail if name == stage else getattr(ksp, name)

    def fail(*_):
        raise PETSc.Error(code)

    A = FluidBlock(MPI.COMM_SELF, 2, 2, False).matrix("bad_")
    solver = LinearSolver(A.mat, "bad_", direct_defaults())
    ksp = solver.ksp
    solver.ksp = Failing()
    with pytest.raises(ConvergenceError, match="linear solver bad_: its (set-up|solve) failed: "):
        solver.solve(np.ones(A.mat.getSize()[0]))
    solver.destroy()
    A.destroy()


def test_the_advice_of_a_solver_that_fails_names_the_options():
    A = FluidBlock(MPI.COMM_SELF, 2, 4, False).matrix("few_")
    solver = LinearSolver(A.mat, "few_", {"ksp_type": "gmres", "pc_type": "none", "ksp_max_it": 1})
    with pytest.raises(
        ConvergenceError, match=r"direct solver \(-few_ksp_type preonly -few_pc_type lu\)"
    ):
        solver.solve(np.arange(A.mat.getSize()[0]) + 1.0)
    solver.destroy()
    A.destroy()


@pytest.mark.parametrize(
    "text", ["-odd_pc_type nosuch", "-odd_pc_type lu -odd_pc_factor_mat_solver_type nosuch"]
)
def test_a_solver_that_petsc_lacks_is_wrong_input(text):
    options.start(command_line=text.split())
    A = FluidBlock(MPI.COMM_SELF, 2, 2, False).matrix("odd_")
    with pytest.raises(InputError, match="-odd_.*nosuch"):
        LinearSolver(A.mat, "odd_", {"ksp_type": "preonly"}).solve(np.ones(A.mat.getSize()[0]))
    A.destroy()
    options.start()
