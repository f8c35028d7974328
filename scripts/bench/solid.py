"""MUMPS, GAMG, hypre, pyamg and incomplete Cholesky on the displacement block of the pulse; writes
docs/studies/solid_solvers.*

The first system of a run, its matrix and right side, by every solver: in 2-D and 3-D, on the first
N (3) meshes, with Poisson's ratio 0.3 and 0.49, with inertia (the scene's step) and without (one
step of 0.02 s).  Without restrictions all of it, each number of ranks in a mpirun of its own;
--json prints the records of what is asked for instead of writing. CPU seconds, the largest of the
ranks: the machine may be shared.  The matrix is solved to the default tolerance of 1e-4 with a
fresh preconditioner (set-up and solve), and to 1e-8 (iterations only).
"""

import argparse
import csv
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from itertools import product
from pathlib import Path
from types import SimpleNamespace
from unittest import mock

import command_line
import launching

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))
TARGET = ROOT / "docs" / "studies" / "solid_solvers"
RECIPES = ROOT / "configs" / "petsc"
SOLVERS = {
    "MUMPS": "direct",
    "GAMG": "solid_gamg",
    "hypre": "solid_hypre",
    "pyamg": "solid_pyamg",
    "ICC": "solid_icc",
}
# Refinements by dimension and order: 2-D 18 r x 8 r cells, 3-D n x n x n; about the same nodes on
# both orders.
MESHES = {(2, 1): (4, 8, 12), (2, 2): (2, 4, 6), (3, 1): (8, 11, 15), (3, 2): (4, 5, 7)}
POISSON = (0.3, 0.49)
# The load is largest after 0.02 s.
INERTIA = {
    "transient": (),
    "static": ("model.solid_inertia=false", "model.fluid_inertia=false", "time.step=0.02"),
}
MU = 5.583e6  # of the scene [Pa]
LOOSE = 1e-4
TIGHT = 1e-8
CAP = 300
KEYS = ("ranks", "dimension", "order", "poisson", "balance", "unknowns")
COLUMNS = (*KEYS, "solver", "iterations", "iterations_tight", "set_up", "solve")


class _FirstSystem(Exception):
    """The solver and the right side of the displacement's first system."""


def _interrupt(solver, rhs):
    raise _FirstSystem(solver, rhs)


