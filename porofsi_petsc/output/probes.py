"""Values at reference points: where each lies is found once, the values are shape functions times
nodal values.
"""

from collections.abc import Sequence

import numpy as np
from mpi4py import MPI

from ..errors import InputError, digits
from ..fem.distribute import LocalMesh

# of the reference coordinates: a point on a face belongs to the mesh in spite of rounding
TOLERANCE = 1e-8
NEWTON_STEPS = 20
ROUND_OFF = 1e-15  # of coordinates
NOWHERE = np.iinfo(np.int64).max


class Probes:
    """Points fixed to the reference configuration.

    When several elements hold a point the one of the smallest natural number is taken, preferred
    ones first, so that the values do not depend on the number of ranks.
    """

    def __init__(
        self,
        mesh: LocalMesh,
        points: Sequence[tuple[str, Sequence[float] | np.ndarray]],
        preferred: np.ndarray | None = None,
        table: str = "[[probe]]",
    ) -> None:
        """Locate the points; collective.

        points : list of (name, coordinates (d,) [m]); preferred : (cells,) bool; table : of the
        scene, for messages.  Raises InputError for a point outside.
        """
        self.comm = mesh.comm
        self.names = [name for name, _ in points]
        later = (
            np.zeros(len(mesh.cells), dtype=int)
            if preferred is None
            else mesh.n_cells_global * ~preferred
        )
        rank = mesh.cell_natural + later
        found = [_locate(mesh, rank, np.asarray(point, dtype=float)) for _, point in points]
        natural = np.array([cell for cell, _, _ in found], dtype=np.int64)
        winner = np.empty_like(natural)
        self.comm.Allreduce(natural, winner, op=MPI.MIN)
        _refuse_outside(mesh, points, winner, table)
        self._rows = np.flatnonzero(natural == winner)
        self._nodes = np.array([found[i][1] for i in self._rows], dtype=int).reshape(
            -1, mesh.element.nodes
        )
        self._shape = np.array([found[i][2] for i in self._rows]).reshape(-1, mesh.element.nodes)

    def evaluate(self, array: np.ndarray) -> np.ndarray:
        """Return the values at the points, (n_probes, k), on every rank; collective.

        array : (n_local, k) nodal values with current ghosts.
        """
        array = np.asarray(array)
        mine = np.zeros((len(self.names), array.shape[1]))
        mine[self._rows] = np.einsum("pa,pak->pk", self._shape, array[self._nodes])
        values = np.empty_like(mine)
        self.comm.Allreduce(mine, values)
        return values


def _locate(mesh, rank, point):
    """Return rank, nodes (A,) and N (A,) of the owned cell of lowest rank (cells,) that holds the
    point (NOWHERE: none does).
    """
    cells = np.flatnonzero(mesh.cell_owned)
    cells = cells[_near(mesh.X[mesh.cells[cells]], point)]
    xi = _reference_coordinates(mesh.element, mesh.X[mesh.cells[cells]], point)
    inside = mesh.element.cell.contains(xi, TOLERANCE)
    cells = cells[inside]
    xi = xi[inside]
    if len(cells) == 0:
        return NOWHERE, None, None
    first = np.argmin(rank[cells])
    return rank[cells[first]], mesh.cells[cells[first]], mesh.element.shape(xi[[first]])[0]


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


def _refuse_outside(mesh, points, winner, table):
    low = mesh.X.min(axis=0, initial=np.inf)
    high = mesh.X.max(axis=0, initial=-np.inf)
    mesh.comm.Allreduce(MPI.IN_PLACE, low, op=MPI.MIN)
    mesh.comm.Allreduce(MPI.IN_PLACE, high, op=MPI.MAX)
    for (name, point), cell in zip(points, winner, strict=True):
        if cell == NOWHERE:
            box = " x ".join(f"[{digits(a)}, {digits(b)}]" for a, b in zip(low, high, strict=True))
            where = ", ".join(digits(x) for x in point)
            raise InputError(
                f"{table} '{name}': at = [{where}] lies outside of the mesh, expected a point of"
                f" it ({box} m)"
            )
