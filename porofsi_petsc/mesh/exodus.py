"""Exodus files, in classic netCDF and in HDF5: element blocks, side sets and node sets.

Format: G. D. Sjaardema, L. A. Schoof, V. R. Yarberry, "EXODUS: a finite element data model"
(Sandia); orders of nodes and numbers of sides as in its library, ex_get_side_set_node_list.
"""

import re
from pathlib import Path

import numpy as np

from .source import Block, Source, Unusable, dimension, numbered

# Beginning of the name of a type: name in meshio by the number of nodes
TYPES = {
    "TRI": {3: "triangle", 6: "triangle6"},
    "QUAD": {4: "quad", 8: "quad8", 9: "quad9"},
    "SHELL": {3: "triangle", 4: "quad", 6: "triangle6", 8: "quad8", 9: "quad9"},
    "TET": {4: "tetra", 10: "tetra10"},
    "HEX": {8: "hexahedron", 20: "hexahedron20", 27: "hexahedron27"},
    "WED": {6: "wedge", 15: "wedge15", 18: "wedge18"},
    "PYR": {5: "pyramid", 13: "pyramid13", 14: "pyramid14"},
    **dict.fromkeys(("BAR", "BEA", "TRU", "ROD", "EDGE"), {2: "line", 3: "line3"}),
    **dict.fromkeys(("SPH", "CIR", "POINT"), {1: "vertex"}),
}
_HEXAHEDRON = [*range(12), *range(16, 20), *range(12, 16)]
_WEDGE = [*range(9), *range(12, 15), *range(9, 12)]
# VTK's order of nodes in Exodus's numbers, of the kinds in which they differ
ORDER = {
    "hexahedron20": _HEXAHEDRON,
    "hexahedron27": [*_HEXAHEDRON, 23, 24, 25, 26, 21, 22, 20],
    "wedge15": _WEDGE,
    "wedge18": [*_WEDGE, 15, 16, 17],
}
_TRIANGLE = ((0, 1), (1, 2), (2, 0))
_QUAD = ((0, 1), (1, 2), (2, 3), (3, 0))
# Vertices of the sides 1, 2, ... by the beginning of the name of a kind
SIDES = {
    "line": ((0,), (1,)),
    "triangle": _TRIANGLE,
    "quad": _QUAD,
    "tetra": ((0, 1, 3), (1, 2, 3), (0, 3, 2), (0, 2, 1)),
    "pyramid": ((0, 1, 4), (1, 2, 4), (2, 3, 4), (0, 4, 3), (0, 3, 2, 1)),
    "wedge": ((0, 1, 4, 3), (1, 2, 5, 4), (0, 3, 5, 2), (0, 2, 1), (3, 4, 5)),
    "hexahedron": (
        *((0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6)),
        *((0, 4, 7, 3), (0, 3, 2, 1), (4, 5, 6, 7)),
    ),
}
# Those of shells, and of triangles in space: the two faces come first
SHELL_SIDES = {
    "line": ((0,), (1,)),
    "triangle": ((0, 1, 2), (2, 1, 0), *_TRIANGLE),
    "quad": ((0, 1, 2, 3), (0, 3, 2, 1), *_QUAD),
}
FACETS = {1: "vertex", 2: "line", 3: "triangle", 4: "quad"}


_READ = re.compile(
    r"coord[xyz]?|connect\d+|(elem|side)_ss\d+|node_ns\d+|(eb|ss|ns)_(names|prop1|status)"
)


def read_exodus(path: Path) -> Source:
    """Return the content of a file; raises ValueError and what else a broken file leads to."""
    with path.open("rb") as file:
        start = file.read(4)
    if start in (b"CDF\1", b"CDF\2"):
        return _Exodus(*_classic(path)).source()
    if start == b"\x89HDF":
        return _Exodus(*_hdf(path)).source()
    raise Unusable("no Exodus file in classic netCDF or HDF5; write it again as one of them")


def _classic(path):
    """Return name -> numbers, and name -> type of the elements."""
    from scipy.io import netcdf_file  # slow to import

    with netcdf_file(path, "r", mmap=False) as file:
        kept = {name: own for name, own in file.variables.items() if _READ.fullmatch(name)}
        types = {name: own.elem_type for name, own in kept.items() if hasattr(own, "elem_type")}
        return {name: np.array(own[()]) for name, own in kept.items()}, types


