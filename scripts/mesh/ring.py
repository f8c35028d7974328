"""Write a quarter of an elastic ring with fluid around it up to a rigid wall, both in graded grids
(added-mass test).

The fluid sticks to ring and wall, the ideal one of the exact solution slides: thin rows of elements
there hold the difference, which is of their thickness.
"""

import gmsh

from mesh import gmsh_file

RING = (0.95, 1.05)  # inside and outside [m]
ROWS = (
    0.008,
    0.025,
    0.067,
    0.125,
    0.125,
    0.067,
    0.025,
    0.008,
)  # of the fluid up to the wall at 1.5 m [m]
# elements of level 0 over the quarter circle and over the ring; one over each row of the fluid
AROUND = 16
ACROSS = 2


def circles():
    """Return the radii of the inside, of the interface and of the ends of all rows of the fluid
    [m].
    """
    radii = [*RING]
    for row in ROWS:
        radii.append(round(radii[-1] + row, 6))
    return radii


def geometry(level):
    """Build ring and fluid, all circles as curves so that quadratic triangles follow them; return
    curves and surfaces by name.
    """
    geo = gmsh.model.geo
    radii = circles()
    centre = geo.addPoint(0.0, 0.0, 0.0)
    right = [geo.addPoint(r, 0.0, 0.0) for r in radii]
    top = [geo.addPoint(0.0, r, 0.0) for r in radii]
    arcs = [geo.addCircleArc(a, centre, b) for a, b in zip(right, top, strict=True)]
    bottom, left = (
        [geo.addLine(a, b) for a, b in zip(side, side[1:], strict=False)] for side in (right, top)
    )
    surfaces = [_annulus(bottom[i], arcs[i + 1], left[i], arcs[i]) for i in range(len(bottom))]
    for arc in arcs:
        geo.mesh.setTransfiniteCurve(arc, AROUND * 2**level + 1)
    for i, lines in enumerate(zip(bottom, left, strict=True)):
        for line in lines:
            geo.mesh.setTransfiniteCurve(line, (1 if i else ACROSS) * 2**level + 1)
        geo.mesh.setTransfiniteSurface(surfaces[i], "Alternate")
    geo.synchronize()
    curves = {"inside": arcs[:1], "interface": arcs[1:2], "wall": arcs[-1:]}
    curves |= {
        "ring_bottom": bottom[:1],
        "ring_left": left[:1],
        "fluid_bottom": bottom[1:],
        "fluid_left": left[1:],
    }
    return curves, {"ring": surfaces[:1], "fluid": surfaces[1:]}


def _annulus(bottom, outer, left, inner):
    loop = gmsh.model.geo.addCurveLoop([bottom, outer, -left, -inner])
    return gmsh.model.geo.addPlaneSurface([loop])


def main():
    """Write the mesh that the command line asks for."""
    gmsh_file.make(gmsh_file.parse("ring", __doc__, range(5)).parse_args(), geometry)


if __name__ == "__main__":
    main()
