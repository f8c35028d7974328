"""The surface between two kinds of regions as a tag of the mesh."""

from collections.abc import Collection, Iterable
from dataclasses import replace

import numpy as np

from .mesh import Mesh
from .topology import cell_facets, facet_multiplicity

INTERFACE = "interface"


def with_interface(mesh: Mesh, regions: Collection[str], tags: Iterable[str]) -> Mesh:
    """Return the mesh with the tag "interface" on the facets between the given regions and all
    others, if there are any.

    The facets of the given tags, of the same regions, belong to it.  Orientation: outward from the
    given regions.
    """
    inside = np.isin(mesh.cell_region, [mesh.regions.index(name) for name in regions])
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
