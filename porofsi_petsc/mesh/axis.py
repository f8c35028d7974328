"""A plane mesh as the section r = x, z = y of a body around the axis x = 0."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from ..errors import InputError
from .check import place
from .mesh import Mesh
from .topology import cell_facets, facet_multiplicity

AXIS = "axis of symmetry"
# of the largest distance from the axis: digits of the coordinates in a mesh file
ROUND_OFF = 1e-9


def around_axis(mesh: Mesh, where: str | Path) -> Mesh:
    """Return the mesh of rings, with the tag AXIS on the facets at x = 0, if there are any.

    Nodes within round-off of the axis are put on it.  Raises InputError where a node is beyond the
    axis, or a cell touches it in a point alone, where nothing bounds the hoop strain.
    """
    points = mesh.points.copy()
    r = points[:, 0]
    r[np.abs(r) <= ROUND_OFF * np.abs(r).max()] = 0.0
    if (r < 0).any():
        first = place(points[np.argmin(r)])
        raise InputError(
            f"{where} [mesh.axisymmetric]: received a node at {first} m, expected x >= 0"
            " everywhere: x is the distance from the axis; move the mesh, or leave the key out"
        )
    facets = cell_facets(mesh.cells, mesh.element)
    outer = facets[facet_multiplicity(mesh.cells, mesh.element) == 1]
    on_axis = outer[(r[outer] == 0).all(axis=1)]
    alone = np.setdiff1d(np.flatnonzero(r == 0), on_axis)
    if len(alone):
        raise InputError(
            f"{where} [mesh.axisymmetric]: received a mesh that touches the axis in the point"
            f" {place(points[alone[0]])} m alone, expected an edge there, or a distance from it"
        )
    tags = mesh.facets | ({AXIS: on_axis} if len(on_axis) else {})
    return replace(mesh, points=points, element=mesh.element.around_axis(), facets=tags)


def tags_on_axis(mesh: Mesh, where: str | Path) -> set[str]:
    """Return the tags of a serial mesh of rings that lie on the axis; raise InputError where one
    does with a part alone.
    """
    found = set()
    for tag, facets in mesh.facets.items() if mesh.element.axisymmetric else ():
        here = (mesh.points[facets, 0] == 0).all(axis=1)
        if here.all():
            found.add(tag)
        elif here.any():
            raise InputError(
                f"{where} [mesh.axisymmetric]: received the boundary '{tag}' on the axis and beside"
                " it, expected a tag of its own on the axis"
            )
    return found
