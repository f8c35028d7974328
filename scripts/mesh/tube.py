"""Write a quarter of an elastic tube with fluid in it, extruded along the axis z (pressure wave in
an artery).
"""

import gmsh

from mesh import gmsh_file

RADII, LENGTH = (0.005, 0.006), 0.05  # inside and outside [m]
SIZE = 0.0022  # of the triangles around the axis [m]
# elements of level 0 over the quarter circle, the wall and the length
AROUND = 4
THROUGH = 1
ALONG = 24


def cross_section(level):
    """Build the quarter of lumen and wall at z = 0 and return their surfaces."""
    geo = gmsh.model.geo
    n = 2**level
    centre = geo.addPoint(0, 0, 0, SIZE / n)
    right = [geo.addPoint(r, 0, 0, SIZE / n) for r in RADII]
    top = [geo.addPoint(0, r, 0, SIZE / n) for r in RADII]
    arcs = [geo.addCircleArc(a, centre, b) for a, b in zip(right, top, strict=True)]
    bottom, left = (
        [geo.addLine(*pair) for pair in ((centre, side[0]), side)] for side in (right, top)
    )
    lumen = geo.addPlaneSurface([geo.addCurveLoop([bottom[0], arcs[0], -left[0]])])
    wall = geo.addPlaneSurface([geo.addCurveLoop([bottom[1], arcs[1], -left[1], -arcs[0]])])
    for arc in arcs:
        geo.mesh.setTransfiniteCurve(arc, AROUND * n + 1)
    for line in (bottom[1], left[1]):
        geo.mesh.setTransfiniteCurve(line, THROUGH * n + 1)
    geo.mesh.setTransfiniteSurface(wall, "Alternate")
    return lumen, wall


def geometry(level):
    """Build the tube; return its surfaces and its volumes by name."""
    geo = gmsh.model.geo
    surfaces = {}
    volumes = {}
    lumen, wall = cross_section(level)
    swept = {
        name: geo.extrude([(2, part)], 0, 0, LENGTH, [ALONG * 2**level])
        for name, part in (("fluid", lumen), ("wall", wall))
    }
    geo.synchronize()
    # extruded: end, volume, then the sides in the order of the loop: y = 0, outer arc, x = 0 (,
    # inner arc)
    for name, start, ends in (
        ("fluid", lumen, ("inlet", "outlet")),
        ("wall", wall, ("wall_inlet", "wall_outlet")),
    ):
        end, volume, bottom, outer, left = (tag for _, tag in swept[name][:5])
        surfaces |= {
            ends[0]: [start],
            ends[1]: [end],
            f"{name}_bottom": [bottom],
            f"{name}_left": [left],
        }
        surfaces["interface" if name == "fluid" else "outside"] = [outer]
        volumes[name] = [volume]
    return surfaces, volumes


def main():
    """Write the mesh that the command line asks for."""
    gmsh_file.make(gmsh_file.parse("tube", __doc__, range(4)).parse_args(), geometry, dim=3)


if __name__ == "__main__":
    main()
