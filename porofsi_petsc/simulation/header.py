"""What the parts of a run write into the header of a checkpoint, checked before any of them takes
it back.
"""

import math
import sys
from collections.abc import Callable
from dataclasses import fields
from typing import NamedTuple

from ..errors import shown
from .energy import Energy


class Kind(NamedTuple):
    """Values of one kind: how a message calls one, and the test."""

    name: str
    holds: Callable


def _is_number(value):
    return type(value) in (int, float) and abs(value) <= sys.float_info.max


TEXT = Kind("text", lambda value: type(value) is str)
FLOAT = Kind(
    "a number", lambda value: type(value) in (int, float)
)  # it may be one that is not finite
NUMBER = Kind("a finite number", _is_number)
SIZE = Kind("a number of at least 0", lambda value: _is_number(value) and value >= 0)
EXTENT = Kind(
    "a number of at least 0 or infinity", lambda value: SIZE.holds(value) or value == math.inf
)
POSITIVE = Kind("a positive number", lambda value: _is_number(value) and value > 0)
COUNT = Kind(
    "a whole number of at least 0", lambda value: type(value) is int and 0 <= value <= sys.maxsize
)

ANY = Kind("a value", lambda value: True)  # of a condition, which alone knows what it is

# A dict is a table, "*" any key, a key with "?" one that may be absent or null; a list stands for
# entries of one kind.
CLOCK = {
    "t": SIZE,
    "step": COUNT,
    "cuts": COUNT,
    "load_parts?": COUNT,
    "nominal": POSITIVE,
    "target?": POSITIVE,
    "substep?": POSITIVE,
    "halvings?": COUNT,
    "fall_backs?": {"*": COUNT},
}
PHASE = {
    "rates?": [SIZE],
    "built_with?": COUNT,
    "surfaces?": {"*": {"*": ANY}},
    "force_age?": SIZE,
}
COUPLING = {
    "solid": PHASE,
    "fluid": PHASE | {"pressure_age?": SIZE},
    "iterations": COUNT,
    "failed?": COUNT,
    "largest": {"*": SIZE},
    "columns?": [COUNT],
    "mesh?": {"smallest_ratio": NUMBER, "worst_shape": NUMBER, "trail?": [[NUMBER]]},
    "switched?": [
        {"term": TEXT, "step": COUNT, "t": SIZE, "measure": TEXT, "size": NUMBER, "bound": NUMBER}
    ],
}
ERROR = {"at": NUMBER, "t": NUMBER, "u?": FLOAT, "v?": FLOAT, "p": FLOAT, "profile": {"*": [FLOAT]}}
LASTING = {"last": EXTENT, "counted": COUNT, "trail": [[EXTENT]]}
MEASURES = {
    "sizes": {"*": EXTENT},
    "lasting?": {"*": LASTING},
    "roughness": SIZE,
    "largest_pressure": SIZE,
    "errors": [ERROR],
    "volume?": {"made": NUMBER, "passed": SIZE},
}
CONTROL = {
    "times": {"u": [SIZE], "p": [SIZE]},
    "largest": {"u": SIZE, "p": SIZE},
    "rejections": COUNT,
}
HEADER = {
    "scene": TEXT,
    "tables?": {"*": TEXT},
    "stage?": COUNT,
    "step": COUNT,
    "time": SIZE,
    "clock": CLOCK,
    "coupling": COUPLING,
    "energy": {field.name: NUMBER for field in fields(Energy)},
    "measures": MEASURES,
    "volumes?": {"*": [NUMBER]},
    "iterations": [COUNT],
    "step_control?": CONTROL,
}


def mistake(header: dict) -> str:
    """Return what is wrong in a header, "" where every entry has its kind and none contradicts
    another.
    """
    return next(_mistakes(HEADER, header, ()), "") or _contradiction(header)


def _mistakes(kind, value, place):
    """Yield what is wrong in an entry; place : its keys from the outermost on."""
    name = ".".join(map(str, place))
    if isinstance(kind, dict) and type(value) is dict:
        for key, part in kind.items():
            yield from _mistakes_at(key, part, value, place)
    elif isinstance(kind, list) and type(value) is list:
        for i, entry in enumerate(value):
            yield from _mistakes(kind[0], entry, (*place, i))
    elif isinstance(kind, (dict, list)):
        yield (
            f"its entry {name} is {shown(value)}, expected a"
            f" {'table' if isinstance(kind, dict) else 'list'}"
        )
    elif not kind.holds(value):
        yield f"its entry {name} is {shown(value)}, expected {kind.name}"


def _mistakes_at(key, kind, table, place):
    """Yield what is wrong at a key of a table as `HEADER` writes it."""
    bare = key.rstrip("?")
    if key == "*":
        for name, entry in table.items():
            yield from _mistakes(kind, entry, (*place, name))
    elif table.get(bare) is not None:
        yield from _mistakes(kind, table[bare], (*place, bare))
    elif key == bare:
        yield f"its entry {'.'.join((*place, bare))} is missing"


def _contradiction(header):
    pairs = (
        ("time", "clock.t", header["clock"]["t"]),
        ("step", "clock.step", header["clock"]["step"]),
        ("step", "the number of iterations", len(header["iterations"])),
    )
    for name, other, value in pairs:
        if header[name] != value:
            return f"its entry {name} is {header[name]}, but {other} is {value}"
    return ""
