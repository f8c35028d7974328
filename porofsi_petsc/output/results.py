"""The fields of a finished run as arrays, for evaluations of one's own."""

import os
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError, digits
from .fields import FOLDER, read_snapshots
from .hdf5 import read_attributes, read_slab

SAME_TIME = 1e-9  # relative: a time read from a text has lost its last digits


def read_fields(directory: str | os.PathLike, time: float | None = None) -> dict[str, Any]:
    """Return the nodal fields that a run wrote at a time [s], the last one by default.

    Name -> (N,) for a scalar, (N, 3) for a vector (z = 0 in two dimensions), (N, 6) for the stress
    (xx, xy, xz, yy, yz, zz), in SI units and the order of the mesh file; beside them t, points (N,
    3) and cells (E, nodes of an element) of the reference mesh. Raises InputError where there are
    no fields, or none of that time.
    """
    snapshots = read_snapshots(directory)
    mesh = Path(directory) / FOLDER / "mesh.h5"
    if not snapshots or not mesh.is_file():
        text = "no fields of a run, expected those that output.fields_every writes"
        raise InputError(f"{directory}: {text}; give the result directory of a run")
    last = snapshots[-1].time
    nearest = min(
        snapshots, key=lambda snapshot: abs(snapshot.time - (last if time is None else time))
    )
    if time is not None and abs(nearest.time - time) > SAME_TIME * abs(time):
        received = f"received the time {digits(time)} s, expected one that was written"
        raise InputError(f"{directory}: {received}; the nearest is {digits(nearest.time)} s")
    names = read_attributes(mesh)[1].keys() & {"points", "cells"}
    found = {name: read_slab(mesh, name) for name in sorted(names)}
    return (
        {"t": np.float64(nearest.time)}
        | found
        | {name: read_slab(nearest.path, name) for name in nearest.shapes}
    )
