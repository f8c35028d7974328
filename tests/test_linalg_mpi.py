"""Distributed matrices and solvers against dense linear algebra, on any number of ranks."""

import numpy as np
import pytest
from linalg_model import ElasticBlock, FluidBlock
from mpi4py import MPI
from petsc4py import PETSc

from porofsi_petsc.errors import ConvergenceError, InputError
from porofsi_petsc.linalg import options

options.start()

from porofsi_petsc.linalg.fieldsplit import (  # noqa: E402
    fluid_defaults,
    fluid_fields,
    rigid_body_modes,
    solid_defaults,
)
from porofsi_petsc.linalg.solver import LinearSolver  # noqa: E402

pytestmark = pytest.mark.mpi
COMM = MPI.COMM_WORLD


def gathered(array):
    return np.concatenate(COMM.allgather(np.ravel(array)))


def dense(mat):
    indptr, indices, values = mat.getValuesCSR()
    rows = np.zeros((len(indptr) - 1, mat.getSize()[1]))
    np.add.at(rows, (np.repeat(np.arange(len(indptr) - 1), np.diff(indptr)), indices), values)
    return np.concatenate(COMM.allgather(rows))


@pytest.mark.parametrize("empty_last_rank", [False, True])
def test_matrix_equals_dense_assembly(empty_last_rank):
    block = FluidBlock(COMM, 2, 4, has_auxiliary=True, empty_last_rank=empty_last_rank)
    A = block.matrix("dense_")
    expected = block.dense()
    free = ~block.constrained
    assert np.allclose(
        dense(A.mat)[np.ix_(free, free)], expected[np.ix_(free, free)], rtol=1e-12, atol=0
    )
    A.destroy()


def test_constrained_rows_carry_the_mean_diagonal_of_their_component():
    block = FluidBlock(COMM, 2, 4, has_auxiliary=False)
    A = block.matrix("diagonal_")
    matrix = dense(A.mat)
    bs = block.block_size
    for row in np.flatnonzero(block.constrained):
        same = (np.arange(len(matrix)) % bs == row % bs) & ~block.constrained
        assert matrix[row, row] == pytest.approx(np.abs(np.diag(matrix))[same].mean(), rel=1e-12)
        assert np.count_nonzero(matrix[row]) == np.count_nonzero(matrix[:, row]) == 1
    A.destroy()


def test_assembly_replaces_the_values_bitwise():
    block = FluidBlock(COMM, 2, 3, has_auxiliary=False)
    A = block.matrix("replace_")
    first = A.mat.getValuesCSR()[2].copy()
    A.assemble(3.0 * block.element_matrices)
    assert not np.array_equal(A.mat.getValuesCSR()[2], first) or first.size == 0
    A.clear()
    for start in range(0, len(block.element_matrices), 5):
        A.add(slice(start, start + 5), block.element_matrices[start : start + 5])
    A.finish()
    assert np.array_equal(A.mat.getValuesCSR()[2], first)
    A.destroy()


def test_matrix_type_without_an_array_of_values_is_refused():
    PETSc.Options().setValue("refused_mat_type", "baij")
    with pytest.raises(InputError, match="refused_.*baij.*aij.*remove"):
        FluidBlock(COMM, 2, 3, has_auxiliary=False).matrix("refused_")
    PETSc.Options().delValue("refused_mat_type")


TIGHT = {"ksp_rtol": 1e-8}


@pytest.mark.parametrize("dim, has_auxiliary", [(2, False), (2, True), (3, False), (3, True)])
def test_fieldsplit_agrees_with_the_dense_solution(dim, has_auxiliary):
    block = FluidBlock(COMM, dim, 6 if dim == 2 else 3, has_auxiliary=has_auxiliary)
    A = block.matrix("fluid_")
    rhs = block.load()
    fields = fluid_fields(COMM, block.first_node, block.n_owned_nodes, dim, block.block_size)
    solver = LinearSolver(A.mat, "fluid_", fluid_defaults(dim, direct=False) | TIGHT, fields=fields)
    matrix = dense(A.mat)  # before it is scaled
    solution = solver.solve(rhs)
    x = gathered(solution)
    expected = np.linalg.solve(matrix, gathered(rhs))
    for component in range(
        block.block_size
    ):  # rtol 1e-8 on a diagonally scaled system; the units do not mix any more
        a = x[component :: block.block_size]
        b = expected[component :: block.block_size]
        assert np.linalg.norm(a - b) < 1e-5 * np.linalg.norm(b)
    assert solver.iterations_max <= 60
    assert_same(solver.solve(rhs), solution)  # a solve leaves the matrix as it was
    solver.destroy()
    A.destroy()


