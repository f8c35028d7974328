"""Serendipity quadrilaterals and hexahedra of order 2, without nodes inside faces and cell,
nodes in VTK's order.

Their shape functions are sums of those of the Lagrange element: at its nodes that they lack they
have the values -1/4, those of a vertex, and 1/2 (in a face) or 1/4 (in a cell), those of a mid-edge
node (Zienkiewicz & Taylor, The Finite Element Method, vol. 1).  On cells that are no
parallelograms complete are the polynomials of degree 1 only (Arnold, Boffi & Falk, Math. Comp. 71
(2002) 909).
"""

import numpy as np

from .simplex import L3
from .tensor import CUBE, H27, Q9, SQUARE, TensorProduct

LAGRANGE = {2: Q9, 3: H27}


class Serendipity(TensorProduct):
    """A quadrilateral or a hexahedron with nodes at vertices and middles of edges."""

    @property
    def supports(self) -> tuple:
        """Return the ends of the edges."""
        return self.cell.edges

    @property
    def lebesgue_constant(self) -> float:
        """Return that at the centroid."""
        return float(np.abs(self.shape(self.cell.centroid)).sum())

    @property
    def polygons(self) -> tuple:
        """Return the nodes along the boundary, from a mid-edge node."""
        return ((4, 1, 5, 2, 6, 3, 7, 0),)

    def _product(self, lines, derivatives):
        """Return those of the Lagrange element, (Q, A'), times the values at its nodes, (A', A)."""
        full = LAGRANGE[self.dim]
        values = np.eye(full.nodes, self.nodes)
        for row, around in enumerate(full.supports[len(self.supports) :], start=self.nodes):
            edges = [set(edge) <= set(around) for edge in self.supports]
            values[row, list(around)] = -1 / 4
            values[row, self.n_vertices :] = np.where(edges, (1 + len(around) / 4) / sum(edges), 0)
        return full._product(lines, derivatives) @ values


Q8 = Serendipity("Q8", SQUARE, 2, "quad8", "Quadrilateral_8", Q9.facets, L3)
H20 = Serendipity(
    "H20", CUBE, 2, "hexahedron20", "Hexahedron_20", tuple(nodes[:8] for nodes in H27.facets), Q8
)
