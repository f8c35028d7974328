"""Loads inside the domain."""

import numpy as np


def body_acceleration(domain, expressions, t):
    """Return b at the quadrature points, (E, Q, d) [m/s²], from dict component -> expression of the
    reference position.
    """
    points = (domain.mass.N @ domain.gather(domain.mesh.X)).reshape(-1, domain.dim)
    b = np.zeros_like(points)
    for component, expression in expressions.items():
        b[:, component] = expression(t, points)
    return b.reshape(domain.n_cells, -1, domain.dim)
