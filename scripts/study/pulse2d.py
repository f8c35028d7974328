"""Refine the pulse scenes in space and time and write what changes: docs/pulse2d_convergence.md.

scripts/run study pulse2d run LEVEL...     into results/study/LEVEL, kept when it is there
scripts/run study pulse2d run all
scripts/run study pulse2d write            the document, from all results that are there
"""

import json
from dataclasses import dataclass
from pathlib import Path

import command_line
import numpy as np

from porofsi_petsc import load_scene, run
from porofsi_petsc.elements import ELEMENTS
from porofsi_petsc.errors import ExpectationError
from porofsi_petsc.output.fields import read_snapshots
from porofsi_petsc.output.hdf5 import read_attributes, read_slab
from porofsi_petsc.output.history import read_history

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "results" / "study"
DOCUMENT = ROOT / "docs" / "pulse2d_convergence.md"
PEAKS = {"A.u_y": ("mm", 1e3), "B.p": ("kPa", 1e-3), "C.u_y": ("mm", 1e3)}
C_P = 85.068  # [m/s], sqrt(E_c/M)
C_S = 57.8, 64.5  # [m/s], sqrt(mu/(rho_s + rho_f)) and sqrt(mu/rho_s)
CENTRE, HALF_STRIP, HEIGHT, WIDTH = 10.5, 0.5, 10.0, 21.0  # [m]


@dataclass(frozen=True)
class Level:
    """A shipped scene with its mesh and step divided (h < 1: coarser), linear or quadratic
    elements, until an end [s].
    """

    scene: str
    h: float = 1
    dt: float = 1
    order: int = 2
    end: float = 0.2

    @property
    def name(self):
        return f"{self.scene}_T{3 * self.order}_h{self.h:g}_dt{self.dt:g}"

    @property
    def label(self):
        return f"T{3 * self.order} | {_fraction('h', self.h)} | {_fraction('Δt', self.dt)}"

    def overrides(self):
        """Return the KEY=VALUE changes of the scene; fields every 4 ms, for the fronts."""
        scene = load_scene(self.scene)
        cells = {
            axis: [max(1, round(n * self.h)) for n in getattr(scene.mesh, axis).cells]
            for axis in "xy"
        }
        step = scene.time.step / self.dt
        changes = {
            "mesh.order": self.order,
            "time.step": step,
            "time.end": self.end,
            "figures.times": [],
        }
        changes |= {f"mesh.{axis}.cells": n for axis, n in cells.items()} | {
            "output.fields_every": max(1, round(4e-3 / step))
        }
        return [f"{key}={value}" for key, value in changes.items()]


def _fraction(symbol, divisor):
    return (
        symbol
        if divisor == 1
        else f"{symbol}/{divisor:g}"
        if divisor > 1
        else f"{1 / divisor:g} {symbol}"
    )


PULSE = [
    Level("pulse2d", 0.5),
    Level("pulse2d"),
    Level("pulse2d", 1, 2),
    Level("pulse2d", 2, 2),
    Level("pulse2d", 2, 2, order=1),
]
STEPS = {
    (1, 0.5): (1, 2, 4),
    (1, 1): (1, 2, 4),
    (1, 2): (1, 2),
    (2, 0.5): (1, 2, 4),
    (2, 1): (1, 2),
}  # (order, h): steps
LOW = [
    Level("pulse2d_low_permeability", h, dt, order, 0.05)
    for (order, h), steps in STEPS.items()
    for dt in steps
]
LEVELS = {level.name: level for level in PULSE + LOW}


def directory(level):
    """Return where the results of a level are."""
    return RESULTS / level.name


def summary_of(level):
    """Return the summary of a level, None when it has not been run."""
    path = directory(level) / "summary.json"
    return json.loads(path.read_text()) if path.is_file() else None


def run_level(level):
    """Run a level unless its results are there; a value that misses its expectation is part of the
    study.
    """
    if summary_of(level):
        return
    try:
        run(load_scene(level.scene, level.overrides()), directory(level), force=True, quiet=True)
    except ExpectationError as miss:
        print(f"{level.name}: {miss}")


