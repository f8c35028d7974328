"""Mesh files of Gmsh, 2.x and 4.x, text and binary, with all physical groups of an element.

Format: Gmsh reference manual, "File formats".  Elements may be in no physical group or in several,
groups may have no name, and two groups of different dimension may have the same one.
"""

from pathlib import Path

import numpy as np

from ..errors import listed
from .source import Block, Source, Unusable, numbered, places_of

# Gmsh's number of a kind: name in meshio, dimension, number of nodes
KINDS = {
    1: ("line", 1, 2),
    2: ("triangle", 2, 3),
    3: ("quad", 2, 4),
    4: ("tetra", 3, 4),
    5: ("hexahedron", 3, 8),
    6: ("wedge", 3, 6),
    7: ("pyramid", 3, 5),
    8: ("line3", 1, 3),
    9: ("triangle6", 2, 6),
    10: ("quad9", 2, 9),
    11: ("tetra10", 3, 10),
    12: ("hexahedron27", 3, 27),
    13: ("wedge18", 3, 18),
    14: ("pyramid14", 3, 14),
    15: ("vertex", 0, 1),
    16: ("quad8", 2, 8),
    17: ("hexahedron20", 3, 20),
    18: ("wedge15", 3, 15),
    19: ("pyramid13", 3, 13),
    21: ("triangle10", 2, 10),
    26: ("line4", 1, 4),
    29: ("tetra20", 3, 20),
    36: ("quad16", 2, 16),
    92: ("hexahedron64", 3, 64),
}
_HEXAHEDRON = [*range(8), 8, 11, 13, 9, 16, 18, 19, 17, 10, 12, 14, 15]
_WEDGE = [*range(6), 6, 9, 7, 12, 14, 13, 8, 10, 11]
_PYRAMID = [*range(5), 5, 8, 10, 6, 7, 9, 11, 12]
# VTK's order of nodes in Gmsh's numbers, of the kinds in which they differ
ORDER = {
    "tetra10": [*range(8), 9, 8],
    "hexahedron20": _HEXAHEDRON,
    "hexahedron27": [*_HEXAHEDRON, 22, 23, 21, 24, 20, 25, 26],
    "wedge15": _WEDGE,
    "wedge18": [*_WEDGE, 15, 17, 16],
    "pyramid13": _PYRAMID,
    "pyramid14": [*_PYRAMID, 13],
}
ELEMENTARY = "gmsh:geometrical"


def read_gmsh(path: Path) -> Source:
    """Return the content of a file; raises ValueError and what else a broken file leads to."""
    data = path.read_bytes()
    version, is_text, size, order, start = _header(data)
    if not 2 <= version < 3 and not 4 <= version < 5:
        raise Unusable(f"version {version:g} of Gmsh's format; save it as version 2.2 or 4.1")
    sections = {}
    for name in (b"PhysicalNames", b"Entities", b"Nodes", b"Elements", b"PartitionedEntities"):
        at = data.find(b"\n$" + name, start - 1)
        if at >= 0:
            sections[name.decode()] = data.index(b"\n", at + 1) + 1
    if "PartitionedEntities" in sections and version < 4.1:
        raise Unusable("a partitioned mesh; save it in one part")

    def numbers(name):
        begin = sections[name]
        end = data.index(b"$End" + name.encode(), begin)
        return _Text(data[begin:end]) if is_text else _Binary(data, begin, size, order)

    names = _names(data, sections["PhysicalNames"]) if "PhysicalNames" in sections else {}
    if version < 3:
        tags, points = _nodes_2(numbers("Nodes"))
        parts = _elements_2(numbers("Elements"))
    else:
        is_old = version < 4.1
        tags, points = (_nodes_40 if is_old else _nodes_4)(numbers("Nodes"))
        groups = _groups_of_entities(numbers("Entities"), is_old) if "Entities" in sections else {}
        if "PartitionedEntities" in sections:
            groups |= _groups_of_parts(numbers("PartitionedEntities"), groups)
        parts = _elements_4(numbers("Elements"), groups, is_old)
    return _assembled(tags, points, parts, names)


def _header(data):
    """Return version, whether it is text, bytes of a size, byte order and where the rest begins."""
    at = data.find(b"$MeshFormat")
    if at < 0:
        raise ValueError("it has no $MeshFormat, as files of Gmsh have")
    begin = data.index(b"\n", at) + 1
    end = data.index(b"\n", begin)
    version, kind, size = data[begin:end].split()[:3]
    order = "<"
    if kind == b"1" and int.from_bytes(data[end + 1 : end + 5], "little") != 1:
        order = ">"
    return float(version), kind == b"0", int(size), order, data.index(b"$EndMeshFormat", end)


