"""The fields of a finished run as arrays, for evaluations of one's own."""

import os
from typing import Any

import numpy as np

from ..errors import InputError, digits
from .snapshots import has_mesh, read_snapshots, read_written_mesh

SAME_TIME = 1e-9  # relative: a time read from a text has lost its last digits


def read_fields(directory: str | os.PathLike, time: float | None = None) -> dict[str, Any]:
    """Return the nodal fields that a run wrote at a time [s], the last one by default.

    Name -> (N,) for a scalar, (N, 3) for a vector (z = 0 in two dimensions), (N, 6) for the stress
    (xx, xy, xz, yy, yz, zz), in SI units and the order of the mesh file; beside them t, points (N,
    3) and cells (E, nodes of an element) of the reference mesh. Raises InputError where there are
    no fields, or none of that time.
    """
    snapshots = read_snapshots(directory)
    if not snapshots or not has_mesh(directory):
        text = "no fields of a run, expected those that output.fields_every writes"
        raise InputError(f"{directory}: {text}; give the result directory of a run")
    last = snapshots[-1].time
    nearest = min(
        snapshots, key=lambda snapshot: abs(snapshot.time - (last if time is None else time))
    )
    if time is not None and abs(nearest.time - time) > SAME_TIME * abs(time):
        received = f"received the time {digits(time)} s, expected one that was written"
        raise InputError(f"{directory}: {received}; the nearest is {digits(nearest.time)} s")
    mesh = read_written_mesh(directory)
    found = {"t": np.float64(nearest.time), "points": mesh.points, "cells": mesh.cells}
    return found | {name: nearest.read(name) for name in nearest.shapes}
