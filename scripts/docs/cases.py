"""Write docs/cases.md from the results of `porofsi verify --suite cases --output DIR`."""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import get_args

import command_line

from porofsi_petsc.config import load_scene
from porofsi_petsc.config.sections import Community
from porofsi_petsc.output.summary import NAME
from porofsi_petsc.simulation.verify import public_problems

PAGE = Path(__file__).resolve().parents[2] / "docs" / "cases.md"
HEAD = """# Public problems

Problems with a right value from outside, by the communities that know them. Written by
`scripts/run docs cases DIR` (do not edit by hand) from the results in DIR of

    porofsi verify --suite cases --output DIR               # all of them
    porofsi verify --suite cases NAME --output DIR          # one row

Version {version}: {problems} problems with {checks} checks, {passed} of them passed, in
{minutes:.0f} min on one core of a machine that had other work too. NAME, in the first column, is
that of a scene (`porofsi run NAME`), which says in `source` where the problem is from and in
`[[expect]]` all values. Right values are published numbers, or those of the exact solution of the
source, whose sizes and moduli are the scene's where it leaves them open. Of several checks the row
has the one that is nearest to its bound, an error over the whole body (`error.u`, `error.p`,
`error.v`, in L2, right value 0) only where there is no other. Errors are over the right value, or
over the `scale` of a check that has one.
"""
COLUMNS = (
    "| scene | what it is | source | quantity | right value | ours | error | bound | checks | s |",
    "|---|---|---|---|---|---|---|---|---|---|",
)
LONGER = """## Longer ones

Not among them, and not run for this page, because they take from minutes to hours: Hron and Turek's
CFD3, CSM3, FSI2 and FSI3, with their tables in [hron_turek.md](hron_turek.md); the vortices of
Schäfer and Turek (`porofsi verify schaefer_turek_2d2`, [verification.md](verification.md)). Orders
of convergence: `porofsi verify`, [manufactured.md](manufactured.md).
"""


def page(directory: Path) -> str:
    """Return the text of docs/cases.md from the results of every public problem."""
    problems = [_problem(name, directory) for name in public_problems()]
    records = [record for *_, summary in problems for record in summary["expectations"]]
    seconds = sum(summary["wall_time"]["total"] for *_, summary in problems)
    head = HEAD.format(
        version=problems[0][-1]["version"],
        problems=len(problems),
        checks=len(records),
        passed=sum(record["passed"] is True for record in records),
        minutes=seconds / 60,
    )
    parts = [head]
    for community in get_args(Community):
        rows = [found[1:] for found in problems if found[0] == community]
        parts.append("\n".join([f"## {community.capitalize()}", "", *table_of(rows), ""]))
    return "\n".join([*parts, LONGER])


def table_of(problems: Iterable[tuple[str, str, dict]]) -> list[str]:
    """Return the lines of the table of problems; each: name of the scene, source, summary."""
    return [*COLUMNS, *(_row(*problem) for problem in problems)]


def _problem(name, directory):
    scene = load_scene(name)
    summary = json.loads((directory / name / NAME).read_text(encoding="utf-8"))
    return scene.community, name, scene.source, summary


def _row(name, source, summary):
    records = summary["expectations"]
    shown = max(records, key=lambda record: (record["reference"] != 0, _part(record)))
    passed = sum(record["passed"] is True for record in records)
    cells = (
        f"`{name}`",
        summary["title"].split(" (exact")[0],
        _linked(source),
        _quantity(shown),
        f"{shown['reference']:.7g}",
        "-" if shown["value"] is None else f"{shown['value']:.7g}",
        "-" if shown["error"] is None else f"{shown['error']:.2g}",
        f"{shown['tolerance']:.2g}",
        f"{passed} of {len(records)}",
        f"{summary['wall_time']['total']:.1f}",
    )
    return f"| {' | '.join(cells)} |"


def _part(record):
    """Return the error over its bound."""
    return float("inf") if record["error"] is None else record["error"] / record["tolerance"]


def _quantity(record):
    if record["at"] is None:
        return f"{record['quantity']} {record['statistic']}"
    since = "" if record["since"] is None else f"since {record['since']:g} s "
    return f"{record['quantity']} {since}at {record['at']:g} s"


def _linked(source):
    """Return the source with links to its digital object identifiers."""
    words = []
    for word in source.split(" "):
        bare = word.rstrip(";")
        doi = bare.startswith("doi:")
        link = f"[{bare}](https://doi.org/{bare.removeprefix('doi:')})"
        words.append(link + word[len(bare) :] if doi else word)
    return " ".join(words)


if __name__ == "__main__":
    parser = command_line.parser("docs cases", __doc__)
    parser.add_argument("directory", type=Path, metavar="DIR", help="results of the suite")
    PAGE.write_text(page(parser.parse_args().directory), encoding="utf-8")
