"""Incompressible flow with porous and solid structures by finite elements on PETSc.

from porofsi_petsc import Simulation, load_scene, read_history, run

summary = run(load_scene("pulse2d"), "results/pulse2d")    # as the command line does
with Simulation.from_scene("pulse2d") as simulation:       # step by step, without files
    simulation.run(until=0.1)
    p = simulation.fields["pressure"]
"""

from __future__ import annotations

import importlib
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .config import Scene

__version__ = "0.1.0"
__all__ = [
    "Simulation",
    "__version__",
    "list_scenes",
    "load_scene",
    "read_fields",
    "read_history",
    "run",
]

# Where the public names are; imported when they are asked for, so that the command line answers at
# once.
HOMES = {
    "Simulation": ".simulation.simulation",
    "list_scenes": ".config",
    "load_scene": ".config",
    "read_fields": ".output.results",
    "read_history": ".output.history",
}


def run(
    scene: Scene | str | os.PathLike | Mapping[str, Any],
    directory: str | os.PathLike | None = None,
    *,
    restart: str | os.PathLike | None = None,
    force: bool = False,
    quiet: bool = False,
    max_time: float | None = None,
    petsc_options: Iterable[str] = (),
    allow_scene_options: bool = False,
) -> dict[str, Any]:
    """Solve a scene and return its summary (the content of summary.json); collective over all
    ranks.

    scene : a `Scene`, or what `load_scene` takes; directory : results, default results/<scene>;
    restart : a checkpoint file;
    force : replace existing results; quiet : no progress; max_time : wall time [s] after which a
    checkpoint is written and the run stops; petsc_options : words that win over the scene's option
    string; allow_scene_options : that string may also name files and code. Raises a PorofsiError:
    InputError, ConvergenceError, Stopped or ExpectationError.
    """
    from .config import Scene, load_scene
    from .linalg.options import start

    scene = scene if isinstance(scene, Scene) else load_scene(scene)
    start(scene.petsc.options, list(petsc_options), allow_scene_options)
    from .simulation import run as run_scene

    folder = Path(directory) if directory else Path("results") / scene.name
    return run_scene(scene, folder, Path(restart) if restart else None, force, quiet, max_time)


def __getattr__(name: str) -> Any:
    """Import a public name from its home."""
    if name in HOMES:
        return getattr(importlib.import_module(HOMES[name], __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
