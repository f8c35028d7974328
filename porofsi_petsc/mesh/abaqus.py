"""Input files of Abaqus: nodes, elements, and sets and surfaces of one part.

Format: Abaqus Analysis User's Guide, "Input syntax rules", "Node definition", "Element definition",
"Surfaces".  The sets that sections give materials to are the regions.
"""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from .source import Block, Source, Unusable, places_of

# Family of elements: pattern of its types, dimension, name in meshio by the number in the type
FAMILIES = (
    (
        re.compile(r"^(?:A|D|DC|EM|Q3|P)?C3D(\d+)"),
        3,
        {
            4: "tetra",
            5: "pyramid",
            6: "wedge",
            8: "hexahedron",
            10: "tetra10",
            13: "pyramid13",
            15: "wedge15",
            20: "hexahedron20",
        },
    ),
    (
        re.compile(r"^(?:CPEG|CPE|CPS|CAX|CGAX|AC2D|DC2D|ACAX|DCAX|STRI|SFM3D|M3D|R3D|DS|S)(\d)"),
        2,
        {3: "triangle", 4: "quad", 6: "triangle6", 8: "quad8", 9: "quad9"},
    ),
    (
        re.compile(r"^(?:T2D|T3D|R2D|RAX|SAX|MAX|B2|B3)(\d)"),
        1,
        {1: "line", 2: "line", 3: "line3"},
    ),
)
# Elements that are no part of a body
POINTS = re.compile(r"^(?:MASS|ROTARY|SPRING|DASHPOT|CONN|GAP|ITT|DCOUP)")
NODES = {"line": 2, "line3": 3, "triangle": 3, "triangle6": 6, "quad": 4, "quad8": 8, "quad9": 9}
NODES |= {"tetra": 4, "tetra10": 10, "pyramid": 5, "pyramid13": 13, "wedge": 6, "wedge15": 15}
NODES |= {"hexahedron": 8, "hexahedron20": 20}
_TRIANGLE = ((0, 1), (1, 2), (2, 0))
_QUAD = ((0, 1), (1, 2), (2, 3), (3, 0))
# Vertices of the faces S1, S2, ... by the beginning of the name of a cell
FACES = {
    "triangle": _TRIANGLE,
    "quad": _QUAD,
    "tetra": ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)),
    "pyramid": ((0, 1, 2, 3), (0, 4, 1), (1, 4, 2), (2, 4, 3), (3, 4, 0)),
    "wedge": ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0)),
    "hexahedron": (
        *((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1)),
        *((1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)),
    ),
}
FACETS = {2: "line", 3: "triangle", 4: "quad"}
GENERATORS = ("NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY")


class Keyword(NamedTuple):
    """A keyword line, its parameters in capitals with their values, and its data lines."""

    name: str
    given: dict[str, str]
    lines: list[list[str]]


def read_abaqus(path: Path) -> Source:
    """Return the content of a file; raises ValueError and what else a broken file leads to."""
    deck = _Deck()
    for keyword in _keywords(path):
        deck.take(keyword)
    return deck.source()


def _keywords(path: Path, depth: int = 0) -> Iterator[Keyword]:
    """Yield the keywords of a file and of those that it includes."""
    if depth > 5:
        raise ValueError("files include each other")
    keywords: list[Keyword] = []
    head = ""
    for line in map(str.strip, path.read_text(errors="replace").splitlines()):
        if not line or line.startswith("**"):
            continue
        if line.startswith("*") or head.endswith(","):
            head += line
            if not line.endswith(","):
                name, _, rest = head[1:].partition(",")
                keywords.append(Keyword(" ".join(name.upper().split()), _parameters(rest), []))
                head = ""
        elif keywords:
            keywords[-1].lines.append([word.strip() for word in line.strip(",").split(",")])
    for keyword in keywords:
        if keyword.name == "INCLUDE":
            included = path.parent / keyword.given.get("INPUT", "")
            if not included.is_file():
                raise Unusable(f"*INCLUDE of {included.name}, and there is no such file beside it")
            yield from _keywords(included, depth + 1)
        else:
            yield keyword


