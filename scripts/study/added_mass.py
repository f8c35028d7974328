"""Count the coupling iterations of fluid-structure interaction over scheme, accelerator and added
mass.

Writes docs/studies/added_mass.csv and .md.  CHECKPOINT : a developed state of hron_turek_fsi3,
written by a run of it; without one the rows of the ring only.  Rows that are in the table already
are kept: a study that was stopped goes on.
"""

import time
from dataclasses import dataclass, replace
from itertools import product
from math import pi
from pathlib import Path

import command_line
import numpy as np

from porofsi_petsc import load_scene
from porofsi_petsc.clock import first_order, second_order
from porofsi_petsc.coupling.robin import STIFFER, solid_impedance
from porofsi_petsc.exact import Ring
from porofsi_petsc.output.checkpoint import open_checkpoint, read_arrays
from porofsi_petsc.output.files import write_text
from porofsi_petsc.phases.coupling_data import Rates
from porofsi_petsc.studies.table import Table, markdown, sweep
from porofsi_petsc.studies.trial import attempt

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "docs" / "studies"
RING = Ring(0.95, 1.05, 1.5, 1e6 * 0.3 / (1.3 * 0.4), 1e6 / 2.6, 1000.0)  # as in ring_added_mass
LAYER = (RING.outer**2 - RING.inner**2) / (
    2 * RING.outer
)  # volume of the ring over area of the interface, H [m]
DENSITIES = (14.0, 140.0, 1400.0)  # of the fluid around the ring [kg/m³]
RATIOS = (10.0, 1.0, 0.1)  # ρ_s/ρ_f of the beam in the channel, ρ_f = 1000 kg/m³
ACCELERATORS = ("none", "constant", "aitken", "anderson", "iqn_ils")
PAIRS = ("dirichlet_neumann", "robin_neumann", "robin_robin", "neumann_dirichlet")
MONOLITHIC = ("quasi_direct", "direct")
STEPS = 20
CHANNEL, CHANNEL_STEP = "hron_turek_fsi3", 0.004  # scene, step [s]
KEYS = ("problem", "added_mass", "scheme", "accelerator")
VALUES = ("mean", "max", "rate", "seconds", "failure")
# ring_added_mass without its rigid wall: p = 0 at 1.5 m, φ ~ r² - b⁴/r² instead of r² + b⁴/r²
OPEN_RING = (
    "boundary.5={on = 'wall'}",
    (
        "initial.fluid_velocity.x='1.8e-4/(1.05 + 1.5**4/1.05**3)*(x + 1.5**4*(x*x - 3*y*y)*x/(x*x"
        " + y*y)**3)'"
    ),
    (
        "initial.fluid_velocity.y='1.8e-4/(1.05 + 1.5**4/1.05**3)*(-y + 1.5**4*(3*x*x - y*y)*y/(x*x"
        " + y*y)**3)'"
    ),
)


@dataclass(frozen=True)
class Case:
    """Twenty steps; problem : "ring", "open ring" or "channel"; added_mass : ρ_f of a ring [kg/m³],
    ρ_s/ρ_f of the channel.
    """

    problem: str
    added_mass: float
    scheme: str
    accelerator: str

    @property
    def keys(self):
        """Return what names the case in the table."""
        return {key: getattr(self, key) for key in KEYS}

    @property
    def label(self):
        """Return a few words for the progress."""
        return ", ".join(map(str, self.keys.values()))

    def scene(self):
        """Return the scene of the case."""
        coupling = [f"coupling.scheme={self.scheme}"]
        if self.scheme in PAIRS:
            coupling = ["coupling.scheme=partitioned", f"coupling.interface={self.scheme}"]
            coupling += [f"coupling.accelerator={self.accelerator}"]
        name, changes = self._channel() if self.problem == "channel" else self._ring()
        return load_scene(name, [*coupling, *changes, "expect=[]"])

    def _ring(self):
        step = ring_step(self.added_mass)
        time = [
            f"time.step={step!r}",
            f"time.end={STEPS * step!r}",
            f"material.1.fluid.density={self.added_mass}",
        ]
        return "ring_added_mass", [*time, *(OPEN_RING if self.problem == "open ring" else ())]

    def _channel(self):
        inflow = (  # the clock starts anew, the flow is developed
            "boundary.0.velocity.x='1.5*2*4*y*(0.41 - y)/0.41**2'"
        )
        time = [f"time.step={CHANNEL_STEP}", f"time.end={STEPS * CHANNEL_STEP}"]
        return CHANNEL, [inflow, *time, f"material.1.solid.density={1000 * self.added_mass}"]


