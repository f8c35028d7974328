"""Cells of a mesh from outside that overlap: folded over a common facet, or one at the boundary
over any.

All cells are positively oriented.  Then the number of cells over a point is the degree of the mesh
as a map, and that changes across the boundary only, where it is higher on the inner side: no two
cells overlap where neighbours lie on opposite sides of their common facet and no cell at the
boundary overlaps another one.
"""

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from ..elements import Element
from ..errors import InputError
from .check import Where, place
from .topology import shares

# Depth of a cell in another that is no overlap, in smallest heights of a cell: digits of a mesh
# file.
ROUNDED = 1e-3
# The same between parts without common nodes, in longest edges: the sides of an interface may lie
# apart by a tenth (fem/transfer.py), on curved ones both have their own sagitta.
APART = 0.15
PARALLEL = 1e-9  # product of two edges over the largest, below which it has no direction
LEAF = 32  # cells that are compared with all cells near them at once


def require_unfolded(
    points: np.ndarray, cells: np.ndarray, element: Element, group: np.ndarray, where: Where
) -> None:
    """Raise InputError where two cells lie on the same side of their common facet.

    Neighbours that are oriented alike traverse it in opposite directions.  points : (N, d) [m].
    cells : (E, A).  group : (E, facets of a cell)
    """
    sides = _orientation(cells[:, element.facet_corners])
    balance = np.bincount(group.ravel() + 1, weights=sides.ravel())[group + 1]
    wrong = (shares(group) == 2) & (balance != 0)
    if not wrong.any():
        return
    first = np.argwhere(group == group[wrong][0])
    corners = cells[first[0, 0], element.facet_corners[first[0, 1]]]
    names = " and ".join(f"{e} at {_centre(points, cells, element, e)}" for e in first[:, 0])
    raise InputError(
        f"{where}: the mesh is tangled at {int(wrong.sum()) // 2} facets, the first at"
        f" {place(points[corners].mean(axis=0))}: its cells {names} (counted from 0) lie on the"
        " same side of it; mesh the domain again, a node has been moved across its neighbours or a"
        " cell is doubled"
    )


def require_disjoint(
    points: np.ndarray, cells: np.ndarray, element: Element, group: np.ndarray, where: Where
) -> None:
    """Raise InputError where a cell at the boundary overlaps another one.

    points : (N, d) [m].  cells : (E, A).  group : (E, facets of a cell)
    """
    simplices = cells[:, element.cell.simplices]
    owner = np.repeat(np.arange(len(cells)), simplices.shape[1])
    simplices = simplices.reshape(len(owner), -1)
    whole = ~_have_twice(simplices)
    owner, simplices = owner[whole], simplices[whole]
    outer = (shares(group) == 1).any(axis=1)
    corners = points[simplices]
    gradients = _gradients(corners)
    allowed = ROUNDED * _height(corners) + 2 * _bulge(points, cells, element)[owner]
    low, high = _boxes(corners)
    for a, b in _near(low, high, np.flatnonzero(outer[owner])):
        other = owner[a] != owner[b]
        a, b = a[other], b[other]
        depth = _depth(corners, gradients, a, b, np.minimum(allowed[a], allowed[b]))
        deep = depth > np.maximum(allowed[a], allowed[b])
        deep[deep] = _too_deep(len(points), cells, owner, corners, depth[deep], a[deep], b[deep])
        if deep.any():
            first = owner[a[deep][0]], owner[b[deep][0]]
            names = " and ".join(f"{e} at {_centre(points, cells, element, e)}" for e in first)
            raise InputError(
                f"{where}: cells overlap: {names} (counted from 0), the first of which is at the"
                " boundary; remove one of them or mesh the domain again"
            )


def _orientation(facets):
    """Return +1 or -1, (E, f), for the sense in which the vertices (E, f, V) of facets are
    traversed, a line or a polygon.
    """
    if facets.shape[2] == 2:
        return np.sign(facets[:, :, 1] - facets[:, :, 0])
    first = facets.argmin(axis=2)[..., None]
    least = np.take_along_axis(facets, first, axis=2)
    after, before = (_next(facets, first, least, step) for step in (1, -1))
    return np.sign(before - after)


def _next(facets, first, least, step):
    """Return the vertex, (E, f), that follows on the least one, or on its double in a collapsed
    facet.
    """
    near, far = (
        np.take_along_axis(facets, (first + k * step) % facets.shape[2], axis=2) for k in (1, 2)
    )
    return np.where(near == least, far, near)[..., 0]


def _centre(points, cells, element, e):
    return place(points[cells[e, : element.n_vertices]].mean(axis=0))


def _boxes(corners):
    """Return the lower and upper corners of the boxes around simplices (n, k, d), (d, n) each."""
    return corners.min(axis=1).T.copy(), corners.max(axis=1).T.copy()


def _near(low, high, outer):
    """Yield pairs of cells, (k,) each, whose boxes meet, the first one of the outer cells (n,).

    The outer ones are halved until few are left.  low, high : (d, E)
    """
    todo = [(outer, np.arange(low.shape[1]))]
    while todo:
        some, cells = todo.pop()
        below = low[:, some]
        above = high[:, some]
        lowest = below.min(axis=1, keepdims=True)
        highest = above.max(axis=1, keepdims=True)
        cells = cells[_meet(low[:, cells], high[:, cells], lowest, highest)]
        if len(some) <= LEAF:
            a, b = np.nonzero(
                _meet(low[:, None, cells], high[:, None, cells], below[..., None], above[..., None])
            )
            other = some[a] != cells[b]
            yield some[a[other]], cells[b[other]]
        else:
            order = np.argsort((below + above)[np.argmax(highest - lowest)])
            todo += [(half, cells) for half in np.array_split(some[order], 2)]


