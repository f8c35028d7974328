"""What a mesh file says, before it is a mesh: nodes, blocks of cells of all dimensions, sets and
arrays.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

NO_GROUP = np.iinfo(np.int64).min  # in an array of numbers of groups
_DIMENSIONS = {"vertex": 0, "line": 1, "triangle": 2, "quad": 2}  # of the other kinds 3


class Block(NamedTuple):
    """Cells of one kind: its name in meshio, its dimension, nodes (n, A) in VTK's order."""

    type: str
    dim: int
    data: np.ndarray


@dataclass
class Source:
    """The content of a file.

    points : (N, >= d) [m].  sets : name -> for each block the numbers of its cells in the set.
    arrays : name -> for each block one integer per cell.  node_sets : name -> node numbers.
    values : name -> for each block one number per cell, of any array that has them.
    sections : the sets that the file gives materials to, if it does.  tags : cells and facets of
    the mesh over again, in sets or with arrays.
    """

    points: np.ndarray
    blocks: list[Block]
    sets: dict[str, list[np.ndarray]] = field(default_factory=dict)
    arrays: dict[str, list[np.ndarray]] = field(default_factory=dict)
    node_sets: dict[str, np.ndarray] = field(default_factory=dict)
    sections: tuple[str, ...] = ()
    values: dict[str, list[np.ndarray]] = field(default_factory=dict)
    tags: list["Source"] = field(default_factory=list)


class Unusable(ValueError):
    """A file that is whole but not what is read; the message says what to do."""


def numbered(number: int) -> str:
    """Return the name of a group that has only a number."""
    return f"group_{number}"


def dimension(name: str) -> int:
    """Return the dimension of a kind of cells by its name in meshio."""
    return _DIMENSIONS.get(name.rstrip("0123456789"), 3)


def places_of(numbers: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """Return what gives the places of nodes among all numbers (N,), -1 for one that is not there.

    Raises Unusable for a number that is there twice.
    """
    order = np.argsort(numbers)
    if len(np.unique(numbers)) < len(numbers):
        raise Unusable("two nodes with one number, of two parts; write one part")

    def places(nodes):
        at = np.searchsorted(numbers, nodes, sorter=order)
        found = order[np.minimum(at, len(numbers) - 1)]
        return np.where(numbers[found] == nodes, found, -1)

    return places
