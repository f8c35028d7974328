"""Whole small runs by every recipe of configs/petsc equal those with MUMPS, on any number of ranks and with a poor PETSc."""

from pathlib import Path

import numpy as np
import pytest
from running import SCENES, Job, history, largest_difference, run_here, state, summary

import porofsi_petsc.linalg.fieldsplit as fieldsplit
from porofsi_petsc.linalg import options, solver

pytestmark = pytest.mark.mpi
RECIPES = Path(__file__).resolve().parent.parent / "configs" / "petsc"
TIGHT = ("coupling.tolerance=1e-10", "time.end=0.003", "output.checkpoint_every=100")
PULSE = ("mesh.order=1", "mesh.x.cells=[5, 2, 5]", "mesh.y.cells=[6]", *TIGHT)
RUNS = {"2-D": ("pulse2d", PULSE), "3-D": (str(SCENES / "block3d.toml"), TIGHT)}
# Coupling residuals of 1e-10 of the largest force, times the condition of the coupled problem (measured: 4e-12 to 2e-9).
SAME = 2e-8


@pytest.fixture(autouse=True)
def clean_options():
    yield
    options.start()


@pytest.fixture(scope="module")
def shared(tmp_path_factory):
    from mpi4py import MPI

    return MPI.COMM_WORLD.bcast(tmp_path_factory.mktemp("runs"))


@pytest.fixture(scope="module", params=RUNS)
def reference(request, shared):
    """Return the scene, its changes, and the results with MUMPS."""
    if not options.has_package("mumps"):
        pytest.skip("PETSc without MUMPS")
    return *RUNS[request.param], run(*RUNS[request.param], shared / request.param, ("direct",))


def run(scene, changes, folder, recipes):
    words = [word for name in recipes for word in ("-options_file", str(RECIPES / f"{name}.opt"))]
    run_here(Job(scene, str(folder), changes, petsc_options=tuple(words)))
    return history(folder), state(folder / "checkpoint.h5"), summary(folder)


def assert_same(a, b):
    for column in a[0]:
        if column != "coupling_iterations":
            assert largest_difference(a[0][column], b[0][column]) < SAME, column
    assert a[1].keys() == b[1].keys()
    for name in ("solid.u", "solid.v", "fluid.v", "fluid.p"):
        assert largest_difference(a[1][name], b[1][name]) < SAME, name


@pytest.mark.parametrize("recipe", [path.stem for path in sorted(RECIPES.glob("*.opt")) if path.stem != "direct"])
def test_recipe_gives_the_results_of_mumps(reference, recipe, shared_path):
    if "hypre" in (RECIPES / f"{recipe}.opt").read_text() and not options.has_package("hypre"):
        pytest.skip("PETSc without hypre")
    if recipe == "solid_pyamg":
        pytest.importorskip("pyamg")
    scene, changes, expected = reference
    computed = run(scene, changes, shared_path / "run", (recipe,))
    assert_same(computed, expected)
    iterations = computed[2]["linear_iterations"]["fluid" if recipe.startswith("fluid") else "solid"]
    assert 1 < iterations["max"] <= 25
    assert np.abs(computed[0]["coupling_iterations"] - expected[0]["coupling_iterations"]).max() <= 1


def test_run_works_without_external_packages(reference, shared_path, monkeypatch):
    for module in (fieldsplit, solver):
        monkeypatch.setattr(module, "has_package", lambda name: False)
    scene, changes, expected = reference
    assert_same(run(scene, changes, shared_path / "poor", ()), expected)


@pytest.mark.parametrize("package", ["mumps", "hypre"])
def test_run_works_without_one_package(reference, shared_path, monkeypatch, package):
    has = options.has_package
    for module in (fieldsplit, solver):
        monkeypatch.setattr(module, "has_package", lambda name: name != package and has(name))
    scene, changes, expected = reference
    assert_same(run(scene, changes, shared_path / package, ()), expected)
