"""Load a scene: command line over [smoke] over the file over the defaults; write it back complete."""

from pathlib import Path

import tomli_w
from pydantic import ValidationError

from ..errors import InputError, shown
from .catalogue import find_scene
from .messages import sentences
from .overrides import apply_override, parse_override
from .schema import Scene
from .toml import read_toml


def load_scene(path, overrides=(), smoke=False):
    """Return the validated scene with every default resolved.

    path : a TOML file, or the name of a shipped scene; overrides : "KEY=VALUE" texts with dotted keys, such as
    "material.0.permeability.k=1e-5"; smoke : apply the scene's [smoke] table first.
    Raises InputError, one line per mistake.
    """
    path = find_scene(path)
    tables = read_toml(path)
    changes = list(_smoke_changes(path, tables)) if smoke else []
    for key, value in changes + [parse_override(text) for text in overrides]:
        tables = apply_override(tables, key, value)
    try:
        scene = Scene.model_validate(tables, context={"folder": path.resolve().parent})
    except ValidationError as error:
        raise InputError(sentences(_short(path), error, tables)) from None
    scene._source_path = path.resolve()
    return scene


def _short(path):
    """Return the path as seen from the working directory where it lies below it."""
    path = path.resolve()
    return path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path


def _smoke_changes(path, tables):
    smoke = tables.get("smoke", {})
    if not isinstance(smoke, dict):
        raise InputError(f"{path} [smoke]: received {shown(smoke)}, expected a table")
    if not smoke:
        raise InputError(f"{path} [smoke]: received nothing, expected the changes that make a short run")
    return smoke.items()


def scene_to_toml(scene):
    """Return the scene as TOML with every default written out and absolute paths; it loads again to an equal scene."""
    return tomli_w.dumps(_tables(scene))


def _tables(scene):
    return _without_empty(scene.model_dump(mode="json", by_alias=True, exclude_none=True))


def completed(tables):
    """Return the tables of a scene with the defaults of keys that it lacks, unchanged where they are no scene any more."""
    try:
        return _tables(Scene.model_validate(tables, context={"folder": Path.cwd()}))
    except ValidationError:
        return tables


def _without_empty(tables):
    """Drop the tables in which nothing is prescribed, and with them noise of the form [boundary.traction]."""
    if isinstance(tables, list):
        return [_without_empty(entry) for entry in tables]
    if isinstance(tables, dict):
        return {key: _without_empty(value) for key, value in tables.items() if _without_empty(value) != {}}
    return tables
