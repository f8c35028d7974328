"""Saturated poroelastic dynamics by finite elements on PETSc.

from porofsi_petsc import load_scene, run
summary = run(load_scene("pulse2d"), "results/pulse2d")
"""

from pathlib import Path

__version__ = "0.1.0"
__all__ = ["__version__", "list_scenes", "load_scene", "run"]


def run(
    scene, directory=None, *, restart=None, force=False, quiet=False, max_time=None, petsc_options=(), allow_scene_options=False
):
    """Solve a scene and return its summary (the content of summary.json); collective.

    directory : results, default results/<scene>; restart : a checkpoint file; force : replace existing results; quiet : no
    progress; max_time : wall time [s] after which a checkpoint is written and the run stops; petsc_options : list of words that
    win over the scene's option string; allow_scene_options : that string may also name files and code.
    Raises a PorofsiError: InputError, ConvergenceError, Stopped or ExpectationError.
    """
    from .linalg.options import start

    start(scene.petsc.options, list(petsc_options), allow_scene_options)
    from .simulation import run as run_scene

    folder = Path(directory) if directory else Path("results") / scene.name
    return run_scene(scene, folder, Path(restart) if restart else None, force, quiet, max_time)


def __getattr__(name):
    """Import the configuration layer only when it is asked for, so that the command line answers at once."""
    if name in ("load_scene", "list_scenes"):
        from . import config

        return getattr(config, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
