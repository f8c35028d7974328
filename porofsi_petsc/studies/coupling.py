"""Study of the coupling iteration: sweeps per step over permeability, step, mesh, order, strain and accelerator."""

from dataclasses import dataclass
from itertools import product

import numpy as np

from ..output.figures import save_figure
from ..output.files import write_text
from ..output.study_plots import draw_heat_maps
from . import soil
from .table import Table, markdown, sweep
from .trial import attempt

PERMEABILITIES = (1.0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-9, 1e-12)  # k_f [m/s]
STATIC = "quasi-static"
STEPS = (1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0, 10.0, STATIC)  # [s]
STATIC_STEP = 1.0  # [s]
NUMBER, TOLERANCE, CAP = 6, 1e-6, 60  # steps of a case, tolerance, most iterations
ACCELERATORS = ("none", "aitken", "anderson", "iqn_ils")
BARS = {"aitken": (15, None), "anderson": (12, 8.5)}  # iterations per step: largest, mean
JUMP_BARS = {"aitken": (25, None), "anderson": (12, 8.5)}  # where the stiffness jumps
COARSE_PERMEABILITIES, COARSE_STEPS = (1.0, 1e-2, 1e-4, 1e-9), (1e-4, 1e-2, 1.0, STATIC)  # for the large meshes
# Layers from below: (permeability, stiffness factor); None where the case says the permeability.
MEDIA = {
    "uniform": ((None, 1.0),),
    "layers": ((1e-2, 1.0), (1e-8, 1.0)) * 2,
    "stiff layers": ((1e-2, 1.0), (1e-8, 100.0)) * 2,
}
KEYS = ("medium", "dim", "cells", "order", "strain", "accelerator", "k", "dt")
VALUES = ("mean", "max", "seconds", "failure")


@dataclass(frozen=True)
class Case:
    """A block of a medium, six steps of one size; k : k_f [m/s], None for layers; dt : step [s] or quasi-static."""

    medium: str
    dim: int
    cells: int
    order: int
    strain: str
    accelerator: str
    k: float | None
    dt: float | str

    @property
    def keys(self):
        """Return what names the case in a table."""
        return {key: getattr(self, key) for key in KEYS}

    @property
    def label(self):
        """Return a few words for the progress."""
        where = f"{self.medium} {self.dim}-D, {self.cells} cells P{self.order}, {self.strain} strain, {self.accelerator}"
        return f"{where}, k = {'layers' if self.k is None else f'{self.k:g}'}, dt = {self.dt}"

    def scene(self):
        """Return the scene: the load grows linearly over the steps, at large strain to 20 % drained confined compression."""
        dynamic, finite = self.dt != STATIC, self.strain == "large"
        law = "neo_hookean" if finite else "linear_elastic"
        step = self.dt if dynamic else STATIC_STEP
        load = soil.confined_load(law, 1 - soil.COMPRESSION) if finite else soil.SMALL_LOAD
        parts = MEDIA[self.medium]
        regions = soil.layers(len(parts)) if len(parts) > 1 else ()
        names = [region["name"] for region in regions] or ["body"]
        time = {"end": NUMBER * step, "step": step, "rho_inf": 0.3} | ({} if dynamic else {"scheme": "backward_euler"})
        return soil.scene(
            self.label,
            soil.mesh(self.cells, self.order, self.dim, regions),
            soil.model(dynamic, finite),
            time,
            [
                soil.material(self.k if k is None else k, law, soil.stiffened(stiffness), region=name)
                for name, (k, stiffness) in zip(names, parts, strict=True)
            ],
            soil.boundary(f"{load!r}*t/{NUMBER * step!r}", self.dim),
            coupling={"accelerator": self.accelerator, "tolerance": TOLERANCE, "max_iterations": CAP},
        )


def run_case(case):
    """Return the columns of a case."""
    outcome = attempt(case.scene())
    return {"mean": outcome.mean, "max": outcome.largest, "seconds": outcome.seconds, "failure": outcome.failure}


def all_cases():
    """Return the whole study: every pair of k_f and Δt on the meshes up to 289 nodes, every fourth pair on the larger ones."""
    cases = []
    for order, cells, strain, accelerator in product((1, 2), (8, 16, 32), ("small", "large"), ACCELERATORS):
        full = cells * order <= 16
        grid = product(PERMEABILITIES, STEPS) if full else product(COARSE_PERMEABILITIES, COARSE_STEPS)
        cases += [Case("uniform", 2, cells, order, strain, accelerator, k, dt) for k, dt in grid]
    for medium, order, strain, accelerator in product(("layers", "stiff layers"), (1, 2), ("small", "large"), ACCELERATORS):
        cases += [Case(medium, 2, 8, order, strain, accelerator, None, dt) for dt in STEPS]
    for strain, accelerator, k, dt in product(("small", "large"), ACCELERATORS[1:], (1e-2, 1e-5, 1e-9), (1e-3, 1e-1, STATIC)):
        cases.append(Case("uniform", 3, 4, 1, strain, accelerator, k, dt))
    return cases


