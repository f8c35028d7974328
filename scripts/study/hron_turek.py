"""Run the channel scenes of Turek and Hron on several meshes and write computed values beside the
published ones.

CASE : cfd1 cfd2 cfd3 csm1 csm2 csm3 fsi1 fsi2 fsi3.  Orders are those of triangles; Q1 and Q2 are
quadrilaterals in blocks, Q4 and Q9.  Meshes and runs go to results/hron_turek, the
tables to DIR, which is docs/studies.  Rows that are in the table already are kept: a study that was
stopped goes on.  The meshes of triangles need gmsh.  A list that starts with level -1 is written
--levels=-1,0.
"""

import csv
import json
import subprocess
import sys
from dataclasses import dataclass
from math import log2
from pathlib import Path

import command_line
import launching

from porofsi_petsc import load_scene, run
from porofsi_petsc.errors import ExpectationError, PorofsiError
from porofsi_petsc.output.figures import save_figure
from porofsi_petsc.output.files import write_text
from porofsi_petsc.output.history import read_history
from porofsi_petsc.studies.table import Table, markdown, sweep

ROOT = Path(__file__).resolve().parents[2]
SCRATCH = ROOT / "results" / "hron_turek"
STUDIES = ROOT / "docs" / "studies"
BLOCKS = {"cfd": ("fluid",), "csm": ("solid",), "fsi": ("fluid", "solid", "mesh")}
DIRECT = (  # on every mesh: costs that compare
    "-{0}_ksp_type preonly -{0}_pc_type lu -{0}_pc_factor_mat_solver_type mumps"
)
PART = {"cfd": "fluid", "csm": "solid", "fsi": "both"}
KEYS = ("order", "level")
QUADRILATERALS = {"Q1": "Q4", "Q2": "Q9"}
COSTS = ("unknowns", "steps", "sweeps", "seconds")
NAMES = {
    "body.f_x": "drag [N/m]",
    "body.f_y": "lift [N/m]",
    "A.u_x": "u_x(A) [m]",
    "A.u_y": "u_y(A) [m]",
}
SHOWN = 3.0  # of a periodic run in its figure [s]
STATISTICS = {
    "final": "",
    "period_mean": "mean of ",
    "period_amplitude": "amplitude of ",
    "frequency": "frequency of ",
}


@dataclass(frozen=True)
class Case:
    """A scene on a mesh of a level and an order (1, 2, Q1, Q2), with changes (KEY=VALUE texts)."""

    name: str
    order: str
    level: int
    changes: tuple

    @property
    def keys(self):
        """Return what names the case in the table."""
        return {"order": self.order, "level": self.level}

    @property
    def label(self):
        """Return a few words for the progress."""
        return f"{self.name} {in_short(self.order)} level {self.level}"

    def mesh(self):
        """Return the mesh file, made when it is not there."""
        part = PART[self.name[:3]]
        path = SCRATCH / f"{part}_{self.level}_{in_short(self.order).lower()}.msh"
        if not path.is_file():
            options = {"level": self.level, "part": part, "output": path}
            if self.order in QUADRILATERALS:
                script = "hron_turek_blocks"
                options["element"] = QUADRILATERALS[self.order]
            else:
                script = "hron_turek"
                options["order"] = self.order
            words = [word for name, value in options.items() for word in (f"--{name}", str(value))]
            subprocess.run(
                [sys.executable, "-m", f"mesh.{script}", *words],
                env=launching.environment(),
                check=True,
            )
        return path

    def run(self):
        """Run the scene and return its costs and values; a value that misses its expectation is
        part of the study.
        """
        scene = load_scene(f"hron_turek_{self.name}", (*self.changes, f"mesh.path={self.mesh()}"))
        directory = SCRATCH / run_name(self.name, self.level, self.order)
        failure = ""
        try:
            summary = run(scene, directory, force=True, quiet=True, petsc_options=self.solvers())
        except ExpectationError:
            summary = _summary(directory)
        except PorofsiError as error:
            summary = _summary(directory)
            failure = str(error)
        return self._costs(summary) | _values(summary) | {"failure": failure}

    def solvers(self):
        """Return the PETSc options that make every block direct."""
        return [word for block in BLOCKS[self.name[:3]] for word in DIRECT.format(block).split()]

    @staticmethod
    def _costs(summary):
        unknowns = summary["unknowns"]
        sweeps = summary["coupling_iterations"]["mean"]
        seconds = summary["wall_time"]["total"] - summary["wall_time"]["output"]
        return {
            "unknowns": sum(unknowns.values()),
            "steps": summary["steps"],
            "sweeps": sweeps,
            "seconds": seconds,
        }


def _summary(directory):
    return json.loads((directory / "summary.json").read_text(encoding="utf-8"))


def _values(summary):
    """Return the computed values of the expectations, seven digits, None where one was skipped."""
    found = {quantity(record): record["value"] for record in summary["expectations"]}
    return {name: None if value is None else f"{value:.7g}" for name, value in found.items()}


