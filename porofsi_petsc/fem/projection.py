"""L2 projection of fields on one surface to the nodes of another that lies on it."""

from math import ceil

import numpy as np
import scipy.sparse
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from ..elements.quadrature import subdivided
from ..elements.simplex import FACET
from ..kernels.surface import facet_normal
from ..mesh.topology import cell_facets, facet_multiplicity
from .closest import closest_points, facet_sizes

# Parts of an edge for each facet of the other side, whose shape functions have kinks inside; and at most, by the dimension of the
# surface.
FINER, FINEST, ROUND_OFF = 2, {1: 16, 2: 4}, 1e-9


class SurfaceProjection:
    """u = P w with ∮ ψ_i u dA = ∮ ψ_i w dA for every inner node i of a surface, and u = w at the nodes r of its rim.

    The rim, where the surface ends at walls or symmetry planes, keeps what is prescribed there; ψ_i is N_i with the N_r of the
    rim's nodes to which i is the closest inner one, so that Σ ψ_i = 1 and Pᵀ makes constant tractions of constant ones (Bernardi,
    Maday & Patera 1994).  With nodes s of the source and R = N_s at the rim:  M_ψi u_i = (M_ψs - M_ψr R) w.  The same quadrature
    on both sides makes P exact for all fields that both can represent, whatever its points are.
    """

    def __init__(self, cell_element, facets, X):
        """Take target and source: facets, (F, Af) positions of their nodes, and coordinates (F, Af, d) [m]."""
        element, (target, source), (X_target, X_source) = FACET[cell_element.name], facets, X
        n, n_source = target.max() + 1, source.max() + 1
        points = np.empty((n, cell_element.dim))
        points[target] = X_target
        self._rim = np.unique(_rim(target, element))
        self._inner = np.setdiff1d(np.arange(n), self._rim)
        facet, N, _ = closest_points(cell_element, X_source, points[self._rim])
        self._at_rim = _sparse(N, np.arange(len(self._rim)), source[facet], (len(self._rim), n_source))
        refinement = facet_sizes(X_target).max() / facet_sizes(X_source).min()
        rule = subdivided(element.dim, 2 * element.order, min(ceil(FINER * refinement - ROUND_OFF), FINEST[element.dim]))
        mass, crossed = (self._weighted(points, m) for m in _masses(cell_element, element, facets, X, rule, (n, n_source)))
        self._crossed = crossed - mass[:, self._rim] @ self._at_rim
        self._factor = splu(mass[:, self._inner].tocsc()) if len(self._inner) else None

    def _weighted(self, points, mass):
        """Return the rows of ψ_i, (n_inner, ...), from those of N_a, (n, ...)."""
        inner, rim = mass[self._inner], mass[self._rim]
        if not (len(self._inner) and len(self._rim)):
            return inner
        _, closest = cKDTree(points[self._inner]).query(points[self._rim])
        ones = np.ones(len(closest))
        return inner + scipy.sparse.csr_matrix((ones, (closest, np.arange(len(closest)))), (len(self._inner), len(closest))) @ rim

    def project(self, values):
        """Return P w on the target's nodes, (n, k), of values w (n_source, k)."""
        projected = np.empty((len(self._rim) + len(self._inner), values.shape[1]))
        projected[self._rim] = self._at_rim @ values
        projected[self._inner] = self._solve(self._crossed @ values, "N")
        return projected

    def transposed(self, forces):
        """Return Pᵀ F on the source's nodes, (n_source, k), of F (n, k)."""
        return self._at_rim.T @ forces[self._rim] + self._crossed.T @ self._solve(forces[self._inner], "T")

    def _solve(self, right, transposed):
        return self._factor.solve(right, transposed) if self._factor else right


def _rim(facets, element):
    """Return the nodes of the edges (in the plane: the ends) that belong to one facet only."""
    single = facet_multiplicity(facets, element) == 1
    return cell_facets(facets, element)[single].ravel()


def _masses(cell_element, element, facets, X, rule, shape):
    """Return ∮ N_a N_b dA of the target, (n, n), and ∮ N_a N_s dA with the source, (n, n_source), by a rule on the target."""
    (target, source), (X_target, X_source), (points, weights) = facets, X, rule
    N, dN = element.shape(points), element.gradient(points)
    dA = np.linalg.norm(facet_normal(dN, weights, X_target), axis=-1)
    places = (N @ X_target).reshape(-1, cell_element.dim)
    facet, N_source, _ = closest_points(cell_element, X_source, places)
    row = np.arange(len(places))
    here = _sparse(np.tile(N, (len(target), 1)), row, np.repeat(target, len(N), axis=0), (len(places), shape[0]))
    there = _sparse(N_source, row, source[facet], (len(places), shape[1]))
    weighted = here.T @ scipy.sparse.diags(dA.ravel())
    return (weighted @ here).tocsr(), (weighted @ there).tocsr()


def _sparse(values, rows, columns, shape):
    """Return the matrix with values (R, A) in rows (R,) and columns (R, A)."""
    entries = np.repeat(rows, columns.shape[1]), columns.ravel()
    return scipy.sparse.csr_matrix((values.ravel(), entries), shape=shape)
