"""Write an elastic ellipse in the middle of a wide round box of fluid, in blocks of quadratic
quadrilaterals; needs no gmsh.

The fluid has confocal ellipses and hyperbolas as lines, by the conformal map x + i y = c cosh(s +
i t): its cells are as good as squares, and those at the body are the smallest.
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

AXES = (0.02, 0.01)  # half axes of the body [m]
WALL = 20.0  # half axis of the box along x, in that of the body
CORE = 0.6  # of the body's half axes: corners of the block in its middle
QUARTER = 4  # cells of level 0 over a quarter of the ellipse
ACROSS = 1  # cells of level 0 from the block in the middle to the ellipse


def main():
    """Write the mesh that the command line asks for."""
    parser = command_line.parser("mesh ellipse", __doc__)
    help_text = "every level halves all sizes"
    parser.add_argument("--level", type=int, choices=range(4), default=0, help=help_text)
    parser.add_argument("--output", type=Path, required=True, help="mesh file (.msh 2.2)")
    options = parser.parse_args()
    mesh = ellipse(options.level)
    options.output.parent.mkdir(parents=True, exist_ok=True)
    write_mesh(options.output, mesh)
    print(f"{len(mesh.points)} nodes, {len(mesh.cells)} quadrilaterals")


def ellipse(level):
    """Return the mesh of body and fluid."""
    mesh = with_interface(joined(_blocks(level), ELEMENTS["Q9"]), ["body"], ())
    cell, local = boundary_facets(mesh.cells, mesh.element)
    wall = cell_facets(mesh.cells, mesh.element)[cell, local]
    return replace(mesh, facets=mesh.facets | {"wall": wall})


def _blocks(level):
    """Return the blocks of body and fluid, points (I, J, 2) each."""
    n = QUARTER * 2**level
    across = middles(np.linspace(0.0, 1.0, ACROSS * 2**level + 1))
    side = middles(np.linspace(-1.0, 1.0, n + 1))
    half = CORE * np.sqrt(0.5)
    x, y = np.meshgrid(half * side, half * side, indexing="ij")
    core = [np.stack([x, y], axis=-1)]
    edge = np.column_stack([np.full_like(side, half), half * side])
    t = np.pi / 4 * side
    circle = np.column_stack([np.cos(t), np.sin(t)])
    core += [_turned(ruled(edge, circle, across), turns) for turns in range(4)]
    return {
        "body": [block * AXES for block in core],
        "fluid": [_confocal(_rows(2 * n), t + turns * np.pi / 2) for turns in range(4)],
    }


def _rows(half_turn):
    """Return s of the rows of the fluid, cells as long as wide where π has so many."""
    first = np.arctanh(AXES[1] / AXES[0])
    last = np.arccosh(WALL * AXES[0] / _focus())
    number = round(half_turn * (last - first) / np.pi)
    return middles(np.linspace(first, last, number + 1))


def _confocal(s, t):
    """Return the points c (cosh s cos t, sinh s sin t), (I, J, 2), of s (I,) and t (J,)."""
    s = s[:, None]
    return _focus() * np.stack([np.cosh(s) * np.cos(t), np.sinh(s) * np.sin(t)], axis=-1)


def _focus():
    """Return the distance c of the foci from the middle [m]."""
    return np.sqrt(AXES[0] ** 2 - AXES[1] ** 2)


def _turned(points, turns):
    """Return points (I, J, 2) turned by so many right angles."""
    for _ in range(turns):
        points = np.stack([-points[..., 1], points[..., 0]], axis=-1)
    return points


if __name__ == "__main__":
    main()
