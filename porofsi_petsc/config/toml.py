"""Read a TOML file, or say in one sentence why it cannot be read."""

import sys
from pathlib import Path

from ..errors import InputError

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib


def read_toml(path):
    """Return the tables of the file; raise InputError when it is missing, a directory, not text, not TOML or empty."""
    path = Path(path)
    if path.is_dir():
        raise InputError(f"{path}: received a directory, expected a scene file")
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; `porofsi list` shows the shipped scenes") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: received a binary file, expected a scene in TOML (UTF-8 text)") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except (RecursionError, ValueError) as error:
        raise InputError(f"{path}: not valid TOML: {error}") from None
    if not tables:
        raise InputError(f"{path}: received an empty file, expected a scene with [mesh], [time] and [[material]]")
    return tables
