"""Fields over time: one HDF5 file per written time, the mesh once, and an XDMF file for ParaView
and meshio.

fields.xdmf        temporal collection (`output.xdmf`)
fields/mesh.h5     points (N, 3) [m], cells (E, A), region (E,); natural order of nodes and cells
fields/000010.h5   step 10: one dataset per field, (N,) scalar, (N, 3) vector, (N, 6) tensor xx xy
                   xz yy yz zz
"""

import os
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..fem.distribute import LocalMesh
from .files import keep_names, on_root
from .hdf5 import Layout, write_slabs
from .slabs import field_slabs, mesh_attributes, mesh_slabs
from .snapshots import FOLDER, VTKHDF, XDMF, Snapshot, read_snapshots, require_no_other
from .xdmf import Collection, Grids


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
        on_root(mesh.comm, require_no_other, self.directory / VTKHDF, "xdmf")
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

        fields : as `field_slabs` takes them.
        """
        path = self.directory / FOLDER / f"{step:06d}.h5"
        slabs = field_slabs(self.mesh, fields, self._type)
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
        path = self.directory / FOLDER / "mesh.h5"
        write_slabs(path, self.mesh.comm, mesh_slabs(self.mesh), mesh_attributes(self.mesh))

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


def _make_folder(directory):
    (directory / FOLDER).mkdir(parents=True, exist_ok=True)


def _remove(paths):
    for path in paths:
        path.unlink(missing_ok=True)
