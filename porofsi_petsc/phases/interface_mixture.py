"""Solid, free fluid and (direct) mesh in one matrix: the tangents of the monolithic Newton
iterations over an interface.
"""

import numpy as np

from ..fem.domain import Domain
from ..linalg.fieldsplit import mixture_defaults
from ..linalg.solver import LinearSolver
from ..linalg.stopwatch import timed


class InterfaceMixture:
    """One Newton step for (u, v_f, p), unknowns of a node together, u of the solid or (direct) of
    the fluid's mesh.

    On the interface v_f = v_s: the columns of v_f go to u with c_v = dv_s/du, the rows of v_f,
    whose test function is that of the solid there, to the rows of u.  Quasi-direct leaves out the
    derivative by the mesh and converges linearly; direct has it, the equation of the mesh included,
    and converges quadratically.
    """

    prefix = "mixture_"

    def __init__(self, solid, fluid, motion, setups, interface, direct):
        """Take the phases, the mesh motion, their (solid, fluid, mesh) setups, the interface
        (n_local,) bool, and the scheme.
        """
        self._solid = solid
        self._fluid = fluid
        self._motion = motion
        self._interface = interface
        self._with_mesh = direct and motion.moves
        self._immersed = setups[0].immersed
        self._setup = setups[1]
        self.mesh = solid.mesh
        self.stopwatch = solid.stopwatch
        self._domain = Domain(self.mesh)
        self._rows = [_rows_in(self._domain, part.domain) for part in (solid, fluid, motion)]
        self._mask = self._make_mask(*setups)
        self._matrix = self.solver = None
        self._linear = solid.is_linear and fluid.is_linear
        self._rates = None
        self.assemblies = 0
        self.force_per_rate = float("inf")

    def _make_mask(self, solid_setup, fluid_setup, mesh_setup):
        d = self.mesh.dim
        in_solid = self._solid.domain.holds[:, None]
        of_mesh = (
            mesh_setup.mask if self._with_mesh else np.ones((self.mesh.n_local, d), dtype=bool)
        )
        outside = ~self._fluid.domain.holds[:, None]
        return np.column_stack(
            [np.where(in_solid, solid_setup.mask, of_mesh), fluid_setup.mask | outside]
        )

    def correct(self, solid_residual, fluid_residuals, rates):
        """Solve for the increments of both phases and add them to the trial states (collective)."""
        if not (self._linear and self._rates == rates):
            self._assemble(rates)
        momentum, volume = fluid_residuals
        d = self.mesh.dim
        n = self.mesh.n_owned
        rhs = -np.column_stack([solid_residual.total, momentum.total, volume.total])
        increment = np.where(self._mask[:n], 0.0, self.solver.solve(rhs.ravel()).reshape(n, -1))
        self._solid.add(np.where(self._solid.domain.holds[:n, None], increment[:, :d], 0.0))
        self._fluid.add(increment[:, d:])

    @timed("assembly")
    def _assemble(self, rates):
        m = 2 * self.mesh.dim + 1
        whole = self._setup.on(self._domain)
        if self._matrix is None:
            self._matrix = whole.new_matrix(self.prefix, m, self._mask)
        values = whole.new_tangents(m)
        self._rates = rates
        self._fill(values, rates)
        self._matrix.assemble(values)
        self.assemblies += 1
        if self.solver is None:
            # a factorization in 3-D too: this matrix has no preconditioner of its own yet
            null = self._setup.constant_pressures(self._domain, m, m - 1)
            self.solver = LinearSolver(
                self._matrix.mat, self.prefix, mixture_defaults(direct=True), null_vectors=null
            )
        self.solver.update()

    def _fill(self, values, rates):
        d = self.mesh.dim
        skeleton = self._motion.skeleton()
        of_solid, of_fluid, of_mesh = self._rows
        for chunk, K in self._solid.trial_tangents(rates):
            values[of_solid[chunk], :, :d, :, :d] += K
        for chunk, K in self._fluid.trial_tangents(rates, skeleton):
            values[of_fluid[chunk], :, d:, :, d:] += K
        if self._immersed:
            for chunk, K in self._solid.drag_tangents():
                values[of_solid[chunk], :, :d, :, d:] += K
            for chunk, K in self._fluid.drag_tangents(rates, skeleton):
                values[of_fluid[chunk], :, d:, :, :d] += K
        if self._with_mesh:
            for chunk, K in self._fluid.mesh_tangents(rates, skeleton):
                values[of_fluid[chunk], :, d:, :, :d] += K
        tie = self._interface[self._fluid.domain.cells][..., None]
        fluid = values[of_fluid]
        fluid[..., :d] += rates.c_v * tie[:, None, None] * fluid[..., d : 2 * d]
        fluid[:, :, :d] += tie[..., None, None] * fluid[:, :, d : 2 * d]
        values[of_fluid] = fluid
        if self._with_mesh:
            inside = ~self._solid.domain.holds[self._motion.domain.cells][..., None, None, None]
            for chunk, K in self._motion.tangents():
                values[of_mesh[chunk], :, :d, :, :d] += inside[chunk] * K


def _rows_in(whole, part):
    """Return the rows in a domain of the elements of one of its parts, (E_part,)."""
    row_of_cell = part.row_of_cell
    rows = np.empty(part.n_cells, dtype=int)
    here = row_of_cell >= 0
    rows[row_of_cell[here]] = whole.row_of_cell[here]
    return rows
