"""Loads inside the domain."""

from collections.abc import Collection, Iterable, Mapping
from typing import NamedTuple

import numpy as np

from ..fem.domain import Domain
from ..fem.essential import Formula


class BodyForce(NamedTuple):
    """Component -> expression of b [m/s²], of the reference position; regions : where it acts, None
    for all.
    """

    expressions: Mapping[int, Formula]
    regions: Collection[str] | None = None


def body_acceleration(domain: Domain, forces: Iterable[BodyForce], t: float) -> np.ndarray:
    """Return the sum of body forces at the quadrature points, (E, Q, d) [m/s²]."""
    points = domain.mass.N @ domain.gather(domain.mesh.X)
    b = np.zeros_like(points)
    for force in forces:
        for region, span in domain.region_slices.items():
            if force.regions is None or region in force.regions:
                here = points[span]
                for component, expression in force.expressions.items():
                    values = expression(t, here.reshape(-1, domain.dim))
                    b[span, :, component] += values.reshape(here.shape[:2])
    return b