def quantity(expectation):
    """Return the column of an expectation or its record: quantity and statistic."""
    get = expectation.get if isinstance(expectation, dict) else expectation.__getattribute__
    return f"{get('quantity')} {get('statistic')}"


# -- what the rows say -----------------------------------------------------------------------------


def in_short(order):
    """Return P and the order of triangles, or the word for quadrilaterals."""
    return order if order in QUADRILATERALS else f"P{order}"


def run_name(case, level, order):
    """Return the name of a run, which begins those of its files."""
    return f"{case}_{level}_{in_short(order).lower()}"


def in_words(name):
    """Return the heading of a column `quantity statistic`."""
    column, statistic = name.split()
    text = STATISTICS[statistic] + NAMES[column]
    return text.partition(" [")[0] + " [Hz]" if statistic == "frequency" else text


def error(value, expectation):
    """Return |value - reference| over the scale of an expectation."""
    return abs(float(value) - expectation.value) / (expectation.scale or abs(expectation.value))


def limits(values):
    """Return observed order and extrapolated value of the last three of a sequence with halved
    sizes, None where there is none.

    Richardson: v(h) = v(0) + c h^q gives 2^q = (v1 - v0)/(v2 - v1); differences that grow or change
    sign have no q.
    """
    if len(values) < 3:
        return None, None
    v0, v1, v2 = values[-3:]
    if (v1 - v0) * (v2 - v1) <= 0 or abs(v1 - v0) <= abs(v2 - v1):
        return None, None
    ratio = (v1 - v0) / (v2 - v1)
    return log2(ratio), v2 + (v2 - v1) / (ratio - 1)


def table_of(rows, expectations):
    """Return the markdown rows: costs, then value and error of every quantity."""
    names = [quantity(e) for e in expectations]
    header = ["element", "level", "unknowns", "steps", "sweeps", "time [s]"]
    header += [word for name in names for word in (in_words(name), "error")]
    body = []
    for row in rows:
        cells = [in_short(row["order"]), row["level"], *(row[cost] for cost in COSTS)]
        for name, expectation in zip(names, expectations, strict=True):
            cells += (
                [row[name], f"{100 * error(row[name], expectation):.2g} %"]
                if row[name]
                else ["", ""]
            )
        body.append(cells)
    reference = ["reference", *[""] * 5] + [
        cell for e in expectations for cell in (f"{e.value:.7g}", "")
    ]
    return markdown(header, [*body, reference])


def limits_table(rows, expectations):
    """Return order, extrapolated value and its error of every quantity and element from the last
    three levels.
    """
    body = []
    for order in sorted({row["order"] for row in rows}):
        for expectation in expectations:
            name = quantity(expectation)
            values = [float(row[name]) for row in rows if row["order"] == order and row[name]]
            if len(values) < 3:
                continue
            q, limit = limits(values)
            found = (
                ["none", ""]
                if q is None
                else [f"{limit:.7g}", f"{100 * error(limit, expectation):.2g} %"]
            )
            body.append(
                [in_short(order), in_words(name), "none" if q is None else f"{q:.2f}", *found]
            )
    header = ["element", "quantity", "observed order", "extrapolated", "error"]
    return markdown(header, body) if body else "fewer than three levels"


def published(case):
    """Return the published rows of a case: unknowns, step -> column `quantity statistic` ->
    value.
    """
    rows = {}
    with (STUDIES / "hron_turek_published.csv").open(newline="", encoding="utf-8") as file:
        for line in csv.DictReader(file):
            if line["case"] == case:
                mesh = rows.setdefault(
                    (int(line["elements"]), int(line["unknowns"]), line["step"]), {}
                )
                mesh[f"{line['quantity']} {line['statistic']}"] = float(line["value"])
    return rows


def published_table(case, expectations):
    """Return the markdown rows of the published meshes with their errors, empty without any."""
    names = [quantity(e) for e in expectations]
    header = ["elements", "unknowns", "step [s]"] + [
        word for name in names for word in (in_words(name), "error")
    ]
    body = []
    for (elements, unknowns, step), values in published(case).items():
        cells = [elements, unknowns, step]
        for name, expectation in zip(names, expectations, strict=True):
            value = values.get(name)
            cells += (
                ["", ""]
                if value is None
                else [f"{value:.7g}", f"{100 * error(value, expectation):.2g} %"]
            )
        body.append(cells)
    return markdown(header, body) if body else "none"


def history_path(case, row):
    """Return where the history of a periodic run is kept."""
    return STUDIES / f"hron_turek_{run_name(case, row['level'], row['order'])}_history.csv"


def keep_history(case, row, names):
    """Keep time, the columns of the expectations and the sweeps of a run in six digits, once."""
    source = SCRATCH / run_name(case, row["level"], row["order"]) / "history.csv"
    target = history_path(case, row)
    if source.is_file() and not target.is_file():
        history = read_history(source)
        columns = [name for name in ("t", *names, "coupling_iterations") if name in history]
        lines = zip(*(history[name] for name in columns), strict=True)
        rows = ([f"{value:.6g}" for value in line] for line in lines)
        write_text(target, "\n".join(",".join(row) for row in [columns, *rows]) + "\n")