def test_fieldsplit_is_right_again_after_it_failed():
    """The matrix, scaled in place, is not scaled a second time for another attempt."""
    block = FluidBlock(COMM, 2, 6, has_auxiliary=True)
    A = block.matrix("fluid_")
    fields = fluid_fields(COMM, block.first_node, block.n_owned_nodes, 2, block.block_size)
    solver = LinearSolver(A.mat, "fluid_", fluid_defaults(2, direct=False) | TIGHT, fields=fields)
    first = solver.solve(block.load())
    solver.ksp.setTolerances(max_it=1)
    with pytest.raises(ConvergenceError):
        solver.solve(block.load())
    solver.ksp.setTolerances(max_it=500)
    assert_same(solver.solve(block.load()), first)
    solver.destroy()
    A.destroy()


@pytest.mark.parametrize("viscous", [False, True])
def test_fieldsplit_stays_right_while_the_matrix_changes_under_its_preconditioner(viscous):
    block = FluidBlock(COMM, 2, 5, has_auxiliary=True)
    A = block.matrix("fluid_")
    fields = fluid_fields(COMM, block.first_node, block.n_owned_nodes, 2, block.block_size)
    solver = LinearSolver(
        A.mat, "fluid_", fluid_defaults(2, direct=False, viscous=viscous) | TIGHT, fields=fields
    )
    first = gathered(solver.solve(block.load()))
    A.assemble(1.5 * block.element_matrices)
    solver.update()
    second = gathered(
        solver.solve(block.load())
    )  # the old preconditioner on the new matrix, scaled anew
    solver.refactor()
    third = gathered(solver.solve(block.load()))
    assert np.linalg.norm(second - first / 1.5) < 1e-6 * np.linalg.norm(first)
    assert np.linalg.norm(third - second) < 1e-6 * np.linalg.norm(first)
    assert solver.factorizations == 2
    A.assemble(block.element_matrices)
    free = ~block.constrained
    assert np.allclose(
        dense(A.mat)[np.ix_(free, free)], block.dense()[np.ix_(free, free)], rtol=1e-12
    )  # not left scaled
    solver.destroy()
    A.destroy()


def elastic_solver(prefix, defaults):
    block = ElasticBlock(COMM, 3, 4)
    A = block.matrix(prefix)
    A.declare_symmetric()
    solver = LinearSolver(
        A.mat, prefix, defaults, near_nullspace=rigid_body_modes(block.X_owned, COMM)
    )
    return block, A, solver


def require(name):
    """Skip the test of a preconditioner that this PETSc or Python lacks."""
    if name == "hypre" and not options.has_package("hypre"):
        pytest.skip("PETSc without hypre")
    if name == "pyamg":
        pytest.importorskip("pyamg")


def assert_same(first, second):
    """Compare to the last bit, on several ranks to round-off: there sums are made in the order in
    which messages come.
    """
    first = gathered(first)
    second = gathered(second)
    assert np.linalg.norm(first - second) <= (
        1e-12 * np.linalg.norm(first) if COMM.size > 1 else 0.0
    )


PYAMG = {
    "pc_type": "bjacobi",
    "sub_pc_type": "python",
    "sub_pc_python_type": "porofsi_petsc.linalg.pyamg_pc.PyAMG",
}


@pytest.mark.parametrize(
    "name, defaults",
    [
        ("gamg", solid_defaults(3, direct=False) | TIGHT),
        ("direct", solid_defaults(3, direct=True)),
        ("hypre", solid_defaults(3, direct=False) | TIGHT | {"pc_type": "hypre"}),
        ("pyamg", solid_defaults(3, direct=False) | TIGHT | PYAMG),
    ],
)
def test_displacement_solvers_agree_with_the_dense_solution(name, defaults):
    require(name)
    block, A, solver = elastic_solver(f"solid_{name}_", defaults)
    x = gathered(solver.solve(block.load()))
    expected = np.linalg.solve(dense(A.mat), gathered(block.load()))
    assert np.linalg.norm(x - expected) < 1e-5 * np.linalg.norm(
        expected
    )  # rtol 1e-8 times the condition number's root
    # multigrid does not know the number of ranks; subdomains without a coarse space do (7, 30, 40,
    # 48, 56 on 1, 2, 3, 5, 8 ranks)
    assert solver.iterations_max <= (20 if name != "pyamg" else 10 + 20 * COMM.size**0.5)
    solver.destroy()
    A.destroy()