def overrides(dimension, order, refinement, poisson, balance):
    """Return the keys of a mesh and of a material with the scene's shear modulus."""
    n = refinement
    cells = (
        [[8 * n, 2 * n, 8 * n], [8 * n]]
        if dimension == 2
        else [[n // 4, n - n // 4], [n // 4, n - n // 4], [n]]
    )
    mesh = tuple(
        f"mesh.{axis}.cells={numbers}" for axis, numbers in zip("xyz", cells, strict=False)
    )
    law = f"material.0.solid.lambda={2 * MU * poisson / (1 - 2 * poisson)}"
    return (
        *mesh,
        f"mesh.order={order}",
        f"material.0.solid.mu={MU}",
        law,
        "model.convection=false",
        *INERTIA[balance],
    )


def first_system(scene, coupling):
    """Return the solver and the right side of the displacement's first solve (collective)."""
    from porofsi_petsc.linalg.solver import LinearSolver
    from porofsi_petsc.simulation.loop import Clock

    with mock.patch.object(LinearSolver, "solve", _interrupt):
        try:
            coupling.step(*Clock(scene.time).schemes(scene.model, scene.time.step), 0.0, 1)
        except _FirstSystem as found:
            return found.args


def times(matrix, rhs, recipe, dimension, tolerance):
    """Return (iterations, set-up, solve) of one solve with a new preconditioner; no iterations
    where it fails (collective).
    """
    from porofsi_petsc.errors import ConvergenceError
    from porofsi_petsc.linalg import options
    from porofsi_petsc.linalg.fieldsplit import solid_defaults
    from porofsi_petsc.linalg.solver import LinearSolver

    limits = ["-solid_ksp_rtol", str(tolerance), "-solid_ksp_max_it", str(CAP)]
    options.start("", ["-options_file", str(RECIPES / f"{recipe}.opt"), *limits])
    solver = LinearSolver(matrix, "solid_", solid_defaults(dimension, False))
    try:
        solver.solve(rhs)
    except ConvergenceError:
        solver.iterations.append(None)
    found = matrix.comm.tompi4py().allgather((solver.setup_time, solver.solve_time))
    iterations = solver.iterations[-1]
    solver.destroy()
    return iterations, *(max(seconds) for seconds in zip(*found, strict=True))


def work(dimensions, orders, meshes):
    """Return the records of all systems (collective)."""
    from porofsi_petsc import Simulation, load_scene
    from porofsi_petsc.linalg import options, solver

    options.start()
    from mpi4py import MPI

    solver.time = SimpleNamespace(perf_counter=time.process_time)
    records = []
    for dimension, order, balance, poisson in product(dimensions, orders, INERTIA, POISSON):
        for refinement in MESHES[dimension, order][:meshes]:
            scene = load_scene(
                f"pulse{dimension}d", overrides(dimension, order, refinement, poisson, balance)
            )
            with Simulation(scene, MPI.COMM_WORLD) as simulation:
                first, rhs = first_system(scene, simulation.coupling)
                system = (
                    MPI.COMM_WORLD.size,
                    dimension,
                    order,
                    poisson,
                    balance,
                    first.matrix.getSize()[0],
                )
                for name, recipe in SOLVERS.items():
                    loose = times(first.matrix, rhs, recipe, dimension, LOOSE)
                    tight = times(first.matrix, rhs, recipe, dimension, TIGHT)
                    found = (name, loose[0], tight[0], min(loose[1], tight[1]), loose[2])
                    records.append(dict(zip(COLUMNS, (*system, *found), strict=True)))
    return records


# -- all ranks, from one process -------------------------------------------------------------------


def launch(ranks, given):
    """Return the records of a number of ranks, in a mpirun of its own."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "records.json"
        words = ["mpirun", "-n", str(ranks), sys.executable, "-m", "bench.solid"]
        words += ["--worker", str(file)]
        for name in ("dimensions", "orders"):
            words += [f"--{name}", *map(str, getattr(given, name))]
        subprocess.run(
            [*words, "--meshes", str(given.meshes)], env=launching.environment(), check=True
        )
        return json.loads(file.read_text())


def summary(records):
    """Return the markdown of all records: iterations over the meshes, and times on the finest."""
    import numpy
    import petsc4py

    versions = (
        f"petsc4py {petsc4py.__version__}, pyamg {_version('pyamg')}, NumPy {numpy.__version__}"
    )
    lines = [
        "# Solvers of the displacement",
        "",
        "    scripts/run bench solid",
        "",
        (
            f"{versions}, Python {platform.python_version()}, {os.cpu_count()} cores that others"
            " used too: CPU seconds, largest of"
        ),
        (
            "the ranks. First system of `pulse2d` and `pulse3d`; every solver a file of"
            " `configs/petsc` (solid_…, MUMPS: direct)."
        ),
        (
            "Transient: with inertia, the scene's step; static: without, one step of 0.02 s. A"
            " dash: over 300 iterations."
        ),
        "",
        "## Iterations to 1e-8 on three meshes",
        "",
        *_table(
            records, lambda group: "/".join(_text(record["iterations_tight"]) for record in group)
        ),
        "",
        "## Set-up + solve to 1e-4 on the finest of them, CPU seconds (iterations)",
        "",
        *_table(records, lambda group: _seconds(group[-1])),
    ]
    return "\n".join(lines) + "\n"


def _table(records, cell):
    lines = [
        f"| | ν | unknowns | ranks | {' | '.join(SOLVERS)} |",
        "|---" * (4 + len(SOLVERS)) + "|",
    ]
    keys = ("dimension", "order", "balance", "poisson", "ranks")
    systems = dict.fromkeys(tuple(record[key] for key in keys) for record in records)
    for dimension, order, balance, poisson, ranks in sorted(systems):
        same = [
            r
            for r in records
            if (r["dimension"], r["order"], r["balance"]) == (dimension, order, balance)
        ]
        same = [r for r in same if (r["poisson"], r["ranks"]) == (poisson, ranks)]
        cells = [cell([r for r in same if r["solver"] == name]) for name in SOLVERS]
        sizes = "/".join(str(n) for n in dict.fromkeys(r["unknowns"] for r in same))
        lines.append(
            f"| {dimension}-D P{order} {balance} | {poisson} | {sizes} | {ranks} |"
            f" {' | '.join(cells)} |"
        )
    return lines


def _text(iterations):
    return "–" if iterations is None else str(iterations)


def _seconds(record):
    return f"{record['set_up']:.2f} + {record['solve']:.2f} ({_text(record['iterations'])})"


def _version(package):
    from importlib.metadata import version

    return version(package)


def main():
    """Measure what is asked for."""
    parser = command_line.parser("bench solid", __doc__)
    parser.add_argument("--dimensions", type=int, nargs="+", default=[2, 3], choices=[2, 3])
    parser.add_argument("--orders", type=int, nargs="+", default=[1, 2], choices=[1, 2])
    parser.add_argument("--meshes", type=int, default=3, choices=[1, 2, 3])
    parser.add_argument("--ranks", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--worker", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.worker:
        records = work(given.dimensions, given.orders, given.meshes)
        from mpi4py import MPI

        if MPI.COMM_WORLD.rank == 0:
            Path(given.worker).write_text(json.dumps(records))
        return
    records = [record for ranks in given.ranks for record in launch(ranks, given)]
    if given.json:
        print(json.dumps(records))
        return
    with TARGET.with_suffix(".csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        writer.writerows(
            record | {key: f"{record[key]:.4f}" for key in ("set_up", "solve")}
            for record in records
        )
    TARGET.with_suffix(".md").write_text(summary(records))


if __name__ == "__main__":
    main()
