"""A plane surface through which a fluid enters, whole on every rank, and the profiles of fully
developed flow through it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import coo_matrix, csc_matrix, csr_matrix
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import spsolve

from .distribute import LocalMesh
from .geometry import Rule, facet_measure

# Largest |n - n̄| of a plane surface: a mesh file may have six digits.
PLANE = 1e-3


@dataclass(frozen=True)
class Section:
    """The facets of a tag in the reference configuration, in an order that all ranks have in
    common.

    points (n, d) [m] of its nodes; held (n,) bool, where the fluid is at rest; mass (n, n) ∫ N_a
    N_b dA [m^(d-1)]; stiffness (n, n) ∫ ∇N_a·∇N_b dA [m^(d-3)]; through (n,) ∫ N_a n̄·n dA
    [m^(d-1)]; normal (d,) n̄, the unit vector along ∫ n dA; unevenness : largest |n - n̄| [-].
    Around an axis dA is that of a ring [m²].
    """

    points: np.ndarray
    held: np.ndarray
    mass: csr_matrix
    stiffness: csr_matrix
    through: np.ndarray
    normal: np.ndarray
    unevenness: float

    @classmethod
    def gathered(cls, mesh: LocalMesh, tag: str, held: np.ndarray) -> Section:
        """Return that of a tag; held : (n_local,) bool with ghosts, see above (collective)."""
        facets = mesh.facets[tag]
        nodes = facets.nodes[facets.owned]
        parts = mesh.comm.allgather((mesh.natural[nodes], mesh.X[nodes], held[nodes]))
        natural, X, rests = (np.concatenate(part) for part in zip(*parts, strict=True))
        order = np.lexsort(natural.T)
        natural, X, rests = natural[order], X[order], rests[order]
        _, first, local = np.unique(natural, return_index=True, return_inverse=True)
        local = local.reshape(natural.shape)
        points = X.reshape(-1, mesh.dim)[first]
        element = mesh.element.facet
        rule = Rule.of(element, 2 * element.order + element.axisymmetric)
        return cls(points, rests.ravel()[first], *_integrals(rule, X, local, len(points)))

    @property
    def is_plane(self) -> bool:
        """Return whether all normals are one."""
        return self.unevenness < PLANE

    @property
    def has_rim(self) -> bool:
        """Return whether the fluid is at rest somewhere on every connected part."""
        count, part = connected_components(self.mass, directed=False)
        return len(np.unique(part[self.held])) == count

    @cached_property
    def plug(self) -> np.ndarray:
        """Return the nodal speeds of a uniform flow, zero where the fluid is at rest, (n,)
        [1/m^(d-1)]: ∫ φ n̄·n dA = 1.
        """
        return self._of_unit_flow(np.where(self.held, 0.0, 1.0))

    @cached_property
    def developed(self) -> np.ndarray:
        """Return those of a flow far from the ends of a pipe, -Δφ = 1: Poiseuille's."""
        return self._of_unit_flow(self._solution(self.stiffness))

    def oscillating(self, rate: complex) -> np.ndarray:
        """Return the complex ones of a flow that oscillates there, s φ - Δφ = 1 (Womersley 1955).

        rate : s = iωρ/μ [1/m²]
        """
        return self._of_unit_flow(self._solution(rate * self.mass + self.stiffness))

    def _solution(self, matrix):
        """Return φ with φ = 0 where the fluid is at rest, natural elsewhere."""
        free = np.flatnonzero(~self.held)
        found = np.zeros(len(self.held), dtype=matrix.dtype)
        source = np.asarray(self.mass.sum(axis=1)).ravel()
        reduced = csc_matrix(matrix[free][:, free])
        found[free] = spsolve(reduced, source[free].astype(matrix.dtype))
        return found

    def _of_unit_flow(self, speed):
        return speed / (self.through @ speed)


def _integrals(rule, X, local, n):
    """Return mass, stiffness, through, normal and unevenness of a `Section` with n nodes.

    X (F, Af, d) coordinates and local (F, Af) numbers of the nodes of its facets
    """
    measure = facet_measure(rule, X)
    dA = np.linalg.norm(measure, axis=-1)
    total = measure.sum(axis=(0, 1))
    normal = total / np.linalg.norm(total)
    tangents = np.swapaxes(X, 1, 2)[:, None] @ rule.dN
    metric = np.swapaxes(tangents, 2, 3) @ tangents
    raised = rule.dN @ np.linalg.inv(metric)
    slopes = np.broadcast_to(
        raised @ np.swapaxes(rule.dN, 1, 2), (*dA.shape, X.shape[1], X.shape[1])
    )
    stiffness = np.einsum("fq,fqab->fab", dA, slopes)
    mass = np.einsum("fq,qa,qb->fab", dA, rule.N, rule.N)
    through = np.zeros(n)
    np.add.at(through, local, np.einsum("fqi,i,qa->fa", measure, normal, rule.N))
    rows, columns = np.broadcast_arrays(local[:, :, None], local[:, None])
    matrices = (
        coo_matrix((part.ravel(), (rows.ravel(), columns.ravel())), shape=(n, n)).tocsr()
        for part in (mass, stiffness)
    )
    unevenness = np.abs(measure / dA[..., None] - normal).max()
    return *matrices, through, normal, float(unevenness)
