"""Some regions of a mesh as a mesh of their own."""

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from ..errors import InputError, shown
from .mesh import Mesh
from .topology import cell_facets, facet_groups, locate_facets


def excerpt(mesh: Mesh, regions: Collection[str], where: str) -> Mesh:
    """Return the mesh of some regions alone, in the numbering of the nodes that are left.

    Their surface toward each region that is left out, as far as it has no tag, is tagged with the
    name of that region; tags keep the facets that are left, outward.  Raises InputError where a
    region is not there, or its name is taken.
    """
    for name in regions:
        if name not in mesh.regions:
            expected = f"regions of the mesh: {', '.join(mesh.regions)}"
            raise InputError(f"{where} [mesh.keep]: received {shown(name)}, expected {expected}")
    kept = np.isin(mesh.cell_region, [mesh.regions.index(name) for name in regions])
    names = tuple(name for name in mesh.regions if name in regions)
    cells = mesh.cells[kept]
    number = np.full(len(mesh.points), -1)
    used = np.unique(cells)
    number[used] = np.arange(len(used))
    facets = _remaining(mesh, cells) | _cuts(mesh, kept, where)
    return replace(
        mesh,
        points=mesh.points[used],
        cells=number[cells],
        regions=names,
        cell_region=np.array([names.index(mesh.regions[i]) for i in mesh.cell_region[kept]]),
        facets={tag: number[nodes] for tag, nodes in facets.items()},
        values={name: values[kept] for name, values in mesh.values.items()},
    )


def with_inner(mesh: Mesh, regions: Collection[str]) -> Mesh:
    """Return the mesh with the surfaces that others have toward some regions."""
    group = facet_groups(mesh.cells, mesh.element)
    facets = cell_facets(mesh.cells, mesh.element)
    found = {}
    for name in regions:
        inside = mesh.cell_region == mesh.regions.index(name)
        shared = (group >= 0) & np.isin(group, group[inside]) & ~inside[:, None]
        found[name] = facets[shared]
    return replace(mesh, inner=found)


def _remaining(mesh, cells):
    """Return tag -> facets of the cells, outward from one of them, without empty tags."""
    found = {}
    for tag, nodes in mesh.facets.items():
        cell, local = locate_facets(nodes, cells, mesh.element)
        here = cell >= 0
        if here.any():
            found[tag] = cell_facets(cells, mesh.element)[cell[here], local[here]]
    return found


def _cuts(mesh, kept, where):
    """Return region that is left out -> facets of the kept cells on it, outward."""
    group = facet_groups(mesh.cells, mesh.element)
    of_kept = group[kept].copy()
    for nodes in mesh.facets.values():
        cell, local = locate_facets(nodes, mesh.cells[kept], mesh.element)
        of_kept[cell[cell >= 0], local[cell >= 0]] = -1
    facets = cell_facets(mesh.cells[kept], mesh.element)
    found = {}
    for i, name in enumerate(mesh.regions):
        beyond = group[~kept & (mesh.cell_region == i)]
        shared = (of_kept >= 0) & np.isin(of_kept, beyond)
        if not shared.any():
            continue
        if name in mesh.facets:
            raise InputError(
                f"{where} [mesh.keep]: the surface toward the region {shown(name)} would have the"
                " name of a boundary, expected different names; rename one of them"
            )
        found[name] = facets[shared]
    return found
