"""Table of the Lagrange simplices; an element is data plus its shape functions."""

from .simplex import T3, T4, T6, T10, Element

ELEMENTS = {element.name: element for element in (T3, T6, T4, T10)}

__all__ = ["ELEMENTS", "Element"]
