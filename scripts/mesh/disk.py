"""Write an elastic disk in the middle of a round box of fluid, in blocks of quadratic
quadrilaterals; needs no gmsh.

The rows of the fluid are thin on disk and wall, where it sticks.
"""

from dataclasses import replace
from pathlib import Path

import command_line
import numpy as np

from mesh.blocks import joined, middles, ruled
from porofsi_petsc.elements import ELEMENTS
from porofsi_petsc.mesh.interface import with_interface
from porofsi_petsc.mesh.topology import boundary_facets, cell_facets
from porofsi_petsc.mesh.write import write_mesh

RADIUS = 0.01  # of the disk [m]
WALL = 0.02  # radius of the box [m]
CORE = 0.6  # of the disk's radius: corners of the square in the middle of the disk
# ends of the rows of the fluid at level 0, from the disk (0) to the wall (1)
ROWS = (0.0, 0.04, 0.1, 0.2, 0.35, 0.65, 0.8, 0.9, 0.96, 1.0)
QUARTER = 4  # cells of level 0 over a quarter of the circle
ACROSS = 2  # cells of level 0 from the square to the circle


def main():
    """Write the mesh that the command line asks for."""
    parser = command_line.parser("mesh disk", __doc__)
    help_text = "every level halves all sizes"
    parser.add_argument("--level", type=int, choices=range(4), default=0, help=help_text)
    parser.add_argument("--output", type=Path, required=True, help="mesh file (.msh 2.2)")
    options = parser.parse_args()
    mesh = disk(options.level)
    options.output.parent.mkdir(parents=True, exist_ok=True)
    write_mesh(options.output, mesh)
    print(f"{len(mesh.points)} nodes, {len(mesh.cells)} quadrilaterals")


def disk(level):
    """Return the mesh of disk and fluid."""
    mesh = with_interface(joined(_blocks(level), ELEMENTS["Q9"]), ["disk"], ())
    cell, local = boundary_facets(mesh.cells, mesh.element)
    wall = cell_facets(mesh.cells, mesh.element)[cell, local]
    return replace(mesh, facets=mesh.facets | {"wall": wall})


def _blocks(level):
    """Return the blocks of disk and fluid, points (I, J, 2) each."""
    n = QUARTER * 2**level
    rows = ROWS
    for _ in range(level):
        rows = middles(rows)
    across = middles(np.linspace(0.0, 1.0, ACROSS * 2**level + 1))
    t = middles(np.linspace(-1.0, 1.0, n + 1))
    half = RADIUS * CORE * np.sqrt(0.5)
    x, y = np.meshgrid(half * t, half * t, indexing="ij")
    blocks = {"disk": [np.stack([x, y], axis=-1)], "fluid": []}
    side = np.column_stack([np.full_like(t, half), half * t])
    for turns in range(4):
        angle = np.pi / 4 * t
        circle = np.column_stack([np.cos(angle), np.sin(angle)])
        block = ruled(side, RADIUS * circle, across)
        rings = ruled(RADIUS * circle, WALL * circle, middles(rows))
        blocks["disk"].append(_turned(block, turns))
        blocks["fluid"].append(_turned(rings, turns))
    return blocks


def _turned(points, turns):
    """Return points (I, J, 2) turned by so many right angles."""
    for _ in range(turns):
        points = np.stack([-points[..., 1], points[..., 0]], axis=-1)
    return points


if __name__ == "__main__":
    main()