def peak(values):
    """Return the value of largest magnitude."""
    return values[np.abs(values).argmax()]


# -- tables ----------------------------------------------------------------------------------------


def peaks_table(done):
    """Return the rows of peaks with their change from level to finest level in %."""
    columns = {level: read_history(directory(level) / "history.csv") for level in done}
    finest = {q: peak(columns[finest_level(done)][q]) for q in PEAKS}
    yield (
        "| element | mesh | step | nodes | "
        + " | ".join(f"{q} [{unit}]" for q, (unit, _) in PEAKS.items())
        + " |"
    )
    yield "|---" * (4 + len(PEAKS)) + "|"
    for level in done:
        cells = []
        for q, (_, factor) in PEAKS.items():
            value = peak(columns[level][q])
            cells.append(f"{factor * value:.4f} ({100 * (value / finest[q] - 1):+.2f} %)")
        yield f"| {level.label} | {summary_of(level)['nodes']} | " + " | ".join(cells) + " |"


def finest_level(done):
    """Return the level with most nodes, steps and the highest order."""
    return max(done, key=lambda level: (level.order, level.h, level.dt))


def energy_table(done):
    """Return the rows of the energy balance in % of the largest external work, dissipations told
    apart.
    """
    names = ["drag_dissipation", "stabilization_dissipation", "time_scheme_dissipation"]
    yield (
        "| element | mesh | step | work [J/m] | stored | drag | stabilization | time scheme | error"
        " | coupling | time [s] |"
    )
    yield "|---" * 11 + "|"
    for level in done:
        summary = summary_of(level)
        energy = summary["energy"]
        coupling = summary["coupling_iterations"]
        work = energy["external_work"]
        stored = energy["kinetic"] + energy["elastic"]
        shares = " | ".join(f"{100 * energy[name] / work:.3f} %" for name in names)
        yield (
            f"| {level.label} | {work:.2f} | {100 * stored / work:.2f} % | {shares} |"
            f" {energy['balance_error_relative']:.0e} | {coupling['mean']:.1f}/{coupling['max']} |"
            f" {summary['wall_time']['total']:.0f} |"
        )


def coupling_table(done):
    """Return the rows of coupling iterations and the pressure oscillation of the low-permeability
    levels.
    """
    yield (
        "| element | mesh | step | nodes | coupling mean/max | steps over 15 | roughness | below 1"
        " m | time [s] |"
    )
    yield "|---" * 9 + "|"
    for level in done:
        summary = summary_of(level)
        iterations = read_history(directory(level) / "history.csv")["coupling_iterations"][1:]
        over = f"{int((iterations > 15).sum())} of {len(iterations)}"
        yield (
            f"| {level.label} | {summary['nodes']} |"
            f" {iterations.mean():.1f}/{int(iterations.max())} | {over} |"
            f" {summary['oscillation_indicator']:.3f} | {deep_roughness(level):.3f} |"
            f" {summary['wall_time']['total']:.0f} |"
        )


def deep_roughness(level):
    """Return the largest |p - p̄| over the largest |p| of the run, norms over the nodes 1 m below
    the surface and deeper.
    """
    mesh = directory(level) / "fields" / "mesh.h5"
    points = read_slab(mesh, "points")
    cells = read_slab(mesh, "cells")
    a, b, c = (points[cells[:, i], :2] for i in range(3))
    area = np.abs(np.linalg.det(np.stack([b - a, c - a], axis=1)))
    inside = (
        (points[:, 1] <= HEIGHT - 1)
        & (points[:, 1] > 0)
        & (points[:, 0] > 0)
        & (points[:, 0] < WIDTH)
    )

    def sum_at_nodes(values):
        return np.bincount(cells.ravel(), np.repeat(values, cells.shape[1]), len(points))

    total = sum_at_nodes(area)
    norms = []
    for snapshot in read_snapshots(directory(level))[1:]:
        p = read_slab(snapshot.path, "pressure")
        rough = p - sum_at_nodes(area * p[cells].mean(axis=1)) / total
        norms.append((np.linalg.norm(rough[inside]), np.linalg.norm(p[inside])))
    rough, pressure = np.max(norms, axis=0)
    return rough / pressure


