"""Both phases in one matrix: the tangents of the monolithic Newton iterations."""

import numpy as np
from petsc4py import PETSc

from ..linalg.fieldsplit import monolithic_defaults
from ..linalg.low_rank import padded
from ..linalg.solver import LinearSolver
from ..linalg.stopwatch import timed
from .block import LinearBlock
from .coupling_data import Rates
from .pore_fluid import PoreFluid
from .residual import Residual
from .skeleton import Skeleton


class QuasiDirectSystem:
    """One Newton step for (y, v_f, p), unknowns of a node together, with all off-diagonal tangents
    on a fixed mesh.

    The derivative by the moving mesh is left out, so the iteration converges linearly, but fast,
    where the mesh moves.

    Variables.  At low permeability the drag S c_v between y and v_f is many orders above everything
    else.  The matrix therefore has the unknowns (y, w, p), v_f = w + χ c_v y with the part χ = S/(S
    + ρ_f c_f) of the fluid that the drag carries along, and the balance of the skeleton with χ
    times that of the fluid.  Drag and inertia then couple y and w no more (exactly, where χ is
    constant), and K_yy has the mass ρ_s c_a + χ ρ_f c_f c_v of the corrected split.

    Scales.  The unknowns are lengths and the rows forces: w counts in units of c_v, p and the
    volume balance in units in which their blocks K_yp and K_py have the norm of K_yy.  Else the
    residual of an iterative solver mixes N and m³/s.
    """

    prefix = "monolithic_"

    def __init__(self, solid: Skeleton, fluid: PoreFluid) -> None:
        """Take the phases."""
        self._solid = solid
        self._fluid = fluid
        self._no_slip = fluid.setup.no_slip[:, None]
        d = solid.mesh.dim
        self._mask = np.column_stack([solid.setup.dirichlet.mask, fluid.setup.mask[:, : d + 1]])
        self._free_velocity = ~self._mask[:, d : 2 * d]
        self._combined = self._free_velocity & ~self._mask[:, :d]
        self.rates: Rates | None = None
        constraints = solid.setup.dirichlet.constraints
        self.block = LinearBlock(
            solid.setup, self.prefix, self._mask, self._new_solver, constraints
        )
        self._linear = solid.is_linear and fluid.is_linear
        self.mesh = solid.mesh
        self.stopwatch = solid.stopwatch
        self._wet = solid.domain.rows_of(fluid.domain)

    def _new_solver(self, matrix):
        sweep = PhaseSweep(self, self._solid, self._fluid)
        defaults = monolithic_defaults(self._solid.setup.direct)
        return LinearSolver(matrix.mat, self.prefix, defaults, preconditioner=sweep)

    def correct(
        self, solid_residual: Residual, fluid_residuals: tuple[Residual, Residual], rates: Rates
    ) -> None:
        """Solve for the increments of both phases and add them to the trial states (collective)."""
        if not (self._linear and self.rates == rates):
            self.assemble(rates)
        momentum, volume = fluid_residuals
        d = self.mesh.dim
        rhs = -np.column_stack([solid_residual.total, momentum.total, volume.total])
        increment = self.separated(self.block.solve(self.combined(rhs)))
        self._solid.add(increment[:, :d])
        self._fluid.add(increment[:, d:])

    def combined(self, balances: np.ndarray) -> np.ndarray:
        """Return the right-hand side of the matrix for those of the balances of solid, fluid and
        volume, both (n_owned, 2 d + 1): the skeleton's with χ times the fluid's, scaled.
        """
        d = self.mesh.dim
        rhs = balances.copy()
        rhs[:, :d] += _product(self._added[: len(rhs)], rhs[:, d : 2 * d])
        return rhs * self._rows

    def separated(self, solution: np.ndarray) -> np.ndarray:
        """Return the increments of (y, v_f, p) of a solution of the matrix, both (n_owned, 2 d +
        1).
        """
        d = self.mesh.dim
        increment = solution * self._columns
        tied = _product(self._tie[: len(increment)], increment[:, :d])
        increment[:, d : 2 * d] += np.where(self._free_velocity[: len(increment)], tied, 0.0)
        return increment

    @timed("assembly")
    def assemble(self, rates: Rates) -> None:
        """Make the matrix of the trial state (collective)."""
        values = self._solid.setup.new_tangents(2 * self.mesh.dim + 1)
        self.rates = rates
        self._fill(values, rates, self._solid.mesh_state())
        self._combine(values)
        self._scale(values)
        self.block.assemble([(slice(None), values)], self._coupled(rates))
        self.block.renewed()

    def _coupled(self, rates):
        """Return what couples whole surfaces of the skeleton; its rows and columns have no other
        scale.
        """
        return padded(self._solid.coupled(rates), slice(self.mesh.dim), 2 * self.mesh.dim + 1)

    def _fill(self, values, rates, mesh_state):
        d = self.mesh.dim
        for chunk, K in self._solid.trial_tangents(rates):
            values[chunk, :, :d, :, :d] = K
        for chunk, K in self._solid.exchange_tangents(rates):
            values[chunk, :, :d, :, d:] = K
        for chunk, K in self._fluid.exchange_tangents(rates, mesh_state):
            values[self._wet[chunk], :, d:, :, :d] = K
        for chunk, K in self._fluid.trial_tangents(rates, mesh_state):
            values[self._wet[chunk], :, d:, :, d:] = K

    def _combine(self, values):
        """Change the variables of the element matrices in place; walls without slip take the fluid
        along (collective).

        _tie : (n_local, d) dv_f/dy for constant w [1/s]; _added : (n_local, d) what the skeleton's
        rows take of the fluid's; tensors (n_local, d, d) where the drag has principal axes
        """
        chi = self._fluid.dragged_part(self._solid.mesh_state(), self.rates)
        velocity_per_position = self._solid.scheme.rates(1.0, 0.0, 0.0, 0.0)[0]
        if chi.ndim == 3:
            self._combine_tensors(values, chi, velocity_per_position)
            return
        d = self.mesh.dim
        cells = self._solid.domain.cells
        self._added = np.where(self._combined, chi[:, None], 0.0)
        self._tie = np.where(self._no_slip, velocity_per_position, self.rates.c_v * self._added)
        values[..., :d] += self._tie[cells][:, None, None] * values[..., d : 2 * d]
        values[:, :, :d] += self._added[cells][..., None, None] * values[:, :, d : 2 * d]

    def _combine_tensors(self, values, chi, velocity_per_position):
        """Change the variables with tensors χ (n_local, d, d): columns by χ, rows by its
        transpose.
        """
        d = self.mesh.dim
        cells = self._solid.domain.cells
        moving = ~self._mask[:, None, :d]
        chi = np.where(self._free_velocity[..., None] & moving, chi, 0.0)
        self._added = np.swapaxes(chi, 1, 2)
        wall = velocity_per_position * np.eye(d)
        self._tie = np.where(self._no_slip[..., None], wall, self.rates.c_v * chi)
        tie, added = self._tie[cells], self._added[cells]
        for i, j in np.ndindex(d, d):
            values[..., j] += tie[:, None, None, :, i, j] * values[..., d + i]
        for i, j in np.ndindex(d, d):
            values[:, :, i] += added[:, :, i, j, None, None] * values[:, :, d + j]

    def _scale(self, values):
        """Scale rows and columns of the element matrices in place (collective)."""
        d = self.mesh.dim
        blocks = values[..., :d, :, :d], values[..., :d, :, 2 * d], values[..., 2 * d, :, :d]
        owned = (
            self._solid.domain.owned
        )  # an element counts once, so that the scales do not depend on the number of ranks
        squares = np.array(
            [(block**2).sum(axis=tuple(range(1, block.ndim)))[owned].sum() for block in blocks]
        )
        stiffness, gradient, divergence = np.sqrt(self.mesh.comm.allreduce(squares))
        self._rows = np.r_[np.ones(2 * d), stiffness / divergence]
        self._columns = np.r_[np.ones(d), np.full(d, self.rates.c_v), stiffness / gradient]
        values *= self._rows[:, None, None] * self._columns

    @property
    def force_per_rate(self) -> float:
        """Return the weight of the volume balance in forces [N s/m³]."""
        return self._rows[-1]

    def to_forces(self, vector: np.ndarray) -> np.ndarray:
        """Return a right-hand side in [N] and [m³/s], (n_owned, 2 d + 1), from the array of a
        vector of the solver.
        """
        return self.block.expanded(vector).reshape(-1, len(self._rows)) / self._rows

    def to_solver(self, increment: np.ndarray) -> np.ndarray:
        """Return the array of a vector of the solver from an increment of (y, w, p), (n_owned, 2 d
        + 1).
        """
        return self.block.reduced((increment / self._columns).ravel())


