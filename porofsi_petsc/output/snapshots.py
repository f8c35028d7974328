"""What is read of the fields of a run: its times and its mesh, whatever format it has written."""

import os
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..errors import InputError
from .hdf5 import read_attributes, read_slab, reading

FOLDER = "fields"
XDMF = "fields.xdmf"
VTKHDF = "fields.vtkhdf"
STEP = re.compile(r"\d{6,}\.h5")  # names of the files of a time
COMPONENTS = ((), (3,), (6,))  # of a scalar, a vector, a tensor
# Of a symmetric tensor in a VTKHDF file, XX YY ZZ XY YZ XZ as ParaView calls them, in xx xy xz yy
# yz zz, and the other way round.
OTHER_ORDER = [0, 3, 5, 1, 4, 2]


class Snapshot(NamedTuple):
    """A written time.

    shapes : name of a field -> shape of its values; precision : bytes of a number; start : of its
    rows in the file of all times, None where it has a file of its own
    """

    step: int
    time: float
    path: Path
    shapes: dict
    precision: int = 8
    start: int | None = None

    def read(self, name: str) -> np.ndarray:
        """Return a field, (N,), (N, 3) or (N, 6) in the order xx xy xz yy yz zz."""
        if self.start is None:
            return read_slab(self.path, name)
        shape = self.shapes[name]
        place = f"VTKHDF/PointData/{name}"
        values = read_slab(self.path, place, self.start, self.start + shape[0])
        return values[:, OTHER_ORDER] if shape[1:] == (6,) else values


class WrittenMesh(NamedTuple):
    """The mesh of a result directory: points (N, 3) [m], cells (E, A), region (E,), the names of
    its element and of its regions.
    """

    points: np.ndarray
    cells: np.ndarray
    region: np.ndarray
    element: str
    regions: list[str]


def read_snapshots(directory: str | os.PathLike[str]) -> list[Snapshot]:
    """Return the snapshots written in the directory, in the order of time.

    Files with other names than those of a step are not looked at.  Raises InputError when one
    cannot be read.
    """
    directory = Path(directory)
    if (directory / VTKHDF).is_file():
        return _of_all_times(directory / VTKHDF)
    paths = sorted((directory / FOLDER).glob("*.h5"))
    return sorted(_snapshot(path) for path in paths if STEP.fullmatch(path.name))


def fields_file(directory: str | os.PathLike[str]) -> Path:
    """Return the file of a result directory that ParaView opens."""
    path = Path(directory) / VTKHDF
    return path if path.is_file() else Path(directory) / XDMF


def require_no_other(path: Path, key: str) -> None:
    """Raise InputError where a run has written the file of the other format than its key says."""
    if path.is_file():
        raise InputError(
            f"{path}: the run has written its fields there, expected a file of output.format ="
            f" '{key}'; continue with the format it began with, or give another directory with"
            " --output"
        )


def has_mesh(directory: str | os.PathLike[str]) -> bool:
    """Return whether a run has written its mesh beside its fields."""
    directory = Path(directory)
    return (directory / VTKHDF).is_file() or (directory / FOLDER / "mesh.h5").is_file()


def read_written_mesh(directory: str | os.PathLike[str]) -> WrittenMesh:
    """Return the mesh of a result directory; raises InputError where there is none."""
    directory = Path(directory)
    if (directory / VTKHDF).is_file():
        return _mesh_of_all_times(directory / VTKHDF)
    path = directory / FOLDER / "mesh.h5"
    attributes, _ = read_attributes(path)
    points, cells, region = (read_slab(path, name) for name in ("points", "cells", "region"))
    return WrittenMesh(points, cells, region, attributes["element"], list(attributes["regions"]))


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
        or not all(shape and shape[1:] in COMPONENTS for shape in shapes.values())
    ):
        text = "an HDF5 file, but not the fields of the step in its name as porofsi writes them"
        raise InputError(f"{path}: {text}; move it away")
    return Snapshot(int(step), float(time), path, shapes, *precisions)


def _of_all_times(path):
    with reading(path) as file:
        group = file["VTKHDF"]
        if "Steps" not in group:
            return []
        n = int(group["Steps"].attrs["NSteps"])
        steps = file["porofsi/steps"][:n]
        times = group["Steps/Values"][:n]
        starts = group["Steps/PartOffsets"][:n]
        n_points = int(group["NumberOfPoints"][0])
        shapes = {}
        precision = 8
        for name, dataset in group["PointData"].items():
            shapes[name] = (n_points, *dataset.shape[1:])
            precision = dataset.dtype.itemsize
            starts = group[f"Steps/PointDataOffsets/{name}"][:n]
    return [
        Snapshot(int(step), float(time), path, shapes, precision, int(start))
        for step, time, start in zip(steps, times, starts, strict=True)
    ]


def _mesh_of_all_times(path):
    with reading(path) as file:
        group = file["VTKHDF"]
        points = group["Points"][()]
        cells = group["Connectivity"][()].reshape(int(group["NumberOfCells"][0]), -1)
        region = group["CellData/region"][()]
        attributes = dict(file["porofsi"].attrs)
    return WrittenMesh(points, cells, region, attributes["element"], list(attributes["regions"]))
