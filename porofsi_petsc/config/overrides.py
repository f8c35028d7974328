"""KEY=VALUE changes of the raw tables of a scene, before it is validated."""

import copy

from ..errors import InputError
from .toml import tomllib


def parse_override(text):
    """Return the dotted key and the TOML value of KEY=VALUE; a bare word is a string; raise InputError without '='."""
    key, separator, value = text.partition("=")
    if not separator or not key.strip():
        raise InputError(f"override '{text}': expected KEY=VALUE such as time.end=0.1")
    return key.strip(), _parse_value(value.strip())


def _parse_value(text):
    try:
        parsed = tomllib.loads(f"value = {text}")
    except (RecursionError, ValueError):
        return text
    return parsed["value"] if len(parsed) == 1 else text


def apply_override(tables, key, value):
    """Return a copy of the tables with the value at the dotted key; tables on the way are made, list entries must exist."""
    tables = copy.deepcopy(tables)
    target, *parts = tables, *key.split(".")
    for done, part in enumerate(parts[:-1]):
        target = _step(target, part, key, parts[:done])
    _assign(target, parts[-1], value, key, parts[:-1])
    return tables


def _step(target, part, key, above):
    if isinstance(target, list):
        return target[_index(target, part, key, above)]
    if isinstance(target, dict):
        return target.setdefault(part, {})
    raise InputError(f"override '{key}': {'.'.join(above)} is a single value, not a table or list")


def _assign(target, part, value, key, above):
    if isinstance(target, list):
        target[_index(target, part, key, above)] = value
    elif isinstance(target, dict):
        target[part] = value
    else:
        raise InputError(f"override '{key}': {'.'.join(above)} is a single value, not a table or list")


def _index(target, part, key, above):
    if not part.isdecimal() or int(part) >= len(target):
        where = ".".join(above)
        raise InputError(f"override '{key}': received '{part}' below the list {where}, expected an index below {len(target)}")
    return int(part)
