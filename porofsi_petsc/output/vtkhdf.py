"""Fields over time in one VTKHDF file, which ParaView opens: the mesh once, and the values of all
times behind one another.

Format: VTKHDF 2.0, docs.vtk.org/en/latest/vtk_file_formats/vtkhdf_file_format. Values of a time
begin at a chunk of their own; `Steps/PointDataOffsets` says at which row. Tensors have VTK's order
of components. `porofsi` has what the format knows nothing of: the numbers of the steps, the names
of the element and of the regions.
"""

import os
from functools import partial
from pathlib import Path

import numpy as np
from meshio._vtk_common import meshio_to_vtk_type

from ..errors import InputError
from ..fem.distribute import LocalMesh
from .appending import appending, finish, shorten
from .fields import EXACT, Storage
from .files import on_root
from .hdf5 import CHUNK_ROWS, filters, write_slabs, write_through_root
from .slabs import field_slabs, mesh_attributes, mesh_slabs
from .snapshots import OTHER_ORDER, VTKHDF, XDMF, Snapshot, read_snapshots, require_no_other

VERSION = (2, 0)  # the first with times
CHUNK_STEPS = 128  # numbers that are kept together, one a time


class VtkhdfWriter:
    """Writes fields in the natural order; what was written before to the file is kept."""

    def __init__(
        self, directory: str | os.PathLike[str], mesh: LocalMesh, storage: Storage = EXACT
    ) -> None:
        """Pick up the times already in the file, or write it with the mesh; collective.

        Raises InputError when the file cannot be read or has another mesh.
        """
        self._path = Path(directory) / VTKHDF
        self._mesh = mesh
        self._storage = storage
        chunks = max(-(-mesh.n_global // CHUNK_ROWS), 1)
        self._chunk = -(-mesh.n_global // chunks)
        self._rows = chunks * self._chunk  # of a time: hardly more than there are nodes
        on_root(mesh.comm, require_no_other, Path(directory) / XDMF, "vtkhdf")
        self.snapshots = on_root(mesh.comm, self._read)
        if self.snapshots is None:
            self._write_mesh()

    def write(self, step: int, time: float, fields: dict[str, np.ndarray]) -> None:
        """Add the fields of one step, instead of those from its time on; collective.

        fields : as `field_slabs` takes them.  Raises InputError where the file has other fields.
        """
        slabs = field_slabs(self._mesh, fields, self._storage.precision)
        shapes = {name: (self._mesh.n_global, *slab.shape[1:]) for name, slab in slabs.items()}
        self._keep([s for s in self.snapshots if s.time < time])
        precision = np.dtype(self._storage.precision).itemsize
        start = len(self.snapshots) * self._rows
        snapshot = Snapshot(step, time, self._path, shapes, precision, start)
        self._require_same_fields(snapshot)
        for name, slab in slabs.items():
            if slab.shape[1:] == (6,):
                slabs[name] = slab[:, OTHER_ORDER]
        add = partial(self._add, snapshot)
        write_through_root(self._path, self._mesh.comm, slabs, add)
        self.snapshots.append(snapshot)

    def truncate(self, time: float) -> None:
        """Drop the times later than the given one; collective."""
        self._keep([s for s in self.snapshots if s.time <= time])

    def close(self) -> None:
        """Do nothing: every time is on the disk."""

    def _read(self):
        """Return the times in the file, None where there is no file."""
        if not self._path.is_file():
            return None
        finish(self._path)
        found = read_snapshots(self._path.parent)
        if any(shape[0] != self._mesh.n_global for s in found for shape in s.shapes.values()):
            raise InputError(f"{self._path}: belongs to another mesh; move it away")
        shorten(self._path)
        return found

    def _write_mesh(self):
        mesh = self._mesh
        arrays = mesh_slabs(mesh)
        cells = arrays["cells"]
        of_root = int(mesh.comm.rank == 0)  # what one rank alone gives
        first = mesh.comm.exscan(len(cells)) or 0
        ends = np.arange(first + 1 - of_root, first + len(cells) + 1)
        cell_type = meshio_to_vtk_type[mesh.element.meshio_name]
        slabs = {
            "Points": arrays["points"],
            "Connectivity": cells.reshape(-1),
            "Offsets": ends * cells.shape[1],
            "Types": np.full(len(cells), cell_type, dtype=np.uint8),
            "CellData/region": arrays["region"],
        }
        sizes = {
            "Points": mesh.n_global,
            "Cells": mesh.n_cells_global,
            "ConnectivityIds": mesh.n_cells_global * cells.shape[1],
        }
        for name, size in sizes.items():
            slabs[f"NumberOf{name}"] = np.full(of_root, size, dtype=np.int64)
        attributes = {
            "VTKHDF/Version": np.array(VERSION, dtype=np.int64),
            "VTKHDF/Type": np.bytes_("UnstructuredGrid"),
        }
        attributes |= {f"porofsi/{name}": value for name, value in mesh_attributes(mesh).items()}
        slabs = {f"VTKHDF/{name}": slab for name, slab in slabs.items()}
        write_slabs(self._path, mesh.comm, slabs, attributes)
        self.snapshots = []

    def _require_same_fields(self, snapshot):
        if not self.snapshots:
            return
        last = self.snapshots[-1]
        if (last.shapes, last.precision) != (snapshot.shapes, snapshot.precision):
            has, received = (
                f"{', '.join(s.shapes)} of {s.precision} bytes" for s in (last, snapshot)
            )
            raise InputError(
                f"{self._path}: has the fields {has}, received {received}; a VTKHDF file has the"
                " same fields at all times: leave output.fields and output.precision as they were,"
                " or take output.format = 'xdmf' in another directory (--output)"
            )

    def _keep(self, snapshots):
        """Keep some of the times, the first ones (collective)."""
        if len(snapshots) == len(self.snapshots):
            return
        if snapshots:
            on_root(self._mesh.comm, self._cut, len(snapshots))
            self.snapshots = snapshots
        else:
            self._write_mesh()

    def _cut(self, number):
        with appending(self._path) as file:
            group = file["VTKHDF"]
            group["Steps"].attrs["NSteps"] = number
            for dataset in _of_steps(file):
                dataset.resize(number, axis=0)
            for dataset in group["PointData"].values():
                dataset.resize(number * self._rows, axis=0)

    def _add(self, snapshot, pieces):
        """Add a time and the pieces of its fields to the file."""
        with appending(self._path) as file:
            group = file["VTKHDF"]
            for name, _, start, rows in pieces:
                dataset = self._field(group, name, rows, snapshot.start)
                dataset[snapshot.start + start : snapshot.start + start + len(rows)] = rows
            self._add_step(file, snapshot)

    def _field(self, group, name, rows, start):
        """Return the dataset of a field with room for one more time."""
        place = f"PointData/{name}"
        if place not in group:
            shape = (0, *rows.shape[1:])
            how = filters(shape, self._storage.compression)
            how |= {"chunks": (self._chunk, *rows.shape[1:]), "maxshape": (None, *rows.shape[1:])}
            group.create_dataset(place, shape, rows.dtype, **how)
        dataset = group[place]
        if len(dataset) < start + self._rows:
            dataset.resize(start + self._rows, axis=0)
        return dataset

    def _add_step(self, file, snapshot):
        """Say that there is one more time: its parts, points, cells and connectivity are those of
        all times.
        """
        steps = file.require_group("VTKHDF/Steps")
        number = len(self.snapshots)
        numbers = {
            "VTKHDF/Steps/Values": snapshot.time,
            "VTKHDF/Steps/PartOffsets": 0,
            "VTKHDF/Steps/NumberOfParts": 1,
            "VTKHDF/Steps/PointOffsets": 0,
            "VTKHDF/Steps/CellOffsets": [0],
            "VTKHDF/Steps/ConnectivityIdOffsets": [0],
            "VTKHDF/Steps/CellDataOffsets/region": 0,
            "porofsi/steps": snapshot.step,
        }
        places = (f"VTKHDF/Steps/PointDataOffsets/{name}" for name in snapshot.shapes)
        numbers |= dict.fromkeys(places, snapshot.start)
        for place, value in numbers.items():
            shape = np.shape(value)
            if place not in file:
                file.create_dataset(
                    place,
                    (0, *shape),
                    np.asarray(value).dtype,
                    maxshape=(None, *shape),
                    chunks=(CHUNK_STEPS, *shape),
                )
            file[place].resize(number + 1, axis=0)
            file[place][number] = value
        steps.attrs["NSteps"] = number + 1


def _of_steps(file):
    """Return the datasets that have a row for each time."""
    steps = file["VTKHDF/Steps"]
    groups = (steps, steps["PointDataOffsets"], steps["CellDataOffsets"])
    found = [item for group in groups for item in group.values() if hasattr(item, "shape")]
    return [*found, file["porofsi/steps"]]
