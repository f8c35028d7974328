"""Tables over time from CSV files."""

import csv
import hashlib
import io
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError, listed, shown
from .numbers import LARGEST, RANGE, in_range
from .text import read_text


def table(
    value: dict[str, Any], folder: str | os.PathLike[str] | None
) -> tuple[dict[str, str], str, Callable[[float, np.ndarray], Any]]:
    """Return the resolved source of a {table, column} entry, a hash of its times and values, and
    the interpolating function.
    """
    unknown = sorted(set(value) - {"table", "column"})
    if (
        unknown
        or not all(isinstance(entry, str) for entry in value.values())
        or "table" not in value
    ):
        raise InputError(
            f'received {shown(value)}, expected {{ table = "file.csv", column = "name" }}'
        )
    path = _resolved(folder, value["table"])
    times, values = _read_table(path, value.get("column"))
    content = hashlib.sha256(np.stack([times, values]).astype("<f8").tobytes()).hexdigest()[:16]
    return dict(value, table=str(path)), content, lambda t, x: np.interp(t, times, values)


def _resolved(folder: str | os.PathLike[str] | None, name: str) -> Path:
    try:
        return Path(folder or ".", name).resolve()
    except (OSError, ValueError, RuntimeError) as error:  # a null character, links in a circle
        raise InputError(f"table {shown(name)} cannot be read: {error}") from None


def _read_table(path: Path, column: str | None) -> tuple[np.ndarray, np.ndarray]:
    """Return the first column (strictly increasing times [s]) and the wanted one of a CSV file,
    with or without a header.
    """
    rows = _rows(path)
    header = rows.pop(0)[1] if rows and not _is_number(rows[0][1][0]) else []
    _require_columns(rows, header, column, path)
    index = _column(header, column, path)
    times, values = (
        np.array([_pair(number, row, index, path) for number, row in rows]).reshape(-1, 2).T
    )
    if not len(times) or (np.diff(times) <= 0).any():
        raise InputError(
            f"table {path}: expected at least one row and strictly increasing times in the first"
            " column"
        )
    if not in_range(peak := np.abs(values).max()):
        raise InputError(f"table {path}: the largest value is {peak:g}, expected 0 or {RANGE}")
    return times, values


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
    rows: list[tuple[int, list[str]]], header: list[str], column: str | None, path: Path
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
    if width > 2 and not header and column is None:
        text = (
            f"received {width} columns without a header, expected time and value (with decimal"
            " points, not commas)"
        )
        raise InputError(f"table {path}: {text}, or a header and column = NAME")


def _pair(number: int, row: list[str], index: int, path: Path) -> tuple[float, float]:
    """Return the time and the value of a row."""
    for i in (0, index):
        cell = row[i] if i < len(row) else ""
        if not _is_number(cell) or not abs(float(cell)) <= LARGEST:
            text = f"received {shown(cell)}, expected a number of at most {LARGEST:g}"
            raise InputError(f"table {path}: line {number}, column {i + 1}: {text}")
    return float(row[0]), float(row[index])


def _column(header: list[str], column: str | None, path: Path) -> int:
    if column is None:
        return 1
    names = [name.strip() for name in header]
    if column not in names[1:]:
        choices = f"choose from {listed(names[1:])}" if names[1:] else "it has no header"
        raise InputError(f"table {path}: no column {shown(column)}; {choices}")
    return names.index(column, 1)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
