"""Tables over time and position from CSV files."""

import csv
import hashlib
import io
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError, listed, shown
from .interpolation import Points, interpolating
from .numbers import LARGEST, RANGE, in_range
from .text import read_text

KEYS = ("table", "column", "over", "factor")
EXPECTED = (
    '{ table = "file.csv", column = "name" }, with over = ["x", "y"] where it is one over'
    " position, and factor = a number"
)


def table(
    value: dict[str, Any], folder: str | os.PathLike[str] | None
) -> tuple[dict[str, Any], str, frozenset[str], Callable[[float, np.ndarray], Any]]:
    """Return the resolved source of a {table, column, over, factor} entry, a hash of its points and
    values, the names of its coordinates, and the interpolating function.
    """
    over = [value["over"]] if isinstance(value.get("over"), str) else value.get("over", ["t"])
    factor = value.get("factor", 1.0)
    if not _is_entry(value, over, factor):
        raise InputError(f"received {shown(value)}, expected {EXPECTED}")
    path = _resolved(folder, value["table"])
    points, values = _read_table(path, value.get("column"), over)
    content = hashlib.sha256(np.vstack([points.T, values]).astype("<f8").tobytes()).hexdigest()[:16]
    source = dict(value, table=str(path))
    values = factor * values
    if over == ["t"]:
        times = points[:, 0]
        return source, content, frozenset("t"), lambda t, x: np.interp(t, times, values)
    function = interpolating(Points(over, points, values, f"table {path}"))
    return source, content, frozenset(over), function


def _is_entry(value, over, factor):
    """Return whether an entry has the form of one."""
    names = {"t", "x", "y", "z"}
    words = [entry for key, entry in value.items() if key in ("table", "column")]
    return (
        not set(value) - set(KEYS)
        and "table" in value
        and all(isinstance(word, str) for word in words)
        and isinstance(over, list)
        and 0 < len(over) == len(set(map(str, over)))
        and set(map(str, over)) <= names
        and isinstance(factor, (int, float))
        and not isinstance(factor, bool)
        and in_range(factor)
    )


def _resolved(folder: str | os.PathLike[str] | None, name: str) -> Path:
    try:
        return Path(folder or ".", name).resolve()
    except (OSError, ValueError, RuntimeError) as error:  # a null character, links in a circle
        raise InputError(f"table {shown(name)} cannot be read: {error}") from None


def _read_table(path: Path, column: str | None, over: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Return the first columns (n, k), the coordinates, and the wanted one (n,) of a CSV file, with
    or without a header.

    One coordinate increases strictly, times [s] or positions [m].
    """
    k = len(over)
    rows = _rows(path)
    header = rows.pop(0)[1] if rows and not _is_number(rows[0][1][0]) else []
    _require_columns(rows, header, column, path, k)
    _require_coordinates(header, over, path)
    index = _column(header, column, path, k)
    numbers = [_numbers(number, row, (*range(k), index), path) for number, row in rows]
    found: np.ndarray = np.array(numbers, dtype=float).reshape(-1, k + 1)
    points, values = found[:, :k], found[:, k]
    if not len(points):
        raise InputError(f"table {path}: received no row of numbers, expected one at least")
    back = np.flatnonzero(np.diff(points[:, 0]) <= 0) if k == 1 else np.zeros(0, dtype=np.int64)
    if len(back):
        what = "times" if over == ["t"] else "positions"
        before, after = points[back[0] : back[0] + 2, 0]
        raise InputError(
            f"table {path}: line {rows[back[0] + 1][0]}: received {after:.10g} after {before:.10g},"
            f" expected strictly increasing {what} in the first column"
        )
    if not in_range(peak := np.abs(values).max()):
        raise InputError(f"table {path}: the largest value is {peak:g}, expected 0 or {RANGE}")
    return points, values


def _require_coordinates(header: list[str], over: list[str], path: Path) -> None:
    """Raise InputError where the header calls a coordinate by the name of another one."""
    for name, wanted in zip((name.strip() for name in header), over, strict=False):
        if name in ("t", "x", "y", "z") and name != wanted:
            raise InputError(
                f"table {path}: received the column {shown(name)}, expected {shown(wanted)} there;"
                ' name the first columns in their order, over = ["x", …]'
            )


def _rows(path: Path) -> list[tuple[int, list[str]]]:
    """Return (line, cells) of every row that is neither empty nor a comment."""
    text = read_text(
        path, "table", "numbers in columns", "a relative path starts at the scene's folder"
    )
    reader = csv.reader(io.StringIO(text, newline=""), skipinitialspace=True)
    try:
        rows = [(reader.line_num, row) for row in reader if row and not row[0].startswith("#")]
    except csv.Error as error:
        raise InputError(
            f"table {path}: line {reader.line_num} is no row of a CSV file ({error})"
        ) from None
    for number, row in rows:
        for mark, name in ((";", "semicolons"), ("\t", "tabs")):
            if any(mark in cell for cell in row):
                text = (
                    f"line {number} has {name}, expected commas between columns and points in"
                    " numbers"
                )
                raise InputError(f"table {path}: {text}; export the table again so")
    return rows


def _require_columns(
    rows: list[tuple[int, list[str]]],
    header: list[str],
    column: str | None,
    path: Path,
    k: int,
) -> None:
    """Raise InputError unless every row is as long as the header, or as the first row, and the
    wanted column is clear.
    """
    width = len(header) if header else len(rows[0][1]) if rows else 0
    for number, row in rows:
        if len(row) != width:
            advice = "a number has a decimal point, no comma"
            raise InputError(
                f"table {path}: line {number} has {len(row)} columns, expected {width} as in the"
                f" first; {advice}"
            )
    if (width > k + 1 and not header and column is None) or 0 < width < k + 1:
        what = "time and value" if k == 1 else f"{k} coordinates and a value"
        kind = "" if header else " without a header"
        text = f"received {width} columns{kind}, expected {what} (with decimal points, not commas)"
        raise InputError(f"table {path}: {text}, or a header and column = NAME")


def _numbers(number: int, row: list[str], columns: tuple[int, ...], path: Path) -> list[float]:
    """Return the numbers in some columns of a row."""
    for i in columns:
        cell = row[i] if i < len(row) else ""
        if not _is_number(cell) or not abs(float(cell)) <= LARGEST:
            text = f"received {shown(cell)}, expected a number of at most {LARGEST:g}"
            raise InputError(f"table {path}: line {number}, column {i + 1}: {text}")
    return [float(row[i]) for i in columns]


def _column(header: list[str], column: str | None, path: Path, k: int) -> int:
    """Return which column has the values: behind the k coordinates."""
    if column is None:
        return k
    names = [name.strip() for name in header]
    if column not in names[k:]:
        choices = f"choose from {listed(names[k:])}" if names[k:] else "it has no header"
        raise InputError(f"table {path}: no column {shown(column)}; {choices}")
    return names.index(column, k)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
