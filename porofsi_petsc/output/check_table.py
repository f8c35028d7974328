"""The table of verification checks on a terminal."""

from collections.abc import Iterable
from typing import Any


def checks_table(checks: Iterable[Any]) -> str:
    """Return a text of computed, reference, error and bound of every check, each with the fields of
    `simulation.verify.Check`.
    """
    from rich.console import Console
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    table.add_column("case", no_wrap=True)
    table.add_column("quantity")
    for heading in ("computed", "reference", "error", "bound"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("")
    previous = None
    for check in checks:
        style = None if check.passed else "red"
        numbers = (
            _number(check.computed, 6),
            _number(check.reference, 6),
            _number(check.error, 2),
            _number(check.bound, 2),
        )
        verdict = "passed" if check.passed else f"FAILED {check.note}"
        table.add_row(
            check.case if check.case != previous else "",
            check.quantity,
            *numbers,
            verdict,
            style=style,
        )
        previous = check.case
    console = Console(width=None if Console().is_terminal else 160)
    with console.capture() as text:
        console.print(table)
    return text.get().rstrip("\n")


def _number(value, digits):
    return "-" if value is None else f"{value:.{digits}g}"
