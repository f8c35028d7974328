"""Write half of the duct with a cylinder of Schäfer and Turek (3D-1Z), quadratic; needs no gmsh."""

from pathlib import Path

import command_line
import numpy as np

from porofsi_petsc.elements import ELEMENTS
from porofsi_petsc.mesh.mesh import Mesh
from porofsi_petsc.mesh.topology import add_midside_nodes, boundary_facets, cell_facets
from porofsi_petsc.mesh.write import write_mesh

LENGTH = 2.5  # [m]
HEIGHT = 0.41  # [m]
CENTRE = np.array([0.5, 0.2])  # [m]
RADIUS = 0.05  # [m]
BOX = (0.35, 0.7)  # the rings around the cylinder end on this part of the duct, along x [m]
# Size of the last over the first element: up and down the duct, off its wall.
UPSTREAM = 2.0
DOWNSTREAM = 5.0
OFF_WALL = 3.0


def main():
    """Write the mesh that the command line asks for."""
    parser = command_line.parser("mesh duct_cylinder", __doc__)
    help_text = "elements over a quarter of the circle, even; all other numbers follow"
    parser.add_argument("--cells", type=int, default=10, help=help_text)
    help_text = (
        "size of the last over the first ring; less for coarse meshes, whose curved cells fold"
    )
    parser.add_argument("--growth", type=float, default=25.0, help=help_text)
    parser.add_argument("--output", type=Path, required=True, help="mesh file (.msh 2.2)")
    options = parser.parse_args()
    if options.cells < 4 or options.cells % 2:
        parser.error(f"--cells: received {options.cells}, expected an even number from 4 on")
    mesh = duct(options.cells, options.growth)
    write_mesh(options.output, mesh)
    print(f"{len(mesh.points)} nodes, {len(mesh.cells)} tetrahedra")


def duct(n, growth=25.0):
    """Return the mesh of z <= HEIGHT/2, made of a plane mesh in layers."""
    plane, triangles = _plane(n, growth)
    z = HEIGHT / 2 * _graded(round(0.6 * n), OFF_WALL)
    points = np.hstack([np.repeat(plane, len(z), axis=0), np.tile(z, len(plane))[:, None]])
    cells = _oriented(points, _layered(triangles, len(z)))
    points, cells = add_midside_nodes(points, cells, ELEMENTS["T10"])
    facets = _facets(points, cells)
    _round(points, np.unique(facets["cylinder"]))
    region = np.zeros(len(cells), dtype=np.int64)
    return Mesh(points, cells, ELEMENTS["T10"], ("fluid",), region, facets)


def _graded(n, ratio):
    """Return n + 1 numbers from 0 to 1, the last difference `ratio` times the first."""
    sizes = ratio ** (np.arange(n) / (n - 1))
    return np.concatenate([[0.0], np.cumsum(sizes) / sizes.sum()])


def _plane(n, growth):
    """Return vertices, (N, 2), and triangles of the cross-section z = 0.

    The vertices are numbered by their distance from the plane y of the cylinder's axis, and the
    numbers choose the diagonals: those on both sides are mirror images and make no lift.
    """
    points = []
    quads = []
    for block in _blocks(n, growth):
        number = np.arange(block[..., 0].size).reshape(block.shape[:2]) + sum(map(len, points))
        corners = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
        quads.append(np.stack([corner.ravel() for corner in corners], axis=1))
        points.append(block.reshape(-1, 2))
    points, number = np.unique(np.vstack(points).round(12), axis=0, return_inverse=True)
    order = np.lexsort([points[:, 0], abs(points[:, 1] - CENTRE[1]).round(12)])
    quads = np.argsort(order)[number.ravel()[np.vstack(quads)]]
    lowest = np.argmin(quads, axis=1)[:, None]
    quads = np.take_along_axis(quads, (lowest + np.arange(4)) % 4, axis=1)
    return points[order], np.vstack([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def _blocks(n, growth):
    """Return lattices of points, (i, j, 2): before, behind and on four sides of the cylinder."""
    along = np.linspace(-1, 1, n + 1)
    x = np.interp(along, [-1, 0, 1], [BOX[0], CENTRE[0], BOX[1]])
    y = np.interp(along, [-1, 0, 1], [0.0, CENTRE[1], HEIGHT])
    before = BOX[0] * (1 - _graded(n // 2, UPSTREAM))
    behind = BOX[1] + (LENGTH - BOX[1]) * _graded(n, DOWNSTREAM)
    sides = [
        (np.pi, np.column_stack([np.full_like(y, BOX[0]), y[::-1]])),
        (-np.pi / 2, np.column_stack([x, np.zeros_like(x)])),
        (0.0, np.column_stack([np.full_like(y, BOX[1]), y])),
        (np.pi / 2, np.column_stack([x[::-1], np.full_like(x, HEIGHT)])),
    ]
    quarters = [_quarter(angle + np.pi / 4 * along, side, growth) for angle, side in sides]
    ends = [np.stack(np.meshgrid(part, y, indexing="ij"), axis=-1) for part in (before, behind)]
    return ends + quarters


def _quarter(angles, side, growth):
    """Return points from an arc of the cylinder to a side of the box, (outwards, around, 2)."""
    arc = CENTRE + RADIUS * np.column_stack([np.cos(angles), np.sin(angles)])
    s = _graded(len(angles) - 1, growth)[:, None, None]
    return (1 - s) * arc + s * side


def _layered(triangles, levels):
    """Return tetrahedra, three to a prism; vertex v of the plane is v * levels + i on level i."""
    a, b, c = (np.sort(triangles, axis=1).T * levels)[..., None] + np.arange(levels - 1)
    prism = [(a, b, c, c + 1), (a, b, b + 1, c + 1), (a, a + 1, b + 1, c + 1)]
    return np.vstack([np.stack(corners, axis=-1).reshape(-1, 4) for corners in prism])


def _oriented(points, cells):
    negative = np.linalg.det(points[cells[:, 1:]] - points[cells[:, :1]]) < 0
    cells[negative, :2] = cells[negative, 1::-1]
    return cells


def _facets(points, cells):
    """Return the facets of the boundary by name."""
    cell, local = boundary_facets(cells, ELEMENTS["T10"])
    nodes = cell_facets(cells, ELEMENTS["T10"])[cell, local]
    x, y, z = np.moveaxis(points[nodes[:, :3]], -1, 0)
    on = {
        "inlet": x == 0,
        "outlet": x == LENGTH,
        "walls": z == 0,
        "symmetry": z == HEIGHT / 2,
        "cylinder": np.isclose(np.hypot(x - CENTRE[0], y - CENTRE[1]), RADIUS, rtol=1e-9),
    }
    chosen = {name: there.all(axis=1) for name, there in on.items()}
    chosen["walls"] |= (y == 0).all(axis=1) | (y == HEIGHT).all(axis=1)
    return {name: nodes[rows] for name, rows in chosen.items()}


def _round(points, nodes):
    """Move nodes onto the cylinder."""
    radial = points[nodes, :2] - CENTRE
    points[nodes, :2] = CENTRE + RADIUS * radial / np.linalg.norm(radial, axis=1, keepdims=True)


if __name__ == "__main__":
    main()
