"""L2 projection of fields on one surface to the nodes of another that lies on it."""

from math import ceil

import numpy as np
import scipy.sparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from ..elements import Element
from ..kernels.surface import facet_normal
from ..mesh.topology import cell_facets, facet_groups
from .closest import closest_points, facet_sizes
from .geometry import Rule, facet_measure

# Parts of an edge for each facet of the other side, whose shape functions have kinks inside, and at
# most; by the dimension of the surface.
FINER = {1: 4, 2: 2}
FINEST = {1: 32, 2: 4}
ROUND_OFF = 1e-9
# Entries of P that its matrix leaves out: they fall exponentially with the distance, and a Newton
# step without them leaves no more than this part of the residual.
NEGLIGIBLE = 1e-10
SHARP = np.cos(
    np.radians(50)
)  # of the angle between normals: eight facets of a circle are smooth, corners are not


class SurfaceProjection:
    """u = P w with ∮ ψ_i u dA = ∮ ψ_i w dA for the inner nodes i of the faces of a surface, u = w
    at the nodes r of their rims.

    Faces end at sharp edges, where tractions jump, and with the surface, at walls and symmetry
    planes, where u is prescribed.  On a face ψ_i is N_i with the N_r of the rim's nodes to which i
    is the closest inner one, so that Σ ψ_i = 1 and Pᵀ makes constant tractions of constant ones
    (Bernardi, Maday & Patera 1994).  With nodes s of the source and R = N_s at the rims: M_ψi u_i =
    (M_ψs - M_ψr R) w.  The same quadrature on both sides makes P exact for all fields that both can
    represent.
    """

    def __init__(
        self,
        cell_element: Element,
        facets: tuple[np.ndarray, np.ndarray],
        X: tuple[np.ndarray, np.ndarray],
    ) -> None:
        """Take target and source: facets, (F, Af) positions of their nodes, and coordinates (F, Af,
        d) [m].
        """
        self._element, (target, source), (X_target, X_source) = cell_element, facets, X
        self._shape = target.max() + 1, source.max() + 1
        face, self._rim = _faces(target, X_target, cell_element.facet)
        self._inner = np.setdiff1d(np.arange(self._shape[0]), self._rim)
        points = np.empty((self._shape[0], cell_element.dim))
        points[target] = X_target
        facet, N, _ = closest_points(cell_element, X_source, points[self._rim])
        self._at_rim = _sparse(N, source[facet], (len(self._rim), self._shape[1]))
        mass, crossed = (
            m[self._inner] for m in self._masses(_tests(target, face, self._rim, points), facets, X)
        )
        self._crossed = crossed - mass[:, self._rim] @ self._at_rim
        self._factor = splu(mass[:, self._inner].tocsc()) if len(self._inner) else None

    def _masses(self, tests, facets, X):
        """Return ∮ ψ_a N_b dA, (n, n), and ∮ ψ_a N_s dA, (n, n_source); tests : those of
        `_tests`.
        """
        element, (target, source), (X_target, X_source), n = (
            self._element.facet,
            facets,
            X,
            self._shape[0],
        )
        refinement = ceil(
            FINER[element.dim] * facet_sizes(X_target).max() / facet_sizes(X_source).min()
            - ROUND_OFF
        )
        points, weights = element.cell.subdivided(
            2 * element.order + element.axisymmetric, min(refinement, FINEST[element.dim])
        )
        N = element.shape(points)
        dA = facet_measure(Rule.at(element, points, weights), X_target)
        facet, N_source, _ = closest_points(
            self._element, X_source, (N @ X_target).reshape(-1, self._element.dim)
        )
        count = len(facet)
        everywhere = np.tile(N, (len(target), 1))
        test, here = (
            _sparse(everywhere, np.repeat(nodes, len(N), axis=0), (count, n + 1))
            for nodes in (tests, target)
        )
        there = _sparse(N_source, source[facet], (count, self._shape[1]))
        weighted = test[:, :n].T @ scipy.sparse.diags(np.linalg.norm(dA, axis=-1).ravel())
        return (weighted @ here[:, :n]).tocsr(), (weighted @ there).tocsr()

    def project(self, values: np.ndarray) -> np.ndarray:
        """Return P w on the target's nodes, (n, k), of values w (n_source, k)."""
        projected = np.empty((self._shape[0], values.shape[1]))
        projected[self._rim] = self._at_rim @ values
        projected[self._inner] = self._solve(self._crossed @ values, "N")
        return projected

    def transposed(self, forces: np.ndarray) -> np.ndarray:
        """Return Pᵀ F on the source's nodes, (n_source, k), of F (n, k)."""
        return self._at_rim.T @ forces[self._rim] + self._crossed.T @ self._solve(
            forces[self._inner], "T"
        )

    def matrix(self) -> scipy.sparse.csr_matrix:
        """Return P, (n, n_source), without entries below NEGLIGIBLE: for tangents, not for what
        is to be conserved.
        """
        inner = self._solve(self._crossed.toarray(), "N")
        inner[np.abs(inner) < NEGLIGIBLE] = 0.0
        order = np.argsort(np.concatenate([self._rim, self._inner]))
        return scipy.sparse.vstack([self._at_rim, scipy.sparse.csr_matrix(inner)]).tocsr()[order]

    def _solve(self, right, transposed):
        return self._factor.solve(right, transposed) if self._factor else right


def _faces(facets, X, element):
    """Return the face of every facet, (F,), and the nodes on the rims of faces, ascending."""
    normals = facet_normal(element.gradient(element.cell.centroid), np.ones(1), X)[:, 0]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    edges = cell_facets(facets, element)
    group = facet_groups(facets, element).ravel()
    owner = np.repeat(np.arange(len(facets)), edges.shape[1])
    order = np.argsort(group, kind="stable")
    same = (group[order[1:]] == group[order[:-1]]) & (group[order[1:]] >= 0)
    first = order[:-1][same]
    second = order[1:][same]
    smooth = (normals[owner[first]] * normals[owner[second]]).sum(axis=1) > SHARP
    first = first[smooth]
    second = second[smooth]
    links = scipy.sparse.coo_matrix(
        (np.ones(len(first)), (owner[first], owner[second])), (len(facets),) * 2
    )
    on_rim = ~np.isin(np.arange(len(owner)), np.concatenate([first, second])) & (group >= 0)
    return connected_components(links, directed=False)[1], np.unique(
        edges.reshape(len(owner), -1)[on_rim]
    )


def _tests(facets, face, rim, points):
    """Return the inner node whose ψ holds the shape function of a node on a facet, (F, Af); n where
    the face has none.
    """
    tests = facets.copy()
    at_rim = np.isin(facets, rim)
    tests[at_rim] = len(points)
    for number in np.unique(face):
        here = face == number
        inner = np.unique(facets[here][~at_rim[here]])
        if len(inner):
            mine = here[:, None] & at_rim
            from scipy.spatial import cKDTree  # slow to import; matching meshes need none

            tests[mine] = inner[cKDTree(points[inner]).query(points[facets[mine]])[1]]
    return tests


def _sparse(values, columns, shape):
    """Return the matrix with values (R, A) in columns (R, A) of its rows."""
    entries = np.repeat(np.arange(len(columns)), columns.shape[1]), columns.ravel()
    return scipy.sparse.csr_matrix((values.ravel(), entries), shape=shape)
