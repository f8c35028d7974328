"""Study of hard cases: did it finish, did the pressure oscillate, was energy kept, how many
iterations.
"""

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from ..errors import PorofsiError
from ..output.files import write_text
from .hard_cases import CASES, QUICK, HardCase
from .table import Row, Table, markdown, sweep
from .trial import Outcome, attempt

VALUES = (
    "wanted",
    "kept",
    "steps",
    "cuts",
    "oscillation",
    "energy_error",
    "mean",
    "max",
    "seconds",
    "note",
    "message",
)
HEADER = (
    "",
    "case",
    "wanted",
    "kept",
    "steps",
    "cut",
    "oscillation of p",
    "energy error",
    "mean",
    "largest",
    "time [s]",
    "note",
)
# of the largest work: ten times the tolerance of the coupling, which is what the balance leaves
ENERGY_BOUND = 1e-5


def run_case(case: HardCase, folder: Path) -> dict[str, Any]:
    """Return the columns of a hard case, whose files go into the folder."""
    watch = case.watch() if case.watch else None
    outcome = _attempt(case, folder, watch)
    return {
        "wanted": case.wanted,
        "kept": "yes" if _kept(case, outcome, watch) else "NO",
        "steps": len(outcome.iterations),
        "cuts": outcome.cuts,
        "oscillation": outcome.oscillation,
        "energy_error": outcome.energy_error,
        "mean": outcome.mean,
        "max": outcome.largest,
        "seconds": outcome.seconds,
        "note": watch.note if watch and not outcome.failure else "",
        "message": outcome.failure,
    }


def _attempt(case, folder, watch):
    try:
        return attempt(case.scene(folder), watch.begin if watch else None)
    except PorofsiError as error:
        return Outcome(failure=str(error))


def _kept(case, outcome, watch):
    """Return whether a case did what is wanted of it and kept its energy."""
    if case.wanted == "refused":
        return bool(outcome.failure)
    fine = (
        not outcome.failure
        and outcome.energy_error < ENERGY_BOUND
        and (watch is None or watch.fine)
    )
    return fine and (case.wanted != "cut" or outcome.cuts > 0)


def study(
    directory: Path, quick: bool = False, anew: bool = False, say: Callable[[str], object] = print
) -> list[Row]:
    """Run the cases and write stability.csv and stability.md into the directory; return the
    rows.
    """
    table = Table(directory / "stability.csv", ("group", "case"), VALUES, anew)
    with tempfile.TemporaryDirectory() as scratch:
        rows = sweep(
            table, QUICK if quick else CASES, lambda case: run_case(case, Path(scratch)), say
        )
    write_text(directory / "stability.md", report(rows))
    say(f"table: {directory / 'stability.md'}")
    return rows


def report(rows: Sequence[Row]) -> str:
    """Return the markdown table and what was refused with which message."""
    columns = ("group", "case", *VALUES[:-1])
    messages = [
        f"- {row['group']}, {row['case']}: {row['message']}" for row in rows if row["message"]
    ]
    table = markdown(HEADER, [[row[column] for column in columns] for row in rows])
    return TEXT.format(table=table, bound=ENERGY_BOUND, messages="\n".join(messages) or "none")


TEXT = """# Hard cases

Written by `porofsi study stability` (do not edit by hand); the scenes:
`porofsi_petsc/studies/hard_cases.py`.

Unless the case says otherwise: the block of [coupling.md](coupling.md) with 16 cells P1, k_f = 1e-2
m/s, 50 steps of 1 ms, ρ∞ = 0.3, a sudden load of 3 kPa on one half of the drained top; large
strain: the load grows linearly to 20 % drained compression. Aitken, tolerance 1e-6. Kept: the case
did what is wanted of it, with an energy error below {bound:g} of the largest work. Oscillation:
norm of the pressure minus its average over the elements of each node over the norm of the pressure,
each the largest of the run; a layer under a drained surface that the mesh does not resolve counts
as well.

{table}

Messages:

{messages}
"""
