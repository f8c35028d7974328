"""Scenes: TOML in, one frozen and fully resolved `Scene` out; neither PETSc nor MPI is imported here."""

from .catalogue import list_scenes
from .expressions import Expression
from .load import completed, load_scene, scene_to_toml
from .schema import Scene

__all__ = ["Expression", "Scene", "completed", "list_scenes", "load_scene", "scene_to_toml"]
