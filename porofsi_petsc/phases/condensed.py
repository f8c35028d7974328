"""What a solid answers to forces on its interface with a fluid: its tangent, condensed to the
unknowns that both share.
"""

import numpy as np

from ..errors import InputError
from .elastic_solid import ElasticSolid
from .free_fluid import FreeFluid


class CondensedSolid:
    """The forces S δu that a change of the displacement of the interface asks for, S =
    [(H_ss⁻¹)_ΓΓ]⁻¹ (N, N) [N/m].

    Γ : the N unknowns of the interface, node by node, where no support and no prescribed velocity
    holds one; all else of the solid is in equilibrium.  H_ss is its tangent with inertia.  S is
    dense and symmetric, and every rank has it: an interface is a line in two dimensions.  It takes
    N solutions with the factored H_ss.
    """

    def __init__(self, solid: ElasticSolid, fluid: FreeFluid) -> None:
        """Take the two phases, which share the nodes of the interface (collective)."""
        self._solid = solid
        self._comm = solid.mesh.comm
        self._nodes, self._components = fluid.interface_unknowns.T
        counts = self._comm.allgather(len(self._nodes))
        first = sum(counts[: self._comm.rank])
        self._own = slice(first, first + len(self._nodes))
        self.size = sum(counts)
        self._stiffness: np.ndarray  # by `renew`

    @property
    def stiffness(self) -> np.ndarray:
        """Return S, in the order of the ranks and of `FreeFluid.interface_unknowns` on each."""
        return self._stiffness

    def renew(self) -> None:
        """Condense the present tangent of the solid (collective)."""
        solver = self._solid.block.solver
        if solver is None or not solver.direct:
            raise InputError(
                'coupling.interface = "condensed": received an iterative solver of the solid,'
                " expected a factorization; leave out the options -solid_… or take"
                ' "dirichlet_neumann"'
            )
        columns = np.empty((len(self._nodes), self.size))
        for j in range(self.size):
            unit = np.zeros(self.size)
            unit[j] = 1.0
            columns[:, j] = self._solid.solve(self._spread(unit))[self._nodes, self._components]
        flexibility = np.concatenate(self._comm.allgather(columns))
        stiffness = np.linalg.inv((flexibility + flexibility.T) / 2)
        self._stiffness = (stiffness + stiffness.T) / 2

    def force(self, displacement: np.ndarray) -> np.ndarray:
        """Return S times a displacement (n_owned, d) [m] on the nodes of the interface, (n_owned,
        d) [N] (collective).
        """
        own = displacement[self._nodes, self._components]
        return self._spread(self._stiffness @ np.concatenate(self._comm.allgather(own)))

    def _spread(self, values):
        """Return values of the unknowns, (N,), on their nodes, (n_owned, d), zero elsewhere."""
        field = np.zeros((self._solid.mesh.n_owned, self._solid.mesh.dim))
        field[self._nodes, self._components] = values[self._own]
        return field
