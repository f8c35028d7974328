"""summary.json: what a run did, in numbers; every key is documented here and nowhere else."""

import json
import os
from pathlib import Path
from typing import Any

from .files import to_json, write_text

NAME = "summary.json"

SUMMARY_KEYS = {
    "scene": "name of the scene (file name without suffix)",
    "title": "title of the scene",
    "version": "version of porofsi_petsc",
    "petsc_version": "version of PETSc",
    "python_version": "version of Python",
    "numpy_version": "version of NumPy",
    "ranks": "number of MPI ranks",
    "exit_code": (
        "0 done, 1 internal error, 2 wrong input, 3 not converged, 4 stopped early, 5 an [[expect]]"
        " failed"
    ),
    "dimension": "space dimension, 2 or 3",
    "elements": "number of elements",
    "nodes": "number of nodes",
    "unknowns.displacement": "number of displacement unknowns",
    "unknowns.fluid_velocity": "number of fluid velocity unknowns",
    "unknowns.pressure": "number of pressure unknowns",
    "unknowns.auxiliary": (
        "number of unknowns of the auxiliary field of the coupling term, 0 without it"
    ),
    "steps": "number of accepted time steps, those before a restart included",
    "step_cuts": (
        "number of times a step was repeated with a smaller step size because the coupling failed"
    ),
    "fall_backs.accelerator": (
        "number of steps whose coupling converged with another accelerator only"
    ),
    "fall_backs.tangents": (
        "number of steps whose coupling converged with new tangents in every sweep only"
    ),
    "fall_backs.gmres": (
        "number of linear solves on whose indefinite matrix CG broke down, and which GMRES did"
    ),
    "load_parts": (
        "number of parts of the load over which steady steps were continued that did not converge"
        " at once"
    ),
    "steps_rejected": (
        "number of times a step was repeated with a smaller step size because of"
        " time.error_tolerance"
    ),
    "time_end": "last computed time [s]",
    "wall_time.setup": (
        "time to distribute the mesh and to build the phases [s], maximum over the ranks like all"
        " wall times"
    ),
    "wall_time.assembly": "time in element matrices and their insertion [s]",
    "wall_time.factorization": "time in factorizations and preconditioner set-ups [s]",
    "wall_time.solve": "time in the linear solvers without their set-up [s]",
    "wall_time.residual": "time in residuals [s]",
    "wall_time.mesh": "time in the motion of a free fluid's mesh, its solves included [s]",
    "wall_time.output": "time in histories, fields and checkpoints [s]",
    "wall_time.total": "time of the whole run [s]",
    "coupling_iterations.mean": "mean number of coupling iterations of a step",
    "coupling_iterations.max": "largest number of coupling iterations of a step",
    "coupling_iterations.total": "sum of the coupling iterations",
    "coupling_iterations.failed": "sum of those of attempts that failed, not among the others",
    "linear_iterations.fluid.mean": "mean number of iterations of a linear solve of the fluid",
    "linear_iterations.fluid.max": "largest number of iterations of a linear solve of the fluid",
    "linear_iterations.solid.mean": "mean number of iterations of a linear solve of the solid",
    "linear_iterations.solid.max": "largest number of iterations of a linear solve of the solid",
    "linear_iterations.mesh.mean": (
        "mean number of iterations of a linear solve of the mesh motion, 0 without it"
    ),
    "linear_iterations.mesh.max": (
        "largest number of iterations of a linear solve of the mesh motion"
    ),
    "linear_iterations.monolithic.mean": (
        "mean number of iterations of a linear solve of the monolithic scheme, 0 without it"
    ),
    "linear_iterations.monolithic.max": (
        "largest number of iterations of a linear solve of the monolithic scheme"
    ),
    "assemblies.fluid": "number of matrices assembled for the fluid",
    "assemblies.solid": "number of matrices assembled for the solid",
    "assemblies.mesh": "number of matrices assembled for the mesh motion",
    "assemblies.monolithic": "number of matrices assembled for the monolithic scheme",
    "factorizations.fluid": "number of factorizations or preconditioner set-ups of the fluid",
    "factorizations.solid": "number of factorizations or preconditioner set-ups of the solid",
    "factorizations.mesh": "number of factorizations of the mesh motion",
    "factorizations.monolithic": "number of factorizations of the monolithic scheme",
    "mesh_motion.smallest_volume_ratio": (
        "least ratio of the volume of a free fluid's moving mesh to that of the reference"
        " configuration, over all quadrature points and the ends of all steps [-]"
    ),
    "mesh_motion.worst_shape": (
        "least shape of an element of that mesh, in the reference configuration and at the ends of"
        " all steps: d det(M)^(1/d)/tr M, M the second moments of its vertices, 1 for a regular"
        " one, 0 for a flat one [-]"
    ),
    "energy.external_work": (
        "work of the loads since the start [J, in 2-D per metre of thickness, around an axis of the"
        " whole body, like all energies]"
    ),
    "energy.kinetic": "kinetic energy of both phases at the end [J]",
    "energy.elastic": "elastic energy of the skeleton at the end [J]",
    "energy.drag_dissipation": "dissipation of the drag between the phases since the start [J]",
    "energy.viscous_dissipation": "viscous dissipation of the fluid since the start [J]",
    "energy.stabilization_dissipation": (
        "dissipation of the stabilization terms since the start [J]"
    ),
    "energy.time_scheme_dissipation": (
        "dissipation of the time integration since the start, and what the branches of viscoelastic"
        " solids store and dissipate, and plastic flow [J]"
    ),
    "energy.balance_error": "external work minus change of all energies minus all dissipations [J]",
    "energy.balance_error_relative": "balance error over the largest external work so far [-]",
    "energy.stabilization_share": (
        "dissipation of the stabilization terms over the largest external work so far [-]"
    ),
    "peak_memory_bytes.max": "largest resident memory of a rank [bytes]",
    "peak_memory_bytes.sum": "resident memory of all ranks at their peaks [bytes]",
    "modelled": "list of the terms that were computed, at the end of the run",
    "switched": (
        'one record per "auto" term that was switched on: term, step and t [s] of the state before'
        " it, measure with its size in the step that was done again and its bound"
    ),
    "neglected": (
        "terms left out: name -> value (size met in the run), bound (limit of the scene or null),"
        " meaning"
    ),
    "oscillation_indicator": (
        "norm of the pressure minus its average over the elements of each node (interior nodes),"
        " over the norm of the pressure, each the largest of the run [-]"
    ),
    "volume_error": (
        "volume that a free fluid has made, by what its solution leaves of div v = 0, over what"
        " flowed through its boundary, both since the start; 0 where it is less than 1e-6 of the"
        " fluid [-]"
    ),
    "errors": (
        "one record per time of [reference] and for the end: at (asked for) and t (end of the step)"
        " [s], relative errors u or v (over the exact one) and p (over its size under the sudden"
        " load, of a flow ρU²) in L2 over the mesh; empty without [reference]"
    ),
    "period": (
        "null without output.period_of or a full period of it; else start and end of the last one"
        " [s], change of the amplitude of that column since the period before [-], columns: name ->"
        " mean (max + min)/2 and amplitude (max - min)/2 in it [unit of the column], frequency of"
        " its own crossings of the mean [Hz], null where it is steady"
    ),
    "expectations": (
        "one record per [[expect]]: quantity, at [s], since [s] or statistic, value (computed),"
        " reference (expected), error (relative), tolerance, passed (null when skipped), reason"
        " (why skipped), source"
    ),
    "files": "files written, relative to the result directory",
}


