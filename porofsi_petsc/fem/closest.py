"""The closest points of a surface of facets to given points: which facet, where on it, how far."""

import numpy as np

from ..elements import Element
from ..tensors import inverse

ROUND_OFF = 1e-12  # of reference coordinates
# Of Gauss and Newton to a curved facet: each contracts by curvature times distance, on two sides of
# an interface by 0.1 or less.
STEPS = 20
CHUNK = 5000  # points at a time, whose candidates stay in memory
OUTER = 2.0  # reference coordinates beyond which an iterate has left the facet for good


def closest_points(
    cell_element: Element, X: np.ndarray, points: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return facet (N,), shape functions there (N, Af) and distance (N,) [m] of the closest point
    of a surface to each point.

    cell_element : of the cells behind; X (F, Af, d) nodes of the facets [m]; points (N, d) [m].  Of
    several facets the first.
    """
    element = cell_element.facet
    found = []
    for start in range(0, max(len(points), 1), CHUNK):
        some = points[start : start + CHUNK]
        facet, point = _candidates(X, some, element.lebesgue_constant)
        xi, distance = _closest_on_facets(element, X[facet], some[point])
        best = np.lexsort([facet, distance, point])[np.searchsorted(point, np.arange(len(some)))]
        found.append((facet[best], element.shape(xi[best]), distance[best]))
    return tuple(np.concatenate(arrays) for arrays in zip(*found, strict=True))


def facet_sizes(X: np.ndarray) -> np.ndarray:
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
    X, x = X - X[:, :1], x - X[:, 0]  # digits far from the origin
    best = np.zeros((len(x), element.dim))
    least = np.full(len(x), np.inf)
    for part in element.cell.parts:
        xi, inside = _stationary(element, X, x, *part)
        distance = np.linalg.norm(x - _at(element.shape(xi), X), axis=1)
        closer = inside & (distance < least)
        best[closer] = xi[closer]
        least[closer] = distance[closer]
    return best, least


def _stationary(element, X, x, part, origin, directions):
    """Return where on a part of the facet's cell, see `Cell.parts`, the distance is stationary, (P,
    dim), and whether inside, (P,).
    """
    s = np.tile(part.centroid, (len(x), 1))
    steps = 0 if part.dim == 0 else 1 if element.is_affine else STEPS
    with np.errstate(all="ignore"):
        for _ in range(steps):
            xi = origin + s @ directions
            slope = np.swapaxes(X, 1, 2) @ (element.gradient(xi) @ directions.T)
            gap = x - _at(element.shape(xi), X)
            descent = (np.swapaxes(slope, 1, 2) @ gap[..., None])[..., 0]
            before = s
            s = (s + _solve(np.swapaxes(slope, 1, 2) @ slope, descent)).clip(-OUTER, OUTER)
            if np.abs(s - before).max(initial=0.0) <= ROUND_OFF:
                break
    return origin + s @ directions, part.contains(s, ROUND_OFF)


def _at(N, X):
    return (N[:, None] @ X)[:, 0]


def _solve(A, b):
    """Return A⁻¹ b of stacks of 1x1 or 2x2 matrices (P, k, k), not finite where A is singular."""
    if A.shape[-1] == 1:
        return b / A[..., 0]
    return (inverse(A)[0] @ b[..., None])[..., 0]
