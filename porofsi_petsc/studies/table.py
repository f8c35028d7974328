"""Tables of a study: a CSV that grows case by case, so that a study goes on where it was stopped,
and markdown rows.
"""

import csv
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol, TypeVar

from ..errors import InputError
from ..output.files import publish, temporary_name

Row = dict[str, str]  # column -> text


class Case(Protocol):
    """What `sweep` asks of a case: its keys in the table, and a short label."""

    @property
    def keys(self) -> dict[str, Any]: ...
    @property
    def label(self) -> str: ...


C = TypeVar("C", bound=Case)


class Table:
    """The rows of a CSV file, each a dict of texts; the first columns, `keys`, name the case."""

    def __init__(
        self, path: Path, keys: Sequence[str], values: Sequence[str], anew: bool = False
    ) -> None:
        """Go on with the file when it is there, unless all is wanted anew; incomplete rows and
        other columns are dropped.

        Raises InputError for a file that is no table and for a place that cannot be written to.
        """
        self.path = path
        self._keys = tuple(keys)
        self._columns = [*keys, *values]
        self._rows: dict[tuple[str, ...], Row] = {}
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            if path.is_file() and not anew:
                self._rows = self._read()
            self._write()
        except OSError as failure:
            reason = failure.strerror
            raise InputError(
                f"{path}: could not be written ({reason}); give another directory with --output"
            ) from failure
        except (UnicodeDecodeError, csv.Error) as other:
            text = "received a file that is no table, expected one of an earlier study"
            raise InputError(
                f"{path}: {text}; replace it with --force, or give another directory with --output"
            ) from other

    def _read(self):
        with self.path.open(newline="", encoding="utf-8") as file:
            rows = [
                row
                for row in csv.DictReader(file)
                if list(row) == self._columns and None not in row.values()
            ]
        return {self._name(row): row for row in rows}

    def _name(self, row):
        return tuple(as_text(row[key]) for key in self._keys)

    def find(self, case: Mapping[str, Any]) -> Row | None:
        """Return the row of a case (dict of its keys), None when it has not been run."""
        return self._rows.get(self._name(case))

    def add(self, row: Mapping[str, Any]) -> None:
        """Append a row to the file."""
        texts = {column: as_text(row[column]) for column in self._columns}
        self._rows[self._name(texts)] = texts
        with self.path.open("a", newline="", encoding="utf-8") as file:
            csv.DictWriter(file, self._columns, lineterminator="\n").writerow(texts)

    def _write(self):
        with temporary_name(self.path).open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, self._columns, lineterminator="\n")
            writer.writeheader()
            writer.writerows(self._rows.values())
        publish(self.path)


def as_text(value: object) -> str:
    """Return the text of a value in a table: four digits of a float, nothing for None."""
    if value is None:
        return ""
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def sweep(
    table: Table,
    cases: Iterable[C],
    run: Callable[[C], dict[str, Any]],
    say: Callable[[str], object] = print,
) -> list[Row]:
    """Run the cases that the table does not have, with a line for each; return the rows of all
    cases in their order.

    cases : objects with `keys` (dict of the table's keys) and a short `label`; run : case -> dict
    of the other columns.
    """
    cases = list(cases)
    began = time.monotonic()
    todo = [case for case in cases if table.find(case.keys) is None]
    if len(todo) < len(cases):
        say(f"{len(cases) - len(todo)} of {len(cases)} cases are in {table.path}")
    for done, case in enumerate(todo, start=1):
        values = run(case)
        table.add(case.keys | values)
        left = (time.monotonic() - began) / done * (len(todo) - done)
        found = ", ".join(
            f"{name} {as_text(value)}" for name, value in values.items() if as_text(value)
        )
        say(f"{done}/{len(todo)} {case.label}: {found}; {left:.0f} s left")
    kept = (table.find(case.keys) for case in cases)
    return [row for row in kept if row is not None]  # all have been run


def markdown(header: Sequence[object], rows: Iterable[Sequence[object]]) -> str:
    """Return a markdown table of texts or numbers."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(
        "| " + " | ".join(as_text(cell).replace("|", "\\|") for cell in line) + " |"
        for line in lines
    )
