"""Arrays over the cells of a mesh file: which are numbers of groups, and what they are called."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .source import NO_GROUP

NOT_A_TAG = ("gmsh:geometrical", "gmsh:bounding_entities")
# Arrays that hold the numbers of materials, whatever else a file has, the first one first.  (MED's
# families, of meshio's key "cell_tags", have names.)
KNOWN = (
    *("MaterialIDs", "gmsh:physical", "medit:ref", "nastran:ref", "netgen:index", "ugrid:ref"),
    *("avsucd:material", "flac3d:group", "CellEntityIds", "cell_tags", "MaterialID"),
    *("material_id", "MatID", "matid", "Material", "material", "materials", "attribute", "regions"),
)


def integer_arrays(data: Mapping[str, Sequence[Any]]) -> dict[str, list[np.ndarray]]:
    """Return the arrays that have one integer for each cell; of floats only those of known names.

    data : name -> for each block an array (n, ...).
    """
    scalars = {key: [_scalars(part) for part in parts] for key, parts in data.items()}
    return {
        key: [_numbers(part) for part in parts]
        for key, parts in scalars.items()
        if key not in NOT_A_TAG and all(_is_integral(part, key in KNOWN) for part in parts)
    }


def scalar_arrays(data: Mapping[str, Sequence[Any]]) -> dict[str, list[np.ndarray]]:
    """Return the arrays that have one number for each cell, as floats; data as `integer_arrays`
    takes it.
    """
    scalars = {key: [_scalars(part) for part in parts] for key, parts in data.items()}
    return {
        key: [part.astype(float) for part in parts]
        for key, parts in scalars.items()
        if all(part.ndim == 1 and part.dtype.kind in "iuf" for part in parts)
    }


def are_distinct(parts: Sequence[np.ndarray]) -> bool:
    """Return whether an array has another number for each of several cells, as their numbers."""
    values = np.concatenate(parts) if parts else np.empty(0)
    return len(values) > 1 and len(np.unique(values)) == len(values)


def _scalars(part):
    """Return an array (n,) where it is given as (n, 1)."""
    part = np.asarray(part)
    return part[:, 0] if part.ndim == 2 and part.shape[1] == 1 else part


def _is_integral(part, also_floats):
    if part.ndim != 1 or part.dtype.kind not in ("iuf" if also_floats else "iu"):
        return False
    return bool((part == np.round(part)).all())


def _numbers(part):
    """Return integers, NO_GROUP for the largest one without a sign, which FEniCS writes for it."""
    if part.dtype.kind == "u":
        return np.where(part == np.iinfo(part.dtype).max, NO_GROUP, part.astype(np.int64))
    return part.astype(np.int64)
