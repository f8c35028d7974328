"""What the mesh scripts share: naming and writing a mesh, judging a plane one of the gmsh module
(pip install .[mesh]).
"""

from pathlib import Path

import command_line
import gmsh
import numpy as np


def parse(name, description, levels):
    """Return the parser with the options that every scalable mesh has; levels : a range."""
    parser = command_line.parser(f"mesh {name}", description)
    parser.add_argument(
        "--level", type=int, choices=levels, default=0, help="every level halves all sizes"
    )
    parser.add_argument(
        "--order",
        type=int,
        choices=(1, 2),
        default=1,
        help="2: curved edges on arcs, straight ones inside",
    )
    parser.add_argument("--output", type=Path, required=True, help="mesh file (.msh 4.1)")
    return parser


def make(options, geometry, dim=2):
    """Write the mesh of a model; geometry : level -> (boundaries, parts), each name -> entities, of
    the model that it builds.
    """
    gmsh.initialize()
    gmsh.option.setNumber("General.Verbosity", 2)
    boundaries, parts = geometry(options.level)
    name_groups(dim - 1, boundaries)
    name_groups(dim, parts)
    write(options.order, options.output, dim)
    if dim == 2:
        report()
    gmsh.finalize()


def name_groups(dim, groups):
    """Name the entities of one dimension; what has no name is not written."""
    for name, members in groups.items():
        gmsh.model.setPhysicalName(dim, gmsh.model.addPhysicalGroup(dim, members), name)


def write(order, path, dim=2):
    """Mesh the model in triangles or tetrahedra of the order and write what is named."""
    gmsh.option.setNumber("Mesh.ElementOrder", order)
    gmsh.option.setNumber("Mesh.MshFileVersion", 4.1)
    gmsh.model.mesh.generate(dim)
    path.parent.mkdir(parents=True, exist_ok=True)
    gmsh.write(str(path))


def report():
    """Print the number of vertices and triangles and the smallest and largest angle of every named
    surface.
    """
    for _, group in gmsh.model.getPhysicalGroups(2):
        corners = np.concatenate(
            [_corners(surface) for surface in gmsh.model.getEntitiesForPhysicalGroup(2, group)]
        )
        angles = _angles(corners)
        vertices = len(np.unique(corners.reshape(-1, 2).round(12), axis=0))
        print(
            f"{gmsh.model.getPhysicalName(2, group)}: {vertices} vertices, {len(corners)}"
            " triangles,",
            end=" ",
        )
        print(f"angles {angles.min():.1f} to {angles.max():.1f} degrees")


def _corners(surface):
    """Return the vertices of the triangles of a surface, (E, 3, 2)."""
    (kind,), _, (nodes,) = gmsh.model.mesh.getElements(2, surface)
    tags, points, _ = gmsh.model.mesh.getNodes(2, surface, includeBoundary=True)
    row = np.zeros(int(tags.max()) + 1, dtype=int)
    row[tags.astype(int)] = np.arange(len(tags))
    width = gmsh.model.mesh.getElementProperties(kind)[3]
    triangles = nodes.astype(int).reshape(-1, width)[:, :3]
    return points.reshape(-1, 3)[row[triangles], :2]


def _angles(corners):
    """Return the angles of triangles, (E, 3) [degrees]."""
    a = np.roll(corners, -1, axis=1) - corners
    b = np.roll(corners, 1, axis=1) - corners
    cosine = (a * b).sum(axis=2) / np.linalg.norm(a, axis=2) / np.linalg.norm(b, axis=2)
    return np.degrees(np.arccos(cosine.clip(-1, 1)))
