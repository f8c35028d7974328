"""The summary of a run."""

from __future__ import annotations

import platform
import resource
from typing import TYPE_CHECKING, Any

import numpy as np
from petsc4py import PETSc

from .. import __version__
from ..config import Scene
from ..config.sections import Model
from ..coupling.protocols import Fluid, Solid

if TYPE_CHECKING:
    from .simulation import Simulation

BLOCKS = ("fluid", "solid", "mesh", "monolithic")


def summarize(
    simulation: Simulation, judgement: dict[str, Any], files: list[str], exit_code: int
) -> dict[str, Any]:
    """Return the content of summary.json (keys: `output.summary.SUMMARY_KEYS`); collective.

    judgement : dict with period and expectations, what the files of the run say of its result
    """
    scene = simulation.scene
    coupling = simulation.coupling
    loop = simulation.loop
    measures = simulation.measures
    mesh = coupling.solid.mesh
    comm = coupling.solid.mesh.comm
    blocks = coupling.blocks
    iterations = np.array(loop.iterations or [0])
    return {
        "scene": scene.name,
        "title": scene.title,
        "version": __version__,
        "petsc_version": ".".join(map(str, PETSc.Sys.getVersion())),
        "python_version": platform.python_version(),
        "numpy_version": np.__version__,
        "ranks": comm.size,
        "exit_code": exit_code,
        "dimension": mesh.dim,
        "elements": mesh.n_cells_global,
        "nodes": mesh.n_global,
        "unknowns": unknowns(coupling.solid, coupling.fluid),
        "steps": loop.clock.step,
        "step_cuts": loop.clock.cuts,
        "fall_backs": loop.clock.fall_backs
        | {"gmres": sum(solver.indefinite for solver in coupling.solvers)},
        "load_parts": loop.clock.load_parts,
        "steps_rejected": loop.control.rejections if loop.control else 0,
        "time_end": loop.clock.t,
        "wall_time": _wall_time(comm, simulation.stopwatch, coupling.solvers),
        "coupling_iterations": _coupling_iterations(iterations, coupling.failed),
        "linear_iterations": {name: _linear_iterations(blocks.get(name)) for name in BLOCKS},
        "assemblies": {name: blocks[name].assemblies if name in blocks else 0 for name in BLOCKS},
        "factorizations": {name: _factorizations(blocks.get(name)) for name in BLOCKS},
        "mesh_motion": _mesh_motion(getattr(coupling, "motion", None)),
        "energy": simulation.energy.report(),
        "peak_memory_bytes": _peak_memory(comm),
        "modelled": modelled(scene, loop.model),
        "switched": loop.auto.switched if loop.auto else [],
        "neglected": measures.neglected(),
        "oscillation_indicator": measures.oscillation_indicator,
        "volume_error": measures.volume_error,
        "errors": measures.comparison.errors() if measures.comparison else [],
        **judgement,
        "files": files,
    }


def unknowns(solid: Solid, fluid: Fluid) -> dict[str, int]:
    """Return field -> number of unknowns."""
    d = fluid.mesh.dim
    n = fluid.domain.n_nodes
    auxiliary = n * (fluid.components - d - 1)
    return {
        "displacement": solid.domain.n_nodes * d,
        "fluid_velocity": n * d,
        "pressure": n,
        "auxiliary": auxiliary,
    }


def _wall_time(comm, stopwatch, solvers):
    seconds = {
        name: stopwatch.seconds[name]
        for name in ("setup", "assembly", "residual", "mesh", "output")
    }
    seconds["factorization"] = sum(solver.setup_time for solver in solvers)
    seconds["solve"] = sum(solver.solve_time for solver in solvers)
    seconds["total"] = stopwatch.total
    everyone = comm.allgather(seconds)
    return {name: max(one[name] for one in everyone) for name in seconds}


def _coupling_iterations(accepted, failed):
    return {
        "mean": accepted.mean(),
        "max": accepted.max(),
        "total": accepted.sum(),
        "failed": failed,
    }


def _linear_iterations(block):
    if block is None or block.solver is None:
        return {"mean": 0.0, "max": 0}
    return {"mean": block.solver.iterations_mean, "max": block.solver.iterations_max}


def _factorizations(block):
    return 0 if block is None or block.solver is None else block.solver.factorizations


def _mesh_motion(motion):
    moves = motion is not None and motion.moves
    return {
        "smallest_volume_ratio": motion.smallest_ratio if moves else None,
        "worst_shape": motion.worst_shape if moves else None,
    }


def _peak_memory(comm):
    everyone = comm.allgather(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024)
    return {"max": max(everyone), "sum": sum(everyone)}


def modelled(scene: Scene, model: Model) -> list[str]:
    """Return the names of the terms that a [model] solves, the laws and the stabilization."""
    terms = [
        name
        for name in ("solid_inertia", "fluid_inertia", "convection", "viscosity", "moving_mesh")
        if getattr(model, name)
    ]
    terms += [f"{model.porosity} porosity"] if scene.is_porous else []
    terms += sorted({entry.solid.law for entry in scene.material if entry.solid})
    stabilized = ["pspg", "supg", "lsic"] if scene.phases[1] else []
    stabilized += ["undrained"] if any(entry.kind == "porous" for entry in scene.material) else []
    return terms + [name for name in stabilized if getattr(scene.stabilization, name)]
