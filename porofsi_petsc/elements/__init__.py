"""Table of the elements of a mesh."""

from .element import Element
from .serendipity import H20, Q8
from .simplex import T3, T4, T6, T10
from .tensor import H8, H27, Q4, Q9

# Elements of order 1 and 2, by the dimension and the name that scenes have for the cells.
FAMILIES = {
    2: {"triangle": (T3, T6), "quadrilateral": (Q4, Q9), "serendipity": (Q4, Q8)},
    3: {"tetrahedron": (T4, T10), "hexahedron": (H8, H27), "serendipity": (H8, H20)},
}
ELEMENTS = {
    element.name: element
    for families in FAMILIES.values()
    for family in families.values()
    for element in family
}

__all__ = ["ELEMENTS", "FAMILIES", "Element"]
