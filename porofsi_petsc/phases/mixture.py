"""Both phases in one matrix: the tangents of the monolithic Newton iterations."""

import numpy as np

from ..errors import InputError
from ..linalg.solver import LinearSolver, direct_defaults
from ..stopwatch import timed


class QuasiDirectMixture:
    """One Newton step for (y, v_f, p), unknowns of a node together, with all off-diagonal tangents on a fixed mesh.

    The derivative by the moving mesh is left out, so the iteration converges linearly, but fast, where the mesh moves.
    """

    prefix = "mixture_"

    def __init__(self, solid, fluid, solid_setup, fluid_setup):
        """Take the phases and their setups."""
        self._solid, self._fluid, self._setup, self._no_slip = solid, fluid, solid_setup, fluid_setup.no_slip
        self._mask = np.column_stack([solid_setup.dirichlet.mask, fluid_setup.mask[:, : solid.mesh.dim + 1]])
        self._matrix = self.solver = self._made_for = None
        self._linear = solid.is_linear and fluid.is_linear
        self.mesh, self.stopwatch, self.assemblies = solid.mesh, solid.stopwatch, 0

    def correct(self, solid_residual, fluid_residuals, rates):
        """Solve for the increments of both phases and add them to the trial states (collective)."""
        if not (self._linear and self._made_for == rates):
            self.assemble(rates)
            self._made_for = rates
        momentum, volume = fluid_residuals
        d = self.mesh.dim
        rhs = -np.column_stack([solid_residual.total, momentum.total, volume.total])
        increment = self.solver.solve(rhs.ravel()).reshape(rhs.shape)
        self._solid.add(increment[:, :d])
        self._fluid.add(increment[:, d:])

    @timed("assembly")
    def assemble(self, rates):
        """Make the matrix of the trial state (collective)."""
        m = 2 * self.mesh.dim + 1
        if self._matrix is None:
            self._matrix = self._setup.new_matrix(self.prefix, m, self._mask)
        values, skeleton = self._setup.element_view(self._matrix, m), self._solid.skeleton()
        self._fill(values, rates, skeleton)
        self._tie_walls(values)
        self._matrix.assemble()
        self.assemblies += 1
        if self.solver is None:
            self.solver = LinearSolver(self._matrix.mat, self.prefix, _direct())
        self.solver.refactor()

    def _fill(self, values, rates, skeleton):
        d = self.mesh.dim
        for chunk, K in self._solid.trial_tangents(rates):
            values[chunk, :, :d, :, :d] = K
        for chunk, K in self._solid.exchange_tangents():
            values[chunk, :, :d, :, d:] = K
        for chunk, K in self._fluid.exchange_tangents(rates, skeleton):
            values[chunk, :, d:, :, :d] = K
        for chunk, K in self._fluid.trial_tangents(rates, skeleton):
            values[chunk, :, d:, :, d:] = K

    def _tie_walls(self, values):
        """Add the columns of v_f to those of y at walls without slip, where the fluid takes the skeleton's velocity along."""
        wall, d = self._no_slip[self._solid.domain.cells], self.mesh.dim
        if wall.any():
            velocity_per_position = self._solid.scheme.rates(1.0, 0.0, 0.0, 0.0)[0]
            values[..., :d] += velocity_per_position * wall[:, None, None, :, None] * values[..., d : 2 * d]


class DirectMixture(QuasiDirectMixture):
    """The same with the derivative by the moving mesh: Newton's iteration, which converges quadratically."""

    def _fill(self, values, rates, skeleton):
        super()._fill(values, rates, skeleton)
        if not skeleton.moving_mesh:
            return
        d = self.mesh.dim
        for chunk, K in self._solid.shape_tangents(self._fluid.flow()):
            values[chunk, :, :d, :, :d] += K
        for chunk, K in self._fluid.shape_tangents(skeleton):
            values[chunk, :, d:, :, :d] += K


def _direct():
    defaults = direct_defaults()
    if defaults is None:
        advice = 'use coupling.scheme = "partitioned" or one rank'
        what = "a monolithic coupling.scheme needs MUMPS on several ranks"
        raise InputError(f"{what}, which this PETSc lacks; {advice}")
    return defaults
