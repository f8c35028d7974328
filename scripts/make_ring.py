"""Write a quarter of an elastic ring with fluid around it up to a rigid wall, both in graded grids (added-mass test)."""

import gmsh
import gmsh_file

RADII = (0.95, 1.05, 1.5)  # inside and outside of the ring, wall [m]
AROUND, ACROSS = 16, (2, 6)  # elements of level 0 over the quarter circle, over ring and fluid


def geometry(level):
    """Build ring and fluid; return their curves by name and the surfaces by name."""
    geo = gmsh.model.geo
    centre = geo.addPoint(0.0, 0.0, 0.0)
    right = [geo.addPoint(r, 0.0, 0.0) for r in RADII]
    top = [geo.addPoint(0.0, r, 0.0) for r in RADII]
    arcs = [geo.addCircleArc(a, centre, b) for a, b in zip(right, top, strict=True)]
    bottom, left = ([geo.addLine(a, b) for a, b in zip(side, side[1:], strict=False)] for side in (right, top))
    loops = [[bottom[i], arcs[i + 1], -left[i], -arcs[i]] for i in (0, 1)]
    surfaces = [geo.addPlaneSurface([geo.addCurveLoop(loop)]) for loop in loops]
    for arc in arcs:
        geo.mesh.setTransfiniteCurve(arc, AROUND * 2**level + 1)
    for i in (0, 1):
        for line in (bottom[i], left[i]):
            geo.mesh.setTransfiniteCurve(line, ACROSS[i] * 2**level + 1)
        geo.mesh.setTransfiniteSurface(surfaces[i], "Alternate")
    geo.synchronize()
    curves = {"inside": arcs[:1], "interface": arcs[1:2], "wall": arcs[2:]}
    curves |= {"ring_bottom": bottom[:1], "ring_left": left[:1], "fluid_bottom": bottom[1:], "fluid_left": left[1:]}
    return curves, {"ring": surfaces[:1], "fluid": surfaces[1:]}


def main():
    """Write the mesh that the command line asks for."""
    options = gmsh_file.parse(__doc__, levels=5).parse_args()
    gmsh.initialize()
    gmsh.option.setNumber("General.Verbosity", 2)
    curves, surfaces = geometry(options.level)
    gmsh_file.name_groups(1, curves)
    gmsh_file.name_groups(2, surfaces)
    gmsh_file.write(options.order, options.output)
    gmsh_file.report()
    gmsh.finalize()


if __name__ == "__main__":
    main()
