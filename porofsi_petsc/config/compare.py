"""Scenes as a restart compares them: complete, and a table of a load by its numbers, wherever its
file lies.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from .expressions import FUNCTION, Expression
from .load import completed
from .schema import Scene
from .types import Table


class _Named(Expression):
    """A table or a function that is compared, not evaluated: its source is a name for it."""

    def __init__(self, kind: str, name: str) -> None:
        self.names = frozenset("t")
        self.content = name
        self.function = None
        self.source = {kind: name}


def table_contents(scene: Scene) -> dict:
    """Return dotted key -> hash of the numbers, for every table of a scene."""
    return dict(_contents(scene, ()))


def comparable(tables: dict, contents: dict | None) -> dict:
    """Return the tables of a scene, as `scene_to_toml` writes them, with all defaults and { table =
    HASH } for its tables.

    A function of Python goes by its name: what it returns is not known here.

    contents : of `table_contents`; None where they are not known: then a table goes by the name of
    its file.
    """
    return completed(_named(tables, contents, ()))


def _contents(value: Any, place: tuple) -> Iterator[tuple[str, str]]:
    if isinstance(value, Expression) and value.content:
        yield ".".join(place), value.content
    elif isinstance(value, Table):
        for name, field in type(value).model_fields.items():
            yield from _contents(getattr(value, name), (*place, field.alias or name))
    elif isinstance(value, tuple):
        for i, entry in enumerate(value):
            yield from _contents(entry, (*place, str(i)))


def _named(value: Any, contents: dict[str, str] | None, place: tuple[str, ...]) -> Any:
    if isinstance(value, list):
        return [_named(entry, contents, (*place, str(i))) for i, entry in enumerate(value)]
    if not isinstance(value, dict):
        return value
    if "table" in value:
        return _Named("table", (contents or {}).get(".".join(place), Path(value["table"]).name))
    if FUNCTION in value:
        return _Named(FUNCTION, value[FUNCTION])
    return {key: _named(entry, contents, (*place, key)) for key, entry in value.items()}
