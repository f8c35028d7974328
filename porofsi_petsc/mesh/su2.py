"""Mesh files of SU2 (.su2): one zone, and its markers by name.

Format: SU2 documentation, "Mesh File".
"""

from pathlib import Path

import numpy as np

from .source import Block, Source, Unusable, dimension

# Number of a type, which is VTK's: name in meshio, number of nodes
TYPES = {
    1: ("vertex", 1),
    3: ("line", 2),
    5: ("triangle", 3),
    9: ("quad", 4),
    10: ("tetra", 4),
    12: ("hexahedron", 8),
    13: ("wedge", 6),
    14: ("pyramid", 5),
}


def read_su2(path: Path) -> Source:
    """Return the content of a file; raises ValueError and what else a broken file leads to."""
    points: list[list[str]] = []
    cells: dict[tuple[str, str], list[list[str]]] = {}  # by marker, "" of the body, and kind
    dim, key, marker = 0, "", ""
    for line in path.read_text(errors="replace").splitlines():
        head, is_key, value = line.partition("%")[0].partition("=")
        words = head.split()
        if is_key:
            key = words[0].upper()
            if key == "NZONE" and int(value) > 1:
                raise Unusable(f"a mesh of {int(value)} zones; write one zone")
            dim = int(value) if key == "NDIME" else dim
            marker = value.strip() if key == "MARKER_TAG" else marker
        elif words and key == "NPOIN":
            points.append(words[:dim])
        elif words and key in ("NELEM", "MARKER_ELEMS"):
            if int(words[0]) not in TYPES:
                raise Unusable(f"elements of the type {words[0]}; mesh the body with linear ones")
            kind, count = TYPES[int(words[0])]
            name = marker if key == "MARKER_ELEMS" else ""
            cells.setdefault((name, kind), []).append(words[1 : 1 + count])
    blocks = [
        Block(kind, dimension(kind), np.array(rows, dtype=np.int64))
        for (_, kind), rows in cells.items()
    ]
    none = np.empty(0, dtype=np.int64)
    sets = {
        name: [np.arange(len(rows)) if own == name else none for (own, _), rows in cells.items()]
        for name in dict.fromkeys(own for own, _ in cells if own)
    }
    return Source(np.array(points, dtype=float), blocks, sets)
