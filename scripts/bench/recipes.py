"""Iterations and CPU time of the recipes of configs/petsc beside what was tried against them
(docs/solver_recipes.md).

Prints a markdown table: some steps of a scene with each string of options, in one process, all of
them N (2) times in turn; the least time counts.  Seconds are CPU time of rank 0 without the start:
the machine may be shared.  Set-up and solve of all linear solvers, and the steps as a whole; mean
iterations of fluid, solid, mesh and monolithic system; MB: what MUMPS used for all its factors, on
all ranks (its INFOG(22)).  More ranks: mpirun -n 2 scripts/run bench recipes TABLE
"""

import gc
import time
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import command_line
import numpy as np
from mpi4py import MPI

from bench.some_steps import some_steps
from porofsi_petsc import load_scene
from porofsi_petsc.errors import ConvergenceError
from porofsi_petsc.linalg import options
from porofsi_petsc.linalg import solver as linear
from porofsi_petsc.simulation.loop import ABSENT_PREFIXES

ROOT = Path(__file__).resolve().parents[2]
RECIPES = ROOT / "configs" / "petsc"
SCENES = ROOT / "tests" / "scenes"
BLOCKS = ("fluid", "solid", "mesh", "monolithic")
HEADS = ("options", *BLOCKS, "sweeps", "set-up, s", "solve, s", "steps, s", "MB")


@dataclass(frozen=True)
class Table:
    """Steps of a scene with changes, and the strings of options compared on it; a word NAME.opt is
    a file of configs/petsc.
    """

    scene: str
    changes: tuple
    steps: int
    rows: tuple


def square(r):
    """Return the cells of pulse2d, 18 r x 8 r."""
    return ("mesh.order=1", f"mesh.x.cells=[{8 * r},{2 * r},{8 * r}]", f"mesh.y.cells=[{8 * r}]")


def cube(n):
    """Return the cells of pulse3d, n x n x n."""
    return (
        f"mesh.x.cells=[{n // 5},{n - n // 5}]",
        f"mesh.y.cells=[{n // 5},{n - n // 5}]",
        f"mesh.z.cells=[{n}]",
    )


FLAP = ("mesh.x.cells=[48,16,72]", "mesh.y.cells=[48,48]")
CHANNEL = ("mesh.x.cells=[6,3,15]", "mesh.y.cells=[3,6,3]", "mesh.z.cells=[6,6]")
BLOCK = ("coupling.scheme=direct", "mesh.x.cells=[7,7]", "mesh.y.cells=[7]", "mesh.z.cells=[11]")
STATIC = (
    "model.solid_inertia=false",
    "model.fluid_inertia=false",
    "model.convection=false",
    "time.step=0.02",
)
NU_49 = ("material.0.solid.lambda=2.736e8",)  # with the scene's mu
SOLID_MUMPS = (
    "-solid_ksp_type preonly -solid_pc_type cholesky -solid_pc_factor_mat_solver_type mumps"
)
SOLID = ("solid_gamg.opt", "solid_hypre.opt", "solid_icc.opt", "solid_pyamg.opt", SOLID_MUMPS)
ITERATIVE_2D = tuple(
    f"fluid_fieldsplit.opt {name}.opt" for name in ("solid_gamg", "solid_hypre", "solid_icc")
)
BLR = " ".join(
    f"-{block}_mat_mumps_icntl_35 2 -{block}_mat_mumps_cntl_7 {{}}" for block in ("fluid", "solid")
)
METIS = "direct.opt -fluid_mat_mumps_icntl_7 5 -solid_mat_mumps_icntl_7 5"
TOLERANCES = (
    "",
    *(f"-fluid_ksp_rtol {rtol}" for rtol in ("1e-4", "1e-3", "1e-2")),
    *(f"-solid_ksp_rtol {rtol}" for rtol in ("1e-5", "1e-3", "1e-2")),
)
TABLES = {
    "small_2d": Table("pulse2d", square(8), 5, ("direct.opt", *ITERATIVE_2D)),
    "large_2d": Table(
        "pulse2d",
        square(16),
        2,
        (
            "direct.opt",
            METIS,
            "direct_out_of_core.opt",
            *(f"direct.opt {BLR.format(drop, drop)}" for drop in ("1e-10", "1e-6")),
            *ITERATIVE_2D,
        ),
    ),
    "porous_3d": Table(
        "pulse3d",
        cube(15),
        3,
        (*SOLID, "direct.opt", "-fluid_pc_type bjacobi", "-fluid_fieldsplit_p_inner_pc_type gamg"),
    ),
    "large_3d": Table("pulse3d", cube(30), 2, SOLID[:4]),
    "short_steps": Table(
        "pulse3d",
        (*cube(15), "time.step=1e-5"),
        3,
        (*SOLID[:3], "-fluid_pc_type bjacobi", "-fluid_pc_type asm"),
    ),
    "low_permeability": Table(
        "pulse3d",
        (*cube(15), "material.0.permeability.k=1e-9"),
        2,
        (*SOLID[:3], "-fluid_pc_type bjacobi", "-fluid_fieldsplit_p_inner_pc_type gamg"),
    ),
    "nearly_incompressible": Table("pulse3d", (*cube(15), *NU_49), 2, SOLID),
    "static": Table("pulse3d", (*cube(15), *STATIC), 1, SOLID),
    "static_nearly_incompressible": Table("pulse3d", (*cube(15), *STATIC, *NU_49), 1, SOLID),
    "free_fluid_2d": Table(
        str(SCENES / "flap.toml"),
        FLAP,
        2,
        (
            "direct.opt",
            "free_fluid_fieldsplit.opt mesh_gamg.opt",
            "free_fluid_fieldsplit.opt mesh_hypre.opt",
        ),
    ),
    "free_fluid_3d": Table(
        str(SCENES / "block_in_channel3d.toml"),
        CHANNEL,
        3,
        (
            "free_fluid_fieldsplit.opt mesh_gamg.opt",
            "free_fluid_fieldsplit.opt mesh_hypre.opt",
            "free_fluid_fieldsplit.opt mesh_hypre.opt solid_hypre.opt",
            "-mesh_pc_type bjacobi -mesh_sub_pc_type icc",
            "-fluid_fieldsplit_v_pc_type bjacobi",
            "-fluid_fieldsplit_p_laplacian_pc_type gamg",
            "direct.opt",
        ),
    ),
    "monolithic": Table(
        str(SCENES / "block3d.toml"),
        BLOCK,
        2,
        (
            "monolithic_direct.opt",
            "monolithic_sweep.opt",
            "monolithic_sweep.opt solid_icc.opt",
            "monolithic_sweep.opt solid_hypre.opt",
        ),
    ),
    "tolerances_porous": Table("pulse3d", cube(14), 5, TOLERANCES),
    "tolerances_free": Table(
        str(SCENES / "block_in_channel3d.toml"),
        (),
        5,
        (*TOLERANCES, *(f"-mesh_ksp_rtol {rtol}" for rtol in ("1e-5", "1e-3", "1e-2"))),
    ),
}


