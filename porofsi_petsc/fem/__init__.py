"""The mesh on many ranks and what is computed on it."""

from .distribute import Facets, LocalMesh, distribute
from .halo import Halo
from .natural_order import NaturalOrder

__all__ = ["Facets", "Halo", "LocalMesh", "NaturalOrder", "distribute"]
