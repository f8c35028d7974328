"""Compare one-way, weak and strong coupling on FSI3: the tip of the beam, the forces, and what a
step costs.

Writes docs/studies/hron_turek_schemes.md and .png.  Runs hron_turek_one_way, hron_turek_weak and
hron_turek_fsi3 in results/schemes; a run that is there is not repeated.
"""

import json
from pathlib import Path

import command_line

from porofsi_petsc import load_scene, run
from porofsi_petsc.errors import ExpectationError, PorofsiError
from porofsi_petsc.output.figures import save_figure
from porofsi_petsc.output.files import write_text
from porofsi_petsc.output.history import read_history
from porofsi_petsc.studies.table import markdown

ROOT = Path(__file__).resolve().parents[2]
SCRATCH = ROOT / "results" / "schemes"
STUDIES = ROOT / "docs" / "studies"
SCENES = {"one-way": "hron_turek_one_way", "weak": "hron_turek_weak", "strong": "hron_turek_fsi3"}
FIRST = (
    "time.end=0.2",
    "figures.times=[]",
)  # 50 steps, for the cost: all schemes one after the other
SIGNALS = {
    "A.u_x": ("u_x(A) [mm]", 1e3),
    "A.u_y": ("u_y(A) [mm]", 1e3),
    "body.f_x": ("drag [N/m]", 1),
    "body.f_y": ("lift [N/m]", 1),
}


def result(scheme, changes, directory):
    """Return summary and history of a scheme, run now unless it is there; a failure is part of the
    study.
    """
    if not (directory / "summary.json").is_file():
        try:
            run(load_scene(SCENES[scheme], ("expect=[]", *changes)), directory, force=True)
        except PorofsiError as failure:
            print(f"{scheme}: {failure}")
    return json.loads((directory / "summary.json").read_text(encoding="utf-8")), read_history(
        directory / "history.csv"
    )


def seconds_per_step(summary):
    """Return the wall time of a step without set-up and output, None of a run that ended on the
    way.
    """
    wall = summary["wall_time"]
    return (
        None
        if failed(summary)
        else (wall["total"] - wall["output"] - wall["setup"]) / summary["steps"]
    )


def failed(summary):
    """Return whether a run did not reach its end; a value beyond its bound is no failure."""
    return summary["exit_code"] not in (0, ExpectationError.exit_code)


def row(scheme, summary, cost):
    """Return the line of a scheme: signals over the last period, sweeps per step, seconds per step
    of another run.
    """
    period = summary["period"]
    columns = period["columns"] if period else {}
    cells = [signal(columns.get(name), factor) for name, (_, factor) in SIGNALS.items()]
    frequency = f"{columns['A.u_y']['frequency']:.3f}" if columns else ""
    end = f"{summary['time_end']:g} s" + (", diverged" if failed(summary) else "")
    sweeps = f"{summary['coupling_iterations']['mean']:.1f}"
    seconds = seconds_per_step(cost)
    return [scheme, end, *cells, frequency, sweeps, "" if seconds is None else f"{seconds:.2f}"]


def signal(oscillation, factor):
    """Return mean ± amplitude as text."""
    return (
        ""
        if oscillation is None
        else f"{oscillation['mean'] * factor:.4g} ± {oscillation['amplitude'] * factor:.4g}"
    )


def draw(figure, histories):
    """Draw the tip over the run, and the lift of the first steps, in which the weak scheme ends."""
    figure.set_size_inches(9.0, 3.2)
    tip, lift = figure.subplots(1, 2, width_ratios=(2, 1))
    end = histories["weak"]["t"][-1]
    for (scheme, history), style in zip(histories.items(), ("C1-", "C3o--", "C0-"), strict=True):
        tip.plot(
            history["t"], 1e3 * history["A.u_y"], style, linewidth=0.8, markersize=3, label=scheme
        )
        first = history["t"] <= 1.5 * end
        lift.plot(
            1e3 * history["t"][first],
            history["body.f_y"][first],
            style,
            linewidth=0.8,
            markersize=3,
        )
    tip.set(xlabel="t [s]", ylabel="u_y(A) [mm]")
    tip.legend(loc="upper left")
    lift.set(xlabel="t [ms]", ylabel="lift [N/m]", title="first steps")
    lift.set_yscale("symlog", linthresh=0.1)


def main():
    """Run what is missing and write page and figure."""
    parser = command_line.parser("study schemes", __doc__)
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="a change of all scenes"
    )
    options = parser.parse_args()
    changes = tuple(options.set)
    results = {scheme: result(scheme, changes, SCRATCH / scheme) for scheme in SCENES}
    costs = {
        scheme: result(scheme, (*changes, *FIRST), SCRATCH / f"{scheme}_cost")[0]
        for scheme in SCENES
    }
    names = [text for text, _ in SIGNALS.values()]
    header = [
        "scheme",
        "end",
        *names,
        "frequency of u_y [Hz]",
        "sweeps per step",
        "seconds per step",
    ]
    table = markdown(
        header, [row(scheme, summary, costs[scheme]) for scheme, (summary, _) in results.items()]
    )
    save_figure(
        STUDIES / "hron_turek_schemes.png",
        draw,
        {scheme: history for scheme, (_, history) in results.items()},
    )
    words = " ".join(["scripts/run study schemes", *(f"--set '{text}'" for text in options.set)])
    write_text(STUDIES / "hron_turek_schemes.md", TEXT.format(command=words, table=table))


TEXT = """# One-way, weak and strong coupling on FSI3

Written by `{command}` (do not edit by hand). Mean ± amplitude over the last full period; seconds
per step of the first 50 steps, one core of a shared machine, without set-up and output.

{table}

![Tip of the beam](hron_turek_schemes.png)
"""


if __name__ == "__main__":
    main()
