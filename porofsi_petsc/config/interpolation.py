"""Linear interpolation of tables over time and position."""

import itertools
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ..errors import InputError, digits

# of the extent of a table: a point so near to its edge belongs to it in spite of rounding
NEAR = 1e-9
Interpolant = Callable[[np.ndarray], np.ndarray]  # (n, k) -> (n,), NaN outside


class Points(NamedTuple):
    """The rows of a table: names of its k coordinates, points (n, k) [s, m], values (n,); where :
    the table, in messages.
    """

    names: Sequence[str]
    points: np.ndarray
    values: np.ndarray
    where: str


def interpolating(rows: Points) -> Callable[[float, np.ndarray], np.ndarray]:
    """Return the function of (t, x), x (n, d), that is linear between the points of a table; in
    time it is constant beyond its ends, outside of it in space it raises InputError.

    A full grid is interpolated axis by axis, scattered points on the triangles or tetrahedra of
    Delaunay.  Raises InputError where the points are neither.
    """
    found = _grid(rows) or _scattered(rows)
    low, high = rows.points.min(axis=0), rows.points.max(axis=0)
    columns = ["txyz".index(name) - 1 for name in rows.names]  # of x, -1: the time

    def evaluate(t, x):
        wanted = np.column_stack([np.full(len(x), t) if i < 0 else x[:, i] for i in columns])
        values = found(_drawn_in(wanted, columns, low, high))
        if np.isnan(values).any():
            _refuse(rows, wanted[np.argmax(np.isnan(values))], low, high)
        return values

    return evaluate


def _drawn_in(wanted, columns, low, high):
    """Return points whose time is that of the nearest end, and whose place is off the edge by no
    more than round-off.
    """
    inside = np.clip(wanted, low, high)
    near = np.abs(wanted - inside) <= NEAR * (high - low)
    near |= np.array(columns) < 0
    return np.where(near, inside, wanted)


def _grid(rows):
    """Return the interpolant of a full grid, None where the points are none."""
    axes = [np.unique(column) for column in rows.points.T]
    if np.prod([len(axis) for axis in axes]) != len(rows.points):
        return None
    order = np.lexsort(rows.points.T[::-1])
    if not np.array_equal(rows.points[order], np.array(list(itertools.product(*axes)))):
        return None
    from scipy.interpolate import RegularGridInterpolator

    shape = [len(axis) for axis in axes]
    long = [i for i, n in enumerate(shape) if n > 1]
    if not long:
        raise InputError(f"{rows.where}: received one point, expected at least two")
    if len(long) < len(shape):
        flat = rows.names[next(i for i, n in enumerate(shape) if n == 1)]
        raise InputError(f"{rows.where}: received one value of {flat}, expected at least two")
    values = rows.values[order].reshape(shape)
    return RegularGridInterpolator(axes, values, bounds_error=False, fill_value=np.nan)


def _scattered(rows):
    """Return the interpolant of scattered points in space."""
    points, count = np.unique(rows.points, axis=0, return_counts=True)
    if len(points) < len(rows.points):
        twice = ", ".join(f"{x:.10g}" for x in points[count > 1][0])
        raise InputError(
            f"{rows.where}: received the point ({twice}) twice, expected distinct ones"
        )
    if "t" in rows.names:
        raise InputError(
            f"{rows.where}: received points that are no full grid of {' and '.join(rows.names)},"
            " expected every position at every time"
        )
    from scipy.interpolate import LinearNDInterpolator
    from scipy.spatial import QhullError

    try:
        linear = LinearNDInterpolator(rows.points, rows.values)
    except QhullError as error:
        raise InputError(
            f"{rows.where}: received points of which no cells can be made, expected some that are"
            " not all on a line or plane"
        ) from error
    centre = rows.points.mean(axis=0)

    def evaluate(wanted):
        values = linear(wanted)
        edge = np.isnan(values)
        if edge.any():
            values[edge] = linear(wanted[edge] + NEAR * (centre - wanted[edge]))
        return values

    return evaluate


def _refuse(rows, point, low, high):
    """Raise InputError for a point outside of a table."""
    received = ", ".join(
        f"{name} = {c:.10g}" for name, c in zip(rows.names, point, strict=True) if name != "t"
    )
    reach = ", ".join(
        f"{name} from {digits(a)} to {digits(b)}"
        for name, a, b in zip(rows.names, low, high, strict=True)
        if name != "t"
    )
    raise InputError(
        f"{rows.where}: received the point {received} [m] outside of its points ({reach});"
        " expected a table that covers all places where it is used"
    )
