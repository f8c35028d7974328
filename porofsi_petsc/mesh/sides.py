"""Names for what a mesh file says nothing about: the sides of the body by their geometry."""

from pathlib import Path

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from ..elements import Element
from ..errors import InputError
from .check import place
from .generate import SIDES
from .topology import cell_facets

# of the largest side of the box around the mesh: digits of a mesh file
ROUND_OFF = 1e-6
DOUBLED = 1e-6  # of the size of a facet, up to which a node lies on it
NEAR = 1e-3  # the same of a vertex of its own
FEATURE = 30.0  # [degrees] between the normals of neighbours, above which a side ends


def named_sides(
    points: np.ndarray,
    cells: np.ndarray,
    element: Element,
    place_of: tuple[np.ndarray, np.ndarray],
    taken: set[str],
) -> dict[str, np.ndarray]:
    """Return name -> which of some boundary facets, numbers below F.

    left, right, ... (`generate.SIDES`) are those that lie flat on a side of the box around the
    mesh; the rest are side_1, side_2, ..., parts that no edge with an angle above `FEATURE` cuts,
    in the order of their centres: by x, then y, then z.  Names that are taken are passed over.
    points : (N, d) [m].  cells : (E, A).  place_of : cell and local number, (F,) each.
    """
    facets = cell_facets(cells, element)[place_of]
    X = points[facets]
    low, high = points.min(axis=0), points.max(axis=0)
    tolerance = ROUND_OFF * (high - low).max()
    rest = np.ones(len(facets), dtype=bool)
    names = {}
    for name, (axis, end) in SIDES[element.dim].items():
        limit = high[axis] if end else low[axis]
        flat = (np.abs(X[:, :, axis] - limit) <= tolerance).all(axis=1) & rest
        if flat.any() and name not in taken:
            names[name] = np.flatnonzero(flat)
            rest &= ~flat
    others = np.flatnonzero(rest)
    corners = cells[:, element.facet_corners][place_of][others]
    number = 0
    for members in _smooth_parts(points, corners, tolerance):
        number += 1
        while f"side_{number}" in taken:
            number += 1
        names[f"side_{number}"] = others[members]
    return names


def _smooth_parts(points, corners, tolerance):
    """Return the parts of facets (F, V) without an edge, in the order of their centres."""
    if not len(corners):
        return []
    normals = facet_normals(points[corners])
    first, second = _neighbours(corners)
    smooth = (normals[first] * normals[second]).sum(axis=1) >= np.cos(np.radians(FEATURE))
    graph = csr_matrix(
        (np.ones(smooth.sum(), dtype=bool), (first[smooth], second[smooth])),
        shape=(len(corners),) * 2,
    )
    count, part = connected_components(graph, directed=False)
    ends = np.cumsum(np.bincount(part, minlength=count))[:-1]
    members = np.split(np.argsort(part, kind="stable"), ends)
    origin = points.min(axis=0)
    centres = points[corners].mean(axis=1) - origin
    means = np.array([centres[chosen].mean(axis=0) for chosen in members])
    order = np.lexsort(np.round(means / tolerance).T[::-1])
    return [members[i] for i in order]


def facet_normals(X: np.ndarray) -> np.ndarray:
    """Return the unit normals, (F, d), of facets with the vertices (F, V, d), to the right of a
    line and on the side from which the vertices of a face turn left.
    """
    if X.shape[2] == 2:
        along = X[:, 1] - X[:, 0]
        normals = np.stack([along[:, 1], -along[:, 0]], axis=1)
    elif X.shape[1] == 3:
        normals = np.cross(X[:, 1] - X[:, 0], X[:, 2] - X[:, 0])
    else:
        normals = np.cross(X[:, 2] - X[:, 0], X[:, 3] - X[:, 1])
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def _neighbours(corners):
    """Return pairs of facets, (n,) each, that share an edge, on a line a vertex."""
    n = corners.shape[1]
    if n == 2:
        edges = corners.reshape(-1, 1)
    else:
        edges = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2)
    facet = np.repeat(np.arange(len(corners)), n)
    edges = np.sort(edges, axis=1)
    whole = np.ones(len(edges), dtype=bool) if n == 2 else edges[:, 0] != edges[:, 1]
    edges, facet = edges[whole], facet[whole]
    order = np.lexsort(edges.T)
    same = (edges[order][1:] == edges[order][:-1]).all(axis=1)
    return facet[order][1:][same], facet[order][:-1][same]


def require_joined(
    points: np.ndarray, corners: np.ndarray, nameless: np.ndarray, where: Path
) -> None:
    """Raise InputError where a boundary facet without a name lies on another one, or a vertex of
    another one lies on it: the body would be split there.

    points : (N, d) [m].  corners : (F, V) of all boundary facets.  nameless : (F,) bool
    """
    from scipy.spatial import cKDTree  # slow to import; meshes whose boundary has names need none

    bare = corners[nameless]
    if not len(bare):
        return
    X = points[bare]
    centres = X.mean(axis=1)
    size = np.linalg.norm(X - centres[:, None], axis=2).max(axis=1, initial=0)
    all_centres = cKDTree(points[corners].mean(axis=1))
    double = np.flatnonzero(
        all_centres.query_ball_point(centres, DOUBLED * size, return_length=True) > 1
    )
    if len(double):
        raise InputError(
            f"{where}: {len(double)} boundary facets without a name lie on others, the first at"
            f" {place(centres[double[0]])}: the nodes there are doubled and the body is split;"
            " merge them in the program that wrote the mesh, or name both sides"
        )
    hanging = _hanging(points, bare, np.unique(corners), centres, size)
    if len(hanging):
        raise InputError(
            f"{where}: {len(hanging)} nodes lie on boundary facets without a name that have other"
            f" vertices, the first at {place(points[hanging[0]])}: the cells on both sides do not"
            " fit together and the body is split; mesh it without hanging nodes, or name both sides"
        )


def _hanging(points, facets, vertices, centres, size):
    """Return which of the vertices (n,) lie on one of the facets (F, V) and are none of its own."""
    from scipy.spatial import cKDTree

    near = cKDTree(points[vertices]).query_ball_point(centres, size)
    facet = np.repeat(np.arange(len(facets)), [len(found) for found in near])
    node = vertices[np.concatenate([np.empty(0, dtype=np.int64), *near]).astype(np.int64)]
    other = (facets[facet] != node[:, None]).all(axis=1)
    facet, node = facet[other], node[other]
    found = np.zeros(len(node), dtype=bool)
    for part in {2: [[0, 1]], 3: [[0, 1, 2]], 4: [[0, 1, 2], [0, 2, 3]]}[facets.shape[1]]:
        found |= _on_simplex(points[node], points[facets[facet][:, part]], DOUBLED * size[facet])
    return np.unique(node[found])


def _on_simplex(x, X, tolerance):
    """Return which points (n, d) lie on lines or triangles (n, k, d), (n,), no corner of which is
    near.
    """
    edges = X[:, 1:] - X[:, :1]
    away = x - X[:, 0]
    products = edges @ edges.swapaxes(1, 2)
    whole = np.linalg.det(products) > 0  # a side of a collapsed cell is none
    products[~whole] = np.eye(edges.shape[1])
    lam = np.linalg.solve(products, edges @ away[:, :, None])[:, :, 0]
    rest = np.linalg.norm(away - np.einsum("ni,nid->nd", lam, edges), axis=1)
    lam = np.column_stack([1 - lam.sum(axis=1), lam])
    inside = (lam >= -DOUBLED).all(axis=1) & (lam <= 1 - NEAR).all(axis=1)
    return whole & inside & (rest <= tolerance)
