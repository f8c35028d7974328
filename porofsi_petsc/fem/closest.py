"""The closest points of a surface of facets to given points: which facet, where on it, how far."""

from itertools import combinations

import numpy as np

from ..elements.simplex import FACET
from ..tensors import inverse

ROUND_OFF = 1e-12  # of reference coordinates
# Sum of |N_a| on a facet of an order, at most: how far over its farthest node a curved facet may
# reach from its centroid.
REACH = {1: 1.0, 2: 5 / 3}
# Of Gauss and Newton to a curved facet: each contracts by curvature times distance, on two sides of
# an interface by 0.1 or less.
STEPS = 20
CHUNK = 5000  # points at a time, whose candidates stay in memory
OUTER = 2.0  # reference coordinates beyond which an iterate has left the facet for good


def closest_points(cell_element, X, points):
    """Return facet (N,), shape functions there (N, Af) and distance (N,) [m] of the closest point
    of a surface to each point.

    cell_element : of the cells behind; X (F, Af, d) nodes of the facets [m]; points (N, d) [m].  Of
    several facets the first.
    """
    element = FACET[cell_element.name]
    found = []
    for start in range(0, max(len(points), 1), CHUNK):
        some = points[start : start + CHUNK]
        facet, point = _candidates(X, some, REACH[element.order])
        xi, distance = _closest_on_facets(element, X[facet], some[point])
        best = np.lexsort([facet, distance, point])[np.searchsorted(point, np.arange(len(some)))]
        found.append((facet[best], element.shape(xi[best]), distance[best]))
    return tuple(np.concatenate(arrays) for arrays in zip(*found, strict=True))


def facet_sizes(X):
    """Return the diameters of the spheres about the centroids of facets, (F,) [m], of their nodes
    (F, Af, d).
    """
    return 2 * np.linalg.norm(X - X.mean(axis=1, keepdims=True), axis=2).max(axis=1)


def _candidates(X, points, reach):
    """Return facet and point, (P,) each: all pairs in which the facet may be the closest one.

    The closest node bounds the distance; a facet reaches no farther from its centroid than its
    radius.
    """
    from scipy.spatial import cKDTree  # slow to import; matching meshes need none

    centroids = X.mean(axis=1)
    radius = (1 + ROUND_OFF) * reach * facet_sizes(X) / 2
    bound, _ = cKDTree(X.reshape(-1, X.shape[2])).query(points)
    lists = cKDTree(centroids).query_ball_point(points, bound + radius.max(), return_sorted=True)
    point = np.repeat(np.arange(len(points)), [len(facets) for facets in lists])
    facet = np.concatenate([[], *lists]).astype(int)
    near = np.linalg.norm(points[point] - centroids[facet], axis=1) <= bound[point] + radius[facet]
    return facet[near], point[near]


def _closest_on_facets(element, X, x):
    """Return reference coordinates (P, dim) and distance (P,) of the closest point of facets X (P,
    Af, d) to x (P, d) each.

    It is a stationary point of the distance on the facet, on one of its edges, or a vertex.
    """
    vertices = element.node_coordinates[: element.dim + 1]
    best = np.zeros((len(x), element.dim))
    least = np.full(len(x), np.inf)
    for size in range(1, len(vertices) + 1):
        for corners in combinations(vertices, size):
            xi, inside = _stationary(element, X, x, np.array(corners))
            distance = np.linalg.norm(x - _at(element.shape(xi), X), axis=1)
            closer = inside & (distance < least)
            best[closer] = xi[closer]
            least[closer] = distance[closer]
    return best, least


def _stationary(element, X, x, corners):
    """Return where on the part with some corners (k + 1, dim) the distance is stationary, (P, dim),
    and whether inside, (P,).
    """
    directions = corners[1:] - corners[0]
    k = len(corners) - 1
    s = np.full((len(x), k), 1 / (k + 1))
    steps = 0 if k == 0 else 1 if element.order == 1 else STEPS
    with np.errstate(all="ignore"):
        for _ in range(steps):
            xi = corners[0] + s @ directions
            slope = np.swapaxes(X, 1, 2) @ (element.gradient(xi) @ directions.T)
            gap = x - _at(element.shape(xi), X)
            pull = (np.swapaxes(slope, 1, 2) @ gap[..., None])[..., 0]
            before = s
            s = (s + _solve(np.swapaxes(slope, 1, 2) @ slope, pull)).clip(-OUTER, OUTER)
            if np.abs(s - before).max(initial=0.0) <= ROUND_OFF:
                break
    inside = (s >= -ROUND_OFF).all(axis=1) & (s.sum(axis=1) <= 1 + ROUND_OFF)
    return corners[0] + s @ directions, inside


def _at(N, X):
    return (N[:, None] @ X)[:, 0]


def _solve(A, b):
    """Return A⁻¹ b of stacks of 1x1 or 2x2 matrices (P, k, k), not finite where A is singular."""
    if A.shape[-1] == 1:
        return b / A[..., 0]
    return (inverse(A)[0] @ b[..., None])[..., 0]
