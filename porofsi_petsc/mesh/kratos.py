"""Mesh files of Kratos (.mdpa): nodes, elements, conditions and sub model parts.

Orders of nodes: Kratos, kratos/geometries.
"""

import re
from pathlib import Path

import numpy as np

from .exodus import ORDER as EXODUS
from .source import Block, Source, Unusable, dimension, places_of

_SURFACES = {3: "triangle", 4: "quad", 6: "triangle6", 8: "quad8", 9: "quad9"}
_LINES = {1: "vertex", 2: "line", 3: "line3"}
_BODIES = {1: "vertex", 2: "line", 3: "triangle", 4: "tetra", 5: "pyramid", 6: "wedge"}
_BODIES |= {8: "hexahedron", 10: "tetra10", 13: "pyramid13", 15: "wedge15"}
_BODIES |= {20: "hexahedron20", 27: "hexahedron27"}
# Name in meshio by what it is, dimension of the space and number of nodes
KINDS = {
    ("Elements", 2): {1: "vertex", 2: "line"} | _SURFACES,
    ("Elements", 3): _BODIES,
    ("Conditions", 2): _LINES,
    ("Conditions", 3): {1: "vertex", 2: "line"} | _SURFACES,
}
# VTK's order of nodes in Kratos's numbers: that of Exodus but for the middle of faces
ORDER = EXODUS | {"hexahedron27": [*EXODUS["hexahedron20"], 24, 22, 21, 23, 20, 25, 26]}


def read_kratos(path: Path) -> Source:
    """Return the content of a file; raises ValueError and what else a broken file leads to."""
    deck = _Deck()
    opened: list[list[str]] = []
    for line in path.read_text(errors="replace").splitlines():
        words = line.partition("//")[0].split()
        if words[:1] == ["Begin"]:
            opened.append(words[1:])
            deck.begin(words[1:])
        elif words[:1] == ["End"]:
            opened.pop()
            deck.end(words[1])
        elif words and opened:
            deck.take(opened[-1][0], words)
    return deck.source()


class _Deck:
    """What has been read so far; numbers are those of the file."""

    def __init__(self):
        self._rows = []
        self._nodes = []
        self._blocks = []  # what it is, type, rows of number, property and nodes
        self._parts = {}  # name -> what -> numbers
        self._inside = []

    def begin(self, head):
        """Begin a block of rows, or a sub model part."""
        self._rows = []
        if head[0] == "SubModelPart":
            if head[1] in self._parts:
                raise Unusable(f"two sub model parts '{head[1]}'; rename one")
            self._parts[head[1]] = {}
            self._inside.append(head[1])
        elif head[0] in ("Elements", "Conditions"):
            self._blocks.append((head[0], head[1], self._rows))
        elif head[0] == "Nodes":
            self._rows = self._nodes

    def take(self, what, words):
        """Take a row."""
        if what in ("Nodes", "Elements", "Conditions"):
            self._rows.append(words)
        elif what.startswith("SubModelPart") and self._inside:
            self._parts[self._inside[-1]].setdefault(what[12:], []).extend(words)

    def end(self, what):
        """End what was begun."""
        if what == "SubModelPart":
            self._inside.pop()

    def source(self):
        """Return the Source: numbers of the file replaced by places."""
        if not self._nodes:
            raise ValueError("it has no nodes, as files of Kratos have")
        table = np.array(self._nodes, dtype=float)
        places = places_of(table[:, 0].astype(np.int64))
        tables = [
            (what, _kind(what, type_, len(rows[0]) - 2), np.array(rows, dtype=np.int64))
            for what, type_, rows in self._blocks
            if rows
        ]
        blocks = [
            Block(kind, dimension(kind), places(rows[:, 2:])[:, ORDER.get(kind, slice(None))])
            for _, kind, rows in tables
        ]
        sets, node_sets = {}, {}
        for name, members in self._parts.items():
            own = {
                what: np.array(words, dtype=np.int64)
                for what, words in members.items()
                if what in ("Nodes", "Elements", "Conditions")
            }
            if own.keys() & {"Elements", "Conditions"}:
                sets[name] = [
                    np.flatnonzero(np.isin(rows[:, 0], own.get(what, ())))
                    for what, _, rows in tables
                ]
            elif "Nodes" in own:
                node_sets[name] = places(own["Nodes"])
        return Source(table[:, 1:4], blocks, sets, {}, node_sets)


def _kind(what, type_, count):
    """Return the name in meshio of "SmallDisplacementElement2D3N", "VMS3D" and the like."""
    match = re.search(r"([23])D(_?\d+N)?$", type_)
    kinds = KINDS[what, int(match[1])] if match else {}
    if re.match("Shell|Membrane|IsotropicShell", type_):
        kinds = _SURFACES
    if not match or count not in kinds:
        raise Unusable(f"{what.lower()} of the type {type_} with {count} nodes; give Element3D4N")
    return kinds[count]
