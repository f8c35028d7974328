"""What a checkpoint holds of a simulation; `restart` gives it back."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ..config import scene_to_toml, table_contents
from ..output.checkpoint import NAME, write_checkpoint
from .restart import PLACED

if TYPE_CHECKING:
    from .simulation import Simulation


def write(simulation: Simulation, directory: Path) -> Path:
    """Write the accepted state of a simulation and return the path of the file (collective)."""
    loop = simulation.loop
    coupling = simulation.coupling
    scene = simulation.scene
    control = loop.control
    with simulation.stopwatch.measure("output"):
        header = {
            "scene_name": scene.name,
            "scene": scene_to_toml(scene),
            "tables": table_contents(scene),
            "stage": simulation.stage,
            "step": loop.clock.step,
            "time": loop.clock.t,
            "clock": loop.clock.state(),
            "coupling": coupling.memory(),
            "energy": simulation.energy.state(),
            "measures": simulation.measures.state(),
            "volumes": simulation.quantities.memory(),
            "iterations": loop.iterations,
            "step_control": control.memory() if control else None,
        }
        arrays = coupling.state() | (control.state() if control else {})
        if simulation.measures.datum is not None:
            arrays["datum.u"] = simulation.measures.datum[: coupling.solid.mesh.n_owned]
        if simulation.has_placed:
            arrays[PLACED] = coupling.solid.mesh.placed
        write_checkpoint(directory, coupling.solid.mesh, header, arrays)
    return directory / NAME
