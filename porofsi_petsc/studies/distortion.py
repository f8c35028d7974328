"""A badly shaped mesh: the interior nodes of a mesh of triangles moved until the angles are as
small as wanted.
"""

from dataclasses import replace

import numpy as np

from ..mesh.mesh import Mesh

HALVINGS = 12  # of the way of a node
SEED = 5


def angles(points: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Return the angles of triangles [degrees], (E, 3); 0 where a triangle is turned over."""
    corners = points[cells]
    ahead = np.roll(corners, -1, axis=1) - corners
    behind = np.roll(corners, 1, axis=1) - corners
    cross = ahead[..., 0] * behind[..., 1] - ahead[..., 1] * behind[..., 0]
    return np.maximum(np.degrees(np.arctan2(cross, (ahead * behind).sum(axis=-1))), 0.0)


def distort(mesh: Mesh, smallest: float) -> Mesh:
    """Return the mesh of T3 with every interior node moved, in a fixed random direction, as far as
    the angles allow [degrees].
    """
    points = mesh.points.copy()
    random = np.random.default_rng(SEED)
    boundary = np.unique(np.concatenate([nodes.ravel() for nodes in mesh.facets.values()]))
    for node in np.setdiff1d(np.arange(len(points)), boundary):
        around = mesh.cells[(mesh.cells == node).any(axis=1)]
        length = np.ptp(points[around].reshape(-1, 2), axis=0).max()
        turn = random.uniform(0, 2 * np.pi)
        _move(points, node, length * np.array([np.cos(turn), np.sin(turn)]), around, smallest)
    return replace(mesh, points=points)


def _move(points, node, way, cells, smallest):
    """Move a node along the largest part of its way, to one in 2^HALVINGS, that keeps the angles of
    its cells.
    """
    start = points[node].copy()
    part = 0.0
    for step in 0.5 ** np.arange(1, HALVINGS + 1):
        points[node] = start + (part + step) * way
        if angles(points, cells).min() >= smallest:
            part += step
    points[node] = start + part * way
