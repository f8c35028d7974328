"""Models of FEBio (.feb), of which the mesh is read: nodes, elements by their names, surfaces and
node sets.

Format: FEBio User Manual, section Mesh (Geometry before version 3).
"""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from .source import Block, Source, Unusable, dimension, places_of

# Name in meshio of a type; the orders of nodes are VTK's
TYPES = {"hex8": "hexahedron", "hex20": "hexahedron20", "tet4": "tetra", "tet10": "tetra10"}
TYPES |= {"penta6": "wedge", "pyra5": "pyramid"}
TYPES |= {"tri3": "triangle", "tri6": "triangle6", "quad4": "quad", "quad8": "quad8"}
TYPES |= {"truss2": "line", "line2": "line"}
# Those of facets, of which the vertices are enough, by the beginning of their name
FACETS = {"tri": ("triangle", 3), "quad": ("quad", 4), "line": ("line", 2)}


def read_febio(path: Path) -> Source:
    """Return the content of a file; raises ValueError and what else a broken file leads to."""
    root = ET.parse(path).getroot()
    mesh = root.find("Mesh") if root.find("Mesh") is not None else root.find("Geometry")
    if mesh is None or mesh.get("from") or mesh.find("Part") is not None:
        raise Unusable("a model whose mesh is in another file or in parts; write it in one")
    nodes = [node for block in mesh.findall("Nodes") for node in block]
    places = places_of(np.array([int(node.attrib["id"]) for node in nodes]))
    points = np.stack([_numbers(node).astype(float) for node in nodes])
    runs = _runs(mesh)
    blocks = [
        Block(kind, dimension(kind), places(np.stack(cells).astype(np.int64)))
        for _, kind, cells in runs
    ]
    none = np.empty(0, dtype=np.int64)
    sets = {
        name: [np.arange(len(cells)) if own == name else none for own, _, cells in runs]
        for name in dict.fromkeys(own for own, *_ in runs if own)
    }
    node_sets = {
        own.attrib["name"]: places(_members(own).astype(np.int64))
        for own in mesh.findall("NodeSet")
    }
    return Source(points, blocks, sets, {}, node_sets)


def _runs(mesh):
    """Return name, kind and cells of the elements and the surfaces, each run of one kind."""
    runs: list[tuple[str, str, list]] = []
    for block in mesh.findall("Elements"):
        for cell in block:
            type_ = block.get("type", "") if cell.tag in ("elem", "e") else cell.tag
            if type_ not in TYPES:
                raise Unusable(f"elements of the type {type_}; mesh the body with tet4, hex8, ...")
            _add(runs, block.get("name") or block.get("elset") or "", TYPES[type_], cell)
    for surface in mesh.findall("Surface"):
        for facet in surface:
            kind, count = FACETS[facet.tag.rstrip("0123456789")]
            _add(runs, surface.get("name", ""), kind, facet, count)
    return runs


def _add(runs, name, kind, element, count=None):
    """Add a cell to the last run, or begin one."""
    if not runs or runs[-1][:2] != (name, kind):
        runs.append((name, kind, []))
    runs[-1][2].append(_numbers(element)[:count])


def _numbers(element):
    return np.array((element.text or "").replace(",", " ").split())


def _members(node_set):
    """Return the numbers in a node set, in its text or, before version 4, one by one."""
    return np.array([*_numbers(node_set), *(node.get("id") for node in node_set)], dtype=object)
