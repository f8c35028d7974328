"""Time at equal error, end to end, beside other programs in one run; writes
docs/studies/peers_<case>.csv and .md.

The error of a case:

    terzaghi  relative L2 error of p at T_v = 0.1 (terzaghi_square.toml)
    fsi1      largest relative error of u_x, u_y, drag and lift
    fsi3      relative error of the amplitude of u_y at the tip in the last half second
    pulse2d,  the partitioned scheme and the monolithic ones on the same mesh with the same step:
    pulse3d   largest difference of the probes' histories from those of "direct", over the largest
              value of each

Rounds of all programs in turn, each run a process of its own; the least time of each counts.
Seconds: of the steps, without set-up, output and a first run in the same process that loads the
compiled routines (fsi3: the only run); process: of the whole run but Python's start and that first
run.

A peer is a command whose output has KEY=VALUE (or "KEY": VALUE): its seconds as loop_wall, total_s
or wall_total; its error as errL2_p, or the history t, ux, uy, drag, lift, from which it is computed
as ours.  What it does not say stays empty.
"""

import argparse
import json
import os
import re
import shlex
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

import command_line
import launching
import numpy as np

from porofsi_petsc import load_scene, run
from porofsi_petsc.errors import ExpectationError
from porofsi_petsc.output.history import read_history
from porofsi_petsc.studies.table import as_text, markdown

ROOT = Path(__file__).resolve().parents[2]
QUIET = ("figures={}", "expect=[]", "output={ fields_every = 1000000 }")
FSI1 = {
    "body.f_x": 14.29426,
    "body.f_y": 0.763746,
    "A.u_x": 2.270493e-5,
    "A.u_y": 8.208773e-4,
}  # Featflow, level 7+0
FSI3 = 34.99e-3  # Featflow, amplitude of u_y(A), level 4+0 with dt = 2.5e-4
COLUMNS = ("program", "unknowns", "steps", "iterations", "seconds", "process", "error")
PRINTED = {
    "unknowns": ["dofs"],
    "steps": ["steps"],
    "iterations": ["nl_it", "newton_per_step"],
}  # by peers
PRINTED |= {"seconds": ["loop_wall", "total_s", "wall_total"], "error": ["errL2_p"]}
HISTORY = {"t": "t", "A.u_x": "ux", "A.u_y": "uy", "body.f_x": "drag", "body.f_y": "lift"}
DEGREE = 0.1  # T_v of the Terzaghi case


@dataclass(frozen=True)
class Own:
    """One of our runs: a scene with changes; error : of a summary and a history; once : whether it
    is too long to be repeated.
    """

    scene: str
    changes: tuple
    error: object = lambda summary, history: None
    once: bool = False


def pressure_error(summary, history):
    """Return the error of p over the exact p, where the summary has it over the pressure of the
    load.
    """
    k = (2 * np.arange(400) + 1) * np.pi / 2
    size = np.sqrt(
        (2 / k**2 * np.exp(-2 * k**2 * DEGREE)).sum()
    )  # |p|/|p_0| = (∑ (2/k)² e^(-2k²T)/2)^½
    return summary["errors"][-1]["p"] / size


def steady_error(summary, history):
    """Return the largest relative error of displacements and forces."""
    return max(abs(history[name][-1] / value - 1) for name, value in FSI1.items())


def swing_error(summary, history):
    """Return the relative error of the amplitude of u_y over the last half second."""
    swing = history["A.u_y"][history["t"] > history["t"][-1] - 0.5]
    return abs((swing.max() - swing.min()) / 2 / FSI3 - 1)


def terzaghi():
    """Return two accuracies, cells and steps of equal error each, on a square and on a strip: the
    solution depends on y alone.
    """
    scene = str(Path(__file__).resolve().with_name("terzaghi_square.toml"))
    short = ("time.step=0.1", "time.growth=1.5", "time.max_step=4")
    runs = {}
    for columns, cells, steps in ((5, 5, ()), (1, 5, ()), (6, 6, short), (1, 8, short)):
        changes = (f"mesh.x.cells=[{columns}]", f"mesh.y.cells=[{cells}]", *steps)
        runs[f"P2 {columns} x {cells}{', short steps' if steps else ''}"] = Own(
            scene, changes, pressure_error
        )
    return runs


