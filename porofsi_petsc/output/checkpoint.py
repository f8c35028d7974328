"""checkpoint.h5: everything a restart needs, in the natural order, so that it is read on any number
of ranks.

It is sealed: HDF5 sees nothing of it before the checksum of all its bytes is right.
"""

import json
import os
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
from mpi4py import MPI

from ..errors import InputError
from ..fem.distribute import LocalMesh
from .files import keep_names, on_all, on_root, temporary_name, to_json
from .hdf5 import read_slab, reading, write_slabs
from .seal import FRONT, is_sealed, seal, starts_with

FORMAT = "porofsi checkpoint"
FORMAT_VERSION = 2
FIRST_SEALED = 2  # the format version from which on files have a checksum
SIGNATURE = b"\x89HDF\r\n\x1a\n"  # of an HDF5 file, where its content starts
NAME = "checkpoint.h5"
PREVIOUS = "checkpoint.previous.h5"
OWN = {
    "format_version": int,
    "mesh_hash": str,
    "ranks": int,
    "nodes": int,
}  # entries of every header and their types


class Dataset(NamedTuple):
    """An array in a checkpoint."""

    shape: tuple
    dtype: np.dtype


def write_checkpoint(
    directory: str | os.PathLike[str],
    mesh: LocalMesh,
    header: dict[str, Any],
    arrays: dict[str, np.ndarray],
) -> None:
    """Write checkpoint.h5, atomically, and keep the one before as checkpoint.previous.h5;
    collective.

    header : dict with JSON values (scene text, step, time [s], …), equal on every rank;
    format_version, mesh_hash, ranks,
    nodes, cells, regions are added here.  arrays : dict name -> (n_owned, ...) in local order; of
    cells, as `is_of_cells` says, (E, ...) with those that other ranks have too.
    Raises PorofsiError when it cannot be written.
    """
    path = Path(directory) / NAME
    own = {
        "format_version": FORMAT_VERSION,
        "mesh_hash": mesh.hash,
        "ranks": mesh.comm.size,
        "nodes": int(mesh.n_global),
        "cells": int(mesh.n_cells_global),
    }
    own["regions"] = list(mesh.regions)
    slabs = {name: _order(mesh, name).to_slab(array) for name, array in arrays.items()}
    written = path.with_name("checkpoint.next.h5")
    attributes = {"format": FORMAT, "header": to_json({**header, **own})}
    write_slabs(written, mesh.comm, slabs, attributes, front=FRONT)
    seal(written, mesh.comm)
    on_root(mesh.comm, _replace, written, path)


def is_of_cells(name: str) -> bool:
    """Return whether an array has a row for each cell, "solid.cell_..."; others have one for each
    node.
    """
    return name.rpartition(".")[2].startswith("cell_")


def _order(mesh, name):
    """Return the `NaturalOrder` of the rows of an array."""
    return mesh.cell_order if is_of_cells(name) else mesh.order


def _replace(written, path):
    """Rename so that at any moment a complete checkpoint is there under its name."""
    if path.exists():
        previous = path.with_name(PREVIOUS)
        link = temporary_name(previous)
        link.unlink(missing_ok=True)
        try:
            os.link(path, link)
            os.replace(link, previous)
        except OSError:  # a file system without hard links
            os.replace(path, previous)
    os.replace(written, path)
    keep_names(path.parent)


def open_checkpoint(path: str | os.PathLike[str], comm: MPI.Comm) -> dict[str, Any]:
    """Return the header of a checkpoint after a look at every byte of the file; collective.

    Keys that it gets here: arrays, name -> `Dataset`; sealed, false where an earlier version wrote
    no checksum. Raises InputError when the file is not there, not a checkpoint, damaged or of a
    newer format.
    """
    path = Path(path)
    try:
        return _open(path, comm)
    except InputError as refused:  # on all ranks
        raise InputError(f"{refused}; {on_root(comm, _advice, path)}") from refused


