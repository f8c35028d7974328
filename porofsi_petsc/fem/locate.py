"""Which cell holds a point, and the shape functions there; where a segment crosses the cells."""

from typing import NamedTuple

import numpy as np
from mpi4py import MPI

from ..kernels.surface import facet_normal
from .distribute import LocalMesh

# of the reference coordinates: a point on a face belongs to the mesh in spite of rounding
TOLERANCE = 1e-8
NEWTON_STEPS = 20
ROUND_OFF = 1e-15  # of coordinates
NOWHERE = np.iinfo(np.int64).max
SHORT = 1e-9  # part of a segment that is none


class Located(NamedTuple):
    """Points in the cells of a mesh, the same on every rank: cell (P,), the natural number of that
    which holds the point, `NOWHERE` where none does; shape (P, A), its shape functions there.
    """

    cell: np.ndarray
    shape: np.ndarray

    @property
    def outside(self) -> np.ndarray:
        """Return which points no cell holds, (P,) bool."""
        return self.cell == NOWHERE

    def rows(self, mesh: LocalMesh, here: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the numbers of points, (R,), and the local cells that hold them, (R,), of those
        cells of this rank that are marked, (cells,) bool.
        """
        chosen = np.flatnonzero(here)
        natural = mesh.cell_natural[chosen]
        order = np.argsort(natural)
        place = np.searchsorted(natural[order], self.cell)
        place = np.minimum(place, max(len(chosen) - 1, 0))
        if not len(chosen):
            return np.zeros(0, dtype=int), np.zeros(0, dtype=int)
        cells = chosen[order[place]]
        points = np.flatnonzero(mesh.cell_natural[cells] == self.cell)
        return points, cells[points]


def locate(mesh: LocalMesh, points: np.ndarray, preferred: np.ndarray | None = None) -> Located:
    """Return the cells of points (P, d) [m]: of several that of the smallest natural number,
    preferred ones (cells,) bool first, so that it does not depend on the number of ranks
    (collective).
    """
    later = (
        np.zeros(len(mesh.cells), dtype=int)
        if preferred is None
        else mesh.n_cells_global * ~preferred
    )
    rank = mesh.cell_natural + later
    found = [_locate(mesh, rank, point) for point in points]
    order = np.array([cell for cell, _ in found], dtype=np.int64)
    winner = np.empty_like(order)
    mesh.comm.Allreduce(order, winner, op=MPI.MIN)
    mine = np.zeros((len(points), mesh.element.nodes))
    for row in np.flatnonzero((order == winner) & (winner != NOWHERE)):
        mine[row] = found[row][1]
    shape = np.empty_like(mine)
    mesh.comm.Allreduce(mine, shape)
    inside = winner != NOWHERE
    return Located(np.where(inside, winner % max(mesh.n_cells_global, 1), NOWHERE), shape)


def _locate(mesh, rank, point):
    """Return rank and N (A,) of the owned cell of lowest rank (cells,) that holds the point
    (NOWHERE: none does).
    """
    cells = np.flatnonzero(mesh.cell_owned)
    cells = cells[_near(mesh.X[mesh.cells[cells]], point)]
    xi = _reference_coordinates(mesh.element, mesh.X[mesh.cells[cells]], point)
    inside = mesh.element.cell.contains(xi, TOLERANCE)
    cells = cells[inside]
    xi = xi[inside]
    if len(cells) == 0:
        return NOWHERE, None
    first = np.argmin(rank[cells])
    return rank[cells[first]], mesh.element.shape(xi[[first]])[0]


def _near(X, point):
    """Mark the elements, X (E, A, d), whose box, widened by half its size for curved sides, holds
    the point.
    """
    low = X.min(axis=1)
    high = X.max(axis=1)
    margin = 0.5 * (high - low).max(axis=1, keepdims=True)
    return np.all((point >= low - margin) & (point <= high + margin), axis=1)


def _reference_coordinates(element, X, point):
    """Return xi (E, d) with sum_a N_a(xi) X_a = point: one Newton step where the map is
    affine, else to convergence.

    A Newton iteration that diverges ends in coordinates outside of the element or in NaN, which is
    outside too.
    """
    xi = np.tile(element.cell.centroid, (len(X), 1))
    digits_of = ROUND_OFF * np.abs(X).max(axis=(1, 2))
    with np.errstate(all="ignore"):
        for _ in range(1 if element.is_affine else NEWTON_STEPS):
            residual = point - np.einsum("ea,eai->ei", element.shape(xi), X)
            J = np.einsum("eai,eaj->eij", X, element.gradient(xi))
            found = np.abs(residual).max(axis=1) <= digits_of
            if found.all():
                break
            # where a side of a collapsed cell is a point, J is singular there
            xi = np.where(found[:, None], xi, xi + _solve(J, residual))
    return xi


def _solve(J, residual):
    """Return J^-1 residual for stacks of small matrices, NaN where J is singular."""
    det = np.linalg.det(J)
    regular = np.isfinite(det) & (det != 0)
    step = np.full_like(residual, np.nan)
    step[regular] = np.linalg.solve(J[regular], residual[regular][:, :, None])[:, :, 0]
    return step


def crossings(mesh: LocalMesh, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Return where a segment enters and leaves the cells, 0 = s_0 < … < s_n = 1, the same on every
    rank: exact where faces are plane (collective).
    """
    cells = mesh.cells[mesh.cell_owned]
    low, high = np.zeros(len(cells)), np.ones(len(cells))
    facet = mesh.element.facet
    for local in mesh.element.facets:
        x = mesh.X[cells[:, local]]
        normal = facet_normal(facet.gradient(facet.cell.centroid), np.ones(1), x)[:, 0]
        middle = np.einsum("a,fad->fd", facet.shape(facet.cell.centroid)[0], x)
        ahead = ((middle - start) * normal).sum(axis=1)
        speed = normal @ (end - start)
        with np.errstate(divide="ignore", invalid="ignore"):
            s = ahead / speed
        low = np.where(speed < 0, np.maximum(low, s), low)
        high = np.where(speed > 0, np.minimum(high, s), high)
        high = np.where((speed == 0) & (ahead < 0), -1.0, high)
    crossed = high - low > SHORT
    mine = np.concatenate([low[crossed], high[crossed]])
    found = np.unique(np.concatenate([*mesh.comm.allgather(mine), [0.0, 1.0]]))
    apart = np.diff(found) > SHORT
    inner = found[1:][apart]
    return np.concatenate([[0.0], inner[:-1], [1.0]]) if len(inner) else np.array([0.0, 1.0])
