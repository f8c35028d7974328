"""Write the channel of Turek & Hron (2006) in blocks of quadrilaterals; needs no gmsh.

Geometry and names are those of mesh/hron_turek.py.  Every block is ruled, straight lines between
two rows of points; around the cylinder one of them lies on the circle.
"""

from dataclasses import replace
from pathlib import Path

import command_line
import numpy as np

from mesh.blocks import TOLERANCE, joined, middles, ruled
from porofsi_petsc.elements import ELEMENTS
from porofsi_petsc.mesh.interface import INTERFACE, with_interface
from porofsi_petsc.mesh.mesh import Mesh
from porofsi_petsc.mesh.topology import boundary_facets, cell_facets
from porofsi_petsc.mesh.write import write_mesh

LENGTH, HEIGHT = 2.5, 0.41  # channel [m]
CENTRE, RADIUS = np.array([0.2, 0.2]), 0.05  # cylinder [m]
TIP, HALF = 0.6, 0.01  # end of the beam and half its thickness [m]
ROOT = np.arcsin(HALF / RADIUS)  # half the angle of the arc on which the beam stands
BOX = 0.1  # half the side of the square around the cylinder [m]
# Of a direction at level 0: cells, and size of the last over the first.
UPSTREAM = 4, 1.0
RADIAL = 6, 3.0
ALONG = 20, 1 / 6  # from the square around the cylinder to the tip
WAKE = 28, 40.0
ARC = 8, 1.0  # a side of the square, or of it what is beside the beam
BESIDE = 8, 6.0  # from the beam to the height of the square
ACROSS = 2, 0.4  # from the middle of the beam to its side
OUTER = 5, 1.0  # from the square to a wall
PARTS = {"fluid": ("fluid",), "solid": ("beam",), "both": ("fluid", "beam")}


def main():
    """Write the mesh that the command line asks for."""
    parser = command_line.parser("mesh hron_turek_blocks", __doc__)
    help_text = "every level halves all sizes"
    parser.add_argument("--level", type=int, choices=range(5), default=0, help=help_text)
    parser.add_argument("--element", choices=("Q4", "Q8", "Q9"), default="Q9")
    parser.add_argument("--part", choices=PARTS, default="both")
    parser.add_argument("--output", type=Path, required=True, help="mesh file (.msh 2.2)")
    options = parser.parse_args()
    mesh = channel(options.level, ELEMENTS[options.element], PARTS[options.part])
    options.output.parent.mkdir(parents=True, exist_ok=True)
    write_mesh(options.output, mesh)
    print(f"{len(mesh.points)} nodes, {len(mesh.cells)} quadrilaterals")


def channel(level, element, parts):
    """Return the mesh of fluid and beam, or of one of them."""
    mesh = joined(_blocks(level), element)
    mesh = with_interface(mesh, ["beam"], ())
    return _part(replace(mesh, facets=mesh.facets | _sides(mesh)), parts)


def _graded(level, cells, ratio):
    """Return numbers from 0 to 1 at ends and middles of cells, the last of which is `ratio` times
    the first.
    """
    n = cells * 2**level
    sizes = ratio ** (np.arange(n) / (n - 1))
    ends = np.concatenate([[0.0], np.cumsum(sizes) / sizes.sum()])
    return middles(ends)


