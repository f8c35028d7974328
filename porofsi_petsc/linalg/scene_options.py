"""What a scene may say to PETSc: solver options alone, so that a scene of somebody else runs no
code and writes no file.
"""

import re
from collections.abc import Sequence

from ..errors import InputError

ALLOW = "--allow-scene-options"
PREFIXES = ("fluid_", "solid_", "mesh_", "monolithic_")
WITHOUT_PREFIX = ("log_view", "options_left")  # without a value: they print at the end
# Parts of names that take a path, load or run something, or open a port.
REFUSED = re.compile(
    r"file|path|tmpdir|dll|python|shell|matlab|history|saws|socket|server|_save|_load|_dump|_plot"
)
OWN_PYTHON = re.compile(r"porofsi_petsc\.linalg\.\w+\.\w+")
SHOWN = re.compile(
    r"_view|_monitor|_reason|_info|_test"
)  # a value of theirs may name a viewer and its file
VIEWERS = re.compile(r"ascii|stdout|stderr|true|false|yes|no|on|off|0|1|(ascii)?::\w+")
PLAIN = re.compile(r"[\w.+-]+(,[\w.+-]+)*")  # a number, a word, several of them


def check_scene_options(words: Sequence[str]) -> None:
    """Raise InputError for the first option of a scene that is none of a solver, or that could run
    code or write a file.

    words : -NAME and values, one after the other.
    """
    for word, value in _pairs(words):
        name = word.lstrip("-").lower()
        if not _allowed(name, value):
            text = (
                f"[petsc] options: received {_shown(word, value)}, expected options of the solvers"
                f" {', '.join(PREFIXES)}"
            )
            raise InputError(
                f"{text} that name no file and no code of others; give it on the command line after"
                f" --, or trust the scene with {ALLOW}"
            )


def _pairs(words):
    """Yield every option with its value, None where it has none; a value alone comes as an
    option.
    """
    rest = list(words)
    while rest:
        word = rest.pop(0)
        yield word, rest.pop(0) if rest and not is_name(rest[0]) else None


def is_name(word: str) -> bool:
    """Return whether a word is the name of an option for PETSc, and no value: -1 is one."""
    return re.match(r"--?[A-Za-z_]", word) is not None


def _allowed(name, value):
    if name in WITHOUT_PREFIX:
        return value is None
    if not name.startswith(PREFIXES) or not re.fullmatch(r"\w+", name):
        return False
    if name.endswith("pc_python_type"):
        return value is not None and OWN_PYTHON.fullmatch(value) is not None
    if REFUSED.search(name):
        return False
    return value is None or (VIEWERS if SHOWN.search(name) else PLAIN).fullmatch(value) is not None


def _shown(word, value):
    text = word if value is None else f"{word} {value}"
    return text if len(text) <= 80 else f"{text[:77]}..."
