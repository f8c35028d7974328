"""Measure what leaving out a term of the model saves and write docs/model_terms.md.

Takes some minutes: every case runs once, one after the other, on one core.
"""

import tempfile
from pathlib import Path

import command_line

from porofsi_petsc import load_scene, run
from porofsi_petsc.config.sections import Limits

DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "model_terms.md"
QUIET = ("output={}", "figures={}", "expect=[]")
EVERYTHING = (
    "model.convection=true",
    "model.viscosity=true",
    "model.porosity=variable",
    "material.0.fluid.viscosity=1e-3",
)
LIMITS = tuple(f"limits.{name}=report" for name in Limits.model_fields)
SCENES = {
    "pulse2d": ("mesh.x.cells=[12, 2, 12]", "mesh.y.cells=[10]", "time.end=0.03"),
    "pulse3d": ("mesh.x.cells=[2, 5]", "mesh.y.cells=[2, 5]", "mesh.z.cells=[6]", "time.end=0.02"),
}
FIXED = ("model.moving_mesh=false", "model.porosity=constant")
QUASI_STATIC = ("model.solid_inertia=false", "model.fluid_inertia=false")
LINEAR = (
    *FIXED,
    "model.convection=false",
    "model.viscosity=false",
    "material.0.solid.law=linear_elastic",
)
CASES = {
    "nothing": (),
    "convection": ("model.convection=false",),
    "viscosity": ("model.viscosity=false",),
    "variable porosity": ("model.porosity=constant",),
    "moving mesh, with it variable porosity": FIXED,
    "inertia of the fluid": ("model.fluid_inertia=false",),
    "inertia of both": QUASI_STATIC,
    "convection, viscosity, moving mesh": (
        *FIXED,
        "model.convection=false",
        "model.viscosity=false",
    ),
    "these and large strain: a linear problem": LINEAR,
    "all of it": (*LINEAR, *QUASI_STATIC),
}
HEAD = """# What leaving out a term saves

Written by `scripts/run bench model_terms` (do not edit by hand):

    scripts/run bench model_terms

One run per row on one core of a machine that others used at the same time: wall time per step
without set-up and output, and its ratio to the first row, where every term is solved: inertia of
both phases, convection, viscosity, moving mesh, porosity n_s0/J, neo-Hookean skeleton. What is left
out is measured in every step; the times contain that. Sweeps: coupling iterations per step.
Matrices: assembled for both phases in the run. Differences of a tenth are the noise of the machine.
The tangents are kept over steps here, so that a term costs its residual; without any inertia the
coupling takes more sweeps.
"""
TABLE = """
## {scene}: {elements} elements, {nodes} nodes, {steps} steps

| left out | time per step [ms] | ratio | sweeps per step | matrices |
|---|---|---|---|---|
"""


def measure(scene, overrides):
    """Return the summary of a run that leaves nothing behind."""
    with tempfile.TemporaryDirectory() as folder:
        return run(
            load_scene(scene, (*SCENES[scene], *QUIET, *EVERYTHING, *LIMITS, *overrides)),
            folder,
            quiet=True,
            force=True,
        )


def seconds_per_step(summary):
    """Return the wall time of a step without set-up and output [s]."""
    time = summary["wall_time"]
    return (time["total"] - time["setup"] - time["output"]) / summary["steps"]


def table(scene):
    """Return the section of a scene."""
    summaries = {name: measure(scene, overrides) for name, overrides in CASES.items()}
    first = summaries["nothing"]
    rows = []
    for name, summary in summaries.items():
        time = seconds_per_step(summary)
        matrices = summary["assemblies"]["fluid"] + summary["assemblies"]["solid"]
        sweeps = summary["coupling_iterations"]["mean"]
        rows.append(
            f"| {name} | {1e3 * time:.0f} | {time / seconds_per_step(first):.2f} | {sweeps:.1f} |"
            f" {matrices} |\n"
        )
    return TABLE.format(
        scene=scene, **{key: first[key] for key in ("elements", "nodes", "steps")}
    ) + "".join(rows)


if __name__ == "__main__":
    command_line.parser("bench model_terms", __doc__).parse_args()
    DOCUMENT.write_text(HEAD + "".join(table(scene) for scene in SCENES), encoding="utf-8")
