"""Tags of cells and facets that stand apart from the mesh, in its file or in another one, joined to
it.
"""

from collections.abc import Container
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..errors import InputError, listed
from .check import place
from .groups import require_array, sets_of
from .source import Source
from .topology import group_rows

# Vertices by the beginning of the name of a kind of cells
VERTICES = {"vertex": 1, "line": 2, "triangle": 3, "quad": 4, "tetra": 4, "pyramid": 5, "wedge": 6}
VERTICES |= {"hexahedron": 8}
APART = 1e-6  # of the size of the mesh: the distance of a node of the tags from that of the mesh


def part(source: Source, dims: Container[int]) -> Source:
    """Return the cells of some dimensions of a source with their sets, arrays and values."""
    kept = [i for i, block in enumerate(source.blocks) if block.dim in dims]
    sets, arrays, values = (
        {name: [parts[i] for i in kept] for name, parts in named.items()}
        for named in (source.sets, source.arrays, source.values)
    )
    sets = {name: parts for name, parts in sets.items() if any(map(len, parts))}
    blocks = [source.blocks[i] for i in kept]
    return Source(source.points, blocks, sets, arrays if kept else {}, values=values)


def joined(source: Source, array: str | None, dim: int, path: Path) -> Source:
    """Return the source with the groups of its arrays and its tags as sets, without both: tagged
    cells are found by their vertices, nodes of other numbers by their place.

    array : the array with the numbers of the groups, where there is one of that name.  Raises
    InputError for tags of nodes or cells that the mesh does not have, and for several arrays over
    the cells, or over the facets, unless one is named.
    """
    require_array([source, *source.tags], array, path)
    if not source.tags:
        return replace(source, sets=sets_of(source, array, path), arrays={})
    rest = part(source, {0, 1, 2, 3} - {dim, dim - 1})
    cells, tags = _named(source, dim, "cells", array, path)
    here = [_at_cells(tagged, cells, path) for tagged in tags]
    cells.sets = _united([cells.sets, *here], len(cells.blocks))
    facets, tags = _named(source, dim - 1, "facets", array, path)
    parts = [replace(rest, sets={}), cells, facets, *tags]
    blocks = [block for own in parts for block in own.blocks]
    sets: dict[str, list[np.ndarray]] = {}
    done = 0
    for own in parts:
        for name, of_blocks in own.sets.items():
            whole = sets.setdefault(name, [np.empty(0, dtype=np.int64)] * len(blocks))
            whole[done : done + len(of_blocks)] = of_blocks
        done += len(own.blocks)
    values = {name: _over(parts, cells, own) for name, own in cells.values.items()}
    return replace(source, blocks=blocks, sets=sets, arrays={}, tags=[], values=values)


def _over(parts, cells, values):
    """Return values over the blocks of the cells of the mesh as values over those of all parts, NaN
    in others.
    """
    found = []
    for own in parts:
        found += values if own is cells else [np.full(len(b.data), np.nan) for b in own.blocks]
    return found


def _named(source, dim, what, array, path):
    """Return the cells of a dimension of the mesh, and of its tags in the numbers of the mesh, all
    with sets only.
    """
    own = part(source, [dim])
    tags = [part(tagged, [dim]) for tagged in source.tags]
    tags = [tagged for tagged in tags if tagged.sets or tagged.arrays]
    numbered = [other for other in (own, *tags) if not other.sets and other.arrays]
    if len(numbered) > 1:
        wanted = [other for other in numbered if array in other.arrays]
        if len(wanted) != 1:
            names = listed(name for other in numbered for name in other.arrays)
            raise InputError(
                f"{path}: several arrays of integers over the {what} ({names}); leave one with the"
                " groups in the file, or name it in mesh.array"
            )
        tags = [other for other in tags if other.sets or other is wanted[0]]
        own = own if own.sets or own is wanted[0] else replace(own, arrays={})
    own = replace(own, sets=sets_of(own, array, path, distinct=what == "facets"), arrays={})
    return own, [_renumbered(tagged, source.points, array, path) for tagged in tags]


def _renumbered(tagged, points, array, path):
    """Return tags with sets only and the numbers of the nodes at the same places of the mesh."""
    sets = sets_of(tagged, array, path, distinct=True)
    width = max(points.shape[1], tagged.points.shape[1])
    theirs, ours = (np.pad(x, ((0, 0), (0, width - x.shape[1]))) for x in (tagged.points, points))
    blocks = tagged.blocks
    if not np.array_equal(theirs, ours):
        used = np.unique(np.concatenate([block.data.ravel() for block in blocks]))
        number = np.full(len(theirs), -1)
        number[used] = _nearest(theirs[used], ours, path)
        blocks = [block._replace(data=number[block.data]) for block in blocks]
    return Source(points, blocks, sets)


def _nearest(points, ours, path):
    """Return the node of the mesh at each point."""
    from scipy.spatial import cKDTree  # slow to import, and tags seldom have nodes of their own

    distance, nearest = cKDTree(ours).query(points, k=2)
    apart = APART * np.ptp(ours, axis=0).max()
    for wrong, what in (
        (distance[:, 0] > apart, "are none of the mesh"),
        (distance[:, 1] <= apart, "are at two nodes of the mesh"),
    ):
        if wrong.any():
            raise InputError(
                f"{path}: {wrong.sum()} nodes of the tags {what}, the first at"
                f" {place(points[wrong][0])}; write the tags with the nodes of this mesh"
            )
    return nearest[:, 0]


def _vertices(block):
    return block.data[:, : VERTICES[block.type.rstrip("0123456789")]]


def _at_cells(tagged, cells, path):
    """Return the sets of tags of cells as those of the cells of the mesh."""
    found = [_found(_vertices(block), cells, path) for block in tagged.blocks]
    return {
        name: [
            np.concatenate(
                [row[m][of[m] == i] for (of, row), m in zip(found, members, strict=True)]
            )
            for i in range(len(cells.blocks))
        ]
        for name, members in tagged.sets.items()
    }


def _found(rows, cells, path):
    """Return the block and the number in it of the cells of the mesh with these vertices (n, V)."""
    own = [(i, _vertices(block)) for i, block in enumerate(cells.blocks)]
    own = [(i, vertices) for i, vertices in own if vertices.shape[1] == rows.shape[1]]
    group = group_rows(np.concatenate([vertices for _, vertices in own] + [rows]))
    count = len(group) - len(rows)
    first = np.unique(group, return_index=True)[1][group[count:]]
    lost = np.flatnonzero(first >= count)
    if len(lost):
        at = place(cells.points[rows[lost[0]]].mean(axis=0))
        raise InputError(
            f"{path}: {len(lost)} tagged cells are none of the mesh, the first at {at}; write the"
            " tags of this mesh"
        )
    block = np.concatenate([np.full(len(vertices), i) for i, vertices in own])
    number = np.concatenate([np.arange(len(vertices)) for _, vertices in own])
    return block[first], number[first]


def _united(several, count):
    """Return name -> members of each block of all sets of the name."""
    united = {name: [np.empty(0, dtype=np.int64)] * count for sets in several for name in sets}
    for sets in several:
        for name, parts in sets.items():
            united[name] = [np.union1d(a, b) for a, b in zip(united[name], parts, strict=True)]
    return united