def read_arrays(
    path: str | os.PathLike[str], header: dict[str, Any], mesh: LocalMesh
) -> dict[str, np.ndarray]:
    """Return dict name -> (n_owned, ...), of cells (E, ...), in the local order of the mesh;
    collective, any number of ranks.

    header : of `open_checkpoint`.  Raises InputError when the file belongs to another mesh or is
    damaged.
    """
    regions = list(mesh.regions)
    if (header["mesh_hash"], header.get("regions", regions)) != (mesh.hash, regions):
        raise InputError(
            f"{path}: belongs to another mesh: received mesh hash {header['mesh_hash']}, expected"
            f" {mesh.hash} of the scene with the regions {', '.join(regions)}; restart with the"
            " scene and mesh file of the first run"
        )
    arrays = {name: _read(path, name, mesh) for name in header["arrays"]}
    finite = all(np.isfinite(array).all() for array in arrays.values())
    if not mesh.comm.allreduce(finite, op=MPI.LAND):
        raise damaged(path, "it holds numbers that are not finite", mesh.comm)
    return arrays


def _read(path, name, mesh):
    """Return an array in the local order of the mesh (collective)."""
    order = _order(mesh, name)
    start, stop = order.bounds[mesh.comm.rank : mesh.comm.rank + 2]
    return order.from_slab(on_all(mesh.comm, partial(read_slab, path, name, start, stop)))


def damaged(path: str | os.PathLike[str], what: str, comm: MPI.Comm) -> InputError:
    """Return the error of a checkpoint in which something is wrong; collective."""
    return InputError(f"{path}: damaged, {what}; {on_root(comm, _advice, Path(path))}")


def _advice(path):
    """Return which checkpoint of the folder is sound."""
    for other in (path.with_name(NAME), path.with_name(PREVIOUS)):
        if other.name != path.name and other.is_file() and _is_sound(other):
            return f"{other} is sound, give that"
    return "give an earlier checkpoint, or run from the start"


def _is_sound(path):
    try:
        return bool(_open(path, MPI.COMM_SELF))
    except InputError:
        return False


def _open(path, comm):
    has_front = on_root(comm, _has_front, path)
    if has_front and not is_sealed(path, comm):
        raise InputError(f"{path}: truncated or damaged, its checksum is not that of its content")
    return on_root(comm, _read_header, path, has_front)


def _has_front(path):
    """Return whether there is something in front of the content, where the checksum is."""
    if not path.is_file():
        raise InputError(f"{path}: no such file, expected a checkpoint")
    at_once = starts_with(path, SIGNATURE)
    if not at_once and not h5py.is_hdf5(path):
        raise InputError(f"{path}: not an HDF5 file, expected a checkpoint.h5 written by porofsi")
    return not at_once


def _read_header(path, sealed):
    try:
        with reading(path) as file:
            kind = file.attrs.get("format")
            text = file.attrs.get("header")
            arrays = {name: _dataset(item) for name, item in file.items()} if kind == FORMAT else {}
    except InputError as failure:
        raise InputError(f"{path}: truncated or damaged, it is no complete HDF5 file") from failure
    if kind != FORMAT:
        raise InputError(f"{path}: an HDF5 file, but not a checkpoint written by porofsi")
    header = _parsed(path, text)
    version = header["format_version"]
    if version > FORMAT_VERSION:
        raise InputError(
            f"{path}: received checkpoint format {version}, expected at most {FORMAT_VERSION}: "
            "a newer porofsi wrote it, which can read it"
        )
    if sealed != (version >= FIRST_SEALED):
        raise InputError(
            f"{path}: damaged, a checkpoint of format {version} has {'no' if sealed else 'a'}"
            " checksum"
        )
    for name, array in arrays.items():
        rows = header.get("cells", 0) if is_of_cells(name) else header["nodes"]
        if array is None or array.shape[:1] != (rows,):
            raise InputError(f"{path}: damaged, expected {rows} rows of numbers in every array")
    return {**header, "arrays": arrays, "sealed": sealed}


def _dataset(item):
    """Return the `Dataset` of an item, None where it holds no numbers as this program writes
    them.
    """
    plain = item.dtype.kind in "fiub" and item.id.get_type().equal(
        h5py.h5t.py_create(item.dtype, logical=True)
    )
    return Dataset(item.shape, item.dtype) if plain and item.shape else None


def _parsed(path, text):
    try:
        header = json.loads(text)
        right = all(type(header[key]) is kind for key, kind in OWN.items())
    except (TypeError, ValueError, KeyError, RecursionError) as failure:
        raise InputError(f"{path}: damaged, its header cannot be read") from failure
    if not right:
        raise InputError(f"{path}: damaged, its header has one of {', '.join(OWN)} in another form")
    return header
