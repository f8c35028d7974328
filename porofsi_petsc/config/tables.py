"""Tables over time from CSV files."""

import csv
import hashlib
from pathlib import Path

import numpy as np

from ..errors import InputError


def table(value, folder):
    """Return the resolved source of a {table, column} entry, a hash of its times and values, and the interpolating function."""
    unknown = sorted(set(value) - {"table", "column"})
    if unknown or not all(isinstance(entry, str) for entry in value.values()) or "table" not in value:
        raise InputError(f'received {value!r}, expected {{ table = "file.csv", column = "name" }}')
    path = Path(folder or ".", value["table"]).resolve()
    times, values = _read_table(path, value.get("column"))
    content = hashlib.sha256(np.stack([times, values]).astype("<f8").tobytes()).hexdigest()[:16]
    return dict(value, table=str(path)), content, lambda t, x: np.interp(t, times, values)


def _read_table(path, column):
    """Return the first column (strictly increasing times [s]) and the wanted one of a CSV file, with or without a header."""
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            rows = [row for row in csv.reader(file, skipinitialspace=True) if row and not row[0].startswith("#")]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"table {path} cannot be read: {getattr(error, 'strerror', None) or 'not a text file'}") from None
    header = rows.pop(0) if rows and not _is_number(rows[0][0]) else []
    index = _column(header, column, path)
    try:
        times, values = np.array([(float(row[0]), float(row[index])) for row in rows]).reshape(-1, 2).T
    except (ValueError, IndexError) as error:
        raise InputError(f"table {path}: expected numbers in column {index + 1} of every row ({error})") from None
    if not len(times) or not np.isfinite([times, values]).all() or (np.diff(times) <= 0).any():
        raise InputError(
            f"table {path}: expected at least one row, finite numbers and strictly increasing times in the first column"
        )
    return times, values


def _column(header, column, path):
    if column is None:
        return 1
    names = [name.strip() for name in header]
    if column not in names[1:]:
        raise InputError(f"table {path}: no column '{column}'; choose from {', '.join(names[1:]) or 'none, it has no header'}")
    return names.index(column)


def _is_number(text):
    try:
        float(text)
    except ValueError:
        return False
    return True