def _parameters(text):
    """Return the parameters of a keyword line, name in capitals -> value without quotes."""
    pairs = (part.partition("=") for part in text.split(",") if part.strip())
    return {key.strip().upper(): value.strip().strip('"') for key, _, value in pairs}


class _Deck:
    """What has been read so far; numbers are those of the file."""

    def __init__(self):
        self.nodes = []
        self.coordinates = []
        self.elements = []  # (kind, dimension, element numbers, nodes)
        self.node_sets = {}
        self.element_sets = {}
        self.surfaces = {}
        self.sections = []
        self.instances = 0
        self.shift = np.zeros(3)

    def take(self, keyword):
        """Take what a keyword says; most of them say nothing of the mesh."""
        name, given, lines = keyword
        if name in GENERATORS:
            raise Unusable(f"*{name} makes nodes or elements; write the mesh without it")
        if name == "NODE":
            self._take_nodes(given, lines)
        elif name == "ELEMENT":
            self._take_elements(given, lines)
        elif name == "NSET" and "ELSET" in given:
            cells = self._resolved(self.element_sets, given["ELSET"])
            self._add(self.node_sets, given["NSET"], [("cells", cells)])
        elif name == "NSET":
            self._add(self.node_sets, given["NSET"], _entries(given, lines))
        elif name == "ELSET":
            self._add(self.element_sets, given["ELSET"], _entries(given, lines))
        elif name == "SURFACE" and given.keys() >= {"NAME"} and "COMBINE" not in given:
            self.surfaces[given["NAME"]] = (given.get("TYPE", "ELEMENT").upper(), lines)
        elif name.endswith("SECTION") and "ELSET" in given and given["ELSET"] not in self.sections:
            self.sections.append(given["ELSET"])
        elif name == "INSTANCE":
            self._take_instance(lines)

    def _take_instance(self, lines):
        self.instances += 1
        if self.instances > 1:
            raise Unusable("several instances; merge them into one part")
        if len(lines) > 1:
            raise Unusable("a rotated instance; write the mesh in the coordinates of the body")
        if lines:
            self.shift = np.array([float(word) for word in lines[0]] + [0.0] * 3)[:3]

    def _take_nodes(self, given, lines):
        if given.get("SYSTEM", "R").upper() != "R":
            raise Unusable("nodes not in Cartesian coordinates; write them as x, y, z")
        numbers = [int(words[0]) for words in lines]
        self.nodes += numbers
        for words in lines:
            given_ones = [float(word or 0) for word in words[1:4]]
            self.coordinates.append(given_ones + [0.0] * (3 - len(given_ones)))
        if "NSET" in given:
            self._add(self.node_sets, given["NSET"], [("numbers", numbers)])

    def _take_elements(self, given, lines):
        kind, dim = _kind(given["TYPE"].upper())
        if dim == 0:
            return
        words = [int(word) for line in lines for word in line if word]
        table = np.array(words, dtype=np.int64).reshape(-1, NODES[kind] + 1)
        self.elements.append((kind, dim, table[:, 0], table[:, 1:]))
        if "ELSET" in given:
            self._add(self.element_sets, given["ELSET"], [("numbers", table[:, 0])])

    @staticmethod
    def _add(sets, name, entries):
        sets.setdefault(name, []).extend(entries)

    def _resolved(self, sets, name, depth=0):
        """Return the numbers in a set, those of the sets in it too."""
        if depth > 20:
            raise ValueError(f"the set '{name}' contains itself")
        names = {key.upper(): key for key in sets}
        if name.upper() not in names:
            raise ValueError(f"there is no set '{name}'")
        parts = [np.empty(0, dtype=np.int64)]
        for what, value in sets[names[name.upper()]]:
            if what == "set":
                value = self._resolved(sets, value, depth + 1)
            elif what == "cells":
                value = self._nodes_of(value)
            parts.append(np.asarray(value, dtype=np.int64))
        return np.unique(np.concatenate(parts))

    def _nodes_of(self, cells):
        chosen = [nodes[np.isin(own, cells)].ravel() for _, _, own, nodes in self.elements]
        return np.concatenate(chosen)

    def source(self):
        """Return the Source: numbers of the file replaced by places, surfaces as blocks of their
        own.
        """
        places = places_of(np.array(self.nodes, dtype=np.int64))
        blocks = [Block(kind, dim, places(nodes)) for kind, dim, _, nodes in self.elements]
        own = [elements for *_, elements, _ in self.elements]
        sets = {}
        for name in self.element_sets:
            members = self._resolved(self.element_sets, name)
            sets[name] = [np.flatnonzero(np.isin(elements, members)) for elements in own]
        used = self._internal_of_surfaces()
        sets = {name: cells for name, cells in sets.items() if name.upper() not in used}
        node_sets = {name: places(self._resolved(self.node_sets, name)) for name in self.node_sets}
        for name, (kind, lines) in self.surfaces.items():
            if kind == "NODE":
                found = [self._node_entry(line[0]) for line in lines]
                node_sets[name] = places(np.concatenate(found))
                continue
            in_blocks = sets.setdefault(name, [])
            for facets in self._surface(lines):
                in_blocks += [np.empty(0, dtype=np.int64)] * (len(blocks) - len(in_blocks))
                in_blocks.append(np.arange(len(facets)))
                dim = 1 if facets.shape[1] == 2 else 2
                blocks.append(Block(FACETS[facets.shape[1]], dim, places(facets)))
        for in_blocks in sets.values():
            in_blocks += [np.empty(0, dtype=np.int64)] * (len(blocks) - len(in_blocks))
        points = np.array(self.coordinates) + self.shift
        known = {name.upper(): name for name in sets}
        sections = [known[name.upper()] for name in self.sections if name.upper() in known]
        return Source(points, blocks, sets, {}, node_sets, tuple(dict.fromkeys(sections)))

    def _internal_of_surfaces(self):
        """Return the names of sets that only make up surfaces, in capitals."""
        named = {_plain(line[0]).upper() for _, lines in self.surfaces.values() for line in lines}
        kept = {name.upper() for name in self.sections}
        return {name for name in named - kept if name.startswith("_")}

    def _node_entry(self, word):
        word = _plain(word)
        return [int(word)] if word.isdigit() else self._resolved(self.node_sets, word)

    def _surface(self, lines):
        """Yield the vertices of the facets of a surface, (n, V), by element block and face."""
        for line in lines:
            word = _plain(line[0])
            members = [int(word)] if word.isdigit() else self._resolved(self.element_sets, word)
            face = line[1].upper() if len(line) > 1 else ""
            for kind, _, own, nodes in self.elements:
                chosen = nodes[np.isin(own, members)]
                if len(chosen):
                    yield chosen[:, _face(kind, face)]


