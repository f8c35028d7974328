"""Accelerators on fixed points that are known: what converges, how fast, and that a step forgets
the ones before.
"""

import numpy as np
import pytest
from mpi4py import MPI

from porofsi_petsc.accelerators import ACCELERATORS

COMM = MPI.COMM_WORLD
N = 8
# on the error of the fixed point, far above the round-off of vectors of order one
TOLERANCE = 1e-10


def dot(a, b):
    return float(np.vdot(a, b))


def linear_map(eigenvalues, seed=1):
    """Return F(x) = A x + b with a symmetric A of given eigenvalues, and its fixed point."""
    rng = np.random.default_rng(seed)
    Q = np.linalg.qr(rng.standard_normal((len(eigenvalues),) * 2))[0]
    A = Q @ np.diag(eigenvalues) @ Q.T
    exact = rng.standard_normal(len(eigenvalues))
    return (lambda x: exact + A @ (x - exact)), exact


def iterations(accelerator, F, exact, cap=100):
    """Return the number of evaluations of F until x is within TOLERANCE of the exact fixed point,
    cap when it never is.
    """
    x = np.zeros_like(exact)
    for iteration in range(1, cap + 1):
        x = accelerator.next(x, F(x))
        if np.abs(x - exact).max() < TOLERANCE:
            return iteration
    return cap


CONTRACTION = np.linspace(0.0, 0.7, N)
EXPANSION = np.array([-1.5, -1.45, -1.4, -1.35, -1.3, -1.25, -1.2, -1.1])
MIXED = np.array([-1.5, -1.2, -0.6, -0.1, 0.0, 0.3, 0.5, 0.7])


@pytest.mark.parametrize("name", ACCELERATORS)
def test_every_accelerator_converges_where_the_plain_iteration_does(name):
    F, exact = linear_map(CONTRACTION)
    plain = iterations(ACCELERATORS["none"](dot), F, exact)
    # the error falls by 0.7 in each iteration: ln(1e-10)/ln(0.7) = 65, a few less because the first
    # error is not in one mode
    assert 50 < plain <= 66
    count = iterations(ACCELERATORS[name](dot), F, exact, cap=200)
    assert count <= {"none": plain, "constant": 2.6 * plain, "aitken": 0.8 * plain}.get(name, N + 4)


@pytest.mark.parametrize("name, most", [("aitken", 15), ("anderson", N + 4), ("iqn_ils", N + 4)])
def test_a_mildly_expanding_map_needs_aitken_or_anderson(name, most):
    """One factor 1/(1 + 1.3) serves the whole spectrum between -1.5 and -1.1."""
    F, exact = linear_map(EXPANSION)
    assert iterations(ACCELERATORS["none"](dot), F, exact) == 100
    assert iterations(ACCELERATORS[name](dot), F, exact) <= most


@pytest.mark.parametrize("name", ["anderson", "iqn_ils"])
def test_least_squares_end_a_linear_problem_in_as_many_iterations_as_it_has_dimensions(name):
    F, exact = linear_map(MIXED)
    assert iterations(ACCELERATORS["none"](dot), F, exact) == 100
    assert (
        iterations(ACCELERATORS[name](dot), F, exact) <= N + 3
    )  # Krylov: N + 1; the rest is the Gram matrix's round-off


@pytest.mark.parametrize("name", ["anderson", "iqn_ils"])
def test_least_squares_converge_where_the_plain_iteration_triples_an_error(name):
    F, exact = linear_map(np.array([-3.0, -2.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6]))
    assert iterations(ACCELERATORS[name](dot), F, exact) <= N + 4


def nonlinear_map(x):
    """Return F(x) of a map whose Jacobian at its fixed point 0 has the eigenvalues -3 … 0.6 and
    that bends by a tenth.
    """
    return np.array([-3.0, -1.0, 0.1, 0.3, 0.4, 0.6]) * x + 0.1 * np.roll(x, 1) ** 2


@pytest.mark.parametrize("name", ["anderson", "iqn_ils"])
def test_least_squares_solve_a_bent_diverging_map(name):
    x = 0.5 * np.ones(6)
    accelerator = ACCELERATORS[name](dot)
    for _ in range(25):
        x = accelerator.next(x, nonlinear_map(x))
    assert np.abs(x).max() < TOLERANCE


def moved(F, shift):
    """Return the same map about a fixed point moved by the shift: the next time step of a linear
    problem.
    """
    return lambda x: shift + F(x - shift)


def test_quasi_newton_solves_the_next_steps_of_a_linear_problem_with_the_columns_of_the_first():
    F, exact = linear_map(MIXED)
    counts = {}
    for reuse in (0, 1):
        accelerator = ACCELERATORS["iqn_ils"](dot, reuse_steps=reuse)
        shifts = (0.0, *np.random.default_rng(3).random((3, N)))
        counts[reuse] = []
        for shift in shifts:
            accelerator.begin_step()
            counts[reuse].append(iterations(accelerator, moved(F, shift), exact + shift))
    assert min(counts[0]) >= N
    assert (
        counts[1][0] == counts[0][0] and max(counts[1][1:]) <= 3
    )  # one, and two more for the filtered part and round-off


