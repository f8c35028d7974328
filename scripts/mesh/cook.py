"""Write Cook's membrane (1974), a tapered panel in a regular grid of triangles: locking of nearly
incompressible solids.
"""

import gmsh

from mesh import gmsh_file

CORNERS = ((0.0, 0.0), (48.0, 44.0), (48.0, 60.0), (0.0, 44.0))  # [mm]
SIDES = ("lower", "loaded", "upper", "clamped")  # from each corner to the next
CELLS = 16  # along every side at level 0


def geometry(level):
    """Build the panel, its lengths in metres; return its sides and its surface by name."""
    geo = gmsh.model.geo
    points = [geo.addPoint(x / 1000, y / 1000, 0.0) for x, y in CORNERS]
    sides = [geo.addLine(a, b) for a, b in zip(points, [*points[1:], points[0]], strict=True)]
    panel = geo.addPlaneSurface([geo.addCurveLoop(sides)])
    for side in sides:
        geo.mesh.setTransfiniteCurve(side, CELLS * 2**level + 1)
    geo.mesh.setTransfiniteSurface(panel, "Alternate")
    geo.synchronize()
    return {name: [side] for name, side in zip(SIDES, sides, strict=True)}, {"panel": [panel]}


def main():
    """Write the mesh that the command line asks for."""
    gmsh_file.make(gmsh_file.parse("cook", __doc__, range(4)).parse_args(), geometry)


if __name__ == "__main__":
    main()
