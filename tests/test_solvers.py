"""Iterative solvers on the matrices of real scenes: bounded under refinement, and invisible to the
coupling iteration.
"""

from dataclasses import replace

import numpy as np
import pytest
from solver_scenes import Case, solve

from porofsi_petsc.linalg import options


@pytest.fixture(autouse=True)
def clean_options():
    yield
    options.start()


# Coarse and fine mesh; largest number of FGMRES iterations.  On short steps the static part of the
# undrained term, which acts on what is not linear in an element, is thousands of times the rest of
# the pressure block: multigrid pays for it on T10 (55 of 3 to 5 cells a side).  There odd and even
# numbers of cells split the loaded edge differently and are not compared.
MESHES = {(2, 1): (8, 32, 12), (2, 2): (4, 16, 18), (3, 1): (3, 6, 14), (3, 2): (3, 5, 60)}
# Without hypre GAMG takes up to 2.6 times as many (PETSc 3.25.5: 46 on T6, 104 on T10 at the static
# part; else 20 at most), as bounded under refinement.
WORSE, MORE = (1.0, 3) if options.has_package("hypre") else (2.6, 5)
PHYSICS = {
    "free fluid, small step": {"k": 1e-2, "dt": 1e-4},
    "free fluid, large step": {"k": 1e-2, "dt": 1e-1},
    "drag": {"k": 1e-5, "dt": 1e-3},
    "undrained": {"k": 1e-9, "dt": 1e-2},
    "quasi-static": {"k": 1e-5, "dt": 1e-1, "dynamic": False},
    "Brinkman": {"k": 1e-2, "dt": 1e-3, "viscous": True},
    "finite strain": {"k": 1e-2, "dt": 1e-3, "finite": True},
}


@pytest.mark.parametrize("physics", PHYSICS)
@pytest.mark.parametrize("dim, order", MESHES)
def test_iterations_are_bounded_under_refinement(dim, order, physics):
    coarse, fine, cap = MESHES[dim, order]
    case = Case(dim=dim, order=order, coupling={"tolerance": 1e-4}, **PHYSICS[physics])
    before, after = (solve(replace(case, n=n), direct=False, steps=1) for n in (coarse, fine))
    assert after.fluid <= min(WORSE * cap, 1.5 * before.fluid + MORE)
    assert after.solid <= min(20, 1.5 * before.solid + 5)


@pytest.mark.skipif(
    not options.has_package("hypre"), reason="the default without hypre is tested already"
)
@pytest.mark.parametrize("dt", [1e-4, 1e-1])
def test_gamg_takes_the_place_of_hypre(monkeypatch, dt):
    from porofsi_petsc.linalg import fieldsplit

    monkeypatch.setattr(fieldsplit, "has_package", lambda name: False)
    assert solve(Case(n=24, dt=dt), direct=False, steps=1).fluid <= 12


@pytest.mark.parametrize("k", [1e-2, 1e-5, 1e-9, 1e-12])
@pytest.mark.parametrize("dt", [1e-4, 1e-2])
def test_coupling_takes_as_many_iterations_as_with_direct_solvers(k, dt):
    case = Case(n=12, k=k, dt=dt)
    direct = solve(case, direct=True)
    iterative = solve(case, direct=False)
    # at k = 1e-12 m/s round-off of the drag leaves residuals of 1e-7 with a direct solver too,
    # close to the tolerance of 1e-6
    assert np.abs(np.subtract(direct.coupling, iterative.coupling)).max() <= (
        2 if k == 1e-12 else 1
    )
    assert direct.fluid == 1 < iterative.fluid


@pytest.mark.parametrize("k, tolerance", [(1e-2, 1e-11), (1e-5, 1e-11)])
def test_iterative_solvers_do_not_floor_the_coupling(k, tolerance):
    case = Case(n=8, k=k, coupling={"tolerance": tolerance})
    direct = solve(case, direct=True)
    iterative = solve(case, direct=False)
    for name in ("u", "v", "p"):
        a = getattr(direct, name)
        b = getattr(iterative, name)
        # residuals of 1e-11 of the largest force, times the condition of the coupled problem
        # (measured: up to 1e-9)
        assert np.linalg.norm(a - b) < 1e-8 * np.linalg.norm(a), name


def test_multigrid_leaves_prescribed_displacements_alone():
    outcome = solve(Case(n=8), direct=False, petsc="-solid_ksp_rtol 1e-2 -fluid_ksp_rtol 1e-2")
    X = outcome.mesh.X
    natural = outcome.mesh.natural
    u = outcome.u[natural]
    assert np.all(u[X[:, 0] == 0, 0] == 0) and np.all(u[X[:, 1] == 0, 1] == 0)
    assert np.abs(u).max() > 0


def test_fieldsplit_without_pspg_uses_the_assembled_schur_complement():
    from porofsi_petsc.linalg.fieldsplit import fluid_defaults

    with_pspg, without = (fluid_defaults(2, direct=False, pspg=pspg) for pspg in (True, False))
    assert with_pspg["pc_fieldsplit_schur_precondition"] == "a11"
    assert without["pc_fieldsplit_schur_precondition"] == "selfp"