def fsi1():
    """Return the shipped scene on the mesh of level 1, at the shipped tolerance and at one that
    fits the error.
    """
    mesh = f"mesh.path={made_mesh(1, 2)}"
    tolerances = {"P2 level 1": 1e-6, "P2 level 1, tolerance 1e-4": 1e-4}
    return {
        label: Own("hron_turek_fsi1", (mesh, f"coupling.tolerance={value}"), steady_error)
        for label, value in tolerances.items()
    }


def fsi3():
    """Return the shipped scene on two meshes."""
    return {
        f"P2 level {level}": Own(
            "hron_turek_fsi3",
            (f"mesh.path={made_mesh(level, 2)}", "time.end=7.0"),
            swing_error,
            once=True,
        )
        for level in (-1, 0)
    }


def pulse2d():
    """Return both schemes at two permeabilities."""
    return _schemes("pulse2d", ("time.end=0.02",), {"1e-2": 1e-3, "1e-5": 1e-3})


def pulse3d():
    """Return both schemes at two permeabilities."""
    return _schemes("pulse3d", ("time.end=0.006",), {"1e-2": 2e-3, "1e-5": 2e-3})


def _schemes(scene, changes, steps):
    runs = {}
    for k, step in steps.items():
        common = (*changes, f"material.0.permeability.k={k}", f"time.step={step}")
        for scheme in ("direct", "quasi_direct", "partitioned"):
            runs[f"{scheme}, k_f = {k}"] = Own(scene, (*common, f"coupling.scheme={scheme}"))
    return runs


CASES = {case.__name__: case for case in (terzaghi, fsi1, fsi3, pulse2d, pulse3d)}


def made_mesh(level, order):
    """Return the path of a mesh of the channel, made when it is not there."""
    path = ROOT / "results" / "hron_turek" / f"both_{level}_p{order}.msh"
    if not path.is_file():
        path.parent.mkdir(parents=True, exist_ok=True)
        maker = [
            sys.executable,
            "-m",
            "mesh.hron_turek",
            "--level",
            str(level),
            "--order",
            str(order),
        ]
        subprocess.run([*maker, "--output", path], env=launching.environment(), check=True)
    return path


def own_row(label, own):
    """Run the scene in this process, to warm it up and then measured; return its row and its
    history.
    """
    scene = load_scene(own.scene, (*QUIET, *own.changes))
    with tempfile.TemporaryDirectory() as folder:
        for turn in range(1 if own.once else 2):
            start = time.perf_counter()
            place = Path(folder) / str(turn)
            try:
                summary = run(scene, place, quiet=True)
            except ExpectationError:
                summary = json.loads((place / "summary.json").read_text())
            process = time.perf_counter() - start
        history = read_history(place / "history.csv")
    walls = summary["wall_time"]
    row = {
        "program": label,
        "unknowns": sum(summary["unknowns"].values()),
        "steps": summary["steps"],
        "iterations": summary["coupling_iterations"]["mean"],
        "seconds": walls["total"] - walls["setup"] - walls["output"],
        "process": process,
        "error": own.error(summary, history),
    }
    return row, {name: list(values) for name, values in history.items()}