def _product(nodal, vectors):
    """Return factors (n, d) of the components or tensors (n, d, d) times vectors (n, d)."""
    return nodal * vectors if nodal.ndim == 2 else np.einsum("nij,nj->ni", nodal, vectors)


class DirectSystem(QuasiDirectSystem):
    """The same with the derivative by the moving mesh: Newton's iteration, which converges
    quadratically.
    """

    def _fill(self, values, rates, mesh_state):
        super()._fill(values, rates, mesh_state)
        if not mesh_state.moving_mesh:
            return
        d = self.mesh.dim
        for chunk, K in self._solid.shape_tangents(self._fluid.flow()):
            values[chunk, :, :d, :, :d] += K
        for chunk, K in self._fluid.shape_tangents(mesh_state):
            values[self._wet[chunk], :, d:, :, :d] += K


class PhaseSweep:
    """PETSc Python preconditioner of a monolithic system: one Gauss-Seidel sweep over the phases by
    the tangents of the corrected split.

    (w, p) first, by the fluid's tangent with the skeleton's answer, then y.  The blocks are the
    phases' own solvers, options -fluid_ and -solid_.
    """

    def __init__(self, system: QuasiDirectSystem, solid: Skeleton, fluid: PoreFluid) -> None:
        """Take the system, whose variables the vectors have, and the phases of the corrected
        split.
        """
        self._system = system
        self._solid = solid
        self._fluid = fluid

    def setUp(self, pc: PETSc.PC) -> None:
        """Renew the tangents of both phases at the trial state (collective)."""
        rates = self._system.rates
        assert rates is not None  # those of the matrix
        self._fluid.renew_tangent(rates, self._solid.mesh_state())
        self._solid.renew_tangent(rates)

    def apply(self, pc: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Set y to the increments of a sweep with the right-hand side x (collective)."""
        system = self._system
        d = self._solid.mesh.dim
        rhs = system.to_forces(x.getArray(readonly=True))
        increment = np.zeros(rhs.shape)
        increment[:, d:] = self._fluid.solve(rhs[:, d:])
        y.setArray(system.to_solver(increment))
        image = x.duplicate()
        pc.getOperators()[0].mult(y, image)
        rest = rhs - system.to_forces(image.getArray(readonly=True))
        image.destroy()
        increment[:, :d] = self._solid.solve(rest[:, :d])
        y.setArray(system.to_solver(increment))