def _blocks(level):
    """Return the blocks of fluid and beam, points (I, J, 2) each."""

    def line(start, end, cells, ratio):
        t = _graded(level, cells, ratio)[:, None]
        return (1 - t) * np.asarray(start) + t * np.asarray(end)

    def arc(start, end, cells, ratio):
        angle = start + (end - start) * _graded(level, cells, ratio)
        return CENTRE + RADIUS * np.stack([np.cos(angle), np.sin(angle)], axis=1)

    def rectangle(x, y):
        return np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)

    def axis(start, end, cells, ratio):
        return start + (end - start) * _graded(level, cells, ratio)

    x, y = CENTRE
    low, high, left, right = y - BOX, y + BOX, x - BOX, x + BOX
    quarter = np.pi / 4
    backward = {
        name: (cells, 1 / ratio)
        for name, (cells, ratio) in {"beside": BESIDE, "across": ACROSS}.items()
    }
    rows = {
        "below": axis(0.0, low, *OUTER),
        "under": axis(low, y - HALF, *backward["beside"]),
        "lower": axis(y - HALF, y, *backward["across"]),
        "upper": axis(y, y + HALF, *ACROSS),
        "over": axis(y + HALF, high, *BESIDE),
        "above": axis(high, HEIGHT, *OUTER),
    }
    side = axis(low, high, *ARC)
    columns = {
        "upstream": axis(0.0, left, *UPSTREAM),
        "square": axis(left, right, *ARC),
        "along": axis(right, TIP, *ALONG),
        "wake": axis(TIP, LENGTH, *WAKE),
    }
    beam = ("lower", "upper")
    fluid = [rectangle(columns["upstream"], side)]
    fluid += [rectangle(columns[c], rows[r]) for c in columns for r in ("below", "above")]
    fluid += [rectangle(columns["along"], rows[r]) for r in ("under", "over")]
    fluid += [rectangle(columns["wake"], rows[r]) for r in rows if r not in ("below", "above")]
    ring = [
        (arc(quarter, 3 * quarter, *ARC), line((right, high), (left, high), *ARC)),
        (arc(3 * quarter, 5 * quarter, *ARC), line((left, high), (left, low), *ARC)),
        (arc(5 * quarter, 7 * quarter, *ARC), line((left, low), (right, low), *ARC)),
        (arc(-quarter, -ROOT, *ARC), line((right, low), (right, y - HALF), *backward["beside"])),
        (arc(ROOT, quarter, *ARC), line((right, y + HALF), (right, high), *BESIDE)),
    ]
    fluid += [ruled(inner, outer, _graded(level, *RADIAL)) for inner, outer in ring]
    foot = [
        (
            arc(-ROOT, 0.0, *backward["across"]),
            line((right, y - HALF), (right, y), *backward["across"]),
        ),
        (arc(0.0, ROOT, *ACROSS), line((right, y), (right, y + HALF), *ACROSS)),
    ]
    solid = [ruled(inner, outer, _graded(level, *RADIAL)) for inner, outer in foot]
    solid += [rectangle(columns["along"], rows[r]) for r in beam]
    return {"fluid": fluid, "beam": solid}


def _sides(mesh):
    """Return the boundary of a mesh by name."""
    cell, local = boundary_facets(mesh.cells, mesh.element)
    nodes = cell_facets(mesh.cells, mesh.element)[cell, local]
    x, y = (mesh.points[nodes][..., i] for i in (0, 1))
    round_ = np.isclose(np.hypot(x - CENTRE[0], y - CENTRE[1]), RADIUS, atol=TOLERANCE)
    of_beam = mesh.cell_region[cell] == mesh.regions.index("beam")
    on = {
        "inlet": np.isclose(x, 0, atol=TOLERANCE),
        "outlet": np.isclose(x, LENGTH, atol=TOLERANCE),
        "walls": np.isclose(y, 0, atol=TOLERANCE) | np.isclose(y, HEIGHT, atol=TOLERANCE),
        "cylinder": round_ & ~of_beam[:, None],
        "root": round_ & of_beam[:, None],
    }
    return {name: nodes[where.all(axis=1)] for name, where in on.items()}


def _part(mesh, names):
    """Return the mesh of some of the regions, with the facets that belong to it."""
    chosen = np.isin(mesh.cell_region, [mesh.regions.index(name) for name in names])
    used, cells = np.unique(mesh.cells[chosen], return_inverse=True)
    own = {INTERFACE, *(("root",) if "beam" in names else ())}
    own |= {"inlet", "outlet", "walls", "cylinder"} if "fluid" in names else set()
    facets = {tag: np.searchsorted(used, mesh.facets[tag]) for tag in mesh.facets if tag in own}
    region = mesh.cell_region[chosen] - mesh.cell_region[chosen].min()
    cells = cells.reshape(-1, mesh.element.nodes)
    return Mesh(mesh.points[used], cells, mesh.element, names, region, facets)


if __name__ == "__main__":
    main()
