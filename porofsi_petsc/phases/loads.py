"""Loads inside the domain: on its mass, on points and lines."""

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


class ConcentratedLoad(NamedTuple):
    """Forces on points of the reference, which the shape functions of their cells take to nodes.

    expressions : component -> formula of a force [N], along a line [N/m]; X (P, d) points; weights
    (P,) : 1, along a line lengths [m]; points (R,), nodes (R,), shape (R,) : which owned node takes
    which part of which point
    """

    expressions: Mapping[int, Formula]
    X: np.ndarray
    weights: np.ndarray
    points: np.ndarray
    nodes: np.ndarray
    shape: np.ndarray

    def add_to(self, nodal: np.ndarray, t: float) -> None:
        """Add the forces at time t to a field (n_owned, d) [N]."""
        for component, expression in self.expressions.items():
            forces = self.weights * expression(t, self.X)
            np.add.at(nodal[:, component], self.nodes, self.shape * forces[self.points])