def ring_step(density):
    """Return 1/100 of the period of the ring beside the rigid wall [s]."""
    return 2 * pi / RING.frequency(density) / 100


def all_cases(checkpoint):
    """Return the cases: the closed ring has no pressure level under Dirichlet-Neumann, the channel
    is not run without a state.

    In the channel the other conditions have the best accelerator only.
    """
    rings = [("open ring", density, PAIRS) for density in DENSITIES] + [
        ("ring", density, PAIRS[1:]) for density in DENSITIES
    ]
    cases = []
    for problem, added_mass, pairs in rings:
        cases += [
            Case(problem, added_mass, pair, accelerator)
            for pair, accelerator in product(pairs, ACCELERATORS)
        ]
        cases += [Case(problem, added_mass, scheme, "") for scheme in MONOLITHIC]
    for ratio in RATIOS if checkpoint else ():
        cases += [Case("channel", ratio, PAIRS[0], accelerator) for accelerator in ACCELERATORS]
        cases += [Case("channel", ratio, pair, ACCELERATORS[-1]) for pair in PAIRS[1:]]
        cases += [Case("channel", ratio, scheme, "") for scheme in MONOLITHIC]
    return cases


class Runner:
    """Runs cases; those of the channel start from a checkpoint, whose material may be another
    one.
    """

    def __init__(self, checkpoint):
        self._checkpoint = checkpoint

    def __call__(self, case):
        """Return the columns of a case; rate : median of the factors by which an iteration changed
        the residual.
        """
        histories = []

        def watcher(coupling):
            if case.problem == "channel":
                self._start(coupling)
            histories.append(coupling.convergence)
            return lambda clock, coupling, energy: None

        began = time.process_time()
        outcome = attempt(case.scene(), watcher)
        seconds = time.process_time() - began
        errors = [max(step.values()) for step in (histories[0].history if histories else [])]
        rate = (
            float(np.median(np.divide(errors[1:], errors[:-1])))
            if len(errors) > 1
            else float("nan")
        )
        return {
            "mean": outcome.mean,
            "max": outcome.largest,
            "rate": rate,
            "seconds": seconds,
            "failure": outcome.failure,
        }

    def _start(self, coupling):
        """Load fields and rates of the checkpoint: the density of the beam changes in this instant;
        tangents are new.
        """
        mesh = coupling.solid.mesh
        header = open_checkpoint(self._checkpoint, mesh.comm)
        arrays = read_arrays(self._checkpoint, header, mesh)
        memory = header["coupling"] | {"columns": ()}
        for phase in ("solid", "fluid"):
            memory[phase]["rates"] = None
        coupling.load_state(arrays, memory, (None, None), None)


# -- the formulas ----------------------------------------------------------------------------------


def waves(density):
    """Return M c_a + K, m_closed and m_open per area of the ring's modes n = 0, 2 … 32, and the
    rates of its scheme.

    The mass M and the stiffness K of a mode follow from its exact frequencies dry and with a fluid;
    m is its added length. n = 0: the thin ring, M = ρ_s H and K = E' H/r² at the mean radius r; a
    closed fluid has no such motion, m is infinite.
    """
    scheme = second_order(1.0, ring_step(density))
    flow = first_order(1.0, ring_step(density))
    modulus = 4 * RING.mu * (RING.lam + RING.mu) / (RING.lam + 2 * RING.mu)
    breathing = LAYER * (RING.density * scheme.c_a + modulus / ((RING.inner + RING.outer) / 2) ** 2)
    found = [(breathing, np.inf, RING.outer * np.log(RING.wall / RING.outer))]
    for mode in range(2, 33, 2):
        ring = replace(RING, mode=mode)
        dry = ring.frequency() ** 2
        wet = ring.frequency(density) ** 2
        mass = density * ring.added_length * wet / (dry - wet)
        ratio = (ring.outer / ring.wall) ** (2 * mode)
        found.append(
            (
                mass * (scheme.c_a + dry),
                ring.added_length,
                ring.outer / mode * (1 - ratio) / (1 + ratio),
            )
        )
    return np.array(found).T, Rates(flow.c_v, scheme.c_v, scheme.c_a)