def _names(data, begin):
    """Return (dimension, number) -> name."""
    text = data[begin : data.index(b"$EndPhysicalNames", begin)].decode(errors="replace")
    names = {}
    for line in text.splitlines()[1:]:
        head, _, rest = line.partition('"')
        if rest:
            dim, number = (int(word) for word in head.split())
            names[dim, number] = rest.rpartition('"')[0].strip()
    return names


class _Text:
    """The numbers of a section in text."""

    def __init__(self, text):
        self._values = np.array(text.split()).astype(float)
        self._at = 0

    def take(self, kind, count):
        """Return the next numbers: kind "i" of an integer, "n" of a size, "d" of a double."""
        part = self._values[self._at : self._at + count]
        if len(part) < count:
            raise ValueError("the file ends too early")
        self._at += count
        return part if kind == "d" else part.astype(np.int64)

    def rows(self, kinds, count):
        """Return the next records: for each (kind, width) an array (count, width)."""
        width = sum(n for _, n in kinds)
        table = self.take("d", count * width).reshape(count, width)
        columns = np.split(table, np.cumsum([n for _, n in kinds])[:-1], axis=1)
        return [
            part if kind == "d" else part.astype(np.int64)
            for (kind, _), part in zip(kinds, columns, strict=True)
        ]


class _Binary:
    """The numbers of a binary section."""

    def __init__(self, data, begin, size, order):
        self._data = data
        self._at = begin
        self._kinds = {"i": f"{order}i4", "n": f"{order}u{size}", "d": f"{order}f8"}

    def take(self, kind, count):
        """Return the next numbers."""
        return self.rows([(kind, count)], 1)[0][0]

    def rows(self, kinds, count):
        """Return the next records."""
        record = np.dtype([(f"{i}", self._kinds[kind], (n,)) for i, (kind, n) in enumerate(kinds)])
        if count < 0 or self._at + count * record.itemsize > len(self._data):
            raise ValueError("the file ends too early")
        table = np.frombuffer(self._data, record, count, self._at)
        self._at += count * record.itemsize
        return [
            table[f"{i}"].reshape(count, n).astype(float if kind == "d" else np.int64)
            for i, (kind, n) in enumerate(kinds)
        ]


def _count_line(numbers):
    """Return the number in the first line, which is text in binary files of version 2 too."""
    if isinstance(numbers, _Text):
        return int(numbers.take("n", 1)[0])
    end = numbers._data.index(b"\n", numbers._at)
    count = int(numbers._data[numbers._at : end])
    numbers._at = end + 1
    return count


def _nodes_2(numbers):
    tags, points = numbers.rows([("i", 1), ("d", 3)], _count_line(numbers))
    return tags[:, 0], points


def _elements_2(numbers):
    """Return (kind, nodes, physical numbers, elementary numbers) for runs of one kind."""
    count = _count_line(numbers)
    runs: list = []
    done = 0
    while done < count:
        if isinstance(numbers, _Text):
            _, kind, n_tags = numbers.take("i", 3).tolist()
            n = 1
            tags = numbers.take("i", n_tags)[None]
            nodes = numbers.take("i", KINDS[kind][2])[None]
        else:
            kind, n, n_tags = numbers.take("i", 3).tolist()
            widths = [("i", 1), ("i", n_tags), ("i", KINDS[kind][2])]
            _, tags, nodes = numbers.rows(widths, n)
        padded = np.zeros((n, 2), dtype=np.int64)
        padded[:, : min(n_tags, 2)] = tags[:, :2]
        if not runs or runs[-1][0] != kind:
            runs.append((kind, [], []))
        runs[-1][1].append(nodes)
        runs[-1][2].append(padded)
        done += n
    parts = []
    for kind, nodes, tags in runs:
        physical, elementary = np.concatenate(tags).T
        parts.append((kind, np.concatenate(nodes), _by_number(physical), elementary))
    return parts


def _by_number(numbers):
    """Return number of a group -> its elements; 0 is none, negative ones are turned around."""
    numbers = np.abs(numbers)
    return {n: np.flatnonzero(numbers == n) for n in np.unique(numbers).tolist() if n}


