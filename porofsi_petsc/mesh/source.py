"""What a mesh file says, before it is a mesh: nodes, blocks of cells of all dimensions, sets and
arrays.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np


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
    sections : the sets that the file gives materials to, if it does.
    """

    points: np.ndarray
    blocks: list[Block]
    sets: dict[str, list[np.ndarray]] = field(default_factory=dict)
    arrays: dict[str, list[np.ndarray]] = field(default_factory=dict)
    node_sets: dict[str, np.ndarray] = field(default_factory=dict)
    sections: tuple[str, ...] = ()


class Unusable(ValueError):
    """A file that is whole but not what is read; the message says what to do."""


def numbered(number: int) -> str:
    """Return the name of a group that has only a number."""
    return f"group_{number}"
