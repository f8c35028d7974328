"""Outlets of a free fluid: surfaces through which it flows as the rest of the scene makes it."""

from collections.abc import Collection, Sequence

from ..config import Scene
from ..fem.distribute import LocalMesh
from ..fem.essential import Essential
from .drainage import holds_normal

OPEN = ("displacement", "velocity", "windkessel")  # velocity: along the surface


def open_tags(
    scene: Scene, mesh: LocalMesh, tags: Collection[str], given: Sequence[Essential]
) -> list[str]:
    """Return those of some tags of free fluids across which nothing is prescribed but a windkessel
    (collective).

    given : the `Essential`s of the velocity.  A given traction or pressure may drive the fluid
    in; a surface with a `backflow` has its own.
    """
    quantities: dict[str, set[str]] = {}
    for boundary in scene.boundary:
        names = {name.partition(".")[0] for name in boundary.given()}
        for tag in boundary.on:
            quantities.setdefault(tag, set()).update(names)
    free = [tag for tag in sorted(tags) if quantities.get(tag, {"none"}) <= set(OPEN)]
    return [tag for tag in free if not holds_normal(mesh, tag, _components(tag, given))]


def _components(tag, given):
    return sorted({entry.component for entry in given if entry.tag == tag})