def _nodes_4(numbers):
    n_blocks, *_ = numbers.take("n", 4).tolist()
    tags, points = [], []
    for _ in range(n_blocks):
        dim, _, parametric = numbers.take("i", 3).tolist()
        (count,) = numbers.take("n", 1).tolist()
        tags.append(numbers.take("n", count))
        width = 3 + (dim if parametric else 0)
        points.append(numbers.take("d", count * width).reshape(count, width)[:, :3])
    return np.concatenate(tags), np.concatenate(points)


def _nodes_40(numbers):
    """Return numbers and places of nodes of version 4.0, in which the number precedes the place."""
    n_blocks, _ = numbers.take("n", 2).tolist()
    tags, points = [], []
    for _ in range(n_blocks):
        _, dim, parametric = numbers.take("i", 3).tolist()
        (count,) = numbers.take("n", 1).tolist()
        own, at = numbers.rows([("i", 1), ("d", 3 + (dim if parametric else 0))], count)
        tags.append(own[:, 0])
        points.append(at[:, :3])
    return np.concatenate(tags), np.concatenate(points)


def _groups_of_entities(numbers, is_old):
    """Return (dimension, tag) -> numbers of the physical groups; 4.0 has boxes of points too."""
    groups = {}
    for dim, count in enumerate(numbers.take("n", 4).tolist()):
        for _ in range(count):
            (tag,) = numbers.take("i", 1).tolist()
            groups[dim, tag] = _groups_of_one(numbers, dim, 6 if dim or is_old else 3)
    return groups


def _groups_of_one(numbers, dim, box):
    """Return the groups of an entity, from its box on, and pass what bounds it."""
    numbers.take("d", box)
    (n,) = numbers.take("n", 1).tolist()
    groups = sorted({abs(g) for g in numbers.take("i", n).tolist()})
    if dim:
        (n,) = numbers.take("n", 1).tolist()
        numbers.take("i", n)
    return groups


def _groups_of_parts(numbers, groups):
    """Return (dimension, tag) -> groups of the entities that a partition has cut others into; what
    lies between two parts is in none.
    """
    (n_parts,) = numbers.take("n", 1).tolist()
    (n_ghosts,) = numbers.take("n", 1).tolist()
    numbers.take("i", 2 * n_ghosts)
    of_parts = {}
    found = set()
    for dim, count in enumerate(numbers.take("n", 4).tolist()):
        for _ in range(count):
            tag, *parent = numbers.take("i", 3).tolist()
            (n,) = numbers.take("n", 1).tolist()
            found |= set(numbers.take("i", n).tolist())
            own = _groups_of_one(numbers, dim, 6 if dim else 3)
            of_parts[dim, tag] = groups.get(tuple(parent), own) if parent[0] == dim else []
    if len(found) < n_parts:
        raise Unusable(
            f"part {listed(map(str, sorted(found)))} of {n_parts} of a mesh; save it in one file"
        )
    return of_parts


def _elements_4(numbers, groups, is_old):
    n_blocks, *_ = numbers.take("n", 2 if is_old else 4).tolist()
    parts = []
    for _ in range(n_blocks):
        dim, entity, kind = numbers.take("i", 3).tolist()
        if is_old:
            dim, entity = entity, dim
        (count,) = numbers.take("n", 1).tolist()
        width = 1 + KINDS[kind][2]
        kind_of_number = "i" if is_old else "n"
        nodes = numbers.take(kind_of_number, count * width).reshape(count, width)[:, 1:]
        members = {number: np.arange(count) for number in groups.get((dim, entity), ())}
        parts.append((kind, nodes, members, np.full(count, entity)))
    return parts


def _assembled(tags, points, parts, names):
    """Return the Source: node tags replaced by their places, groups by their names."""
    places = places_of(tags)
    blocks: list[Block] = []
    members: dict[str, dict[int, list]] = {}
    for index, (kind, nodes, groups, _) in enumerate(parts):
        name, dim, _ = KINDS[kind]
        blocks.append(Block(name, dim, places(nodes)[:, ORDER.get(name, slice(None))]))
        for number, cells in groups.items():
            group = names.get((dim, number), "") or numbered(number)
            members.setdefault(group, {}).setdefault(index, []).append(cells)
    none = [np.empty(0, dtype=np.int64)]
    sets = {
        name: [np.concatenate(of_block.get(i, none)) for i in range(len(blocks))]
        for name, of_block in members.items()
    }
    elementary = {ELEMENTARY: [numbers for *_, numbers in parts]}
    return Source(points, blocks, sets, elementary)