def check_summary(summary: dict[str, Any]) -> None:
    """Raise KeyError when a documented key is missing or a present one is not documented."""
    present = set(_flat_keys(summary))
    missing = SUMMARY_KEYS.keys() - present
    unknown = present - SUMMARY_KEYS.keys()
    if missing or unknown:
        raise KeyError(f"summary: missing {sorted(missing)}, undocumented {sorted(unknown)}")


def write_summary(directory: str | os.PathLike[str], summary: dict[str, Any]) -> None:
    """Replace summary.json, keys in the order of SUMMARY_KEYS, on the calling rank.  Raises
    KeyError as check_summary.
    """
    check_summary(summary)
    write_text(Path(directory) / NAME, to_json(_sorted(summary), indent=2) + "\n")


def read_summary(directory: str | os.PathLike[str]) -> dict[str, Any] | None:
    """Return the summary in a directory, None where there is none with the keys of this version."""
    try:
        summary = json.loads((Path(directory) / NAME).read_text(encoding="utf-8"))
        check_summary(summary)
    except (OSError, ValueError, KeyError, AttributeError, RecursionError):
        return None
    return summary


def summary_documentation() -> str:
    """Return docs/summary.md."""
    rows = [f"| `{key}` | {text} |" for key, text in SUMMARY_KEYS.items()]
    return "\n".join(
        [
            "# Keys of summary.json",
            "",
            (
                "A dot separates the levels. A number that a run does not have (a phase without"
                " matrices, say) is `null`."
            ),
            "",
            "| key | meaning |",
            "|---|---|",
            *rows,
            "",
        ]
    )


def _flat_keys(summary, prefix=""):
    for key, value in summary.items():
        if isinstance(value, dict) and prefix + key not in SUMMARY_KEYS:
            yield from _flat_keys(value, f"{prefix}{key}.")
        else:
            yield prefix + key


def _sorted(summary, prefix=""):
    order = list(SUMMARY_KEYS)

    def position(key):
        return next(
            i
            for i, name in enumerate(order)
            if name == prefix + key or name.startswith(f"{prefix}{key}.")
        )

    def value_of(key):
        value = summary[key]
        nested = isinstance(value, dict) and prefix + key not in SUMMARY_KEYS
        return _sorted(value, f"{prefix}{key}.") if nested else value

    return {key: value_of(key) for key in sorted(summary, key=position)}
