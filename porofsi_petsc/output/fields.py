"""Fields over time: one HDF5 file per written time, the mesh once, and an XDMF file for ParaView
and meshio.

fields.xdmf              temporal collection, replaced after every written time fields/mesh.h5
points (N, 3) [m], cells (E, A), region (E,); natural order of nodes and cells fields/000010.h5
step 10: one dataset per field, (N,) scalar, (N, 3) vector, (N, 6) tensor xx xy xz yy yz zz
"""

import os
import re
from pathlib import Path
from typing import NamedTuple
from xml.sax.saxutils import quoteattr

import numpy as np

from ..errors import InputError
from ..fem.distribute import LocalMesh
from ..fem.natural_order import NaturalOrder
from .files import on_root, write_text
from .hdf5 import read_attributes, write_slabs

FOLDER = "fields"
XDMF = "fields.xdmf"
STEP = re.compile(r"\d{6,}\.h5")  # names of the files of a time
ATTRIBUTE_TYPE = {(): "Scalar", (3,): "Vector", (6,): "Tensor6"}


class Snapshot(NamedTuple):
    """A written time; shapes : dict name of a field -> shape of its dataset."""

    step: int
    time: float
    path: Path
    shapes: dict


class FieldWriter:
    """Writes fields in the natural order; what was written before in the directory is kept."""

    def __init__(self, directory: str | os.PathLike[str], mesh: LocalMesh) -> None:
        """Pick up the times already in the directory and write the mesh; collective.

        Raises InputError when a file of a time cannot be read.
        """
        self.directory = Path(directory)
        self.mesh = mesh
        on_root(mesh.comm, _make_folder, self.directory)
        self.n_points = mesh.n_global
        self.cells_shape = (mesh.n_cells_global, mesh.cells.shape[1])
        self.snapshots = on_root(mesh.comm, read_snapshots, self.directory)
        self._write_mesh()

    def write(self, step: int, time: float, fields: dict[str, np.ndarray]) -> None:
        """Write the fields of one step and list them in the XDMF file; collective.

        fields : dict name -> (n_owned, k) or (n_owned,), k = 1 scalar, mesh.dim vector, 6 symmetric
        tensor.
        """
        path = self.directory / FOLDER / f"{step:06d}.h5"
        slabs = {
            name: self.mesh.order.to_slab(_columns(name, array, self.mesh.dim))
            for name, array in fields.items()
        }
        write_slabs(path, self.mesh.comm, slabs, {"step": step, "time": time})
        shapes = {name: (self.n_points, *slab.shape[1:]) for name, slab in slabs.items()}
        self.snapshots = [s for s in self.snapshots if s.step != step] + [
            Snapshot(step, time, path, shapes)
        ]
        self._write_xdmf()

    def truncate(self, time: float) -> None:
        """Drop the times later than the given one; collective."""
        later = [s.path for s in self.snapshots if s.time > time]
        self.snapshots = [s for s in self.snapshots if s.time <= time]
        self._write_xdmf()
        on_root(self.mesh.comm, _remove, later)

    def _write_mesh(self):
        mesh = self.mesh
        owned = mesh.cell_owned
        cell_order = NaturalOrder(mesh.comm, mesh.cell_natural[owned], mesh.n_cells_global)
        slabs = {
            "points": mesh.order.to_slab(_padded(mesh.X[: mesh.n_owned])),
            "cells": cell_order.to_slab(mesh.natural[mesh.cells[owned]].astype(np.int64)),
            "region": cell_order.to_slab(mesh.cell_region[owned].astype(np.int32)),
        }
        attributes = {"element": mesh.element.name, "dim": mesh.dim, "regions": list(mesh.regions)}
        write_slabs(self.directory / FOLDER / "mesh.h5", mesh.comm, slabs, attributes)

    def _write_xdmf(self):
        grids = [
            _grid(s, self.mesh.element.xdmf_name, self.n_points, self.cells_shape)
            for s in self.snapshots
        ]
        text = XDMF_TEXT.format(grids="\n".join(grids))
        on_root(self.mesh.comm, write_text, self.directory / XDMF, text)


def read_snapshots(directory: str | os.PathLike[str]) -> list[Snapshot]:
    """Return the Snapshots (step, time, path, shapes) written in the directory, in the order of
    time.

    Files with other names than those of a step are not looked at.  Raises InputError when one
    cannot be read.
    """
    paths = sorted((Path(directory) / FOLDER).glob("*.h5"))
    return sorted(_snapshot(path) for path in paths if STEP.fullmatch(path.name))


def _snapshot(path):
    attributes, shapes = read_attributes(path)
    step = attributes.get("step")
    time = attributes.get("time")
    numbers = isinstance(step, np.integer) and isinstance(time, np.floating) and np.isfinite(time)
    if (
        not numbers
        or step != int(path.stem)
        or not all(shape and shape[1:] in ATTRIBUTE_TYPE for shape in shapes.values())
    ):
        text = "an HDF5 file, but not the fields of the step in its name as porofsi writes them"
        raise InputError(f"{path}: {text}; move it away")
    return Snapshot(int(step), float(time), path, shapes)


def _make_folder(directory):
    (directory / FOLDER).mkdir(parents=True, exist_ok=True)


def _remove(paths):
    for path in paths:
        path.unlink(missing_ok=True)


def _columns(name, array, dim):
    array = np.asarray(array, dtype=float)
    if array.ndim == 1 or array.shape[1] == 1:
        return array.reshape(len(array))
    if array.shape[1] == dim:
        return _padded(array)
    if array.shape[1] == 6:
        return array
    raise ValueError(f"field {name}: received {array.shape[1]} components, expected 1, {dim} or 6")


def _padded(vectors):
    return np.pad(vectors, ((0, 0), (0, 3 - vectors.shape[1])))


XDMF_TEXT = """<?xml version="1.0" ?>
<Xdmf Version="3.0"><Domain>
<Grid Name="fields" GridType="Collection" CollectionType="Temporal">
{grids}
</Grid>
</Domain></Xdmf>
"""


def _grid(snapshot, topology, n_points, cells_shape):
    mesh = f"{FOLDER}/mesh.h5"
    lines = [
        (
            f'<Grid Name="step {snapshot.step}" GridType="Uniform"><Time'
            f' Value="{snapshot.time:.17g}"/>'
        ),
        f'<Topology TopologyType="{topology}" NumberOfElements="{cells_shape[0]}">'
        f"{_item(f'{mesh}:/cells', cells_shape, 'Int', 8)}</Topology>",
        (
            "<Geometry"
            f' GeometryType="XYZ">{_item(f"{mesh}:/points", (n_points, 3), "Float", 8)}</Geometry>'
        ),
        f'<Attribute Name="region" AttributeType="Scalar" Center="Cell">'
        f"{_item(f'{mesh}:/region', cells_shape[:1], 'Int', 4)}</Attribute>",
    ]
    for name, shape in sorted(snapshot.shapes.items()):
        item = _item(f"{FOLDER}/{snapshot.path.name}:/{name}", shape, "Float", 8)
        kind = ATTRIBUTE_TYPE[tuple(shape[1:])]
        lines.append(
            f'<Attribute Name={quoteattr(name)} AttributeType="{kind}"'
            f' Center="Node">{item}</Attribute>'
        )
    return "\n".join(lines) + "\n</Grid>"


def _item(location, shape, kind, precision):
    dimensions = " ".join(map(str, shape))
    return (
        f'<DataItem DataType="{kind}" Precision="{precision}" Dimensions="{dimensions}"'
        f' Format="HDF">{location}</DataItem>'
    )
