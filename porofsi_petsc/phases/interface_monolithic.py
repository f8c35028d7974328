"""Solid, free fluid and (direct) mesh in one matrix: the tangents of the monolithic Newton
iterations over an interface.
"""

import numpy as np

from ..fem.domain import Domain
from ..fem.transfer import InterfaceTransfer
from ..linalg.fieldsplit import monolithic_defaults
from ..linalg.low_rank import Coupled, padded
from ..linalg.solver import LinearSolver
from ..linalg.stopwatch import timed
from .block import LinearBlock
from .coupling_data import Rates
from .elastic_solid import ElasticSolid
from .free_fluid import FreeFluid
from .mesh_motion import MeshMotion
from .residual import Residual


class InterfaceSystem:
    """One Newton step for (u, v_f, p), unknowns of a node together, u of the solid or (direct) of
    the fluid's mesh.

    On the interface v_f = v_s: the columns of v_f go to u with c_v = dv_s/du, the rows of v_f,
    whose test function is that of the solid there, to the rows of u.  Where the fluid has nodes of
    its own, u there is P u_s of the `fem.transfer.InterfaceTransfer` and no unknown: columns go to
    the solid's by P, rows by Pᵀ.  Quasi-direct leaves out the derivative by the mesh and converges
    linearly; direct has it, the equation of the mesh included, and converges quadratically.
    """

    prefix = "monolithic_"

    def __init__(
        self,
        solid: ElasticSolid,
        fluid: FreeFluid,
        motion: MeshMotion,
        transfer: InterfaceTransfer,
        direct: bool,
    ) -> None:
        """Take the phases, the mesh motion, what crosses the interface, and the scheme."""
        self._solid = solid
        self._fluid = fluid
        self._motion = motion
        self._interface = transfer.fluid_nodes
        self._with_mesh = direct and motion.moves
        self._immersed = solid.setup.immersed
        self.mesh = solid.mesh
        self.stopwatch = solid.stopwatch
        self._domain = Domain(self.mesh)
        self._rows = [_rows_in(self._domain, part.domain) for part in (solid, fluid, motion)]
        self._mask = self._make_mask(solid.setup, fluid.setup, motion.setup, transfer.follows)
        self._whole = fluid.setup.on(self._domain)
        own = solid.setup.dirichlet.constraints
        constraints = transfer.eliminated(self._mask[:, : self.mesh.dim], own)
        self.block = LinearBlock(
            self._whole, self.prefix, self._mask, self._new_solver, constraints
        )
        self._linear = solid.is_linear and fluid.is_linear
        self._rates: Rates | None = None
        self.force_per_rate = float("inf")

    def _new_solver(self, matrix):
        """Return a factorization, in 3-D too: this matrix has no preconditioner of its own yet."""
        m = self._mask.shape[1]
        null = self._fluid.setup.constant_pressures(self._domain, m, m - 1)
        defaults = monolithic_defaults(direct=True)
        return LinearSolver(matrix.mat, self.prefix, defaults, null_vectors=null)

    def _make_mask(self, solid_setup, fluid_setup, mesh_setup, follows):
        d = self.mesh.dim
        in_solid = self._solid.domain.holds[:, None]
        of_mesh = (
            mesh_setup.mask if self._with_mesh else np.ones((self.mesh.n_local, d), dtype=bool)
        )
        outside = ~self._fluid.domain.holds[:, None]
        held = np.where(in_solid, solid_setup.mask, of_mesh) & ~follows[:, None]
        return np.column_stack([held, fluid_setup.mask | outside])

    def correct(
        self, solid_residual: Residual, fluid_residuals: tuple[Residual, Residual], rates: Rates
    ) -> None:
        """Solve for the increments of both phases and add them to the trial states (collective)."""
        if not (self._linear and self._rates == rates):
            self.assemble(rates)
        momentum, volume = fluid_residuals
        d = self.mesh.dim
        n = self.mesh.n_owned
        rhs = -np.column_stack([solid_residual.total, momentum.total, volume.total])
        increment = self.block.solve(rhs)
        self._solid.add(np.where(self._solid.domain.holds[:n, None], increment[:, :d], 0.0))
        self._fluid.add(increment[:, d:])

    @timed("assembly")
    def assemble(self, rates: Rates) -> None:
        """Make the matrix of the trial state (collective)."""
        values = self._whole.new_tangents(2 * self.mesh.dim + 1)
        self._rates = rates
        self._fill(values, rates)
        self.block.assemble([(slice(None), values)], self._coupled(rates))
        self.block.renewed()

    def _coupled(self, rates):
        """Return what couples whole surfaces, with v_f = v_s on the interface as in `_fill`."""
        d = self.mesh.dim
        tie = self._interface[: self.mesh.n_owned, None]
        found = padded(self._solid.coupled(rates), slice(d), 2 * d + 1)
        of_fluid = self._fluid.coupled(self._motion.mesh_state())
        for term in padded(of_fluid, slice(d, 2 * d), 2 * d + 1):
            on_interface = tie * term.vector[:, d : 2 * d]
            row, column = term.vector.copy(), term.vector
            row[:, :d] += on_interface
            column[:, :d] += rates.c_v * on_interface
            found.append(Coupled(row, term.factor, column))
        return found

    def _fill(self, values, rates):
        d = self.mesh.dim
        mesh_state = self._motion.mesh_state()
        of_solid, of_fluid, of_mesh = self._rows
        for chunk, K in self._solid.trial_tangents(rates):
            values[of_solid[chunk], :, :d, :, :d] += K
        for chunk, K in self._fluid.trial_tangents(rates, mesh_state):
            values[of_fluid[chunk], :, d:, :, d:] += K
        if self._immersed:
            for chunk, K in self._solid.drag_tangents():
                values[of_solid[chunk], :, :d, :, d:] += K
            for chunk, K in self._fluid.drag_tangents(rates, mesh_state):
                values[of_fluid[chunk], :, d:, :, :d] += K
        if self._with_mesh:
            for chunk, K in self._fluid.mesh_tangents(rates, mesh_state):
                values[of_fluid[chunk], :, d:, :, :d] += K
        if self._with_mesh and self._immersed:
            for chunk, K in self._solid.shape_tangents(self._fluid.flow()):
                values[of_solid[chunk], :, :d, :, :d] += K
        tie = self._interface[self._fluid.domain.cells][..., None]
        fluid = values[of_fluid]
        fluid[..., :d] += rates.c_v * tie[:, None, None] * fluid[..., d : 2 * d]
        fluid[:, :, :d] += tie[..., None, None] * fluid[:, :, d : 2 * d]
        values[of_fluid] = fluid
        if self._with_mesh:
            carried = self._motion.setup.carried
            inside = ~carried[self._motion.domain.cells][..., None, None, None]
            for chunk, K in self._motion.tangents():
                values[of_mesh[chunk], :, :d, :, :d] += inside[chunk] * K


def _rows_in(whole, part):
    """Return the rows in a domain of the elements of one of its parts, (E_part,)."""
    row_of_cell = part.row_of_cell
    rows = np.empty(part.n_cells, dtype=int)
    here = row_of_cell >= 0
    rows[row_of_cell[here]] = whole.row_of_cell[here]
    return rows
