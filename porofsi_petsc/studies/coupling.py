"""Study of the coupling iteration: sweeps per step over body, Poisson's ratio, k_f, step, mesh,
strain and accelerator.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from ..config import Scene
from ..output.figures import save_figure
from ..output.files import write_text
from ..output.study_plots import draw_heat_maps
from . import soil
from .bodies import BODIES
from .table import Row, Table, markdown, sweep
from .trial import attempt

PERMEABILITIES = (1.0, 1e-2, 1e-4, 1e-6, 1e-9, 1e-12)  # k_f [m/s]
STATIC = "quasi-static"
STEPS = (1e-5, 1e-3, 1e-1, 1.0, 10.0, STATIC)  # [s]
# Pairs of both from end to end, for what is varied besides.
PAIRS = ((1.0, 1e-5), (1e-3, 1e-2), (1e-6, 1.0), (1e-9, 1e-1), (1e-12, STATIC))
FEW_PAIRS = PAIRS[1::2] + PAIRS[-1:]
RATIOS = (0.0, 0.1, 0.2, 0.3, 0.45, 0.4999)  # Poisson's [-]
SOIL = 0.3  # Poisson's ratio of the soil, set A
STATIC_STEP = 1.0  # [s]
NUMBER, TOLERANCE, CAP = 6, 1e-6, 200  # steps of a case, tolerance, most iterations
ACCELERATORS = ("none", "aitken", "anderson", "iqn_ils")
BARS = {
    "aitken": (15, None),
    "anderson": (12, 8),
    "iqn_ils": (12, 8),
}  # iterations per step: largest, mean
# Layers from below: (permeability, stiffness factor); None where the case says the permeability.
MEDIA = {
    "uniform": ((None, 1.0),),
    "layers": ((1e-4, 1.0), (1e-8, 1.0)) * 2,
    "stiff layers": ((1e-4, 1.0), (1e-8, 100.0)) * 2,
    "rigid layers": ((1e-4, 1.0), (1e-8, 1e4)) * 2,
}
CRUSHED = 0.1  # load of large strain over Young's modulus, where the sides are free
KEYS = ("medium", "body", "dim", "cells", "order", "poisson", "strain", "accelerator", "k", "dt")
VALUES = ("mean", "max", "seconds", "failure")


@dataclass(frozen=True)
class Case:
    """A body of a medium, six steps of one size; k : k_f [m/s], None for layers; dt : step [s] or
    quasi-static.
    """

    medium: str
    body: str
    dim: int
    cells: int
    order: int
    poisson: float
    strain: str
    accelerator: str
    k: float | None
    dt: float | str

    @property
    def keys(self) -> dict[str, Any]:
        """Return what names the case in a table."""
        return {key: getattr(self, key) for key in KEYS}

    @property
    def label(self) -> str:
        """Return a few words for the progress."""
        where = (
            f"{self.medium} {self.body} {self.dim}-D, {self.cells} cells P{self.order}, nu ="
            f" {self.poisson:g}"
        )
        k = "layers" if self.k is None else f"{self.k:g}"
        return f"{where}, {self.strain} strain, {self.accelerator}, k = {k}, dt = {self.dt}"

    @property
    def load(self) -> float:
        """Return the pressure at the end [Pa]; large strain is 20 % of drained compression where
        the sides are held.
        """
        if self.strain == "small":
            return soil.SMALL_LOAD
        held = self.body in ("confined", "strip")
        return (
            soil.confined_load("neo_hookean", 1 - soil.COMPRESSION)
            if held
            else CRUSHED * soil.YOUNG
        )

    def scene(self) -> Scene:
        """Return the scene: the load grows linearly over the steps; a step that fails is not
        helped.
        """
        dynamic = self.dt != STATIC
        finite = self.strain == "large"
        law = "neo_hookean" if finite else "linear_elastic"
        step = self.dt if dynamic else STATIC_STEP
        parts = MEDIA[self.medium]
        regions = soil.layers(len(parts)) if len(parts) > 1 else ()
        names = [region["name"] for region in regions] or ["body"]
        time = {"end": NUMBER * step, "step": step, "rho_inf": 0.3} | (
            {} if dynamic else {"scheme": "backward_euler"}
        )
        ramp = f"{self.load!r}*t/{NUMBER * step!r}"
        mesh, boundary = BODIES[self.body](self.cells, self.order, self.dim, ramp, regions)
        choice = {
            "accelerator": self.accelerator,
            "tolerance": TOLERANCE,
            "max_iterations": CAP,
            "on_failure": "stop",
        }
        return soil.scene(
            self.label,
            mesh,
            soil.model(dynamic, finite),
            time,
            [
                soil.material(
                    self.k if k is None else k, law, soil.lame(self.poisson, factor), region=name
                )
                for name, (k, factor) in zip(names, parts, strict=True)
            ],
            boundary,
            coupling=choice,
        )


def run_case(case: Case) -> dict[str, Any]:
    """Return the columns of a case."""
    outcome = attempt(case.scene())
    return {
        "mean": outcome.mean,
        "max": outcome.largest,
        "seconds": outcome.seconds,
        "failure": outcome.failure,
    }


def all_cases() -> list[Case]:
    """Return the whole study: slices through the product of all parameters, each of which is varied
    from end to end.
    """
    return [
        case for slice_ in (_ratios, _grid, _meshes, _space, _large, _layers) for case in slice_()
    ]


def _with_all(grid):
    """Return the cases of a grid, which yields (all but accelerator, k and dt; pairs of k and dt),
    with every accelerator.
    """
    return [
        Case(*case, accelerator, k, dt)
        for case, pairs in grid
        for (k, dt), accelerator in product(pairs, ACCELERATORS)
    ]


def _ratios():
    """Return every Poisson's ratio on every body."""
    return _with_all(
        (("uniform", body, 2, 8, 1, nu, "small"), PAIRS) for nu, body in product(RATIOS, BODIES)
    )


