"""The shipped scenes, in the checkout or in an installed wheel."""

from pathlib import Path

from ..errors import InputError
from .toml import read_toml
from .types import closest

_PACKAGE = Path(__file__).resolve().parent.parent


def scenes_folder():
    """Return the folder of the shipped scenes: `scenes` inside an installed package, `configs` beside it in a checkout."""
    packaged = _PACKAGE / "scenes"
    return packaged if packaged.is_dir() else _PACKAGE.parent / "configs"


def list_scenes():
    """Return (name, title, path) of every shipped scene, by name."""
    return [(name, read_toml(path).get("title", ""), path) for name, path in _shipped().items()]


def _shipped():
    return {path.stem: path for path in sorted(scenes_folder().glob("*.toml"))}


def find_scene(path):
    """Return the path of a scene file, or of the shipped scene of that name; raise InputError when there is neither."""
    path = Path(path)
    if path.suffix or len(path.parts) != 1 or path.is_file():
        return path
    shipped = _shipped()
    if path.name not in shipped:
        raise InputError(f"scene '{path}': neither a file nor a shipped scene; {closest(path.name, list(shipped))}")
    return shipped[path.name]
