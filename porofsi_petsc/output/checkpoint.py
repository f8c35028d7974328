"""checkpoint.h5: everything a restart needs, in the natural order, so that it is read on any number of ranks."""

import json
import os
from pathlib import Path

import h5py
import numpy as np
from mpi4py import MPI

from ..errors import InputError
from .files import keep_names, on_root, temporary_name, to_json
from .hdf5 import read_slab, write_slabs

FORMAT = "porofsi checkpoint"
FORMAT_VERSION = 1
NAME = "checkpoint.h5"
PREVIOUS = "checkpoint.previous.h5"
REQUIRED = {"format_version", "mesh_hash", "ranks", "nodes"}


def write_checkpoint(directory, mesh, header, arrays):
    """Write checkpoint.h5, atomically, and keep the one before as checkpoint.previous.h5; collective.

    header : dict with JSON values (scene text, step, time [s], …), equal on every rank; format_version, mesh_hash, ranks,
    nodes are added here.  arrays : dict name -> (n_owned, ...) in local order.  Raises PorofsiError when it cannot be written.
    """
    path = Path(directory) / NAME
    own = {"format_version": FORMAT_VERSION, "mesh_hash": mesh.hash, "ranks": mesh.comm.size, "nodes": int(mesh.n_global)}
    slabs = {name: mesh.order.to_slab(array) for name, array in arrays.items()}
    written = path.with_name("checkpoint.next.h5")
    write_slabs(written, mesh.comm, slabs, {"format": FORMAT, "header": to_json({**header, **own})})
    on_root(mesh.comm, _replace, written, path)


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


def read_checkpoint(path, mesh):
    """Return the header and dict name -> (n_owned, ...) in the local order of the mesh; collective, any number of ranks.

    Raises InputError when the file is not there, not a checkpoint, damaged, of a newer format or of another mesh.
    """
    header = on_root(mesh.comm, _read_header_of_mesh, path, mesh.hash)
    start, stop = mesh.order.bounds[mesh.comm.rank], mesh.order.bounds[mesh.comm.rank + 1]
    arrays = {name: mesh.order.from_slab(read_slab(path, name, start, stop)) for name in header["arrays"]}
    finite = all(np.isfinite(array).all() for array in arrays.values())
    if not mesh.comm.allreduce(finite, op=MPI.LAND):
        raise InputError(_damaged(path))
    return header, arrays


def read_header(path):
    """Return the header of a checkpoint; its key arrays lists the names and shapes of the arrays.  Raises InputError."""
    path = Path(path)
    if not path.is_file():
        raise InputError(_missing(path))
    if not h5py.is_hdf5(path):
        raise InputError(f"{path}: not an HDF5 file, expected a checkpoint.h5 written by porofsi; give the path of one")
    try:
        with h5py.File(path, "r") as file:
            kind, text = file.attrs.get("format"), file.attrs.get("header")
            shapes = {name: list(dataset.shape) for name, dataset in file.items() if isinstance(dataset, h5py.Dataset)}
    except OSError as failure:
        raise InputError(_damaged(path)) from failure
    if kind != FORMAT:
        raise InputError(f"{path}: an HDF5 file, but not a checkpoint written by porofsi; give the checkpoint.h5 of a run")
    try:
        header = json.loads(text)
        version = int(header["format_version"])
        complete = REQUIRED <= set(header)
    except (TypeError, ValueError, KeyError) as failure:
        raise InputError(_damaged(path)) from failure
    if not complete:
        raise InputError(_damaged(path))
    if version > FORMAT_VERSION:
        raise InputError(
            f"{path}: received checkpoint format {header['format_version']}, expected at most {FORMAT_VERSION}; "
            "use the newer porofsi that wrote it"
        )
    return {**header, "arrays": shapes}


def _read_header_of_mesh(path, mesh_hash):
    header = read_header(path)
    if any(shape[0] != header["nodes"] for shape in header["arrays"].values()):
        raise InputError(_damaged(path))
    if header["mesh_hash"] != mesh_hash:
        raise InputError(
            f"{path}: belongs to another mesh: received mesh hash {header['mesh_hash']}, expected {mesh_hash} of the scene; "
            "restart with the scene and mesh file of the first run"
        )
    return header


def _missing(path):
    previous = path.with_name(PREVIOUS)
    advice = f"{previous} is there, give that" if previous.is_file() else "give the path of a checkpoint.h5"
    return f"{path}: no such file, expected a checkpoint; {advice}"


def _damaged(path):
    previous = path.with_name(PREVIOUS)
    advice = f"use {previous}" if previous.is_file() and path != previous else "use an earlier checkpoint"
    return f"{path}: truncated or damaged, expected a complete checkpoint; {advice}"
