"""Both phases in one matrix: the tangent of the monolithic Newton iteration on a fixed mesh (quasi-direct coupling)."""

import numpy as np

from ..errors import InputError
from ..linalg.solver import LinearSolver, direct_defaults
from ..stopwatch import timed


class Mixture:
    """One Newton step for (y, v_f, p), unknowns of a node together, with all off-diagonal tangents.

    The derivative by the moving mesh
    is left out, so the iteration is Newton's on a fixed mesh and converges linearly, but fast, where the mesh moves.
    """

    prefix = "mixture_"

    def __init__(self, solid, fluid, solid_setup, fluid_setup):
        """Take the phases and their setups."""
        self._solid, self._fluid, self._setup = solid, fluid, solid_setup
        self._mask = np.column_stack([solid_setup.dirichlet.mask, fluid_setup.mask[:, : solid.mesh.dim + 1]])
        self._matrix = self.solver = self._made_for = None
        self._linear = solid.is_linear and fluid.is_linear
        self.mesh, self.stopwatch, self.assemblies = solid.mesh, solid.stopwatch, 0

    def correct(self, solid_residual, fluid_residuals, rates):
        """Solve for the increments of both phases and add them to the trial states (collective)."""
        if not (self._linear and self._made_for == rates):
            self._assemble(rates)
            self._made_for = rates
        momentum, volume = fluid_residuals
        d = self.mesh.dim
        rhs = -np.column_stack([solid_residual.total, momentum.total, volume.total])
        increment = self.solver.solve(rhs.ravel()).reshape(rhs.shape)
        self._solid.add(increment[:, :d])
        self._fluid.add(increment[:, d:])

    @timed("assembly")
    def _assemble(self, rates):
        d, m = self.mesh.dim, 2 * self.mesh.dim + 1
        if self._matrix is None:
            self._matrix = self._setup.new_matrix(self.prefix, m, self._mask)
        values, skeleton = self._setup.element_view(self._matrix, m), self._solid.skeleton()
        for chunk, K in self._solid.trial_tangents(rates):
            values[chunk, :, :d, :, :d] = K
        for chunk, K in self._solid.exchange_tangents():
            values[chunk, :, :d, :, d:] = K
        for chunk, K in self._fluid.exchange_tangents(rates, skeleton):
            values[chunk, :, d:, :, :d] = K
        for chunk, K in self._fluid.trial_tangents(rates, skeleton):
            values[chunk, :, d:, :, d:] = K
        self._matrix.assemble()
        self.assemblies += 1
        if self.solver is None:
            self.solver = LinearSolver(self._matrix.mat, self.prefix, _direct())
        self.solver.refactor()


def _direct():
    defaults = direct_defaults()
    if defaults is None:
        advice = 'use coupling.scheme = "partitioned" or one rank'
        what = 'coupling.scheme = "monolithic" needs MUMPS on several ranks'
        raise InputError(f"{what}, which this PETSc lacks; {advice}")
    return defaults
