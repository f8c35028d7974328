"""The graph of a mesh: which nodes share a cell."""

import numpy as np


def node_graph(cells: np.ndarray, n_nodes: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the adjacency of the nodes of cells (E, A) in CSR form without the diagonal: indptr
    (N + 1,), indices sorted in each row.
    """
    low, high = np.triu_indices(cells.shape[1], k=1)
    pairs = np.unique(
        np.concatenate(
            [
                _unique_pairs(cells[:, a], cells[:, b], n_nodes)
                for a, b in zip(low, high, strict=True)
            ]
        )
    )
    i, j = np.divmod(pairs, n_nodes)
    apart = i != j  # a collapsed cell has a node twice
    i, j, pairs = i[apart], j[apart], pairs[apart]
    keys = np.sort(np.concatenate([pairs, j * n_nodes + i]))
    rows, indices = np.divmod(keys, n_nodes)
    return np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=n_nodes))]), indices


def _unique_pairs(a, b, n_nodes):
    return np.unique(np.minimum(a, b) * n_nodes + np.maximum(a, b))