def draw_histories(figure, rows, case, names):
    """Draw every column over the last three seconds, one line for each run."""
    figure.set_size_inches(9.0, 1.8 * len(names))
    axes = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
    for row in rows:
        history = read_history(history_path(case, row))
        shown = history["t"] >= history["t"][-1] - SHOWN
        for ax, name in zip(axes, names, strict=True):
            ax.plot(
                history["t"][shown],
                history[name][shown],
                linewidth=0.8,
                label=f"{in_short(row['order'])}, level {row['level']}",
            )
            ax.set_ylabel(NAMES[name])
    axes[-1].set_xlabel("t [s]")
    axes[0].legend(loc="upper left", ncols=2)


def draw(figure, rows, case, expectations):
    """Draw the error of every quantity over the unknowns, computed by order and published."""
    figure.set_size_inches(3.4 * len(expectations), 3.0)
    axes = figure.subplots(1, len(expectations), squeeze=False)[0]
    for ax, expectation in zip(axes, expectations, strict=True):
        name = quantity(expectation)
        for order, marker in (("1", "o-"), ("2", "s-"), ("Q1", "D-"), ("Q2", "v-")):
            mine = [row for row in rows if row["order"] == order and row[name]]
            if mine:
                errors = [error(row[name], expectation) for row in mine]
                ax.loglog(
                    [int(row["unknowns"]) for row in mine],
                    errors,
                    marker,
                    markersize=4,
                    label=in_short(order),
                )
        peer = {
            mesh[1]: error(values[name], expectation)
            for mesh, values in published(case).items()
            if name in values
        }
        peer = {
            unknowns: size for unknowns, size in peer.items() if size > 0
        }  # the finest row may be the reference itself
        (
            ax.loglog(*zip(*peer.items(), strict=True), "k^:", markersize=4, label="published")
            if peer
            else None
        )
        ax.set_xlabel("unknowns")
        ax.set_title(in_words(name).partition(" [")[0])
    axes[0].set_ylabel("relative error")
    axes[0].legend()


def command(case, options):
    """Return the command line that makes the table of a case."""
    words = [
        "scripts/run study hron_turek",
        case,
        f"--levels={options.levels}",
        f"--orders={options.orders}",
    ]
    return " ".join(words + [f"--set '{text}'" for text in options.set])


def study(case, options):
    """Run the levels and orders of a case and write its table and text."""
    scene = load_scene(f"hron_turek_{case}")
    names = [quantity(e) for e in scene.expect]
    table = Table(options.output / f"hron_turek_{case}.csv", KEYS, (*COSTS, *names, "failure"))
    cases = [
        Case(case, order, int(level), tuple(options.set))
        for order in options.orders.split(",")
        for level in options.levels.split(",")
    ]
    rows = sweep(table, cases, Case.run)
    steady = all(e.statistic == "final" for e in scene.expect)
    signals = list(dict.fromkeys(e.quantity for e in scene.expect))
    if steady:
        save_figure(table.path.with_suffix(".png"), draw, rows, case, scene.expect)
    else:
        for row in rows:
            keep_history(case, row, signals)
        kept = [row for row in rows if history_path(case, row).is_file()]
        save_figure(table.path.with_suffix(".png"), draw_histories, kept, case, signals)
    text = TEXT.format(
        title=scene.title,
        command=command(case, options),
        table=table_of(rows, scene.expect),
        limits=limits_table(rows, scene.expect),
        published=published_table(case, scene.expect),
        failed="\n".join(
            f"- {in_short(row['order'])} level {row['level']}: {row['failure']}"
            for row in rows
            if row["failure"]
        )
        or "none",
        figure=f"\n![{'Errors' if steady else 'Histories'}](hron_turek_{case}.png)\n",
        source=scene.expect[0].source,
    )
    write_text(table.path.with_suffix(".md"), text)


TEXT = """# {title}

Written by `{command}` (do not edit by hand). Errors are relative to the reference ({source}), of a
mean near zero to the amplitude. Wall times are those of one core of a shared machine, with set-up,
without output; a sweep is one coupling iteration, on average per step.

{table}

Order and limit from the last three levels (sizes halve); "none": their differences do not fall from
one sign to the same.

{limits}

Published by the reference's authors for their meshes (Q2/P1disc, uniform refinement of one coarse
mesh; columns as above):

{published}
{figure}
Failed: {failed}
"""


def main():
    """Do the study that the command line asks for."""
    parser = command_line.parser("study hron_turek", __doc__)
    names = [f"{kind}{number}" for kind in PART for number in (1, 2, 3)]
    parser.add_argument("case", nargs="+", choices=names, metavar="CASE", help=", ".join(names))
    parser.add_argument("--levels", default="0,1,2", help="of the mesh, coarse to fine")
    parser.add_argument("--orders", default="1,2", help="of the elements: 1, 2, Q1, Q2")
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="a change of the scene"
    )
    parser.add_argument("--output", type=Path, default=STUDIES, help="where the tables go")
    options = parser.parse_args()
    for case in options.case:
        study(case, options)


if __name__ == "__main__":
    main()