def _hdf(path):
    import h5py  # slow to import

    with h5py.File(path, "r") as file:
        kept = [name for name in file if _READ.fullmatch(name)]
        types = {
            name: np.ravel(file[name].attrs["elem_type"])[0]
            for name in kept
            if "elem_type" in file[name].attrs
        }
        return {name: file[name][()] for name in kept}, types


class _Exodus:
    """The variables of a file."""

    def __init__(self, variables, types):
        self._variables = variables
        self._types = types
        self._blocks = []
        self._members = {}

    def source(self):
        """Return the Source: element blocks, and a block for each side of them in a side set."""
        points = self._points()
        sides_of = [self._add_elements(i, name, points) for i, name in self._named("eb", "connect")]
        elements = list(self._blocks)
        for i, name in self._named("ss", "elem_ss"):
            self._add_sides(i, name, elements, sides_of)
        node_sets = {}
        if len(self._blocks) == len(elements):
            node_sets = {
                name: self._numbers("node_ns", i) for i, name in self._named("ns", "node_ns")
            }
        none = [np.empty(0, dtype=np.int64)]
        sets = {
            name: [np.concatenate(of.get(k, none)) for k in range(len(self._blocks))]
            for name, of in self._members.items()
        }
        return Source(points, self._blocks, sets, {}, node_sets)

    def _points(self):
        if "coord" in self._variables:
            return self._variables["coord"].T.astype(float)
        found = [self._variables.get(f"coord{axis}") for axis in "xyz"]
        return np.stack([x.astype(float) for x in found if x is not None], axis=1)

    def _named(self, kind, variable):
        """Yield number and name of what there is of a kind, that of its id where it has none."""
        ids = self._variables.get(f"{kind}_prop1", ())
        names = self._variables.get(f"{kind}_names", [[]] * len(ids))
        for i, (id_, name) in enumerate(zip(ids, names, strict=True), start=1):
            if f"{variable}{i}" in self._variables:
                yield i, _text(b"".join(name)) or numbered(int(id_))

    def _numbers(self, variable, i):
        """Return numbers of nodes, elements or sides, from 0 on."""
        return self._variables[f"{variable}{i}"].astype(np.int64) - 1

    def _add(self, name, kind, nodes):
        of_block = self._members.setdefault(name, {}).setdefault(len(self._blocks), [])
        of_block.append(np.arange(len(nodes)))
        self._blocks.append(Block(kind, dimension(kind), nodes))

    def _add_elements(self, i, name, points):
        """Add an element block; return the vertices of the sides of its elements."""
        nodes = self._numbers("connect", i)
        type_ = _text(self._types[f"connect{i}"]).upper()
        kind = _kind(type_, nodes.shape[1])
        self._add(name, kind, nodes[:, ORDER.get(kind, slice(None))])
        base = kind.rstrip("0123456789")
        is_shell = type_.startswith("SHELL") or (base == "triangle" and points.shape[1] == 3)
        return SHELL_SIDES[base] if is_shell and base in SHELL_SIDES else SIDES.get(base, ())

    def _add_sides(self, i, name, elements, sides_of):
        """Add the facets of a side set by element block and side."""
        cells, sides = self._numbers("elem_ss", i), self._numbers("side_ss", i)
        first = np.cumsum([0, *(len(block.data) for block in elements)])
        block_of = np.searchsorted(first, cells, side="right") - 1
        dim = max(block.dim for block in elements)
        for k, side in np.unique(np.stack([block_of, sides], axis=1), axis=0).tolist():
            if not (0 <= k < len(elements) and 0 <= side < len(sides_of[k])):
                raise ValueError(f"side {side + 1} of an element in side set {name} is not there")
            vertices = list(sides_of[k][side])
            if dim == 2 and len(vertices) > 2:
                raise Unusable(
                    f"side set {name} has faces of the plane mesh, no edges; write the mesh in two"
                    " dimensions"
                )
            chosen = cells[(block_of == k) & (sides == side)] - first[k]
            self._add(name, FACETS[len(vertices)], elements[k].data[chosen][:, vertices])


def _kind(type_, nodes):
    """Return the name of an element in meshio."""
    for start, kinds in TYPES.items():
        if type_.startswith(start) and nodes in kinds:
            return kinds[nodes]
    if type_.startswith(("NSIDED", "NFACED")):
        raise Unusable("polygons or polyhedra; mesh the body with triangles, tetrahedra, ...")
    raise Unusable(f"elements of the type {type_} with {nodes} nodes; write TRI3, HEX8, TET10, ...")


def _text(name):
    name = name.decode(errors="replace") if isinstance(name, bytes) else str(name)
    return name.partition("\0")[0].strip()
