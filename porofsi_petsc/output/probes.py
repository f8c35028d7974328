"""Values at reference points: where each lies is found once, the values are shape functions times
nodal values.
"""

from collections.abc import Sequence

import numpy as np
from mpi4py import MPI

from ..errors import InputError, digits
from ..fem.distribute import LocalMesh
from ..fem.locate import locate


class Probes:
    """Points fixed to the reference configuration.

    When several elements hold a point the one of the smallest natural number is taken, preferred
    ones first, so that the values do not depend on the number of ranks.

    in_preferred : (n_probes,) bool, which points are in preferred ones
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
        X = np.array([point for _, point in points], dtype=float).reshape(-1, mesh.dim)
        found = locate(mesh, X, preferred)
        _refuse_outside(mesh, points, found.outside, table)
        self._rows, cells = found.rows(mesh, mesh.cell_owned)
        self._nodes = mesh.cells[cells]
        self._shape = found.shape[self._rows]
        here = np.zeros(len(points), dtype=np.int64)
        here[self._rows] = True if preferred is None else preferred[cells]
        counts = np.empty_like(here)
        self.comm.Allreduce(here, counts)
        self.in_preferred = counts > 0

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


def _refuse_outside(mesh, points, outside, table):
    low = mesh.X.min(axis=0, initial=np.inf)
    high = mesh.X.max(axis=0, initial=-np.inf)
    mesh.comm.Allreduce(MPI.IN_PLACE, low, op=MPI.MIN)
    mesh.comm.Allreduce(MPI.IN_PLACE, high, op=MPI.MAX)
    for (name, point), missed in zip(points, outside, strict=True):
        if missed:
            box = " x ".join(f"[{digits(a)}, {digits(b)}]" for a, b in zip(low, high, strict=True))
            where = ", ".join(digits(x) for x in point)
            raise InputError(
                f"{table} '{name}': at = [{where}] lies outside of the mesh, expected a point of"
                f" it ({box} m)"
            )