def own_process(case, label):
    """Return row and history of a run in a fresh process."""
    words = [sys.executable, "-m", "bench.peers", case, "--only", label, "--inside"]
    done = subprocess.run(
        words, env=launching.environment(), capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise SystemExit(f"{label}: {done.stderr.strip()[-600:]}")
    return json.loads(done.stdout.splitlines()[-1])


def peer_row(label, command, error):
    """Return the row of a peer's run; error : of a history, None where it says its own."""
    start = time.perf_counter()
    done = subprocess.run(shlex.split(command), capture_output=True, text=True, check=False)
    process = time.perf_counter() - start
    found = defaultdict(list)
    for key, value in re.findall(r'"?(\w+)"?(?:=|: )([-+]?\d[-+.\de]*)', done.stdout):
        found[key].append(float(value))
    if done.returncode and not any(
        name in found for name in PRINTED["seconds"]
    ):  # some end in a fault after their last word
        raise SystemExit(f"{label}: {done.stderr.strip()[-600:]}")
    row = {
        column: next((found[name][-1] for name in names if name in found), None)
        for column, names in PRINTED.items()
    }
    if row["error"] is None and "uy" in found:
        n = len(found["uy"])
        row["error"] = error(
            None, {ours: np.array(found[theirs][-n:]) for ours, theirs in HISTORY.items()}
        )
    return row | {"program": label, "seconds": row["seconds"] or process, "process": process}


def add_differences(rows, histories):
    """Set the errors of runs of the same model to their difference from the direct scheme's
    history.
    """
    for label, row in rows.items():
        scheme, _, rest = label.partition(", ")
        exact = histories.get(f"direct, {rest}")
        if exact is not None and row["error"] is None and scheme in ("partitioned", "quasi_direct"):
            probes = [name for name in exact if name not in ("t", "coupling_iterations")]
            pairs = [(np.array(histories[label][name]), np.array(exact[name])) for name in probes]
            row["error"] = max(np.abs(a - b).max() / np.abs(b).max() for a, b in pairs)


def measure(case, labels, peers, rounds, error):
    """Return label -> row with the least times of all rounds; error : of a peer's history."""
    rows = {}
    histories = {}
    for turn in range(rounds):
        for label in [*labels, *peers]:
            if label in peers:
                row = peer_row(label, peers[label], error)
            else:
                row, histories[label] = own_process(case, label)
            best = rows.setdefault(label, row)
            for name in ("seconds", "process"):
                best[name] = min(best[name], row[name])
            print(
                f"round {turn + 1}, load {os.getloadavg()[0]:.1f}: "
                + ", ".join(f"{k} {as_text(v)}" for k, v in row.items()),
                flush=True,
            )
    add_differences(rows, histories)
    return rows


def write(case, rows, command, folder):
    """Write the table as CSV and markdown."""
    texts = [[as_text(row[column]) for column in COLUMNS] for row in rows.values()]
    (folder / f"peers_{case}.csv").write_text(
        "\n".join(",".join(f'"{t}"' if "," in t else t for t in r) for r in [COLUMNS, *texts])
        + "\n"
    )
    table = markdown(COLUMNS, texts)
    (folder / f"peers_{case}.md").write_text(
        f"# {case}\n\nWritten by `{command}` (do not edit by hand).\n\n{table}\n"
    )


def main():
    """Measure what the command line asks for."""
    parser = command_line.parser("bench peers", __doc__)
    parser.add_argument("case", choices=CASES)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--only", nargs="+", metavar="LABEL", help="these of our runs alone")
    parser.add_argument("--peer", action="append", default=[], metavar="LABEL=COMMAND")
    parser.add_argument("--output", type=Path, default=ROOT / "docs" / "studies")
    parser.add_argument("--inside", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    runs = CASES[options.case]()
    labels = options.only or list(runs)
    if options.inside:
        print(json.dumps(own_row(labels[0], runs[labels[0]])))
        return
    peers = dict(peer.split("=", 1) for peer in options.peer)
    words = [
        options.case,
        "--rounds",
        str(options.rounds),
        *(["--only", *options.only] if options.only else []),
    ]
    words += [word for label in peers for word in ("--peer", f"{label}=COMMAND")]
    rows = measure(options.case, labels, peers, options.rounds, next(iter(runs.values())).error)
    write(options.case, rows, f"scripts/run bench peers {shlex.join(words)}", options.output)


if __name__ == "__main__":
    main()
