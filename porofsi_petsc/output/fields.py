"""Fields over time: one HDF5 file per written time, the mesh once, and an XDMF file for ParaView
and meshio.

fields.xdmf        temporal collection (`output.xdmf`)
fields/mesh.h5     points (N, 3) [m], cells (E, A), region (E,); natural order of nodes and cells
fields/000010.h5   step 10: one dataset per field, (N,) scalar, (N, 3) vector, (N, 6) tensor xx xy
                   xz yy yz zz
"""

import os
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..errors import InputError
from ..fem.distribute import LocalMesh
from ..fem.natural_order import NaturalOrder
from .files import keep_names, on_root
from .hdf5 import Layout, read_attributes, write_slabs
from .xdmf import ATTRIBUTE_TYPE, Collection, Grids

FOLDER = "fields"
XDMF = "fields.xdmf"
STEP = re.compile(r"\d{6,}\.h5")  # names of the files of a time


class Snapshot(NamedTuple):
    """A written time.

    shapes : name of a field -> shape of its values; precision : bytes of a number
    """

    step: int
    time: float
    path: Path
    shapes: dict
    precision: int = 8


class Storage(NamedTuple):
    """How fields are kept; compression : level of gzip, 0 for none."""

    precision: str = "float64"
    compression: int = 0


EXACT = Storage()


class FieldWriter:
    """Writes fields in the natural order; what was written before in the directory is kept."""

    def __init__(
        self, directory: str | os.PathLike[str], mesh: LocalMesh, storage: Storage = EXACT
    ) -> None:
        """Pick up the times already in the directory and write the mesh; collective.

        Raises InputError when a file of a time cannot be read.
        """
        self.directory = Path(directory)
        self.mesh = mesh
        self._type = np.dtype(storage.precision)
        self._compression = storage.compression
        on_root(mesh.comm, _make_folder, self.directory)
        self.n_points = mesh.n_global
        self.cells_shape = (mesh.n_cells_global, mesh.cells.shape[1])
        self.snapshots = on_root(mesh.comm, read_snapshots, self.directory)
        self._write_mesh()
        self._grids = Grids(mesh.element.xdmf_name, self.n_points, self.cells_shape, FOLDER)
        self._collection = Collection(self.directory / XDMF)
        self._rewrite_collection()

    def write(self, step: int, time: float, fields: dict[str, np.ndarray]) -> None:
        """Write the fields of one step and list them in the XDMF file; collective.

        fields : dict name -> (n_owned, k) or (n_owned,), k = 1 scalar, mesh.dim vector, 6 symmetric
        tensor.
        """
        path = self.directory / FOLDER / f"{step:06d}.h5"
        slabs = {
            name: self.mesh.order.to_slab(columns(name, array, self.mesh.dim).astype(self._type))
            for name, array in fields.items()
        }
        attributes = {"step": step, "time": time}
        write_slabs(path, self.mesh.comm, slabs, attributes, compression=self._compression)
        shapes = {name: (self.n_points, *slab.shape[1:]) for name, slab in slabs.items()}
        self._list(Snapshot(step, time, path, shapes, self._type.itemsize))

    def _list(self, snapshot):
        """List a time that was written in the collection."""
        if snapshot.step in self._steps:  # a run that was continued writes its end again
            self.snapshots = [s for s in self.snapshots if s.step != snapshot.step] + [snapshot]
            self._rewrite_collection()
            return
        self.snapshots.append(snapshot)
        self._steps.add(snapshot.step)
        on_root(self.mesh.comm, self._collection.append, self._grid(snapshot))

    def truncate(self, time: float) -> None:
        """Drop the times later than the given one; collective."""
        later = [s.path for s in self.snapshots if s.time > time]
        self.snapshots = [s for s in self.snapshots if s.time <= time]
        self._rewrite_collection()
        on_root(self.mesh.comm, _remove, later)

    def close(self) -> None:
        """Force what was written to the disk; collective."""
        on_root(self.mesh.comm, self._collection.close)
        on_root(self.mesh.comm, keep_names, self.directory / FOLDER)

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

    def _rewrite_collection(self):
        self._steps = {snapshot.step for snapshot in self.snapshots}
        grids = [self._grid(snapshot) for snapshot in self.snapshots]
        on_root(self.mesh.comm, self._collection.rewrite, grids)

    def _grid(self, snapshot):
        place = f"{FOLDER}/{snapshot.path.name}"
        fields = {
            name: Layout(shape, snapshot.precision) for name, shape in snapshot.shapes.items()
        }
        return self._grids.at(snapshot.step, snapshot.time, place, fields)


def read_snapshots(directory: str | os.PathLike[str]) -> list[Snapshot]:
    """Return the Snapshots (step, time, path, shapes) written in the directory, in the order of
    time.

    Files with other names than those of a step are not looked at.  Raises InputError when one
    cannot be read.
    """
    paths = sorted((Path(directory) / FOLDER).glob("*.h5"))
    return sorted(_snapshot(path) for path in paths if STEP.fullmatch(path.name))


def _snapshot(path):
    attributes, layouts = read_attributes(path)
    shapes = {name: layout.shape for name, layout in layouts.items()}
    precisions = {layout.precision for layout in layouts.values()}
    step = attributes.get("step")
    time = attributes.get("time")
    numbers = isinstance(step, np.integer) and isinstance(time, np.floating) and np.isfinite(time)
    if (
        not numbers
        or step != int(path.stem)
        or len(precisions) > 1
        or not all(shape and shape[1:] in ATTRIBUTE_TYPE for shape in shapes.values())
    ):
        text = "an HDF5 file, but not the fields of the step in its name as porofsi writes them"
        raise InputError(f"{path}: {text}; move it away")
    return Snapshot(int(step), float(time), path, shapes, *precisions)


def _make_folder(directory):
    (directory / FOLDER).mkdir(parents=True, exist_ok=True)


def _remove(paths):
    for path in paths:
        path.unlink(missing_ok=True)


def columns(name, array, dim):
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