def _grid():
    """Return every permeability with every step."""
    pairs = [pair for pair in product(PERMEABILITIES, STEPS) if pair not in PAIRS]
    return _with_all([(("uniform", "confined", 2, 8, 1, SOIL, "small"), pairs)])


def _meshes():
    """Return quadratic elements on every body at both ends of ν, and finer meshes of the block."""
    quadratic = [
        (("uniform", body, 2, 4, 2, nu, "small"), FEW_PAIRS)
        for nu, body in product((0.0, 0.4999), BODIES)
    ]
    finer = [
        (("uniform", "free sides", 2, cells, order, 0.0, "small"), PAIRS[3:])
        for cells, order in ((16, 1), (32, 1), (16, 2))
    ]
    return _with_all([*quadratic, *finer])


def _space():
    """Return 3-D, linear and quadratic."""
    shapes = product((0.0, 0.4999), BODIES, ((4, 1), (2, 2)))
    return _with_all(
        (("uniform", body, 3, *mesh, nu, "small"), PAIRS[3:]) for nu, body, mesh in shapes
    )


def _large():
    """Return large strain."""
    return _with_all(
        (("uniform", body, 2, 8, 1, nu, "large"), PAIRS)
        for nu, body in product((0.0, SOIL), BODIES)
    )


def _layers():
    """Return layers, of one stiffness and with jumps."""
    shapes = product(list(MEDIA)[1:], ("confined", "free sides"), (0.0, SOIL))
    pairs = [(None, dt) for dt in (1e-3, 1e-1, STATIC)]
    return _with_all(((medium, body, 2, 8, 1, nu, "small"), pairs) for medium, body, nu in shapes)


def quick_cases() -> list[Case]:
    """Return a sample of seconds: the block, P1, small strain, Aitken, four pairs of k_f and
    step.
    """
    block = ("uniform", "confined", 2, 8, 1, SOIL, "small", "aitken")
    return [Case(*block, k, dt) for k, dt in product(PERMEABILITIES[::3], STEPS[::3])]


def study(
    directory: Path, quick: bool = False, anew: bool = False, say: Callable[[str], object] = print
) -> list[Row]:
    """Run the cases and write coupling.csv, coupling.md and coupling.png into the directory; return
    the rows.
    """
    table = Table(directory / "coupling.csv", KEYS, VALUES, anew)
    rows = sweep(table, quick_cases() if quick else all_cases(), run_case, say)
    write_text(directory / "coupling.md", report(rows))
    labels = [f"{k:g}" for k in PERMEABILITIES], [_label(dt) for dt in STEPS]
    save_figure(directory / "coupling.png", draw_heat_maps, heat_maps(rows), *labels)
    say(f"table: {directory / 'coupling.md'}")
    return rows


# -- the summary -----------------------------------------------------------------------------------


def report(rows: Sequence[Row]) -> str:
    """Return the markdown summary."""
    header = ["cases", "failed", "mean", "largest", "bar: mean, largest", "kept"]
    by_body = _table(rows, ("medium", "body", "dim", "strain"), header)
    by_ratio = _table(
        [row for row in rows if row["medium"] == "uniform" and row["strain"] == "small"],
        ("poisson",),
        header,
    )
    failures = [f"- {_place(row)}: {row['failure']}" for row in rows if row["failure"]]
    over = [
        f"- {_place(row)}: mean {row['mean']}, largest {row['max']}"
        for row in rows
        if not row["failure"] and _over(row)
    ]
    return TEXT.format(
        number=NUMBER,
        tolerance=TOLERANCE,
        cap=CAP,
        load=soil.confined_load("neo_hookean", 1 - soil.COMPRESSION) / 1e6,
        crushed=CRUSHED * soil.YOUNG / 1e6,
        small=soil.SMALL_LOAD / 1e3,
        by_body=by_body,
        by_ratio=by_ratio,
        over="\n".join(over) or "none",
        failures="\n".join(failures) or "none",
    )


