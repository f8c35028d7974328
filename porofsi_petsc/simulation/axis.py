"""What holds on the axis of a body of revolution: no radial displacement and no radial velocity, by
themselves.
"""

from pathlib import Path

import numpy as np

from ..config import Scene
from ..config.expressions import Expression
from ..errors import InputError
from ..fem.distribute import LocalMesh
from ..fem.essential import Essential
from ..mesh.axis import AXIS

RADIAL = ("displacement.x", "velocity.x")


def on_axis(mesh: LocalMesh) -> list[Essential]:
    """Return the `Essential` of the axis, the radial component of a vector, above all others; none
    where the mesh has no axis.
    """
    if AXIS not in mesh.facets:
        return []
    return [Essential(AXIS, 0, Expression(0.0), np.inf, "mesh.axisymmetric")]


def axis_tags(mesh: LocalMesh) -> set[str]:
    """Return the tags whose facets lie on the axis (collective)."""
    if AXIS not in mesh.facets:
        return set()
    mine = {
        tag for tag, facets in mesh.facets.items() if (mesh.X[facets.nodes, 0] > 0).any(axis=None)
    }
    return set(mesh.facets) - set().union(*mesh.comm.allgather(mine))


def check_axis(scene: Scene, tags: set[str], where: str | Path) -> None:
    """Raise InputError where something is prescribed on the axis, which is no boundary; a radial
    component of zero says what holds anyway.
    """
    for i, boundary in enumerate(scene.boundary):
        for tag in sorted(tags.intersection(boundary.on)):
            for quantity in boundary.given():
                if quantity in RADIAL and _is_zero(boundary, quantity):
                    continue
                raise InputError(
                    f"{where} [boundary.{i}.{quantity}]: tag '{tag}' is the axis of symmetry, which"
                    " is no boundary: u_x = v_x = 0 hold there by themselves; leave it out"
                )


def _is_zero(boundary, quantity):
    name, _, axis = quantity.partition(".")
    expression = getattr(getattr(boundary, name), axis)
    return expression.is_constant and not expression(0.0, np.zeros((1, 2))).any()
