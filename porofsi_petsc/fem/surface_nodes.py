"""Nodes of a surface, few enough that every rank knows all their values: what is computed of them
does not depend on the number of ranks.
"""

from collections.abc import Iterable

import numpy as np
import scipy.sparse

from .distribute import LocalMesh


class SurfaceNodes:
    """Some nodes of a mesh, wherever they are.

    natural (N,) : ascending natural numbers; local, owned : the nodes of this rank among them, with
    and without ghosts;
    rows : the positions of `local` in `natural`
    """

    def __init__(self, mesh: LocalMesh, natural: np.ndarray) -> None:
        """Find the nodes of the ranks (collective)."""
        self.natural = natural
        self._comm = mesh.comm
        self.local = np.flatnonzero(np.isin(mesh.natural, natural))
        self.owned = self.local[self.local < mesh.n_owned]
        self.rows = np.searchsorted(natural, mesh.natural[self.local])
        self._order = np.argsort(np.concatenate(mesh.comm.allgather(mesh.natural[self.owned])))

    def gather(self, field: np.ndarray) -> np.ndarray:
        """Return the values of a field, (n_owned, k) or longer, in the order of the natural
        numbers, (N, k) (collective).
        """
        return np.concatenate(self._comm.allgather(field[self.owned]))[self._order]

    def in_order(self, rows: scipy.sparse.spmatrix, dim: int) -> scipy.sparse.csr_matrix:
        """Return the rows of a matrix, dim for each node in the order of the ranks, in that of the
        natural numbers.
        """
        return rows.tocsr()[(dim * self._order[:, None] + np.arange(dim)).ravel()]


def surface_facets(mesh: LocalMesh, tags: Iterable[str]) -> tuple[np.ndarray, np.ndarray]:
    """Return natural node numbers (F, Af) and coordinates (F, Af, d) of all facets of some tags, in
    one order (collective).
    """
    mine = np.concatenate([mesh.facets[tag].nodes[mesh.facets[tag].owned] for tag in tags])
    nodes, X = (
        np.concatenate(mesh.comm.allgather(field[mine])) for field in (mesh.natural, mesh.X)
    )
    order = np.lexsort(nodes.T)
    return nodes[order], X[order]
