"""The loads of a scene on points and lines of its solid."""

from collections.abc import Callable
from typing import Any

import numpy as np

from ..config import Scene
from ..errors import InputError, digits
from ..fem.domain import Domain
from ..fem.locate import NOWHERE, Located, crossings, locate
from ..phases.loads import ConcentratedLoad


def concentrated_loads(
    scene: Scene, domain: Domain, formulas: Callable[[Any], dict[int, Any]]
) -> tuple[ConcentratedLoad, ...]:
    """Return the [[load]]s of a scene on the domain of its solid; formulas : from a vector to
    component -> formula (collective).

    Raises InputError where a load lies outside of it.
    """
    found = []
    for i, load in enumerate(scene.load):
        X, weights = _points(domain, load)
        located = locate(domain.mesh, X, domain.row_of_cell >= 0)
        located = _in(domain, located)
        if located.outside.any():
            place = ", ".join(digits(c) for c in X[np.argmax(located.outside)])
            raise InputError(
                f"{scene.source_path or 'scene'} [load.{i}]: received the point ({place}) m, which"
                " is not in the solid, expected one of it; move the load"
            )
        nodal = _nodal(domain, located)
        found.append(ConcentratedLoad(formulas(load.force), X, weights, *nodal))
    return tuple(found)


def _points(domain, load):
    """Return the points (P, d) of a load and their weights (P,): Gauss points between the faces of
    the cells along a line.
    """
    if load.at is not None:
        return np.array([load.at], dtype=float), np.ones(1)
    start, end = (np.array(point, dtype=float) for point in load.line)
    s = crossings(domain.mesh, start, end)
    # along a line the shape functions are of the degree d times their order at most
    xi, w = np.polynomial.legendre.leggauss(2 * domain.element.order + 1)
    middle, half = (s[1:] + s[:-1]) / 2, (s[1:] - s[:-1]) / 2
    along = (middle[:, None] + half[:, None] * xi).ravel()
    weights = (half[:, None] * w).ravel() * np.linalg.norm(end - start)
    return start + along[:, None] * (end - start), weights


def _in(domain, located):
    """Return where points are, `NOWHERE` for those in a cell that is not of the domain
    (collective).
    """
    mesh = domain.mesh
    rows, _ = located.rows(mesh, mesh.cell_owned & (domain.row_of_cell >= 0))
    here = np.zeros(len(located.cell), dtype=np.int64)
    here[rows] = 1
    everywhere = np.empty_like(here)
    mesh.comm.Allreduce(here, everywhere)
    return Located(np.where(everywhere > 0, located.cell, NOWHERE), located.shape)


def _nodal(domain, located):
    """Return the point, the node and the shape function of each owned node of the cells, (R,)
    each; a rank holds every cell that touches one of its nodes.
    """
    mesh = domain.mesh
    points, cells = located.rows(mesh, np.ones(len(mesh.cells), dtype=bool))
    nodes = mesh.cells[cells]
    owned = nodes < mesh.n_owned
    which = np.broadcast_to(points[:, None], nodes.shape)
    return which[owned], nodes[owned], located.shape[points][owned]