def predicted(case):
    """Return the largest error factor of the modes without acceleration, None where there is no
    formula.
    """
    if case.problem == "channel" or case.accelerator != "none":
        return None
    (solid, closed, free), rates = waves(case.added_mass)
    S_s = solid / rates.c_v
    S_f = case.added_mass * (free if case.problem == "open ring" else closed) * rates.c_f
    alpha = STIFFER * solid_impedance(RING.lam + 2 * RING.mu, RING.density, LAYER, rates)
    factors = {
        "dirichlet_neumann": S_f / S_s,
        "robin_neumann": np.abs(S_s - alpha) / S_s / (1 + alpha / S_f),
    }
    return float(factors[case.scheme].max()) if case.scheme in factors else None


# -- the report ------------------------------------------------------------------------------------


def iterations(row):
    """Return mean/largest of a row, or why it failed."""
    if not row["failure"]:
        return f"{float(row['mean']):.1f}/{row['max']}"
    return (
        "inverted"
        if "inverted" in row["failure"]
        else "not in 60"
        if "did not converge" in row["failure"]
        else "failed"
    )


def table_of(problem, added_mass, rows):
    """Return the lines of one table: schemes down, accelerators across."""
    rows = [
        row for row in rows if (row["problem"], row["added_mass"]) == (problem, f"{added_mass:g}")
    ]
    found = {(row["scheme"], row["accelerator"]): row for row in rows}
    body = []
    for scheme in [*PAIRS, *MONOLITHIC]:
        if scheme in MONOLITHIC and (scheme, "") in found:
            body.append([f"`{scheme}`", iterations(found[scheme, ""]), *[""] * 4, "", ""])
        elif any(name == scheme for name, _ in found):
            factor = predicted(Case(problem, added_mass, scheme, "none"))
            plain = found.get((scheme, "none"))
            rate = plain["rate"] if plain and not plain["failure"] else ""
            cells = [
                iterations(found[scheme, name]) if (scheme, name) in found else ""
                for name in ACCELERATORS
            ]
            body.append([f"`{scheme}`", *cells, "" if factor is None else f"{factor:.3f}", rate])
    return (
        markdown(["", *ACCELERATORS, "factor by formula", "measured"], body) if body else "not run"
    )


def report(rows):
    """Return the markdown summary."""
    parts = [TEXT]
    for density in DENSITIES:
        step = ring_step(density)
        parts += [f"## Ring, ρ_f = {density:g} kg/m³, Δt = {step:.4f} s", "Open at 1.5 m:"]
        parts += [
            table_of("open ring", density, rows),
            "Rigid wall at 1.5 m:",
            table_of("ring", density, rows),
        ]
    if any(row["problem"] == "channel" for row in rows):
        parts += [CHANNEL_TEXT]
        for ratio in RATIOS:
            parts += [
                f"## Beam in the channel, ρ_s/ρ_f = {ratio:g}",
                table_of("channel", ratio, rows),
            ]
    return "\n\n".join(parts) + "\n"


TEXT = """# Coupling iterations under added mass

Written by `scripts/run study added_mass` (do not edit by hand); every case is a row of
`added_mass.csv`.

Iterations of a step, mean/largest over twenty steps, tolerance 1e-6 on all balances, at most 60;
"inverted": an element was turned inside out. "constant" has the factor that Dirichlet-Neumann
starts with, else 0.5; all others start with it, or with 1. Factor: how an iteration without
accelerator changes the error, by formula the largest of the modes cos nθ, n = 0, 2 … 32, measured
the median of the last step. What it means: [../added_mass.md](../added_mass.md).

The step is 1/100 of the exact period beside the rigid wall, ρ∞ = 1. A closed fluid cannot follow n
= 0, however light it is: there the factor of Robin-Neumann is |1 - α/S_s|. Neumann-Dirichlet needs
a solid that is lighter than the fluid."""

CHANNEL_TEXT = """The channel is `hron_turek_fsi3` from a developed state; at the start the density
of the beam changes, every other field is kept."""


def main():
    """Run the cases that are missing and write the tables."""
    parser = command_line.parser("study added_mass", __doc__)
    parser.add_argument("checkpoint", nargs="?", type=Path, metavar="CHECKPOINT")
    checkpoint = parser.parse_args().checkpoint
    table = Table(FOLDER / "added_mass.csv", KEYS, VALUES)
    sweep(table, all_cases(checkpoint), Runner(checkpoint))
    rows = [row for case in all_cases(True) if (row := table.find(case.keys))]
    write_text(FOLDER / "added_mass.md", report(rows))
    print(f"table: {FOLDER / 'added_mass.md'}")


if __name__ == "__main__":
    main()
