"""Mesh and nodal fields of all ranks as slabs of the natural order, as files have them."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import DTypeLike

from ..fem.distribute import LocalMesh
from ..fem.natural_order import NaturalOrder


def mesh_slabs(mesh: LocalMesh) -> dict[str, np.ndarray]:
    """Return this rank's slabs of points (N, 3) [m], cells (E, A) and region (E,); collective."""
    owned = mesh.cell_owned
    cell_order = NaturalOrder(mesh.comm, mesh.cell_natural[owned], mesh.n_cells_global)
    return {
        "points": mesh.order.to_slab(_padded(mesh.X[: mesh.n_owned])),
        "cells": cell_order.to_slab(mesh.natural[mesh.cells[owned]].astype(np.int64)),
        "region": cell_order.to_slab(mesh.cell_region[owned].astype(np.int32)),
    }


def mesh_attributes(mesh: LocalMesh) -> dict[str, object]:
    """Return what is said of a mesh beside its arrays."""
    return {"element": mesh.element.name, "dim": mesh.dim, "regions": list(mesh.regions)}


def field_slabs(
    mesh: LocalMesh, fields: Mapping[str, np.ndarray], kind: DTypeLike
) -> dict[str, np.ndarray]:
    """Return this rank's slabs of fields in a floating-point type: (N,) of a scalar, (N, 3) of a
    vector, (N, 6) of a symmetric tensor; collective.

    fields : dict name -> (n_owned, k) or (n_owned,), k = 1 scalar, mesh.dim or 3 vector, 6 tensor.
    """
    return {
        name: mesh.order.to_slab(_columns(name, array, mesh.dim).astype(kind))
        for name, array in fields.items()
    }


def _columns(name, array, dim):
    array = np.asarray(array, dtype=float)
    if array.ndim == 1 or array.shape[1] == 1:
        return array.reshape(len(array))
    if array.shape[1] in (dim, 3):
        return _padded(array)
    if array.shape[1] == 6:
        return array
    raise ValueError(f"field {name}: received {array.shape[1]} components, expected 1, {dim} or 6")


def _padded(vectors):
    return np.pad(vectors, ((0, 0), (0, 3 - vectors.shape[1])))
