"""Write a mesh of the channel of Turek & Hron (2006): cylinder with an elastic beam, conforming
along their interface.

Surfaces fluid and beam; curves inlet, outlet, walls, cylinder (wetted arc), root (the arc on which
the beam stands) and interface (wetted boundary of the beam).  The same gmsh writes the same file;
configs/meshes/README.md has the commands.
"""

from math import asin, cos, hypot, pi, sin

import gmsh

from mesh import gmsh_file

LENGTH, HEIGHT = 2.5, 0.41  # channel [m]
CENTRE, RADIUS = (0.2, 0.2), 0.05  # cylinder [m]
TIP, HALF = 0.6, 0.01  # end of the beam and half its thickness [m]
ROOT = asin(HALF / RADIUS)  # half the angle of the arc on which the beam stands
SIDE, THICKNESS = 56, 4  # elements along a side of the beam and over its thickness at level 0
CLUSTER = 0.3  # size at root and tip over the size at half length: both ends are singular
NARROW = 0.4  # at the tip: size at the corners over the size at the middle
# size at cylinder and beam, at the tip's corners [m], its growth with the distance [-]
WALL = 0.01
CORNER = 0.0025
GROWTH = 0.22
# largest size up to the end of the wake, at the outlet [m], and that end [m]
WAKE = 0.03
FAR = 0.07
WAKE_END = 1.5


def size(x, y):
    """Return the element size of level 0 [m]: smallest at the corners of the tip, moderate in the
    wake, growing to the outlet.
    """
    cylinder = hypot(x - CENTRE[0], y - CENTRE[1]) - RADIUS
    beam = hypot(max(CENTRE[0] - x, x - TIP, 0.0), max(abs(y - CENTRE[1]) - HALF, 0.0))
    corner = min(hypot(x - TIP, y - CENTRE[1] - offset) for offset in (-HALF, HALF))
    behind = max(x - WAKE_END, 0.0) / (LENGTH - WAKE_END)
    return min(
        WALL + GROWTH * max(min(cylinder, beam), 0.0),
        CORNER + GROWTH * corner,
        WAKE + behind * (FAR - WAKE),
    )


def polyline(points):
    """Return the lines from each point to the next."""
    return [gmsh.model.geo.addLine(a, b) for a, b in zip(points, points[1:], strict=False)]


def circle_points(angles):
    """Return points of the cylinder at angles from the x axis [rad]."""
    return [
        gmsh.model.geo.addPoint(CENTRE[0] + RADIUS * cos(a), CENTRE[1] + RADIUS * sin(a), 0.0)
        for a in angles
    ]


def structure(level, beam, sides, root, corners):
    """Make the beam a grid of alternating diagonals, its elements smallest at root and tip, and
    there at the corners.
    """
    mesh = gmsh.model.geo.mesh
    low, *tip, high = sides
    along, across = (round(number * 2**level) for number in (SIDE, THICKNESS))
    steps = max(
        across // 2 - 1, 1
    )  # from element to element of half the tip; a single one has none
    for side in (low, high):
        mesh.setTransfiniteCurve(side, along + 1, "Bump", CLUSTER)
    for half, first_to_last in zip(
        tip, (1 / NARROW, NARROW), strict=True
    ):  # from the lower corner, to the upper one
        mesh.setTransfiniteCurve(half, across // 2 + 1, "Progression", first_to_last ** (1 / steps))
    mesh.setTransfiniteCurve(root, across + 1)
    mesh.setTransfiniteSurface(beam, "Alternate", corners)


def geometry(level):
    """Build the two surfaces; return their curves by name and the surfaces by name."""
    geo = gmsh.model.geo
    box = [geo.addPoint(x, y, 0.0) for x, y in ((0, 0), (LENGTH, 0), (LENGTH, HEIGHT), (0, HEIGHT))]
    bottom, outlet, top, inlet = polyline(box + box[:1])
    centre = geo.addPoint(*CENTRE, 0.0)
    on_circle = circle_points([ROOT, pi / 2, pi, 1.5 * pi, -ROOT])
    arcs = [
        geo.addCircleArc(a, centre, b)
        for a, b in zip(on_circle, on_circle[1:] + on_circle[:1], strict=True)
    ]
    ends = [
        geo.addPoint(TIP, CENTRE[1] + offset, 0.0) for offset in (-HALF, 0.0, HALF)
    ]  # the middle one is A
    sides = polyline([on_circle[-1], *ends, on_circle[0]])
    hole = geo.addCurveLoop([*arcs[:-1], *sides])
    fluid = geo.addPlaneSurface([geo.addCurveLoop([bottom, outlet, top, inlet]), hole])
    beam = geo.addPlaneSurface([geo.addCurveLoop([*sides, -arcs[-1]])])
    structure(level, beam, sides, arcs[-1], [on_circle[-1], ends[0], ends[2], on_circle[0]])
    geo.synchronize()
    curves = {"inlet": [inlet], "outlet": [outlet], "walls": [bottom, top]}
    return curves | {"cylinder": arcs[:-1], "root": arcs[-1:], "interface": sides}, {
        "fluid": [fluid],
        "beam": [beam],
    }


def channel(level, part):
    """Build the surfaces with their element sizes; return curves and surfaces of the part by
    name.
    """
    groups = geometry(level)
    for option in ("FromPoints", "FromCurvature", "ExtendFromBoundary"):
        gmsh.option.setNumber(f"Mesh.MeshSize{option}", 0)
    gmsh.model.mesh.setSizeCallback(lambda dim, tag, x, y, z, *_: size(x, y) / 2**level)
    unwanted = {
        "fluid": ("beam", "root"),
        "solid": ("fluid", "inlet", "outlet", "walls", "cylinder"),
        "both": (),
    }[part]
    return (
        {name: members for name, members in named.items() if name not in unwanted}
        for named in groups
    )


def main():
    """Write the mesh that the command line asks for."""
    parser = gmsh_file.parse("hron_turek", __doc__.splitlines()[0], range(-1, 5))
    parser.add_argument("--part", choices=("fluid", "solid", "both"), default="both")
    options = parser.parse_args()
    gmsh_file.make(options, lambda level: channel(level, options.part))
    print(f"elements over the thickness of the beam: {round(THICKNESS * 2**options.level)}")


if __name__ == "__main__":
    main()
