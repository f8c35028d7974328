"""Cells that no element has are cut into cells that one has, facets alike on both sides.

Where a facet is cut, its own node numbers decide how, so that both cells do it alike.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from ..errors import InputError
from .check import place
from .source import Block, Source

POLYGONS = {"penta_prism": 5, "hexa_prism": 6}


def cut_prisms(source: Source, where: Path) -> tuple[Source, str]:
    """Return the source with prisms over pentagons and hexagons cut into wedges, and a sentence on
    it, "" where there are none.

    A polygon is cut into the triangles at its smallest node number.  Raises InputError where that
    is another one at the bottom than at the top.
    """
    counts = [len(block.data) * (block.type in POLYGONS) for block in source.blocks]
    if not any(counts):
        return source, ""
    for index, block in enumerate(source.blocks):
        if counts[index]:
            wedges = _wedges(block, source.points, where)
            owner = np.repeat(np.arange(counts[index]), POLYGONS[block.type] - 2)
            source = replaced(source, index, Block("wedge", 3, wedges), owner)
    return source, f"{sum(counts)} prisms over pentagons or hexagons are cut into wedges"


def _wedges(block, points, where):
    n = POLYGONS[block.type]
    bottom, top = block.data[:, :n], block.data[:, n:]
    first = bottom.argmin(axis=1)
    other = np.flatnonzero(first != top.argmin(axis=1))
    if len(other):
        at = place(points[block.data[other[0]]].mean(axis=0))
        raise InputError(
            f"{where}: {len(other)} prisms, the first at {at}, have their smallest node number at"
            " another corner at the bottom than at the top, so that they cannot be cut alike on"
            " both sides; number the nodes layer by layer, or mesh with wedges or hexahedra"
        )
    corner = (first[:, None, None] + _fan(n)) % n
    cells = np.arange(len(block.data))[:, None, None]
    return np.concatenate([bottom[cells, corner], top[cells, corner]], axis=2).reshape(-1, 6)


def _fan(n):
    """Return the triangles at corner 0 of a polygon of n corners, (n - 2, 3)."""
    return np.array([[0, i, i + 1] for i in range(1, n - 1)])


def replaced(source: Source, index: int, block: Block, owner: np.ndarray) -> Source:
    """Return the source with parts in place of the cells of a block; owner : (n,) cell of each
    part.
    """
    blocks = [block if i == index else old for i, old in enumerate(source.blocks)]
    sets = {
        name: [
            np.flatnonzero(np.isin(owner, part)) if i == index else part
            for i, part in enumerate(parts)
        ]
        for name, parts in source.sets.items()
    }
    arrays = {
        name: [part[owner] if i == index else part for i, part in enumerate(parts)]
        for name, parts in source.arrays.items()
    }
    return replace(source, blocks=blocks, sets=sets, arrays=arrays)