def test_quasi_newton_goes_on_from_its_columns_as_if_nothing_had_happened():
    """A restart gives the new accelerator what `columns` returned; a step of its own afterwards is
    the same to the last digit.
    """
    F, exact = linear_map(MIXED)
    first = ACCELERATORS["iqn_ils"](dot, reuse_steps=2)
    for shift in (0.0, 0.1, 0.2):
        first.begin_step()
        x = np.zeros(N)
        for _ in range(3):
            x = first.next(x, moved(F, shift)(x))
    second = ACCELERATORS["iqn_ils"](dot, reuse_steps=2)
    results = []
    second.load(first.columns())
    for accelerator in (first, second):
        accelerator.begin_step()
        x = np.zeros(N)
        for _ in range(3):
            x = accelerator.next(x, moved(F, 0.3)(x))
        results.append(x)
    assert np.array_equal(*results)


def test_quasi_newton_drops_the_columns_that_newer_ones_contain():
    """Three steps of a map of rank one: the residuals change along one line, of which one column is
    enough.
    """
    accelerator = ACCELERATORS["iqn_ils"](dot, reuse_steps=3)
    direction = np.array([1.0, 2.0, 2.0])
    for _ in range(3):
        accelerator.begin_step()
        x = np.zeros(3)
        for _ in range(3):
            x = accelerator.next(x, direction * (1 - direction @ x))
    assert sum(map(len, accelerator.columns())) == 1


@pytest.mark.parametrize("omega", [0.3, 0.5, 1.0])
def test_constant_relaxation_has_the_rate_of_its_factor(omega):
    accelerator = ACCELERATORS["constant"](dot, omega)
    eigenvalue = -0.4
    x = np.ones(3)
    for _ in range(5):
        x = accelerator.next(x, eigenvalue * x)
    assert np.allclose(
        x, (1 - omega * (1 - eigenvalue)) ** 5, rtol=1e-13, atol=0
    )  # round-off of five products


@pytest.mark.parametrize("name", ["aitken", "anderson", "iqn_ils"])
def test_a_scalar_equation_is_solved_by_secants(name):
    """x = cos x: the plain iteration gains a factor 0.674 per step, a secant squares the error and
    more.
    """
    exact = np.array([0.7390851332151607])
    assert iterations(ACCELERATORS["none"](dot), np.cos, exact) > 50
    assert iterations(ACCELERATORS[name](dot, guard=(0.05, 1.6)), np.cos, exact) <= 8


def test_aitken_computes_the_factor_of_its_formula_within_its_guard():
    x0 = np.array([0.0, 0.0])
    x1 = np.array([1.0, 2.0])
    F0 = np.array([1.0, 2.0])
    F1 = np.array([1.5, 1.0])
    r0 = F0 - x0
    r1 = F1 - x1
    omega = -r0 @ (r1 - r0) / ((r1 - r0) @ (r1 - r0))
    for guard, expected in (((0.05, 1.6), omega), ((0.8, 1.6), 0.8), ((0.05, 0.1), 0.1)):
        accelerator = ACCELERATORS["aitken"](dot, guard=guard)
        assert np.array_equal(accelerator.next(x0, F0), F0)
        assert np.allclose(
            accelerator.next(x1, F1), x1 + expected * r1, rtol=1e-15, atol=0
        )  # one rounding


@pytest.mark.parametrize("name", ACCELERATORS)
def test_a_restart_forgets_the_steps_before(name):
    F, exact = linear_map(MIXED)
    accelerator = ACCELERATORS[name](dot)
    x = np.zeros(N)
    first = []
    second = []
    for sequence in (first, second):
        accelerator.restart()
        x = np.zeros(N)
        for _ in range(6):
            x = accelerator.next(x, F(x))
            sequence.append(x)
    assert np.array_equal(first, second)


@pytest.mark.parametrize("name", ACCELERATORS)
def test_a_fixed_point_stays_where_it_is(name):
    """Two equal residuals have no difference to divide by."""
    accelerator = ACCELERATORS[name](dot)
    x = np.arange(3.0)
    for _ in range(4):
        assert np.array_equal(accelerator.next(x, x), x)


@pytest.mark.mpi
@pytest.mark.parametrize("name", ACCELERATORS)
def test_a_distributed_vector_gives_the_iterates_of_the_whole_one(name):
    F, exact = linear_map(MIXED)
    mine = slice(*(N * np.array([COMM.rank, COMM.rank + 1]) // COMM.size))
    whole = ACCELERATORS[name](dot)
    part = ACCELERATORS[name](lambda a, b: float(COMM.allreduce(np.vdot(a, b))))
    x = np.zeros(N)
    for _ in range(6):
        y = F(x)
        local = part.next(x[mine], y[mine])
        x = whole.next(x, y)
        assert np.allclose(
            local, x[mine], rtol=0, atol=1e-11
        )  # the order of sums over ranks, through a least-squares problem
