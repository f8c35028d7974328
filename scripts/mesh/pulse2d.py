"""Write configs/meshes/pulse2d.msh: the block of the pulse scenes, T6, graded toward the load strip
(needs the gmsh module).
"""

from pathlib import Path

import command_line
import gmsh

from mesh import gmsh_file

WIDTH, HEIGHT, STRIP = 21.0, 10.0, (10.0, 11.0)  # [m]
FINE, COARSE = 0.2, 1.5  # element size at the strip and far away [m]
PROBE = (10.5, 9.0)  # [m], inside
MESH = Path(__file__).resolve().parents[2] / "configs" / "meshes" / "pulse2d.msh"


def outline():
    """Return the curves of the outline, counter-clockwise from the lower left corner, and the
    surface.
    """
    geo = gmsh.model.geo
    top = [21.0, 15.5, 11.0, 10.5, 10.0, 0.0]
    corners = [(0.0, 0.0), (WIDTH, 0.0)] + [(x, HEIGHT) for x in top]
    points = [geo.addPoint(x, y, 0.0) for x, y in corners]
    lines = [geo.addLine(a, b) for a, b in zip(points, points[1:] + points[:1], strict=True)]
    surface = geo.addPlaneSurface([geo.addCurveLoop(lines)])
    probe = geo.addPoint(*PROBE, 0.0)
    geo.synchronize()
    gmsh.model.mesh.embed(0, [probe], 2, surface)
    return lines, surface


def name_groups(lines, surface):
    """Name the surface and every part of the boundary."""
    bottom, right, *top, left = lines
    strip = top[2:4]
    rest = top[:2] + top[4:]
    groups = {"bottom": [bottom], "right": [right], "top": rest, "strip": strip, "left": [left]}
    gmsh_file.name_groups(1, groups)
    gmsh_file.name_groups(2, {"body": [surface]})


def grade(strip):
    """Let the element size grow with the distance from the strip."""
    field = gmsh.model.mesh.field
    distance = field.add("Distance")
    size = field.add("Threshold")
    field.setNumbers(distance, "CurvesList", strip)
    for name, value in {
        "InField": distance,
        "SizeMin": FINE,
        "SizeMax": COARSE,
        "DistMin": 1.2,
        "DistMax": 16.0,
    }.items():
        field.setNumber(size, name, value)
    field.setAsBackgroundMesh(size)
    for option in ("FromPoints", "FromCurvature", "ExtendFromBoundary"):
        gmsh.option.setNumber(f"Mesh.MeshSize{option}", 0)


def main():
    """Write the mesh file."""
    command_line.parser("mesh pulse2d", __doc__).parse_args()
    gmsh.initialize()
    gmsh.option.setNumber("General.Verbosity", 2)
    lines, surface = outline()
    name_groups(lines, surface)
    grade(lines[4:6])
    gmsh_file.write(2, MESH)
    gmsh.finalize()


if __name__ == "__main__":
    main()
