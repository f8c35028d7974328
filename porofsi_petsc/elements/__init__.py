"""Table of the elements of a mesh."""

from .element import Element
from .simplex import T3, T4, T6, T10
from .tensor import H8, H27, Q4, Q9

ELEMENTS = {element.name: element for element in (T3, T6, Q4, Q9, T4, T10, H8, H27)}
# Elements of order 1 and 2 of a built-in mesh, by the name of their cells.
FAMILIES = {
    "triangle": (T3, T6),
    "quadrilateral": (Q4, Q9),
    "tetrahedron": (T4, T10),
    "hexahedron": (H8, H27),
}

__all__ = ["ELEMENTS", "FAMILIES", "Element"]
