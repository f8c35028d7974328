"""Write a flat quarter of a cylinder around the axis z, graded towards its side (unconfined
compression).
"""

import gmsh

from mesh import gmsh_file

# of the cylinder, of its part without layers, of both [m]
RADIUS = 3.175e-3
CORE = 1.9e-3
HEIGHT = 5e-4
SIZE = 1.2e-3  # of the triangles around the axis [m]
# elements of level 0 over the quarter circle and the layers; each over the next one inside
AROUND = 5
THROUGH = 4
GROWTH = 0.6


def cross_section(level):
    """Build the quarter disc at z = 0 and return its two surfaces."""
    geo = gmsh.model.geo
    n = 2**level
    centre = geo.addPoint(0, 0, 0, SIZE / n)
    right = [geo.addPoint(r, 0, 0, SIZE / n) for r in (CORE, RADIUS)]
    top = [geo.addPoint(0, r, 0, SIZE / n) for r in (CORE, RADIUS)]
    arcs = [geo.addCircleArc(a, centre, b) for a, b in zip(right, top, strict=True)]
    bottom, left = (
        [geo.addLine(*pair) for pair in ((centre, side[0]), side)] for side in (right, top)
    )
    core = geo.addPlaneSurface([geo.addCurveLoop([bottom[0], arcs[0], -left[0]])])
    layers = geo.addPlaneSurface([geo.addCurveLoop([bottom[1], arcs[1], -left[1], -arcs[0]])])
    for arc in arcs:
        geo.mesh.setTransfiniteCurve(arc, AROUND * n + 1)
    for line in (bottom[1], left[1]):
        geo.mesh.setTransfiniteCurve(line, THROUGH * n + 1, "Progression", GROWTH ** (1 / n))
    geo.mesh.setTransfiniteSurface(layers, "Alternate")
    return core, layers


def geometry(level):
    """Build the cylinder; return its surfaces and its volume by name."""
    geo = gmsh.model.geo
    names = ("z0", "top", "y0", "side", "x0")
    surfaces = {name: [] for name in names}
    body = []
    parts = cross_section(level)
    # extruded: end, volume, then the sides in the order of the loop: y = 0, outer arc, x = 0 (,
    # inner arc)
    for start, outer in zip(parts, (None, "side"), strict=True):
        end, volume, bottom, arc, left = (
            tag for _, tag in geo.extrude([(2, start)], 0, 0, HEIGHT, [2**level])[:5]
        )
        for name, surface in (
            ("z0", start),
            ("top", end),
            ("y0", bottom),
            (outer, arc),
            ("x0", left),
        ):
            if name:
                surfaces[name].append(surface)
        body.append(volume)
    geo.synchronize()
    return surfaces, {"body": body}


def main():
    """Write the mesh that the command line asks for."""
    gmsh_file.make(gmsh_file.parse("cylinder", __doc__, range(4)).parse_args(), geometry, dim=3)


if __name__ == "__main__":
    main()
