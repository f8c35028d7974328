"""Table of the elements of a mesh."""

from .element import Element
from .simplex import T3, T4, T6, T10

ELEMENTS = {element.name: element for element in (T3, T6, T4, T10)}

__all__ = ["ELEMENTS", "Element"]
