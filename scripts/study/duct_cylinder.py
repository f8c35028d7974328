"""Refine the mesh of schaefer_turek_3d1; coefficients and Δp: docs/studies/duct_cylinder.csv.

Each number of cells has a row, which takes the place of an older one.
"""

import csv
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import command_line
from mesh.duct_cylinder import duct

from porofsi_petsc import load_scene, run
from porofsi_petsc.mesh.write import write_mesh
from porofsi_petsc.output.history import read_history

TABLE = Path(__file__).resolve().parents[2] / "docs" / "studies" / "duct_cylinder.csv"
FORCE = 4.1e-4  # of the half for a coefficient of 1 [N]


def row(cells, folder):
    """Return the row of a mesh with as many elements over a quarter of the circle."""
    mesh = duct(cells)
    path = folder / "mesh.msh"
    write_mesh(path, mesh)
    scene = load_scene("schaefer_turek_3d1", [f"mesh.path={path}", "expect=[]", "figures.times=[]"])
    start = time.process_time()
    summary = run(scene, folder / "run", quiet=True)
    seconds = time.process_time() - start
    history = read_history(folder / "run" / "history.csv")
    end = {name: values[-1] for name, values in history.items()}
    return {
        "cells": cells,
        "tetrahedra": len(mesh.cells),
        "unknowns": 4 * len(mesh.points),
        "sweeps": int(end["coupling_iterations"]),
        "fluid_iterations": f"{summary['linear_iterations']['fluid']['mean']:.1f}",
        "cpu_seconds": f"{seconds:.0f}",
        "drag": f"{end['cylinder.f_x'] / FORCE:.5f}",
        "lift": f"{end['cylinder.f_y'] / FORCE:.6f}",
        "pressure_difference": f"{end['front.p'] - end['back.p']:.6f}",
    }


def main(counts):
    """Run the meshes and write the table after each of them."""
    rows = {}
    if TABLE.exists():
        with TABLE.open(encoding="utf-8") as file:
            rows = {int(old["cells"]): old for old in csv.DictReader(file)}
    for cells in counts:
        with TemporaryDirectory() as folder:
            rows[cells] = row(cells, Path(folder))
        with TABLE.open("w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, rows[cells], lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows[count] for count in sorted(rows))


if __name__ == "__main__":
    parser = command_line.parser("study duct_cylinder", __doc__)
    parser.add_argument("cells", nargs="+", type=int, metavar="CELLS")
    main(parser.parse_args().cells)
