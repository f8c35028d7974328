"""The saturated porous medium solved as one system: Newton's iteration with all off-diagonal
tangents (quasi-direct, direct).
"""

from mpi4py import MPI

from ..linalg.solver import LinearSolver
from ..phases.block import LinearBlock
from ..phases.coupling_data import MeshState, Rates
from ..phases.residual import Residual
from .medium import Medium
from .protocols import Fluid, MonolithicSystem, Solid


class MonolithicCoupling(Medium):
    """Newton's iteration for (y, v_f, p) together; what the partitioned scheme must reproduce to
    its tolerance.
    """

    def __init__(
        self,
        solid: Solid,
        fluid: Fluid,
        comm: MPI.Comm,
        tolerance: float,
        max_iterations: int,
        system: MonolithicSystem,
    ) -> None:
        """Take the medium and a system of `phases.monolithic`, which solves for both increments."""
        super().__init__(solid, fluid, comm, tolerance, max_iterations)
        self.system = system

    @property
    def blocks(self) -> dict[str, LinearBlock]:
        """Return the linear blocks by name."""
        return super().blocks | {"monolithic": self.system.block}

    @property
    def solvers(self) -> list[LinearSolver]:
        """Return the system's solver, whose time contains those of the phases."""
        solver = self.system.block.solver
        return [solver] if solver else []

    def _begin(self, t: float, rates: Rates, accepted: MeshState) -> None:
        """Start every step of a nonlinear problem with a new preconditioner, since a restart has no
        other.
        """
        solver = self.system.block.solver
        if solver and not (self.solid.is_linear and self.fluid.is_linear):
            solver.refactor()

    def _iterate(
        self,
        iteration: int,
        solid_residual: Residual,
        fluid_residuals: tuple[Residual, Residual],
        rates: Rates,
    ) -> None:
        self.system.correct(solid_residual, fluid_residuals, rates)
        self.convergence.force_per_rate = self.system.force_per_rate
