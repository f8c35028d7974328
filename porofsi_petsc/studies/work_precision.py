"""Study of work against error: order, mesh, step, coupling tolerance, scheme and accelerator of one
scene.
"""

import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

from ..config import Scene, load_scene
from ..config.sections import LIMIT_OF
from ..errors import InputError
from ..output.figures import save_figure
from ..output.files import write_text
from ..output.study_plots import draw_work_precision
from .samples import Errors, Samples, quarters, sample_points
from .soil import REPORT_ALL
from .table import Row, Table, as_text, markdown, sweep
from .trial import attempt

# factors on the cells of each segment and on the time step
CELLS = (0.5, 1.0, 2.0)
STEPS = (
    2.0,
    1.0,
    0.5,
)
TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-6, 1e-8)  # of the coupling, at the scene's own mesh and step
ACCELERATORS = ("aitken", "anderson", "iqn_ils")
MONOLITHIC = ("quasi_direct", "direct")
FINEST_TOLERANCE = 1e-9
KEYS = ("changes", "order", "cells", "step", "tolerance", "scheme", "accelerator")
VALUES = ("steps", "unknowns", "mean", "error_u", "error_p", "error", "seconds", "failure")


@dataclass(frozen=True)
class Setting:
    """How a scene is solved; cells : factor on the cells of each segment; step : factor on the time
    step.
    """

    order: int
    cells: float
    step: float
    tolerance: float
    scheme: str = "partitioned"
    accelerator: str = "iqn_ils"

    def overrides(self, scene: Scene) -> list[str]:
        """Return the KEY=VALUE changes of a scene; an axis of one cell, the width of a column,
        keeps it.

        A growing step grows by the factor to the power `step`, so that half the step takes twice as
        many everywhere.
        """
        time = scene.time
        changes = {
            "mesh.order": self.order,
            "time.step": self.step * time.step,
            "time.growth": time.growth**self.step,
        }
        if time.max_step is not None:
            changes["time.max_step"] = self.step * time.max_step
        changes |= {
            f"mesh.{axis}.cells": self._multiplied(getattr(scene.mesh, axis).cells)
            for axis in "xyz"[: scene.dim]
        }
        changes |= {
            f"coupling.{name}": getattr(self, name)
            for name in ("tolerance", "scheme", "accelerator")
        }
        return [f"{key}={value}" for key, value in changes.items()]

    def _multiplied(self, cells):
        return (
            list(cells) if tuple(cells) == (1,) else [max(1, round(self.cells * n)) for n in cells]
        )


@dataclass(frozen=True)
class Case:
    """A setting of a scene with changes (KEY=VALUE texts)."""

    scene: str
    changes: tuple
    setting: Setting

    @property
    def keys(self) -> dict[str, Any]:
        """Return what names the case in a table."""
        return {"changes": " ".join(self.changes)} | {
            key: getattr(self.setting, key) for key in KEYS[1:]
        }

    @property
    def label(self) -> str:
        """Return a few words for the progress."""
        return wording(self.keys)

    def load(self) -> Scene:
        """Return the scene solved in this way."""
        return base_scene(
            self.scene,
            (*self.changes, *self.setting.overrides(base_scene(self.scene, self.changes))),
        )


def base_scene(name: str, changes: Sequence[str]) -> Scene:
    """Return the scene with its changes, without its own expectations; raises InputError for a mesh
    from a file.

    Its bounds only report: u/h grows with the cells, and every run is to have the same model.  An
    "auto" term keeps its bound.
    """
    scene = load_scene(name, ("expect=[]", *changes))
    if scene.mesh.kind == "file":
        raise InputError(
            f"{name} [mesh]: received a mesh file, expected a generated mesh, whose cells a study"
            " can multiply"
        )
    needed = {limit for term, limit in LIMIT_OF.items() if getattr(scene.model, term) == "auto"}
    reported = {limit: text for limit, text in REPORT_ALL.items() if limit not in needed}
    return scene.model_copy(update={"limits": scene.limits.model_copy(update=reported)})


