"""A mesh as a Gmsh file, regions and boundaries as physical groups."""

import os

import meshio
import numpy as np

from .mesh import Mesh


def write_mesh(path: str | os.PathLike[str], mesh: Mesh) -> None:
    """Write a `Mesh` as Gmsh 2.2 (text); `read_mesh` returns an equal one."""
    kind = mesh.element.meshio_name
    facet_kind = mesh.element.facet.meshio_name
    d = mesh.dim
    groups = [(facet_kind, d - 1, tag, nodes) for tag, nodes in mesh.facets.items()]
    groups += [
        (kind, d, name, mesh.cells[mesh.cell_region == i]) for i, name in enumerate(mesh.regions)
    ]
    numbers = [np.full(len(nodes), i) for i, (*_, nodes) in enumerate(groups, start=1)]
    meshio.Mesh(
        np.pad(mesh.points, ((0, 0), (0, 3 - d))),
        [(kind, nodes) for kind, *_, nodes in groups],
        cell_data={"gmsh:physical": numbers, "gmsh:geometrical": numbers},
        field_data={
            name: np.array([i, dim]) for i, (_, dim, name, _) in enumerate(groups, start=1)
        },
    ).write(path, file_format="gmsh22", binary=False)
