"""Load a scene: command line over [smoke] over the file over the defaults; write it back
complete.
"""

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from pydantic import ValidationError

from ..errors import InputError, shown
from .catalogue import find_scene
from .messages import sentences
from .overrides import apply_override, parse_override
from .schema import Scene
from .toml import read_toml


def load_scene(
    source: str | os.PathLike | Mapping[str, Any],
    overrides: Iterable[str] = (),
    smoke: bool = False,
) -> Scene:
    """Return the validated scene with every default resolved.

    source : a TOML file, the name of a shipped scene, or the tables of a scene as a dict, whose
    relative paths start at the working directory and whose formulas may be functions of Python
    (`Expression`);
    overrides : "KEY=VALUE" texts with dotted keys, such as "material.0.permeability.k=1e-5"; smoke
    : apply the scene's [smoke] table first. Raises InputError, one line per mistake.
    """
    if isinstance(source, Mapping):
        return _validated(_plain(source), "scene", Path.cwd(), overrides, smoke)
    path = find_scene(source)
    scene = _validated(read_toml(path), _short(path), path.resolve().parent, overrides, smoke)
    scene._source_path = path.resolve()
    return scene


def _plain(value: Any) -> Any:
    """Return the tables of a scene with numbers and lists as TOML has them, in place of NumPy's."""
    if isinstance(value, Mapping):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    if isinstance(value, (list, tuple)):
        return [_plain(entry) for entry in value]
    return value


def _validated(
    tables: dict[str, Any], name: str | Path, folder: Path, overrides: Iterable[str], smoke: bool
) -> Scene:
    """Return the scene of some tables; name : of the scene in messages, folder : where its relative
    paths start.
    """
    changes = list(_smoke_changes(name, tables)) if smoke else []
    for key, value in changes + [parse_override(text) for text in overrides]:
        tables = apply_override(tables, key, value)
    try:
        return Scene.model_validate(tables, context={"folder": folder})
    except ValidationError as error:
        raise InputError(sentences(name, error, tables)) from None


def _short(path: Path) -> Path:
    """Return the path as seen from the working directory where it lies below it."""
    path = path.resolve()
    return path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path


def _smoke_changes(name: str | Path, tables: dict[str, Any]) -> Iterable[tuple[str, Any]]:
    smoke = tables.get("smoke", {})
    if not isinstance(smoke, dict):
        raise InputError(f"{name} [smoke]: received {shown(smoke)}, expected a table")
    if not smoke:
        raise InputError(
            f"{name} [smoke]: received nothing, expected the changes that make a short run"
        )
    return smoke.items()


def scene_to_toml(scene: Scene) -> str:
    """Return the scene as TOML with every default written out and absolute paths; it loads again to
    an equal scene.
    """
    return tomli_w.dumps(_tables(scene))


def _tables(scene: Scene) -> dict[str, Any]:
    return _without_empty(scene.model_dump(mode="json", by_alias=True, exclude_none=True))


def completed(tables: dict[str, Any]) -> dict[str, Any]:
    """Return the tables of a scene with the defaults of keys that it lacks, unchanged where they
    are no scene any more.
    """
    try:
        return _tables(Scene.model_validate(tables, context={"folder": Path.cwd()}))
    except ValidationError:
        return tables


def _without_empty(tables: Any) -> Any:
    """Drop the tables in which nothing is prescribed, and with them noise of the form
    [boundary.traction].
    """
    if isinstance(tables, list):
        return [_without_empty(entry) for entry in tables]
    if isinstance(tables, dict):
        return {
            key: _without_empty(value)
            for key, value in tables.items()
            if _without_empty(value) != {}
        }
    return tables