def _face(kind, face):
    """Return the vertices of a face of a kind of elements, "S2", of a shell all of them."""
    base = re.match(r"[a-z]+", kind)[0]
    if face in ("SPOS", "SNEG"):
        return list(range(3 if base == "triangle" else 4))
    if not re.fullmatch(r"S\d", face) or not 1 <= int(face[1]) <= len(FACES.get(base, ())):
        raise Unusable(f"a surface of the faces '{face}' of {kind}; write S1, S2, ...")
    return list(FACES[base][int(face[1]) - 1])


def _plain(word):
    """Return a name or number without the instance in front of it."""
    return word.rpartition(".")[2].strip().strip('"')


def _entries(given, lines):
    """Return the entries of a set: numbers, ranges and names of sets."""
    if "GENERATE" in given:
        ranges = ([int(word) for word in line if word] for line in lines)
        return [("numbers", np.arange(a, b + 1, *step or [1])) for a, b, *step in ranges]
    words = [_plain(word) for line in lines for word in line if word]
    numbers = [int(word) for word in words if word.isdigit()]
    return [("numbers", numbers)] + [("set", word) for word in words if not word.isdigit()]


def _kind(type_):
    """Return the name of an element in meshio and its dimension, 0 for what is no body."""
    if POINTS.match(type_):
        return "", 0
    for pattern, dim, kinds in FAMILIES:
        match = pattern.match(type_)
        if match:
            number = int(match[1])
            if type_.startswith("STRI65"):
                number = 6
            if number in kinds:
                return kinds[number], dim
    raise Unusable(f"elements of the type {type_}; mesh the body with C3D4, C3D8, CPE4, ...")