BLOCKS = {"pc_type": "bjacobi", "sub_pc_type": "icc"}


@pytest.mark.parametrize("name", ["gamg", "hypre", "icc", "pyamg"])
def test_a_new_preconditioner_is_that_of_a_new_solver(name):
    """After `refactor` nothing of the matrix before is left, blocks and interpolations neither: a
    restart goes on identically.
    """
    require(name)
    choice = {"gamg": {}, "hypre": {"pc_type": "hypre"}, "icc": BLOCKS, "pyamg": PYAMG}[name]
    defaults = solid_defaults(3, direct=False) | choice
    solutions = []
    for kind in ("old", "new"):
        block, A, solver = elastic_solver(f"{kind}_{name}_", defaults)
        if kind == "old":
            solver.solve(block.load())
        diagonal = A.mat.getDiagonal()
        diagonal.setArray(diagonal.getArray() * (2 + np.sin(block.X_owned).ravel()))
        A.mat.setDiagonal(diagonal)
        solver.refactor()
        solutions.append(solver.solve(block.load()))
        solver.destroy()
        A.destroy()
    assert_same(*solutions)  # interpolation, blocks or random numbers of before: 1e-6 and more


def test_rigid_body_modes_are_orthonormal_and_strain_free():
    block = ElasticBlock(COMM, 3, 3, constrained=False)
    A = block.matrix("rigid_")
    modes = np.array([gathered(mode) for mode in rigid_body_modes(block.X_owned, COMM)])
    assert modes.shape[0] == 6
    assert np.allclose(modes @ modes.T, np.eye(6), atol=1e-12)
    matrix = dense(A.mat)
    assert np.abs(matrix @ modes.T).max() < 1e-10 * np.abs(matrix).max()
    A.destroy()


def test_preconditioner_is_kept_while_it_is_good_and_rebuilt_when_worn():
    defaults = solid_defaults(3, direct=True) | {"ksp_type": "gmres", "ksp_rtol": 1e-10}
    block, A, solver = elastic_solver("reuse_", defaults)
    rhs = block.load()
    solver.solve(rhs)
    A.assemble(1.0001 * block.element_matrices)
    solver.update()
    solver.solve(rhs)
    assert solver.factorizations == 1
    A.assemble(block.softened())
    solver.update()
    solver.solve(rhs)  # many iterations with the old preconditioner
    assert solver.factorizations == 1 and solver.iterations[-1] > 4
    solver.update()
    x = solver.solve(rhs)
    assert solver.factorizations == 2 and solver.iterations[-1] <= 2
    assert np.allclose(
        gathered(x), np.linalg.solve(dense(A.mat), gathered(rhs)), rtol=1e-6, atol=1e-12
    )
    solver.destroy()
    A.destroy()


def test_direct_solver_factors_after_an_update_only():
    block, A, solver = elastic_solver("factor_", solid_defaults(3, direct=True))
    first = gathered(solver.solve(block.load()))
    A.assemble(2.0 * block.element_matrices)
    assert np.allclose(gathered(solver.solve(block.load())), first, rtol=1e-12)
    solver.update()
    assert np.allclose(gathered(solver.solve(block.load())), first / 2, rtol=1e-9)
    assert (solver.solves, solver.factorizations) == (3, 2)
    solver.refactor()
    solver.solve(block.load())
    assert solver.setup_time > 0 and solver.solve_time > 0
    solver.destroy()
    A.destroy()


def test_failure_names_prefix_reason_and_hint():
    block, A, solver = elastic_solver(
        "poor_", {"ksp_type": "cg", "ksp_max_it": 2, "ksp_rtol": 1e-12, "pc_type": "none"}
    )
    with pytest.raises(
        ConvergenceError, match=r"poor_ .*DIVERGED_MAX_IT after 2 iterations.*-poor_ksp_monitor"
    ):
        solver.solve(block.load())
    solver.destroy()
    A.destroy()


def test_nan_in_a_direct_solve_is_an_error():
    block, A, solver = elastic_solver("nan_", solid_defaults(3, direct=True))
    rhs = block.load()
    rhs[:1] = np.nan
    with pytest.raises(ConvergenceError, match="DIVERGED_NANORINF"):
        solver.solve(rhs)
    solver.destroy()
    A.destroy()
