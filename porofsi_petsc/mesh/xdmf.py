"""XDMF files: the mesh in one grid, tags of its cells and facets in further grids.

Format: "XDMF Model and Format", versions 2 and 3, as DOLFINx, legacy FEniCS and meshio write it:
numbers in the text, in binary files or in HDF5 files beside it, parts of one grid used by others.
"""

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from .arrays import integer_arrays, scalar_arrays
from .source import Block, Source, Unusable, dimension

_KINDS = {"float": "f", "int": "i", "uint": "u", "char": "i", "short": "i", "uchar": "u"}
_COORDINATES = {"XY": 2, "XYZ": 3}
_COUNTED = (1, 2)  # numbers of polyvertex and polyline, on which the number of their nodes follows


def read_xdmf(path: Path) -> Source:
    """Return the first grid with cells of the highest dimension, the others with arrays over their
    cells as its tags; raises ValueError and what else a broken file leads to.
    """
    root = ET.parse(path).getroot()
    reader = _Reader(root, path.parent)
    grids = [reader.grid(element) for element in _grids(root)]
    if not grids:
        raise ValueError("it has no grid with cells")
    dims = [max((block.dim for block in grid.blocks), default=0) for grid in grids]
    mesh = grids.pop(dims.index(max(dims)))
    mesh.tags = [grid for grid in grids if grid.arrays]
    return mesh


def _grids(root):
    """Return the uniform grids; of series in time, if there is nothing else, the first one."""
    domain = root.find("Domain")
    uniform, series = [], []
    for grid in domain.findall("Grid") if domain is not None else ():
        if grid.get("GridType", "Uniform") == "Uniform":
            uniform.append(grid)
        elif grid.get("CollectionType") == "Temporal":
            series += grid.findall("Grid")[:1]
        else:
            raise Unusable("a mesh in several parts (a collection of grids); write it in one")
    return uniform or series[:1]


