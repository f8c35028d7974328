"""Whole small runs by every recipe of configs/petsc equal those with MUMPS, on any number of ranks
and with a poor PETSc.
"""

import re
from pathlib import Path

import numpy as np
import pytest
from running import SCENES, Job, fields, history, largest_difference, run_here, summary

import porofsi_petsc.linalg.fieldsplit as fieldsplit
from porofsi_petsc.errors import InputError
from porofsi_petsc.linalg import options, solver

pytestmark = pytest.mark.mpi
ROOT = Path(__file__).resolve().parent.parent
RECIPES = ROOT / "configs" / "petsc"
NAMES = sorted(path.stem for path in RECIPES.glob("*.opt"))
TIGHT = ("coupling.tolerance=1e-10", "time.end=0.003", "output.checkpoint_every=100")
PULSE = ("mesh.order=1", "mesh.x.cells=[5, 2, 5]", "mesh.y.cells=[6]", *TIGHT)
FLOW = ("coupling.tolerance=1e-10", "output.checkpoint_every=100")
CHANNEL = (
    "mesh.x.cells=[2,1,5]",
    "mesh.y.cells=[1,2,1]",
    "mesh.z.cells=[2,2]",
    "time.end=0.1",
    *FLOW,
)
POROUS = {"2-D": ("pulse2d", PULSE), "3-D": (str(SCENES / "block3d.toml"), TIGHT)}
TOLD = "coupling.interface=dirichlet_neumann"  # by default another one where all is factored
FREE = {
    "2-D": (str(SCENES / "flap.toml"), ("time.end=0.02", TOLD, *FLOW)),
    "3-D": (str(SCENES / "block_in_channel3d.toml"), CHANNEL),
}
DIRECT = ("coupling.scheme=direct",)
MONOLITHIC = {name: (scene, (*changes, *DIRECT)) for name, (scene, changes) in POROUS.items()}
# Scenes that have the solver of a recipe, by the first word of its name, and what factors all their
# matrices.
RUNS = {
    "free": (FREE, ("direct",)),
    "mesh": (FREE, ("direct",)),
    "monolithic": (MONOLITHIC, ("monolithic_direct",)),
}
DEFAULT_RUNS = (POROUS, ("direct",))
# Coupling residuals of 1e-10 of the largest force, times the condition of the coupled problem
# (measured: 4e-12 to 2e-9).
SAME = 2e-8


@pytest.fixture(autouse=True)
def clean_options():
    yield
    options.start()


@pytest.fixture(scope="module")
def shared(tmp_path_factory):
    from mpi4py import MPI

    return MPI.COMM_WORLD.bcast(tmp_path_factory.mktemp("runs"))


@pytest.fixture(scope="module")
def factored(shared):
    """Return a function of scenes and dimension that gives scene, changes, and the results with
    MUMPS, made once.
    """
    if not options.has_package("mumps"):
        pytest.skip("PETSc without MUMPS")
    made = {}

    def results(first_word, dimension):
        scenes, recipes = RUNS.get(first_word, DEFAULT_RUNS)
        scene, changes = scenes[dimension]
        if (scene, changes) not in made:
            made[scene, changes] = run(scene, changes, shared / str(len(made)), recipes)
        return scene, changes, made[scene, changes]

    return results


@pytest.fixture(params=POROUS)
def reference(request, factored):
    """Return a porous scene, its changes, and the results with MUMPS."""
    return factored("porous", request.param)


def run(scene, changes, folder, recipes):
    words = [word for name in recipes for word in ("-options_file", str(RECIPES / f"{name}.opt"))]
    run_here(Job(scene, str(folder), changes, petsc_options=tuple(words)))
    return history(folder), fields(folder / "checkpoint.h5"), summary(folder)


def assert_same(a, b):
    for column in a[0]:
        if column != "coupling_iterations":
            assert largest_difference(a[0][column], b[0][column]) < SAME, column
    assert a[1].keys() == b[1].keys()
    for name in ("solid.u", "solid.v", "fluid.v", "fluid.p"):
        assert largest_difference(a[1][name], b[1][name]) < SAME, name


def require_packages(recipe):
    if "hypre" in (RECIPES / f"{recipe}.opt").read_text() and not options.has_package("hypre"):
        pytest.skip("PETSc without hypre")
    if recipe == "solid_pyamg":
        pytest.importorskip("pyamg")


@pytest.mark.parametrize("dimension", POROUS)
@pytest.mark.parametrize("recipe", [name for name in NAMES if "direct" not in name])
def test_recipe_gives_the_results_of_mumps(factored, recipe, dimension, shared_path):
    require_packages(recipe)
    scene, changes, expected = factored(recipe.partition("_")[0], dimension)
    computed = run(scene, changes, shared_path / "run", (recipe,))
    assert_same(computed, expected)
    block = next(name for name in ("fluid", "solid", "mesh", "monolithic") if name in recipe)
    assert 1 < computed[2]["linear_iterations"][block]["max"] <= 25
    assert (
        np.abs(computed[0]["coupling_iterations"] - expected[0]["coupling_iterations"]).max() <= 1
    )


def test_factors_on_disk_give_the_same_results(reference, shared_path):
    scene, changes, expected = reference
    assert_same(run(scene, changes, shared_path / "run", ("direct_out_of_core",)), expected)


@pytest.mark.parametrize("recipe", NAMES)
def test_a_misspelt_option_in_a_recipe_is_an_error(recipe, shared_path):
    require_packages(recipe)
    scene, changes = RUNS.get(
        "free" if recipe == "direct" else recipe.partition("_")[0], DEFAULT_RUNS
    )[0]["2-D"]
    words = [
        line.split("#")[0].split() for line in (RECIPES / f"{recipe}.opt").read_text().splitlines()
    ]
    words = [word for line in words for word in line]
    first = next(i for i, word in enumerate(words) if word.endswith(("ksp_rtol", "icntl_14")))
    words[first] += "x"
    with pytest.raises(InputError, match=f"nothing used {words[first]}"):
        run_here(Job(scene, str(shared_path / "run"), changes, petsc_options=tuple(words)))


def test_the_page_names_every_recipe_and_every_recipe_is_a_file():
    named = re.findall(r"`(\w+)\.opt`", (ROOT / "docs" / "solver_recipes.md").read_text())
    assert sorted(set(named)) == NAMES


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
