"""Scenes: TOML in, one frozen and fully resolved `Scene` out; neither PETSc nor MPI is imported
here.
"""

from .catalogue import list_scenes
from .compare import comparable, table_contents
from .expressions import Expression
from .load import load_scene, scene_to_toml
from .schema import Scene

__all__ = [
    "Expression",
    "Scene",
    "comparable",
    "list_scenes",
    "load_scene",
    "scene_to_toml",
    "table_contents",
]