class _Reader:
    """The numbers of a file and of those beside it."""

    def __init__(self, root, folder):
        self._root = root
        self._folder = folder

    def grid(self, element):
        """Return the Source of a grid."""
        blocks = self._blocks(self._part(element, "Topology"))
        points = self._points(self._part(element, "Geometry"))
        sizes = np.cumsum([len(block.data) for block in blocks])
        data = {}
        for attribute in element.findall("Attribute"):
            if attribute.get("Center") == "Cell":
                values = self._numbers(attribute.find("DataItem"))
                if len(values) != sizes[-1]:
                    raise ValueError(f"{len(values)} values over {sizes[-1]} cells")
                data[attribute.get("Name", "values")] = np.split(values, sizes[:-1])
        return Source(points, blocks, arrays=integer_arrays(data), values=scalar_arrays(data))

    def _part(self, grid, tag):
        """Return the topology or geometry of a grid, which may be that of another one."""
        found = grid.find(tag)
        if found is None:
            for include in grid:
                pointer = include.get("xpointer", "")
                if include.tag.endswith("XInclude}include") and tag in pointer:
                    name = re.search(r"Grid\[@Name=[\"'](.+?)[\"']\]", pointer)
                    found = self._root.find(_path_in_grid(name and name[1], tag))
        return self._followed(found)

    def _followed(self, element):
        """Return what an element refers to, itself if to nothing."""
        if element is None:
            raise ValueError("a grid without topology or geometry")
        reference = element.get("Reference")
        if reference is None:
            return element
        path = (element.text if reference == "XML" else reference).strip()
        return self._followed(self._root.find(re.sub(r"^/(?!/)[^/]*", ".", path)))

    def _points(self, geometry):
        kind = geometry.get("GeometryType") or geometry.get("Type") or "XYZ"
        parts = [self._numbers(item) for item in geometry.findall("DataItem")]
        if kind.upper() in ("X_Y", "X_Y_Z"):
            return np.stack([part.ravel() for part in parts], axis=1)
        if kind.upper() not in _COORDINATES:
            raise Unusable(f"a geometry of the kind {kind}; write the nodes as XYZ")
        return parts[0].reshape(-1, _COORDINATES[kind.upper()]).astype(float)

    def _blocks(self, topology):
        from meshio.xdmf.common import xdmf_to_meshio_type

        kind = topology.get("TopologyType") or topology.get("Type") or ""
        item = topology.find("DataItem")
        if item is None or topology.get("Order") or topology.get("BaseOffset", "0") != "0":
            raise Unusable(
                f"a topology '{kind}' of a structured grid; write the nodes of all cells"
            )
        numbers = self._numbers(item).astype(np.int64)
        if kind.lower() == "mixed":
            return _mixed(numbers.ravel())
        names = {name.lower(): own for name, own in xdmf_to_meshio_type.items()}
        if kind.lower() not in names:
            raise Unusable(
                f"cells of the kind '{kind}'; mesh the body with triangles, tetrahedra, ..."
            )
        name = names[kind.lower()]
        return [Block(name, dimension(name), numbers.reshape(-1, _nodes(name)))]

    def _numbers(self, item):
        """Return the numbers of a data item in its shape."""
        item = self._followed(item)
        shape = [int(word) for word in item.get("Dimensions", "-1").split()]
        if item.get("ItemType", "Uniform") != "Uniform":
            raise Unusable(f"data of the kind {item.get('ItemType')}; write the numbers themselves")
        text = (item.text or "").strip()
        kind = item.get("DataType") or item.get("NumberType")
        type_ = np.dtype(f"{_KINDS[(kind or 'Float').lower()]}{item.get('Precision', '4')}")
        format_ = item.get("Format", "XML").upper()
        if format_ == "HDF":
            return self._hdf(text).reshape(shape)
        if format_ == "BINARY":
            order = {"BIG": ">", "LITTLE": "<"}.get(item.get("Endian", "").upper(), "=")
            content = np.fromfile(
                self._folder / text,
                type_.newbyteorder(order),
                int(np.prod(shape)),
                offset=int(item.get("Seek", "0")),
            )
            return content.reshape(shape)
        if format_ != "XML":
            raise ValueError(f"data in the format {format_}")
        values = np.array(text.split()).astype(type_ if type_.kind in "iu" else float)
        if kind is None and (values == np.round(values)).all():
            values = values.astype(np.int64)
        return values.reshape(shape)

    def _hdf(self, place):
        import h5py  # slow to import

        name, _, inside = place.partition(":")
        if not (self._folder / name).is_file():
            raise Unusable(f"its numbers are in {name}, and there is no such file beside it")
        with h5py.File(self._folder / name, "r") as file:
            return file[inside][()]


def _path_in_grid(name, tag):
    return f".//Grid[@Name='{name}']/{tag}" if name else f"./Domain/Grid/{tag}"


def _nodes(name):
    from meshio._common import num_nodes_per_cell

    return num_nodes_per_cell[name]


def _mixed(numbers):
    """Return the blocks of cells of several kinds, each behind the number of its kind."""
    from meshio.xdmf.common import xdmf_idx_to_meshio_type

    blocks, at = [], 0
    while at < len(numbers):
        number = int(numbers[at])
        if number not in xdmf_idx_to_meshio_type:
            raise Unusable("polygons or polyhedra; mesh the body with triangles, tetrahedra, ...")
        name = xdmf_idx_to_meshio_type[number]
        head = 2 if number in _COUNTED else 1
        width = head + _nodes(name)
        rest = numbers[at : at + (len(numbers) - at) // width * width].reshape(-1, width)
        alike = (rest[:, :head] == rest[:1, :head]).all(axis=1)
        count = len(rest) if alike.all() else int(np.argmin(alike))
        if count == 0:
            raise ValueError("the cells end too early")
        blocks.append(Block(name, dimension(name), rest[:count, head:]))
        at += count * width
    return blocks