def _meet(low, high, other_low, other_high):
    """Return whether boxes meet; the first axis is that of the coordinates."""
    return ((low <= other_high) & (high >= other_low)).all(axis=0)


def _depth(corners, gradients, a, b, allowed):
    """Return how deep cells a reach into cells b, (n,) [m]; what is not more than allowed is not
    exact.

    The least depth along the normals of both and, in space, the products of their edges (separating
    axis theorem; Gottschalk, Lin & Manocha 1996).
    """
    depth = _across_facets(corners[a], gradients[a], corners[b])
    near = np.flatnonzero(depth > allowed)
    for along in (_depth_in_second, _depth_along_edges)[: corners.shape[2] - 1]:
        depth[near] = np.minimum(depth[near], along(corners, gradients, a[near], b[near]))
        near = near[depth[near] > allowed[near]]
    return depth


def _gradients(corners):
    """Return ∇λ of the barycentric coordinates of cells, (E, d + 1, d) [1/m]."""
    others = np.linalg.inv(corners[:, 1:] - corners[:, :1]).swapaxes(1, 2)
    return np.concatenate([-others.sum(axis=1, keepdims=True), others], axis=1)


def _across_facets(corners, gradients, other):
    """Return the depth of other simplices along the facet normals of simplices, (n,) [m]."""
    coordinates = np.einsum("nid,nvd->vin", gradients, other - corners[:, :1])
    coordinates[:, 0] += 1
    depth = np.minimum(1 - coordinates.min(axis=0), coordinates.max(axis=0))
    return (depth / np.sqrt(np.einsum("nid,nid->in", gradients, gradients))).min(axis=0)


def _depth_in_second(corners, gradients, a, b):
    return _across_facets(corners[b], gradients[b], corners[a])


def _depth_along_edges(corners, gradients, a, b):
    """Return the depth along the products of the edges of tetrahedra that are not parallel, (n,)
    [m].
    """
    axes = _edge_products(corners[a], corners[b])
    length = np.linalg.norm(axes, axis=2)
    first, second = (np.einsum("nkd,nvd->nkv", axes, corners[cells]) for cells in (a, b))
    depth = np.minimum(
        first.max(axis=2) - second.min(axis=2), second.max(axis=2) - first.min(axis=2)
    )
    usable = length > PARALLEL * length.max(axis=1, keepdims=True)
    apart = np.divide(depth, length, out=np.full_like(depth, np.inf), where=usable)
    return apart.min(axis=1, initial=np.inf)


def _edge_products(first, second):
    """Return the products of the edges of tetrahedra, (n, 36, 3)."""
    products = np.cross(_edges(first)[:, :, None], _edges(second)[:, None])
    return products.reshape(len(first), 36, 3)


def _edges(corners):
    low, high = np.triu_indices(corners.shape[1], k=1)
    return corners[:, high] - corners[:, low]


def _size(corners):
    """Return the longest edge of simplices, (n,) [m]."""
    return np.linalg.norm(_edges(corners), axis=2).max(axis=1)


def _height(corners):
    """Return d! V over the longest edge to the power d - 1, about the smallest height, (n,) [m]."""
    volume = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1]))
    return volume / _size(corners) ** (corners.shape[2] - 1)


def _bulge(points, cells, element):
    """Return by how much cells are curved, (n,) [m]: nodes from the middle of the vertices around
    them, and the diagonals of a quadrilateral facet from its middle.
    """
    X = points[cells]
    bulge = np.zeros(len(cells))
    for i, around in enumerate(element.supports, start=element.n_vertices):
        away = X[:, i] - X[:, list(around)].mean(axis=1)
        np.maximum(bulge, np.linalg.norm(away, axis=1), out=bulge)
    for corners in element.facet_corners:
        if len(corners) == 4:
            twist = (X[:, corners] * np.array([1, -1, 1, -1])[:, None]).mean(axis=1)
            twist[_have_twice(cells[:, corners])] = 0
            np.maximum(bulge, np.linalg.norm(twist, axis=1), out=bulge)
    return bulge


def _have_twice(rows):
    """Return which rows of nodes (R, k) have one twice, (R,) bool."""
    return (np.diff(np.sort(rows, axis=1), axis=1) == 0).any(axis=1)


def _too_deep(n_nodes, cells, owner, corners, depth, first, second):
    """Return which pairs overlap by more than parts without common nodes may."""
    if not len(first):
        return np.zeros(0, dtype=bool)
    part = _parts(cells, n_nodes)
    size = np.maximum(_size(corners[first]), _size(corners[second]))
    part = part[cells[owner, 0]]
    return (part[first] == part[second]) | (depth > APART * size)


def _parts(cells, n_nodes):
    """Return the number of the part that a node belongs to, (N,): cells with a common node are
    one.
    """
    first = np.repeat(cells[:, 0], cells.shape[1] - 1)
    other = cells[:, 1:].ravel()
    graph = csr_matrix((np.ones(len(first), dtype=bool), (first, other)), shape=(n_nodes, n_nodes))
    return connected_components(graph, directed=False)[1]
