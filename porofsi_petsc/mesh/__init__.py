"""Serial meshes: generators, files, checks, adjacency."""

from .check import require_regions, require_tags
from .generate import box, rectangle
from .graph import node_graph
from .mesh import Mesh
from .read import read_mesh

__all__ = ["Mesh", "box", "node_graph", "read_mesh", "rectangle", "require_regions", "require_tags"]
