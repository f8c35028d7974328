"""Typed errors, each mapped to one exit code of the command line, and how their sentences show what
was received.
"""

import reprlib
from collections.abc import Iterable

SMALLER_STEP = "try a smaller step"  # advice of a ConvergenceError that a cut of the step follows
WIDTH = 60  # characters of a received value that a sentence shows
LONGEST_LIST = 240  # characters of what there is to choose from


class _Short(reprlib.Repr):
    """Values as Python writes them, long ones without their middle, deep ones without their
    depth.
    """

    def __init__(self) -> None:
        super().__init__()
        self.maxlevel = 3
        self.maxother = WIDTH
        self.maxlong = WIDTH
        self.maxstring = WIDTH
        self.maxlist = self.maxtuple = self.maxdict = 8

    def repr_int(self, x: int, level: int) -> str:
        """Return the digits of a whole number, or how many it has where Python refuses to write
        them.
        """
        try:
            return super().repr_int(x, level)
        except ValueError:
            return f"a whole number of about {int(x.bit_length() * 0.30103)} digits"


def shown(value: object) -> str:
    """Return a received value as one short line: text in quotes, true and false as in TOML."""
    text = str(value).lower() if isinstance(value, bool) else _Short().repr(value)
    return text if len(text) <= WIDTH + 2 else f"{text[: WIDTH - 1]}…"


def listed(names: Iterable[str]) -> str:
    """Return names with commas between them, only the first ones where all would not fit into a
    sentence.
    """
    text = ", ".join(names)
    if len(text) <= LONGEST_LIST:
        return text
    first = text[:LONGEST_LIST].rpartition(", ")[0]
    return f"{first or text[:LONGEST_LIST]}, …"


def digits(number: float) -> str:
    """Return a number with six digits where they are all of it, else with all that it has."""
    number = float(number)
    return f"{number:g}" if float(f"{number:g}") == number else repr(number)


class PorofsiError(Exception):
    """Root of all errors that the package raises on purpose; the message is one sentence for the
    user.
    """

    exit_code = 1


class InputError(PorofsiError):
    """Wrong input: what, where, received, expected, what to do."""

    exit_code = 2


class IncompatibleData(InputError):
    """Boundary data for which the equations have no solution, found at any time; raised on all
    ranks together.
    """


class LimitError(InputError):
    """A term that the scene leaves out has passed its bound; raised on all ranks together, after an
    accepted step.
    """


class ConvergenceError(PorofsiError):
    """An iteration reached its cap, a linear solver failed or a trial state is inadmissible; raised
    on all ranks together.
    """

    exit_code = 3

    def __init__(self, what: str, advice: str = "") -> None:
        """Take what happened and what to try, where there is something: the message is "what;
        advice".
        """
        super().__init__(f"{what}; {advice}" if advice else what)
        self.what = what
        self.advice = advice


class Stopped(PorofsiError):
    """The run was stopped by a signal or the time limit after a checkpoint was written."""

    exit_code = 4


class ExpectationError(PorofsiError):
    """A computed quantity misses the value stated in an `[[expect]]` of the scene."""

    exit_code = 5