# -- fronts ----------------------------------------------------------------------------------------


class Fronts:
    """Volume strain and rotation at the centres of the elements of a level."""

    def __init__(self, level):
        mesh = directory(level) / "fields" / "mesh.h5"
        element = ELEMENTS[read_attributes(mesh)[0]["element"]]
        points = read_slab(mesh, "points")[:, :2]
        self._cells = read_slab(mesh, "cells")
        dN = element.gradient(np.full((1, 2), 1 / 3))[0]
        X = points[self._cells]
        self._G = dN @ np.linalg.inv(np.swapaxes(X, 1, 2) @ dN)  # dN_a/dX_j, (E, A, 2)
        self.centres = X.mean(axis=1)
        self.snapshots = read_snapshots(directory(level))

    def strain_rotation_motion(self, snapshot):
        """Return div u, curl u and |u| of the elements, (E,)."""
        u = read_slab(snapshot.path, "displacement")[:, :2][self._cells]
        gradient = np.swapaxes(u, 1, 2) @ self._G
        return (
            gradient[:, 0, 0] + gradient[:, 1, 1],
            gradient[:, 1, 0] - gradient[:, 0, 1],
            np.linalg.norm(u.mean(axis=1), axis=1),
        )

    @property
    def depth(self):
        """Return the distance of the elements from the nearest side of the block, (E,) [m]."""
        x, y = self.centres.T
        return np.minimum.reduce([x, WIDTH - x, y, HEIGHT - y])


def core_table(fronts):
    """Return rows: what is there in the part of the block that no wave from a side can have
    reached.
    """
    yield "| t [s] | c_P t [m] | volume strain | rotation (beyond 64.5 m/s t) | displacement |"
    yield "|---" * 5 + "|"
    for snapshot in fronts.snapshots:
        if not 0 < snapshot.time < 0.045 or round(snapshot.time / 8e-3, 6) % 1:
            continue
        strain, rotation, motion = fronts.strain_rotation_motion(snapshot)
        core = fronts.depth > C_P * snapshot.time
        slow_core = fronts.depth > C_S[1] * snapshot.time
        shares = [
            100 * np.abs(field[where]).max() / np.abs(field).max()
            for field, where in ((strain, core), (rotation, slow_core), (motion, core))
        ]
        yield (
            f"| {snapshot.time:.3f} | {C_P * snapshot.time:.2f} | "
            + " | ".join(f"{share:.2f} %" for share in shares)
            + " |"
        )


def shear_speed(fronts):
    """Return the speed [m/s] of the peak of rotation on rays 35 to 55 degrees below the surface,
    and the times used [s].
    """
    x = fronts.centres[:, 0] - CENTRE
    y = HEIGHT - fronts.centres[:, 1]
    radius = np.hypot(x, y)
    angle = np.degrees(np.arctan2(y, x))
    width = 0.35  # [m]
    edges = np.arange(0.5, 9.0, width)
    bins = np.where((angle > 35) & (angle < 55), np.digitize(radius, edges), 0)
    counts = np.maximum(np.bincount(bins, minlength=len(edges) + 1), 1)
    found = []
    for snapshot in fronts.snapshots:
        if 0.059 < snapshot.time < 0.109:
            rotation = fronts.strain_rotation_motion(snapshot)[1]
            profile = (np.bincount(bins, rotation, len(edges) + 1) / counts)[1:-1]
            i = int(np.abs(profile).argmax())
            a, b, c = profile[i - 1 : i + 2]
            found.append(
                (snapshot.time, edges[i] + width * (0.5 + 0.5 * (a - c) / (a - 2 * b + c)))
            )
    t, r = np.array(found).T
    return np.polyfit(t, r, 1)[0], t


def rows(lines):
    """Return the lines of a table as text."""
    return "\n".join(lines)