def wording(row: Mapping[str, Any]) -> str:
    """Return the settings of a row in words."""
    scheme = (
        f"partitioned with {row['accelerator']}"
        if row["scheme"] == "partitioned"
        else row["scheme"]
    )
    size = f"P{row['order']}, {as_text(row['cells'])} x cells, {as_text(row['step'])} x step"
    return f"{size}, tolerance {as_text(row['tolerance'])}, {scheme}"


def settings(
    scene: Scene, cells: Sequence[float] = CELLS, steps: Sequence[float] = STEPS
) -> list[Setting]:
    """Return the settings of the study: orders, meshes and steps, then the couplings at the scene's
    order and the middle ones.
    """
    assert scene.mesh.kind != "file"  # by `base_scene`
    accelerator = scene.coupling.accelerator
    tolerance = scene.coupling.tolerance
    found = [
        Setting(order, h, dt, tolerance, accelerator=accelerator)
        for order, h, dt in product((1, 2), cells, steps)
    ]
    middle = Setting(scene.mesh.order, cells[len(cells) // 2], steps[len(steps) // 2], tolerance)
    found += [
        replace(middle, tolerance=t, accelerator=a) for t, a in product(TOLERANCES, ACCELERATORS)
    ]
    found += [
        replace(middle, tolerance=t, scheme=s) for t, s in product(TOLERANCES[1:4:2], MONOLITHIC)
    ]
    return list(dict.fromkeys(found))


def finest(cells: Sequence[float], steps: Sequence[float]) -> Setting:
    """Return the setting that stands for the exact solution: twice the cells, half the step, P2,
    direct.
    """
    return Setting(2, 2 * max(cells), min(steps) / 2, FINEST_TOLERANCE, "direct")


def study(
    name: str,
    directory: Path,
    changes: Sequence[str] = (),
    error: float = 1e-2,
    cells: Sequence[float] = CELLS,
    steps: Sequence[float] = STEPS,
    anew: bool = False,
    say: Callable[[str], object] = print,
) -> list[Row]:
    """Run the settings of a scene and write work_precision_SCENE.csv, .md and .png into the
    directory; return the rows.

    changes : KEY=VALUE texts; error : the wanted one, which the recommended setting reaches.
    """
    scene = base_scene(name, changes)
    table = Table(directory / f"work_precision_{scene.name}.csv", KEYS, VALUES, anew)
    cases = [Case(name, tuple(changes), setting) for setting in settings(scene, cells, steps)]
    watch = (
        Errors
        if scene.reference
        else _compared(name, changes, finest(cells, steps), table, cases, say)
    )
    if any(table.find(case.keys) is None for case in cases):
        _warm_up(cases[0])
    rows = sweep(table, cases, lambda case: run_case(case, watch), say)
    front = pareto(rows)
    text = report(
        scene,
        command(scene, changes, error, cells, steps),
        rows,
        front,
        error,
        finest(cells, steps),
    )
    write_text(table.path.with_suffix(".md"), text)
    save_figure(table.path.with_suffix(".png"), draw_work_precision, _series(rows), front)
    say(recommendation(rows, error))
    say(f"table: {table.path.with_suffix('.md')}")
    return rows


def _warm_up(case):
    """Do one step, so that the first measured run does not pay for what Python and PETSc load
    once.
    """
    scene = case.load()
    attempt(
        scene.model_copy(update={"time": scene.time.model_copy(update={"end": scene.time.step})})
    )


def _compared(name, changes, setting, table, cases, say):
    """Return what makes the watch of a scene without exact solution: the distance from its finest
    run, which is done first.
    """
    if all(table.find(case.keys) for case in cases):
        return None
    scene = base_scene(name, changes)
    points = sample_points(scene)
    times = quarters(scene)
    reference = Samples(points, times)
    case = Case(name, tuple(changes), setting)
    say(f"reference: {case.label}")
    outcome = attempt(case.load(), reference.begin)
    if outcome.failure:
        raise InputError(
            f"{name}: its finest run failed ({outcome.failure}); choose other --cells or --steps"
        )
    return lambda scene: Samples(points, times, reference.values)


def run_case(case: Case, watch: Callable[[Scene], Any]) -> dict[str, Any]:
    """Return the columns of a case; watch : scene -> object with `begin` and, after the run,
    error_u and error_p.
    """
    scene = case.load()
    errors = watch(scene)
    outcome = attempt(scene, errors.begin)
    u, p = (None, None) if outcome.failure else (errors.error_u, errors.error_p)
    return {
        "steps": len(outcome.iterations),
        "unknowns": outcome.unknowns,
        "mean": outcome.mean,
        "error_u": u,
        "error_p": p,
        "error": max((e for e in (u, p) if e is not None), default=None),
        "seconds": outcome.seconds,
        "failure": outcome.failure,
    }


# -- what the rows say -----------------------------------------------------------------------------


def pareto(rows: Sequence[Row]) -> list[Row]:
    """Return the rows than which no other is both quicker and more exact, the quickest first."""
    front: list[Row] = []
    for row in sorted(
        (row for row in rows if row["error"]),
        key=lambda row: (float(row["seconds"]), float(row["error"])),
    ):
        if not front or float(row["error"]) < float(front[-1]["error"]):
            front.append(row)
    return front


def recommendation(rows: Sequence[Row], error: float) -> str:
    """Return one sentence: the quickest setting with the wanted error, or the most exact one when
    none has it.
    """
    front = pareto(rows)
    reached = [row for row in front if float(row["error"]) <= error]
    if not front:
        return "No run finished."
    if not reached:
        best = front[-1]
        return (
            f"No run reached an error of {error:g}; the most exact is {wording(best)}:"
            f" {best['error']} in {best['seconds']} s."
        )
    best = reached[0]
    return (
        f"For an error of {error:g}: {wording(best)}; it reached {best['error']} in"
        f" {best['seconds']} s."
    )


def _series(rows):
    """Return label -> rows that finished, by order and, apart from the partitioned scheme, by
    scheme.
    """
    series = {}
    for row in rows:
        if row["error"]:
            name = f"P{row['order']}" + (
                "" if row["scheme"] == "partitioned" else f", {row['scheme']}"
            )
            series.setdefault(name, []).append(row)
    return series


def command(
    scene: Scene,
    changes: Sequence[str],
    error: float,
    cells: Sequence[float],
    steps: Sequence[float],
) -> str:
    """Return the command line of a study."""
    words = ["porofsi", "study", "work-precision", scene.name, "--error", f"{error:g}"]
    words += [word for text in changes for word in ("--set", text)]
    for name, factors in (("--cells", cells), ("--steps", steps)):
        words += [name, ",".join(f"{factor:g}" for factor in factors)]
    return shlex.join(words)


def report(
    scene: Scene,
    command: str,
    rows: Sequence[Row],
    front: Sequence[Row],
    error: float,
    finest: Setting,
) -> str:
    """Return the markdown table, the front and the recommendation."""
    header = [
        "order",
        "x cells",
        "x step",
        "tolerance",
        "scheme",
        "accelerator",
        "steps",
        "unknowns",
        "sweeps",
    ]
    header += ["error of u", "error of p", "time [s]"]
    columns = [*KEYS[1:], "steps", "unknowns", "mean", "error_u", "error_p", "seconds"]
    body = [[row[column] for column in columns] for row in rows if row["error"]]
    failures = [f"- {wording(row)}: {row['failure']}" for row in rows if row["failure"]]
    against = EXACT if scene.reference else FINEST.format(finest=wording(vars(finest)))
    return TEXT.format(
        scene=scene.name,
        title=scene.title,
        command=command,
        against=against,
        sentence=recommendation(rows, error),
        front=markdown(header, [[row[column] for column in columns] for row in front]),
        table=markdown(header, body),
        failures="\n".join(failures) or "none",
    )


EXACT = """Errors: the largest over the times of [reference] of the relative errors in L2 over the
mesh, u over the exact u, p over its size under the sudden load."""
FINEST = """Errors: relative distance from the finest run ({finest}) over up to 400 nodes of the
scene's own mesh, at the quarters of the time, linear between steps."""
TEXT = """# Work against error: {scene}

{title}. Do not edit by hand; written by

    {command}

{against} Cells and steps are factors on those of the scene; an axis of one cell keeps it. Times are
wall times of one core with set-up, without output and comparison.

**{sentence}**

Pareto front, from quick to exact:

{front}

![Error over time and unknowns](work_precision_{scene}.png)

All runs:

{table}

Failed:

{failures}
"""
