"""The shipped scenes, in the checkout or in an installed wheel."""

import os
from pathlib import Path

from ..errors import InputError, shown
from .toml import read_toml
from .types import similar

_PACKAGE = Path(__file__).resolve().parent.parent


def scenes_folder() -> Path:
    """Return the folder of the shipped scenes: `scenes` inside an installed package, `configs`
    beside it in a checkout.
    """
    packaged = _PACKAGE / "scenes"
    return packaged if packaged.is_dir() else _PACKAGE.parent / "configs"


def list_scenes() -> list[tuple[str, str, Path]]:
    """Return (name, title, path) of every shipped scene, by name."""
    return [(name, read_toml(path).get("title", ""), path) for name, path in _shipped().items()]


def _shipped() -> dict[str, Path]:
    return {path.stem: path for path in sorted(scenes_folder().glob("*.toml"))}


def find_scene(path: str | os.PathLike[str]) -> Path:
    """Return the path of a scene file, or of the shipped scene of that name; raise InputError when
    there is neither.
    """
    path = Path(path)
    if (
        path.suffix or len(path.parts) != 1 or os.path.isfile(path)
    ):  # unlike Path.is_file it knows names that are too long
        return path
    shipped = _shipped()
    if path.name not in shipped:
        match = similar(path.name, list(shipped))
        advice = f"did you mean '{match}'?" if match else "`porofsi list` shows those"
        raise InputError(f"scene {shown(str(path))}: neither a file nor a shipped scene; {advice}")
    return shipped[path.name]
