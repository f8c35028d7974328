"""What is left of a scene and its mesh in a stage that has taken regions away."""

from collections.abc import Collection
from dataclasses import replace
from typing import Any

import numpy as np

from ..conditions import CONDITIONS
from ..config import Scene
from ..config.conditions import BodyForce, boundary_table
from ..errors import InputError, shown
from ..fem.distribute import Facets, LocalMesh
from ..fem.domain import Domain
from ..mesh.excerpt import excerpt
from ..mesh.mesh import Mesh
from ..mesh.topology import facet_groups, locate_facets
from .loads import concentrated_loads


def remaining_mesh(scene: Scene, mesh: Mesh) -> Mesh:
    """Return the serial mesh without the inactive regions of a scene, whose surface toward each of
    them has its name; raises InputError where that cannot be.
    """
    if not scene.inactive:
        return mesh
    where = f"{scene.source_path or 'scene'} [stage.inactive]"
    left = [name for name in mesh.regions if name not in scene.inactive]
    if not left:
        raise InputError(f"{where}: received all regions, expected one at least that stays")
    taken = [name for name in scene.inactive if name in mesh.facets]
    if taken:
        raise InputError(
            f"{where}: received {shown(taken[0])}, which is the name of a boundary too, expected a"
            " region with a name of its own, which is that of the surface toward it; rename one"
        )
    if tag := _tag_between(mesh, scene.inactive):
        raise InputError(
            f"{where}: the boundary {shown(tag)} lies on the surface of an inactive region inside"
            " of the mesh, which has the name of that region; leave the tag out"
        )
    return excerpt(mesh, left, where)


def _tag_between(mesh, inactive):
    """Return a tag with a facet between an inactive region and another one, "" without any."""
    group = facet_groups(mesh.cells, mesh.element)
    gone = np.isin(mesh.cell_region, [mesh.regions.index(name) for name in inactive])
    between = np.intersect1d(group[gone], group[~gone])
    for tag, nodes in mesh.facets.items():
        cell, local = locate_facets(nodes, mesh.cells, mesh.element)
        if np.isin(group[cell, local], between[between >= 0]).any():
            return tag
    return ""


def remaining_scene(scene: Scene, before: Collection[str], left: Collection[str]) -> Scene:
    """Return the scene of what is left; before, left : tags of the mesh with and without the
    inactive regions, toward which surfaces have names.

    The surface toward an inactive region is free and sealed where the scene says nothing of it.
    """
    if not scene.changing:
        return scene
    gone = {*before, *scene.changing} - {*left}
    _require_no_columns(scene, gone)
    boundaries = _without(scene.boundary, "on", gone)
    named = {tag for boundary in boundaries for tag in boundary.on}
    free = [name for name in scene.inactive if name in left and name not in named]
    boundaries += [boundary_table().model_validate({"on": [name]}) for name in free]
    changes: dict[str, Any] = {
        "boundary": tuple(boundaries),
        "material": tuple(_without(scene.material, "region", scene.inactive)),
    }
    if not isinstance(scene.body_force, BodyForce):
        forces = tuple(_without(scene.body_force, "on", scene.inactive))
        changes["body_force"] = forces or BodyForce()
    found = scene.model_copy(update=changes)
    found._absent_kinds = tuple(
        (name, material.kind)
        for name in scene.inactive
        for material in scene.material
        if name in material.region or "all" in material.region
    )
    return found


def _without(entries, key, gone):
    """Return the entries without some tags or regions."""
    found = []
    for entry in entries:
        words = tuple(word for word in getattr(entry, key) if word not in gone)
        if words:
            found.append(entry.model_copy(update={key: words}))
    return found


def _require_no_columns(scene, gone):
    """Refuse to take away a surface of which the history records something."""
    for i, boundary in enumerate(scene.boundary):
        for name in boundary.surface_conditions():
            lost = gone.intersection(boundary.on)
            if CONDITIONS[name].columns and lost:
                raise InputError(
                    f"{scene.source_path or 'scene'} [boundary.{i}.{name}]: the tag"
                    f" {shown(sorted(lost)[0])} is on inactive regions alone, expected a surface"
                    " that stays, of which the history records the condition; keep its region"
                )


def remaining_facets(scene: Scene, mesh: LocalMesh) -> LocalMesh:
    """Return the mesh with the tagged facets of what is left, those toward inactive regions among
    them, by the names of these (collective).
    """
    numbers = [i for i, name in enumerate(mesh.regions) if name in scene.inactive]
    active = ~np.isin(mesh.cell_region, numbers)
    groups = mesh.facets | {name: mesh.inner[name] for name in scene.inactive}
    here = {tag: active[facets.cells] for tag, facets in groups.items()}
    tags = set().union(*mesh.comm.allgather({tag for tag, rows in here.items() if rows.any()}))
    left = {tag: _part(groups[tag], here[tag]) for tag in groups if tag in tags}
    return replace(mesh, facets=left)


def require_loads(scene: Scene, mesh: LocalMesh) -> None:
    """Raise InputError where in some stage a concentrated load is on what is not there
    (collective).
    """
    first = "; on a region that is placed later give it as load of the [[stage]] that places it"
    names = [first, *(f" (in the stage '{stage.name}')" for stage in scene.stage)]
    for name, present in zip(names, scene.stages, strict=True):
        if present.inactive and present.load:
            active = [region for region in mesh.regions if region not in present.inactive]
            try:
                concentrated_loads(present, Domain(mesh, active), lambda force: {})
            except InputError as error:
                raise InputError(f"{error}{name}") from None


def require_plates(scene: Scene, mesh: LocalMesh) -> None:
    """Raise InputError where a stage places a part of a surface whose nodes move alike: what is
    there of it may have moved, and the region is free of strain (collective).
    """
    for k, (stage, present) in enumerate(zip(scene.stage, scene.stages[1:], strict=True)):
        plates = [boundary.on for boundary in present.boundary if boundary.equal_displacement]
        for tags in plates if stage.active else ():
            behind = {mesh.cell_region[i] for tag in tags for i in _cells_behind(mesh, tag)}
            names = {mesh.regions[i] for i in set().union(*mesh.comm.allgather(behind))}
            names -= {*present.inactive}
            if names & {*stage.active} and names - {*stage.active}:
                raise InputError(
                    f"{scene.source_path or 'scene'} [stage.{k}.active]: received"
                    f" {shown(sorted(names & {*stage.active})[0])}, a part of whose surface is on"
                    f" {shown(tags[0])}, where equal_displacement holds what is there already;"
                    " expected a tag of its own for the surface that is placed"
                )


def _cells_behind(mesh, tag):
    """Return the cells behind the facets of a tag, of the mesh or toward a region."""
    groups = [group[tag].cells for group in (mesh.facets, mesh.inner) if tag in group]
    return np.concatenate(groups) if groups else np.zeros(0, dtype=int)


def _part(facets, rows):
    return Facets(facets.nodes[rows], facets.cells[rows], facets.local[rows], facets.owned[rows])
