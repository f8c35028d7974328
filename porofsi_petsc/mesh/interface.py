"""The surface between two kinds of regions as a tag of the mesh."""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace

import numpy as np

from .mesh import Mesh
from .topology import boundary_facets, cell_facets, facet_multiplicity, locate_facets

INTERFACE = "interface"
OF_REGION = f"{INTERFACE} of "  # followed by the name of a region


def with_interface(mesh: Mesh, regions: Collection[str], tags: Iterable[str]) -> Mesh:
    """Return the mesh with the tag "interface" on the facets between the given regions and all
    others, if there are any.

    The facets of the given tags, of the same regions, belong to it.  Orientation: outward from the
    given regions.
    """
    inside = _within(mesh, regions)
    inner = (facet_multiplicity(mesh.cells, mesh.element) == 2)[inside]
    shared = (
        inner & (facet_multiplicity(mesh.cells[inside], mesh.element) == 1)
        if inside.any()
        else inner
    )
    facets = np.concatenate(
        [cell_facets(mesh.cells[inside], mesh.element)[shared], *(mesh.facets[tag] for tag in tags)]
    )
    return replace(mesh, facets=mesh.facets | {INTERFACE: facets}) if len(facets) else mesh


def with_interface_of(mesh: Mesh, kinds: Mapping[str, str], names: Collection[str]) -> Mesh:
    """Return the mesh with those tags of `names` that are "interface of REGION": the facets between
    the fluid and that region of a solid, outward from the fluid; what the mesh has already stays.

    kinds : region -> "solid", "fluid" or "porous".  A restart may name others: they are `derived`.
    """
    wet = mesh.cells[_within(mesh, [name for name in kinds if kinds[name] == "fluid"])]
    outer = cell_facets(wet, mesh.element)[boundary_facets(wet, mesh.element)]
    found = {}
    for name in kinds:
        if kinds[name] != "fluid" and OF_REGION + name in set(names).difference(mesh.facets):
            cells = mesh.cells[_within(mesh, [name])]
            found[OF_REGION + name] = outer[locate_facets(outer, cells, mesh.element)[0] >= 0]
    found = {tag: facets for tag, facets in found.items() if len(facets)}
    return replace(mesh, facets=mesh.facets | found, derived=tuple(found))


def _within(mesh, names):
    """Return which cells lie in the regions, (E,) bool."""
    return np.isin(mesh.cell_region, [mesh.regions.index(name) for name in names])
