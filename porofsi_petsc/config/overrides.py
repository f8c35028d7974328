"""KEY=VALUE changes of the raw tables of a scene, before it is validated."""

import copy
from typing import Any

from ..errors import InputError, shown
from .toml import DEEPEST, require_plain, tomllib

LONGEST_INDEX = 9  # digits


def parse_override(text: str) -> tuple[str, Any]:
    """Return the dotted key and the TOML value of KEY=VALUE; a bare word is a string; raise
    InputError without '='.
    """
    key, separator, value = text.partition("=")
    if not separator or not key.strip():
        raise InputError(f"override {shown(text)}: expected KEY=VALUE such as time.end=0.1")
    if not _is_utf8(text):
        raise InputError(
            f"override {shown(text)}: received bytes that are not UTF-8, expected text in UTF-8"
        )
    parsed = _parse_value(value.strip())
    require_plain(parsed, f"override {shown(text)}")
    return key.strip(), parsed


def _is_utf8(text: str) -> bool:
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


def _parse_value(text: str) -> Any:
    try:
        parsed = tomllib.loads(f"value = {text}")
    except (RecursionError, ValueError):
        return text
    return parsed["value"] if len(parsed) == 1 else text


def apply_override(tables: dict[str, Any], key: str, value: Any) -> dict[str, Any]:
    """Return a copy of the tables with the value at the dotted key; tables on the way are made,
    list entries must exist.
    """
    tables = copy.deepcopy(tables)
    target, *parts = tables, *key.split(".")
    if len(parts) > DEEPEST:
        raise InputError(
            f"override {shown(key)}: received a key of {len(parts)} parts, expected one of"
            " docs/scene.md"
        )
    for done, part in enumerate(parts[:-1]):
        target = _step(target, part, key, parts[:done])
    _assign(target, parts[-1], value, key, parts[:-1])
    return tables


def _step(target: Any, part: str, key: str, above: list[str]) -> Any:
    if isinstance(target, list):
        return target[_index(target, part, key, above)]
    if isinstance(target, dict):
        return target.setdefault(part, {})
    raise _single(key, above)


def _assign(target: Any, part: str, value: Any, key: str, above: list[str]) -> None:
    if isinstance(target, list):
        target[_index(target, part, key, above)] = value
    elif isinstance(target, dict):
        target[part] = value
    else:
        raise _single(key, above)


def _single(key: str, above: list[str]) -> InputError:
    return InputError(
        f"override {shown(key)}: {'.'.join(above)} is a single value, not a table or list"
    )


def _index(target: list, part: str, key: str, above: list[str]) -> int:
    decimal = part.isascii() and part.isdecimal() and len(part) <= LONGEST_INDEX
    if not decimal or int(part) >= len(target):
        received = f"received {shown(part)} below the list {'.'.join(above)}"
        raise InputError(
            f"override {shown(key)}: {received}, expected an index below {len(target)}"
        )
    return int(part)