def _table(rows, names, header):
    """Return a markdown table with a line for every value of the named columns and every
    accelerator.
    """
    groups = {}
    for row in rows:
        groups.setdefault((*(row[name] for name in names), row["accelerator"]), []).append(row)
    return markdown(
        [*names, "accelerator", *header],
        [[*name, *_judged(name[-1], group)] for name, group in groups.items()],
    )


def _judged(accelerator, rows):
    """Return cases, failures, mean over all steps, largest, the bar, and whether it is kept."""
    finished = [row for row in rows if not row["failure"]]
    mean = float(np.mean([float(row["mean"]) for row in finished])) if finished else float("nan")
    largest = max((int(row["max"]) for row in finished), default=0)
    most, average = BARS.get(accelerator, (None, None))
    kept = len(finished) == len(rows) and largest <= (most or CAP) and mean <= (average or CAP)
    bar = f"{average or '-'}, {most}" if most else ""
    return (
        len(rows),
        len(rows) - len(finished),
        f"{mean:.1f}",
        largest,
        bar,
        ("yes" if kept else "NO") if most else "",
    )


def _over(row):
    most, _ = BARS.get(row["accelerator"], (None, None))
    return most is not None and int(row["max"]) > most


def _place(row):
    return ", ".join(f"{key} {row[key]}" for key in KEYS if row[key])


def heat_maps(rows: Sequence[Row]) -> dict[str, np.ndarray]:
    """Return accelerator -> largest iterations, (steps, permeabilities), of the uniform block in
    2-D at small strain.

    NaN where nothing was run, infinite where a case failed.
    """
    panels: dict[str, np.ndarray] = {}
    for row in rows:
        if not _on_grid(row):
            continue
        map_ = panels.setdefault(
            row["accelerator"], np.full((len(STEPS), len(PERMEABILITIES)), np.nan)
        )
        at = (
            [str(dt) for dt in STEPS].index(str(_number(row["dt"]))),
            PERMEABILITIES.index(float(row["k"])),
        )
        map_[at] = np.fmax(map_[at], np.inf if row["failure"] else int(row["max"]))
    return panels


def _on_grid(row):
    """Return whether a row belongs to the uniform block at the soil's ν, with one of the grid's
    permeabilities and steps.
    """
    block = row["medium"], row["body"], row["dim"], row["strain"], float(row["poisson"])
    return (
        block == ("uniform", "confined", "2", "small", SOIL)
        and float(row["k"]) in PERMEABILITIES
        and _number(row["dt"]) in STEPS
    )


def _label(step):
    return step if step == STATIC else f"{step:g}"


def _number(text):
    return text if text == STATIC else float(text)


TEXT = """# Coupling iterations

Written by `porofsi study coupling` (do not edit by hand); every case is a row of `coupling.csv`.

Soil: E = 14.5 MPa (at ν = 0.3 set A, λ = 8.375 MPa, μ = 5.583 MPa), n_f = 0.33, ρ_sR = 2000, ρ_fR =
1000 kg/m³. The load grows linearly over {number} steps, to {small:g} kPa (small strain, linear
elastic) or, at large strain (neo-Hookean, moving mesh, n_s = n_s0/J, convection), to {load:.3f} MPa
where the sides are held (20 % drained compression at ν = 0.3) and {crushed:.3f} MPa where they are
free. Tolerance {tolerance:g} on the true residuals of all three balances, at most {cap} sweeps, ρ∞
= 0.3; quasi-static steps by backward Euler. Neither another accelerator nor a cut of the step helps
a case.

- confined: a block of 10 m between rollers, one half of its drained top loaded
- free sides: the same between planes of symmetry, the other sides free and impermeable
- strip: a block of 20 m by 10 m between rollers, drained top but for an impermeable footing, which
  is loaded
- sphere: an eighth of a ball (in 2-D a quarter of a cylinder) of 5 m, drained and pressed all
  around (Cryer)
- layers of 2.5 m: k_f = 1e-4 and 1e-8 m/s in turn; stiff, rigid layers: the tight ones are 1e2, 1e4
  times as stiff besides

"mean" is over the cases, "largest" over all their steps.

{by_body}

The uniform bodies at small strain, by Poisson's ratio:

{by_ratio}

Over their bar:

{over}

Failed:

{failures}

![Largest number of iterations of a step](coupling.png)

Largest number of iterations of a step of the uniform block in 2-D at ν = 0.3 and small strain.
"""
