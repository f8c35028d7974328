"""What the stages of a scene name: it has to be in the mesh, and there when it is to act."""

from collections.abc import Collection, Iterator, Sequence

from ..config import Scene
from ..config.conditions import BodyForce
from ..config.stages import CHANGES, Stage
from ..errors import InputError, listed
from ..mesh.check import require_regions
from ..mesh.mesh import Mesh


def require_known_regions(scene: Scene, mesh: Mesh) -> None:
    """Raise InputError where a stage names a region that the mesh has not."""
    where = scene.source_path or "scene"
    for i, stage in enumerate(scene.stage):
        for key in CHANGES:
            require_regions(mesh, getattr(stage, key), f"{where} [stage.{i}.{key}]")
        for key, names in _regions(stage):
            require_regions(mesh, names, f"{where} [stage.{i}.{key}]")


def require_known_tags(scene: Scene, tags: Collection[str]) -> None:
    """Raise InputError where a [[stage.boundary]] is on a tag that the mesh has not, whatever is
    there.

    tags : of the whole mesh; the surface toward what is not there has the name of its region
    """
    known = {*tags, *scene.changing}
    for i, stage in enumerate(scene.stage):
        for key, name in _tags(stage):
            if name not in known:
                raise InputError(
                    f"{scene.source_path or 'scene'} [stage.{i}.{key}]: the mesh has no boundary"
                    f" tag '{name}'; choose from {listed(sorted(known))} (in the stage"
                    f" '{stage.name}')"
                )


def require_effect(scene: Scene, there: Sequence[Collection[str]]) -> None:
    """Raise InputError where what a stage gives is on nothing that is there in this or a later one.

    there : the tags of what is there in each stage after the first
    """
    regions = [later.inactive for later in scene.stages[1:]]
    for i, stage in enumerate(scene.stage):
        gone = set(regions[i]).intersection(*regions[i:])
        left = set().union(*there[i:])
        lost = [(key, name) for key, names in _regions(stage) for name in names if name in gone]
        lost += [(key, name) for key, name in _tags(stage) if name not in left]
        for key, name in lost:
            raise InputError(
                f"{scene.source_path or 'scene'} [stage.{i}.{key}]: received '{name}', of which in"
                f" the stage '{stage.name}' and after it nothing is there, expected what is; leave"
                " it out"
            )


def _regions(stage: Stage) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield keys and names of the regions for which a stage gives something."""
    forces = stage.body_force
    listed_forces = () if forces is None or isinstance(forces, BodyForce) else forces
    named = [(f"material.{j}.region", entry.region) for j, entry in enumerate(stage.material)]
    named += [(f"body_force.{j}.on", entry.on) for j, entry in enumerate(listed_forces)]
    return ((key, names) for key, names in named if names != ("all",))


def _tags(stage: Stage) -> Iterator[tuple[str, str]]:
    """Yield keys and names of the surfaces for which a stage gives something."""
    for j, entry in enumerate(stage.boundary):
        for name in entry.on:
            yield f"boundary.{j}.on", name
