"""Files that are either complete or absent, and errors of rank 0 that every rank sees."""

import json
import os
import sys
from pathlib import Path

from ..errors import InputError, PorofsiError

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib


def raise_everywhere(comm, error):
    """Raise the error of rank 0 (or nothing when it is None) on every rank; collective."""
    error = comm.bcast(error)
    if error is not None:
        raise error


def on_root(comm, action, *arguments):
    """Call the action on rank 0 and return its result, or raise its error, on every rank;
    collective.
    """
    result = error = None
    if comm.rank == 0:
        try:
            result = action(*arguments)
        except OSError as failure:
            error = writing_error(failure)
        except Exception as failure:
            error = failure
    raise_everywhere(comm, error)
    return comm.bcast(result)


def on_all(comm, action):
    """Call the action on every rank and return its result there, or raise the first rank's
    InputError on all; collective.
    """
    result = error = None
    try:
        result = action()
    except InputError as failure:
        error = failure
    errors = [error for error in comm.allgather(error) if error is not None]
    if errors:
        raise errors[0]
    return result


def writing_error(failure, path=None):
    """Return the PorofsiError that states which file could not be written and why."""
    path = path or failure.filename or "the output directory"
    reason = failure.strerror or str(failure)
    return PorofsiError(
        f"{path}: could not be written ({reason}); free some space, or give another directory with"
        " --output"
    )


def temporary_name(path):
    """Return the name under which a file is written before it is complete."""
    path = Path(path)
    return path.with_name(path.name + ".tmp")


def publish(path):
    """Give the complete temporary file its final name: fsync, rename, fsync of the folder."""
    path = Path(path)
    _fsync(temporary_name(path), os.O_RDWR)
    os.replace(temporary_name(path), path)
    keep_names(path.parent)


def keep_names(folder):
    """Force the names in the folder to the disk."""
    _fsync(folder, os.O_RDONLY)


def _fsync(path, flags):
    descriptor = os.open(path, flags)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def write_text(path, text):
    """Replace the file by the text atomically."""
    temporary_name(path).write_text(text, encoding="utf-8")
    publish(path)


def to_json(value, indent=None):
    """Return the JSON text of plain Python and NumPy values; floats keep all their digits."""
    return json.dumps(value, indent=indent, default=_plain, ensure_ascii=False)


def _plain(value):
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"{type(value).__name__} has no JSON form")


def parse_toml(text):
    """Return the dict of a TOML text."""
    return tomllib.loads(text)