def quick_cases():
    """Return a sample of seconds: the coarsest mesh, P1, small strain, Aitken, every fourth k_f and step."""
    return [Case("uniform", 2, 8, 1, "small", "aitken", k, dt) for k, dt in product(PERMEABILITIES[::4], STEPS[::4])]


def study(directory, quick=False, anew=False, say=print):
    """Run the cases and write coupling.csv, coupling.md and coupling.png into the directory; return the rows."""
    table = Table(directory / "coupling.csv", KEYS, VALUES, anew)
    rows = sweep(table, quick_cases() if quick else all_cases(), run_case, say)
    write_text(directory / "coupling.md", report(rows))
    labels = [f"{k:g}" for k in PERMEABILITIES], [_label(dt) for dt in STEPS]
    save_figure(directory / "coupling.png", draw_heat_maps, heat_maps(rows), *labels)
    say(f"table: {directory / 'coupling.md'}")
    return rows


# -- the summary ----------------------------------------------------------------------------------------------------------


def report(rows):
    """Return the markdown summary."""
    groups = {}
    for row in rows:
        groups.setdefault((row["medium"], row["dim"], row["strain"], row["accelerator"]), []).append(row)
    header = ["medium", "dimension", "strain", "accelerator", "cases", "failed", "mean", "largest", "bar: mean, largest", "kept"]
    body = [[*name[:1], name[1], *name[2:], *_judged(name, group)] for name, group in groups.items()]
    failures = [f"- {_place(row)}: {row['failure']}" for row in rows if row["failure"]]
    worst = [row for row in rows if not row["failure"] and _over(row)]
    over = [f"- {_place(row)}: mean {row['mean']}, largest {row['max']}" for row in worst]
    return TEXT.format(
        number=NUMBER,
        tolerance=TOLERANCE,
        load=soil.confined_load("neo_hookean", 1 - soil.COMPRESSION) / 1e6,
        small=soil.SMALL_LOAD / 1e3,
        table=markdown(header, body),
        over="\n".join(over) or "none",
        failures="\n".join(failures) or "none",
    )


def _bar(medium, accelerator):
    return (JUMP_BARS if medium == "stiff layers" else BARS).get(accelerator, (None, None))


def _judged(name, rows):
    """Return cases, failures, mean over all steps, largest, the bar, and whether it is kept."""
    finished = [row for row in rows if not row["failure"]]
    mean = float(np.mean([float(row["mean"]) for row in finished])) if finished else float("nan")
    largest = max((int(row["max"]) for row in finished), default=0)
    most, average = _bar(name[0], name[3])
    kept = len(finished) == len(rows) and largest <= (most or CAP) and mean <= (average or CAP)
    bar = f"{average or '-'}, {most}" if most else ""
    return len(rows), len(rows) - len(finished), f"{mean:.1f}", largest, bar, ("yes" if kept else "NO") if most else ""


def _over(row):
    most, _ = _bar(row["medium"], row["accelerator"])
    return most is not None and int(row["max"]) > most


def _place(row):
    return ", ".join(f"{key} {row[key]}" for key in KEYS if row[key])


def heat_maps(rows):
    """Return title -> largest iterations, (steps, permeabilities), over all meshes and orders of the uniform block in 2-D.

    NaN where nothing was run, infinite where a case failed.
    """
    panels = {}
    for row in rows:
        if row["medium"] != "uniform" or row["dim"] != "2":
            continue
        map_ = panels.setdefault(
            f"{row['accelerator']}, {row['strain']} strain", np.full((len(STEPS), len(PERMEABILITIES)), np.nan)
        )
        at = [str(dt) for dt in STEPS].index(str(_number(row["dt"]))), PERMEABILITIES.index(float(row["k"]))
        map_[at] = np.fmax(map_[at], np.inf if row["failure"] else int(row["max"]))
    return panels


def _label(step):
    return step if step == STATIC else f"{step:g}"


def _number(text):
    return text if text == STATIC else float(text)


TEXT = """# Coupling iterations

Written by `porofsi study coupling` (do not edit by hand); every case is a row of `coupling.csv`.

A block of 10 m (set A: λ = 8.375 MPa, μ = 5.583 MPa, n_f = 0.33, ρ_sR = 2000, ρ_fR = 1000 kg/m³), rollers at sides and base,
drained top, one half of it loaded. The load grows linearly over {number} steps, to {small:g} kPa (small strain, linear elastic)
or {load:.3f} MPa (large strain, neo-Hookean, moving mesh, n_s = n_s0/J, convection: 20 % drained confined compression).
Tolerance {tolerance:g} on the true residuals of all three balances, ρ∞ = 0.3; quasi-static steps by backward Euler. Layers of
2.5 m: k_f = 1e-2 and 1e-8 m/s in turn; stiff layers: the tight ones are 100 times as stiff besides. The meshes of up to 289
nodes see every pair of k_f and Δt, the larger ones k_f = 1, 1e-2, 1e-4, 1e-9 m/s with Δt = 1e-4, 1e-2, 1 s and quasi-static.
"mean" is over the cases, "largest" over all their steps.

{table}

Over their bar:

{over}

Failed:

{failures}

![Largest number of iterations of a step](coupling.png)

Largest number of iterations of a step over all meshes and orders of the uniform block in 2-D.
"""
