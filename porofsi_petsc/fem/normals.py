"""Normals at the nodes of surfaces: one where a surface is smooth, several at its edges."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from ..elements import Element
from ..kernels.surface import facet_normal

# Facets at a node whose normals are nearer than this belong to one smooth surface, as in the
# feature angle of mesh generators.
FEATURE = np.cos(np.radians(40))
# A collapsed facet has no normal at a vertex that it has twice, over the one in its middle.
NONE = 1e-9


class NodalNormals(NamedTuple):
    """The directions of surfaces at nodes, one for each smooth surface that meets there.

    node (n,), sorted; direction (n, d) unit vectors, outward; share (n, k) : parts of k surfaces in
    them, whose sums are 1
    """

    node: np.ndarray
    direction: np.ndarray
    share: np.ndarray


def nodal_normals(
    points: np.ndarray, surfaces: Sequence[np.ndarray], element: Element
) -> NodalNormals:
    """Return the normals of k surfaces (F, Af) at their nodes, points (N, d) [m]; element : of the
    cells behind them.

    Means over facets by their measure at the node, which are exact on planes and of second order on
    curved surfaces.
    """
    facet = element.facet
    assert facet is not None  # of a cell
    normals = [_at_nodes(points[nodes], facet) for nodes in surfaces]
    node = np.concatenate([nodes.ravel() for nodes in surfaces])
    vector = np.concatenate([normal.reshape(-1, points.shape[1]) for normal in normals])
    surface = np.repeat(np.arange(len(surfaces)), [nodes.size for nodes in surfaces])
    order = np.argsort(node, kind="stable")
    node, vector, surface = node[order], vector[order], surface[order]
    group = _smooth_groups(node, vector)
    n = group.max(initial=-1) + 1
    size = np.linalg.norm(vector, axis=1)
    share = np.zeros((n, len(surfaces)))
    np.add.at(share, (group, surface), size)
    mean = np.zeros((n, points.shape[1]))
    np.add.at(mean, group, vector)
    first = np.unique(group, return_index=True)[1]
    return NodalNormals(
        node[first],
        mean / np.linalg.norm(mean, axis=1, keepdims=True),
        share / share.sum(axis=1, keepdims=True),
    )


def _at_nodes(X, facet):
    """Return the normals times the measure at the nodes of facets X (F, Af, d), (F, Af, d)."""
    nodes = facet.node_coordinates
    found = facet_normal(facet.gradient(nodes), np.ones(len(nodes)), X)
    middle = found.mean(axis=1, keepdims=True)
    size, of_middle = (np.linalg.norm(v, axis=2, keepdims=True) for v in (found, middle))
    return np.where(size > NONE * of_middle, found, middle)


def _smooth_groups(node, vector):
    """Return the number of the smooth surface of every vector (n, d) at a node (n,), sorted by
    nodes: (n,).
    """
    unit = vector / np.linalg.norm(vector, axis=1, keepdims=True)
    starts = np.flatnonzero(np.diff(node, prepend=-1))
    counts = np.diff(np.append(starts, len(node)))
    sums = np.add.reduceat(unit, starts) if len(starts) else unit
    mean = np.repeat(sums, counts, axis=0)
    alike = (unit * mean).sum(axis=1) >= FEATURE * np.linalg.norm(mean, axis=1)
    smooth = np.logical_and.reduceat(alike, starts) if len(starts) else alike
    parts = np.zeros(len(node), dtype=np.int64)
    for start, count in zip(starts[~smooth], counts[~smooth], strict=True):
        of_node = slice(start, start + count)
        near = csr_matrix(unit[of_node] @ unit[of_node].T >= FEATURE)
        parts[of_node] = connected_components(near, directed=False)[1]
    return np.unique(np.stack([node, parts], axis=1), axis=0, return_inverse=True)[1].ravel()
