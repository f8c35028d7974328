"""Loads inside the domain."""

from collections.abc import Mapping

import numpy as np

from ..fem.domain import Domain
from ..fem.essential import Formula


def body_acceleration(domain: Domain, expressions: Mapping[int, Formula], t: float) -> np.ndarray:
    """Return b at the quadrature points, (E, Q, d) [m/s²], from dict component -> expression of the
    reference position.
    """
    points = (domain.mass.N @ domain.gather(domain.mesh.X)).reshape(-1, domain.dim)
    b = np.zeros_like(points)
    for component, expression in expressions.items():
        b[:, component] = expression(t, points)
    return b.reshape(domain.n_cells, -1, domain.dim)
