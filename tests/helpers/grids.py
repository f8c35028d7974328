"""Built-in meshes by the name of their element."""

from porofsi_petsc.elements import ELEMENTS, FAMILIES
from porofsi_petsc.mesh import box, rectangle

PLANE = [name for name, element in ELEMENTS.items() if element.dim == 2]
SOLID = [name for name, element in ELEMENTS.items() if element.dim == 3]


def cell_type(name):
    """Return the name that scenes have for the cells of an element."""
    families = FAMILIES[ELEMENTS[name].dim]
    return next(cells for cells, pair in families.items() if ELEMENTS[name] in pair)


def grid(name, axes, order=None, **options):
    """Return the mesh of an element, or of another order of its family, along some axes."""
    make = rectangle if len(axes) == 2 else box
    order = order or ELEMENTS[name].order
    return make(*axes, order=order, cell_type=cell_type(name), **options)
