"""Read a TOML file, or say in one sentence why it cannot be read."""

import os
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ..errors import InputError, shown
from .numbers import LARGEST
from .text import read_text

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

DEEPEST = 12  # tables and lists inside each other, twice those of a scene


def read_toml(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return the tables of the file; raise InputError when it is missing, no file, not text, not
    TOML or empty.
    """
    path = Path(path)
    text = read_text(
        path, "scene file", "a scene in TOML", "`porofsi list` shows the shipped scenes"
    )
    try:
        tables = tomllib.loads(text)
    except (RecursionError, ValueError) as error:
        raise InputError(f"{path}: not valid TOML: {error}") from None
    require_plain(tables, str(path))
    if not tables:
        raise InputError(
            f"{path}: received an empty file, expected a scene with [mesh], [time] and [[material]]"
        )
    return tables


def require_plain(value: Any, where: str) -> None:
    """Raise InputError where tables are nested so deep, or whole numbers so long, that no key of a
    scene can mean them.
    """
    level = [value]
    for _ in range(DEEPEST):
        numbers = [entry for entry in level if isinstance(entry, int) and abs(entry) > LARGEST]
        if numbers:
            raise InputError(
                f"{where}: received {shown(numbers[0])}, expected a number of at most {LARGEST:g}"
            )
        level = [inner for entry in level for inner in _entries(entry)]
    if level:
        raise InputError(
            f"{where}: received tables nested more than {DEEPEST} deep, expected the keys of"
            " docs/scene.md"
        )


def _entries(value: Any) -> Iterable[Any]:
    return value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
