"""Files that are either complete or absent, and errors of rank 0 that every rank sees."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from ..errors import InputError, PorofsiError

if TYPE_CHECKING:
    from mpi4py import MPI

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

T = TypeVar("T")


def raise_everywhere(comm: MPI.Comm, error: Exception | None) -> None:
    """Raise the error of rank 0 (or nothing when it is None) on every rank; collective."""
    error = comm.bcast(error)
    if error is not None:
        raise error


def on_root(comm: MPI.Comm, action: Callable[..., T], *arguments: Any) -> T:
    """Call the action on rank 0 and return its result, or raise its error, on every rank;
    collective.
    """
    result: T | None = None
    error: Exception | None = None
    if comm.rank == 0:
        try:
            result = action(*arguments)
        except OSError as failure:
            error = writing_error(failure)
        except Exception as failure:
            error = failure
    raise_everywhere(comm, error)
    return comm.bcast(result)


def on_all(comm: MPI.Comm, action: Callable[[], T]) -> T:
    """Call the action on every rank and return its result there, or raise the first rank's
    InputError on all; collective.
    """
    error = None
    try:
        result = action()
    except InputError as failure:
        error = failure
    errors = [error for error in comm.allgather(error) if error is not None]
    if errors:
        raise errors[0]
    return result


def writing_error(failure: OSError, path: str | os.PathLike[str] | None = None) -> PorofsiError:
    """Return the PorofsiError that states which file could not be written and why."""
    path = path or failure.filename or "the output directory"
    reason = failure.strerror or str(failure)
    return PorofsiError(
        f"{path}: could not be written ({reason}); free some space, or give another directory with"
        " --output"
    )


def temporary_name(path: str | os.PathLike[str]) -> Path:
    """Return the name under which a file is written before it is complete."""
    path = Path(path)
    return path.with_name(path.name + ".tmp")


def publish(path: str | os.PathLike[str]) -> None:
    """Give the complete temporary file its final name and force both to the disk."""
    complete(path)
    keep_names(Path(path).parent)


def complete(path: str | os.PathLike[str]) -> None:
    """Give the complete temporary file its final name: fsync, rename.  After a loss of power it is
    complete or absent; `keep_names` makes sure that it is there.
    """
    keep_content(temporary_name(path))
    os.replace(temporary_name(path), path)


def keep_content(path: str | os.PathLike[str]) -> None:
    """Force the content of a file to the disk."""
    _fsync(path, os.O_RDWR)


def keep_names(folder: str | os.PathLike[str]) -> None:
    """Force the names in the folder to the disk."""
    _fsync(folder, os.O_RDONLY)


def _fsync(path, flags):
    descriptor = os.open(path, flags)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Replace the file by the text atomically."""
    temporary_name(path).write_text(text, encoding="utf-8")
    publish(path)


def to_json(value: Any, indent: int | None = None) -> str:
    """Return the JSON text of plain Python and NumPy values; floats keep all their digits."""
    return json.dumps(value, indent=indent, default=_plain, ensure_ascii=False)


def _plain(value):
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"{type(value).__name__} has no JSON form")


def parse_toml(text: str) -> dict[str, Any]:
    """Return the dict of a TOML text."""
    return tomllib.loads(text)
