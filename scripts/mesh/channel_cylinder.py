"""Write the channel with a cylinder of Schäfer and Turek (radius 0.05 m), finest at the cylinder
and behind it.
"""

import gmsh

from mesh import gmsh_file

LENGTH, HEIGHT, CENTRE, RADIUS = 2.2, 0.41, (0.2, 0.2), 0.05  # [m]
# size [m] at the cylinder, its growth per distance, largest
AT_CYLINDER = 0.008
GROWTH = 0.16
LARGEST = 0.06
IN_WAKE = 0.025  # size [m] in the wake


def geometry(level):
    """Build the channel; return curves and surfaces by name."""
    occ = gmsh.model.occ
    channel = occ.addRectangle(0, 0, 0, LENGTH, HEIGHT)
    disk = occ.addDisk(*CENTRE, 0, RADIUS, RADIUS)
    (fluid,), _ = occ.cut([(2, channel)], [(2, disk)])
    occ.synchronize()
    curves = {"inlet": [], "outlet": [], "walls": [], "cylinder": []}
    for _, curve in gmsh.model.getEntities(1):
        curves[_name(*gmsh.model.getBoundingBox(1, curve))].append(curve)
    _sizes(curves["cylinder"], 0.5**level)
    return curves, {"fluid": [fluid[1]]}


def _name(x0, y0, _z0, x1, y1, _z1):
    slack = 1e-6
    if x1 < slack:
        return "inlet"
    if x0 > LENGTH - slack:
        return "outlet"
    return "walls" if y1 < slack or y0 > HEIGHT - slack else "cylinder"


def _sizes(cylinder, factor):
    """Let the size of elements grow with the distance from the cylinder, less in its wake."""
    field = gmsh.model.mesh.field
    distance = field.add("Distance")
    size = field.add("MathEval")
    field.setNumbers(distance, "CurvesList", cylinder)
    field.setNumber(distance, "Sampling", 200)
    wake = (
        f"({IN_WAKE} + 10*max(0, 0.2 - x) + 0.6*max(0, abs(y - 0.2) - 0.08) + 0.03*max(0, x - 0.6))"
    )
    grown = f"({AT_CYLINDER} + {GROWTH}*F{distance})"
    smallest = f"min(min({grown}, {wake}), {LARGEST})"
    field.setString(size, "F", f"{factor}*{smallest}")
    field.setAsBackgroundMesh(size)
    for option in ("MeshSizeExtendFromBoundary", "MeshSizeFromPoints", "MeshSizeFromCurvature"):
        gmsh.option.setNumber(f"Mesh.{option}", 0)


def main():
    """Write the mesh that the command line asks for."""
    gmsh_file.make(
        gmsh_file.parse("channel_cylinder", __doc__, range(-1, 4)).parse_args(), geometry
    )


if __name__ == "__main__":
    main()