def words_of(row):
    """Return the words of a string of options with the files in full."""
    return [
        part
        for word in row.split()
        for part in (("-options_file", str(RECIPES / word)) if word.endswith(".opt") else (word,))
    ]


def run(table, row, changes):
    """Return (nodes, cells of the row) of the steps with a string of options (collective)."""
    scene = load_scene(table.scene, (*table.changes, *changes))
    with some_steps(scene, table.steps, words_of(row)) as done:
        options.check_options(MPI.COMM_WORLD, exempt_prefixes=ABSENT_PREFIXES)
        solvers = done.solvers
        memory = sum(map(_factor, solvers.values()))
        return done.coupling.solid.mesh.n_global, (
            *_counts(solvers, done.sweeps),
            done.seconds,
            memory,
        )


def _counts(solvers, sweeps):
    """Return iterations of the blocks, sweeps, and the times of all solvers."""
    iterations = (solvers[block].iterations_mean if block in solvers else 0.0 for block in BLOCKS)
    times = (
        sum(getattr(solver, name) for solver in solvers.values())
        for name in ("setup_time", "solve_time")
    )
    return *iterations, float(np.mean(sweeps)), *times


def _factor(solver):
    """Return the megabytes that MUMPS used for a factor, 0 for another solver."""
    pc = solver.ksp.getPC()
    if pc.getType() not in ("lu", "cholesky") or pc.getFactorSolverType() != "mumps":
        return 0
    return pc.getFactorMatrix().getMumpsInfog(22)


def attempt(table, row, changes):
    """Return what `run` does, or (None, why it failed) (collective)."""
    try:
        return run(table, row, changes)
    except ConvergenceError as error:
        return None, str(error).partition(";")[0]
    finally:
        gc.collect()


def markdown(table, repeats, changes):
    """Return the lines of a table (collective)."""
    found = {row: [] for row in table.rows}
    for _ in range(repeats):
        for row, results in found.items():
            results.append(attempt(table, row, changes))
    nodes = next(nodes for nodes, _ in (results[0] for results in found.values()) if nodes)
    lines = [f"{nodes} nodes", "", "| " + " | ".join(HEADS) + " |", "|---" * len(HEADS) + "|"]
    for row, results in found.items():
        done = [cells for nodes, cells in results if nodes]
        lines.append(f"| `{row or 'default'}` | {_cells(done) if done else results[0][1]} |")
    return lines


def _cells(runs):
    """Return the cells of a row with the least times of its runs."""
    *counts, _, _, _, memory = runs[0]
    times = np.min([cells[len(counts) : -1] for cells in runs], axis=0)
    texts = [
        *(f"{count:.1f}" if count else "" for count in counts),
        *(f"{seconds:.2f}" for seconds in times),
        str(memory or ""),
    ]
    return " | ".join(texts)


def main():
    """Print the tables asked for."""
    parser = command_line.parser("bench recipes", __doc__)
    parser.add_argument("tables", nargs="+", choices=TABLES, metavar="TABLE")
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--set", dest="changes", action="append", default=[], metavar="KEY=VALUE")
    given = parser.parse_args()
    linear.time = SimpleNamespace(perf_counter=time.process_time)
    for name in given.tables:
        lines = markdown(TABLES[name], given.repeats, given.changes)
        if MPI.COMM_WORLD.rank == 0:
            print(f"{name}, {TABLES[name].steps} steps, " + "\n".join(lines) + "\n", flush=True)


if __name__ == "__main__":
    main()