def write():
    """Write the document from the levels that have been run."""
    pulse, low = ([level for level in group if summary_of(level)] for group in (PULSE, LOW))
    fronts = Fronts(finest_level(pulse))
    speed, times = shear_speed(fronts)
    DOCUMENT.write_text(
        TEXT.format(
            peaks=rows(peaks_table(pulse)),
            energy=rows(energy_table(pulse)),
            core=rows(core_table(fronts)),
            coupling=rows(coupling_table(low)),
            exceeded="; ".join(
                f"{level.label.replace(' |', ',')}"
                for level in low
                if summary_of(level)["coupling_iterations"]["max"] > 15
            )
            or "none",
            speed=speed,
            first=times[0],
            last=times[-1],
            low_end=LOW[0].end,
            finest=finest_level(pulse).label.replace(" |", ","),
        ),
        encoding="utf-8",
    )


TEXT = """# Refinement of the pulse scenes

Written by `scripts/run study pulse2d` (do not edit by hand):

    scripts/run study pulse2d run all && scripts/run study pulse2d write

h and Δt are those of the shipped scenes, which have T6. Wall times are those
of one core of a machine that others used at the same time: orders of magnitude.

## pulse2d: peaks

Value of largest magnitude within 0.2 s, in parentheses its difference from the finest run
({finest}).

{peaks}

These rows and those of the energy date from before the undrained term got its present weights; with
them the shipped scene (T6, h, Δt) gives -1.2596 mm, 24.030 kPa and -7.6125 mm, at most 0.01 % away.

## pulse2d: energy

In % of the external work at the end, per metre of thickness. The error is what is missing in the
balance, over the largest external work: the tolerance of the coupling (1e-6). Dissipation by
stabilization and time scheme is numerical, it falls with h and Δt.

{energy}

## pulse2d: physical limits

The constituents are incompressible, so the pressure answers the load everywhere at once, and its
gradient moves both phases. In two dimensions it is therefore not the displacement that stands still
before the P front, but the *volume strain* of the skeleton, which obeys a damped wave equation of
speed c_P = 85.07 m/s, and its rotation (at most 64.5 m/s). In one dimension there is nothing but
volume strain, and the solid does stand still (`column_step`). The motion ahead of the front does
not leave the sides free of stress, so that waves start from all sides at once; what must be at rest
is the core of the block, farther from every side than a wave can have come. Largest magnitude in
the core over the largest magnitude anywhere, finest run:

{core}

Shear wave: the peak of the rotation runs along the rays 35° to 55° below the surface, away from the
middle of the strip, with **{speed:.1f} m/s** (straight line through t = {first:.3f} … {last:.3f}
s). The limits are 57.8 m/s, the fluid moves along, and 64.5 m/s, it does not.

## pulse2d_low_permeability: coupling iterations

k_f = 1e-5 m/s, Aitken, tolerance 1e-6, until t = {low_end:g} s (the pulse ends at 0.04 s).
Roughness is the largest norm of the difference between nodal pressures and their local averages
over the largest norm of the pressures in the run (`oscillation_indicator` of the summary, interior
nodes): mostly the layer of √(c_v t) = 0.03 m under the drained strip, which no mesh here resolves.
A checkerboard fills the block, so the next column leaves out the upper metre.

{coupling}

More than 15 iterations in some step: {exceeded}.

The undrained stabilization weighs the increment of the pressure with α² times the larger of 1/(4
E_c/h² + c_a ρ) and 0.3 h²/(4 E_c). Without the second, which does not fade where Δt < h/c_P, the
roughness below 1 m grew as the step shrank, to 0.46 (T3, 2 h, Δt/4), and a step took up to 20
iterations (T6).
"""


def main():
    """Run the named levels (or all), or write the document."""
    parser = command_line.parser("study pulse2d", __doc__)
    parser.add_argument("what", choices=("run", "write"))
    parser.add_argument("levels", nargs="*", metavar="LEVEL", help=", ".join(LEVELS))
    given = parser.parse_args()
    if given.what == "write":
        return write()
    levels = list(LEVELS) if given.levels == ["all"] else given.levels
    if not levels or not set(levels) <= set(LEVELS):
        parser.error(f"expected levels to run, of {', '.join(LEVELS)}")
    for name in levels:
        run_level(LEVELS[name])


if __name__ == "__main__":
    main()
