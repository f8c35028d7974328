"""Tags and regions that a scene gives to what lies somewhere in a mesh."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from ..errors import InputError, digits, listed
from .check import Where, place
from .generate import AXES
from .mesh import Mesh
from .sides import ROUND_OFF, facet_normals
from .topology import cell_facets, facet_multiplicity, locate_facets

ACROSS = 0.5  # of the normal along the axis, up to which a facet is one of the cylinder


class Selector(Protocol):
    """What gets a name: a facet or a cell that meets every condition that is not None.

    name : the tag, or with cells the region.  of : only facets of this tag, cells of this region.
    plane : its `resolved(dim)` returns a point [m] and the normal, (dim,) each.  box : x, y, z, an
    interval [m] or None each.  cylinder : point [m] and axis, (d,), none in the plane, radius [m],
    surface: whether only what lies on its surface.  formula : (t, x) -> values, met where they are
    positive.  normal : direction, (d,), from which the outward normal is at most `angle` [degrees]
    away.
    """

    name: str
    cells: bool
    of: str | None
    plane: Any
    box: Any
    cylinder: Any
    formula: Any
    normal: Any
    angle: float


def with_tags(mesh: Mesh, selectors: Sequence[Selector], where: Where) -> Mesh:
    """Return the mesh with the tags and regions of the selectors, each of which takes what it
    names out of the tags or regions before it.

    Facets are those of the boundary, or of the tag `of`; their nodes must meet the conditions, and
    of a formula their centre.  Of cells it is the centre.  Raises InputError where a selector names
    nothing.
    """
    for index, selector in enumerate(selectors):
        place_of = f"{where} [mesh.tag.{index}]"
        mesh = (_with_region if selector.cells else _with_tag)(mesh, selector, place_of)
    return mesh


def _with_region(mesh, selector, where):
    centres = mesh.points[mesh.cells].mean(axis=1)
    candidates = np.ones(len(centres), dtype=bool)
    if selector.of is not None:
        _require_known(selector.of, mesh.regions, "region", where)
        candidates = mesh.cell_region == mesh.regions.index(selector.of)
    here = candidates & _inside(selector, centres[:, None], centres, _tolerance(mesh), where)
    _require_some(here, centres[candidates], mesh, selector, where)
    names = [*mesh.regions, *([] if selector.name in mesh.regions else [selector.name])]
    region = np.where(here, names.index(selector.name), mesh.cell_region)
    used, region = np.unique(region, return_inverse=True)
    return replace(mesh, regions=tuple(names[i] for i in used), cell_region=region)


def _with_tag(mesh, selector, where):
    """Return the mesh with the tag on facets, which no other tag has any more."""
    shape = len(mesh.cells), len(mesh.element.facets)
    keys = {
        tag: np.ravel_multi_index(locate_facets(nodes, mesh.cells, mesh.element), shape)
        for tag, nodes in mesh.facets.items()
    }
    if selector.of is None:
        outer = facet_multiplicity(mesh.cells, mesh.element) == 1
        candidates = np.flatnonzero(outer)
    else:
        _require_known(selector.of, mesh.facets, "boundary tag", where)
        candidates = keys[selector.of]
    facets = cell_facets(mesh.cells, mesh.element)[np.unravel_index(candidates, shape)]
    X = mesh.points[facets]
    centres = X.mean(axis=1)
    here = _inside(selector, X, centres, _tolerance(mesh), where) & _directed(
        selector, mesh, facets
    )
    _require_some(here, centres, mesh, selector, where)
    chosen = candidates[here]
    tags = {tag: mesh.facets[tag][~np.isin(own, chosen)] for tag, own in keys.items()}
    former = tags.get(selector.name, facets[:0])
    tags[selector.name] = np.concatenate([former, facets[here]])
    return replace(mesh, facets={tag: nodes for tag, nodes in tags.items() if len(nodes)})


def _directed(selector, mesh, facets):
    """Return which facets, (F, Af), have the direction that a selector says, (F,)."""
    vertices = mesh.element.cell.facet_vertices
    normals = facet_normals(mesh.points[facets[:, :vertices]])
    here = np.ones(len(facets), dtype=bool)
    if selector.normal is not None:
        along = np.array(selector.normal) / np.linalg.norm(selector.normal)
        here &= normals @ along >= np.cos(np.radians(selector.angle))
    cylinder = selector.cylinder
    if cylinder is not None and cylinder.surface and len(cylinder.axis):
        axis = np.array(cylinder.axis) / np.linalg.norm(cylinder.axis)
        here &= np.abs(normals @ axis) <= ACROSS
    return here


def _require_some(here, centres, mesh, selector, where):
    if here.any():
        return
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    box = " x ".join(
        f"[{digits(a)}, {digits(b)}]" for a, b in zip(low.tolist(), high.tolist(), strict=True)
    )
    what = "cells" if selector.cells else "facets"
    of = f"'{selector.of}'" if selector.of else "the mesh" if selector.cells else "the boundary"
    nearest = ""
    if selector.plane is not None:
        away = np.abs(_away(selector.plane, centres))
        first = int(away.argmin())
        nearest = f", the centre next to its plane, {away[first]:.3g} m away, is"
        nearest += f" {place(centres[first])} m"
    raise InputError(
        f"{where}: '{selector.name}' gets none of the {len(centres)} {what} of {of}, expected one"
        f" at least; the mesh lies in {box} m{nearest}"
    )


def _inside(selector, nodes, centres, tolerance, where):
    """Return which of some facets or cells, of nodes (n, k, d) and centres (n, d), meet what a
    selector says of their place.
    """
    here = np.ones(len(centres), dtype=bool)
    if selector.plane is not None:
        here &= (np.abs(_away(selector.plane, nodes)) <= tolerance).all(axis=1)
    for axis, name in enumerate(AXES[: nodes.shape[2]]):
        interval = getattr(selector.box, name, None)
        if interval is not None:
            x = nodes[:, :, axis]
            low, high = interval[0] - tolerance, interval[1] + tolerance
            here &= ((x >= low) & (x <= high)).all(axis=1)
    if selector.cylinder is not None:
        r = _radius(selector.cylinder, nodes)
        limit = selector.cylinder.radius
        here &= (r <= limit + tolerance).all(axis=1)
        if selector.cylinder.surface:
            here &= (r >= limit - tolerance).all(axis=1)
    if selector.formula is not None:
        try:
            here &= selector.formula(0.0, centres) > 0
        except InputError as error:
            raise InputError(f"{where[:-1]}.formula]: {error}") from None
    return here


def _away(plane, X):
    """Return the distances of points (..., d) from a plane [m], positive along its normal."""
    point, normal = map(np.array, plane.resolved(X.shape[-1]))
    return (X - point) @ (normal / np.linalg.norm(normal))


def _radius(cylinder, nodes):
    """Return the distances from the axis, (n, k) [m]."""
    away = nodes - np.array(cylinder.point)
    if len(cylinder.axis):
        axis = np.array(cylinder.axis) / np.linalg.norm(cylinder.axis)
        away = away - (away @ axis)[..., None] * axis
    return np.linalg.norm(away, axis=-1)


def _tolerance(mesh):
    return ROUND_OFF * np.ptp(mesh.points, axis=0).max()


def _require_known(name, names, kind, where):
    if name not in names:
        raise InputError(
            f"{where[:-1]}.of]: the mesh has no {kind} '{name}' here; choose from"
            f" {listed(sorted(names))}"
        )
