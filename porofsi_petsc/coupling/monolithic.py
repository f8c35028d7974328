"""The saturated porous medium solved as one system: Newton's iteration with all off-diagonal
tangents (quasi-direct, direct).
"""

from mpi4py import MPI

from ..linalg.solver import LinearSolver
from ..phases.block import LinearBlock
from ..phases.coupling_data import MeshState, Rates
from ..phases.residual import Residual
from .medium import Medium
from .protocols import Fluid, Mixture, Solid


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
        mixture: Mixture,
    ) -> None:
        """Take the medium and a mixture of `phases.mixture`, which solves for both increments."""
        super().__init__(solid, fluid, comm, tolerance, max_iterations)
        self.mixture = mixture

    @property
    def blocks(self) -> dict[str, LinearBlock]:
        """Return the linear blocks by name."""
        return super().blocks | {"mixture": self.mixture.block}

    @property
    def solvers(self) -> list[LinearSolver]:
        """Return the mixture's solver, whose time contains those of the phases."""
        solver = self.mixture.block.solver
        return [solver] if solver else []

    def _begin(self, t: float, rates: Rates, accepted: MeshState) -> None:
        """Start every step of a nonlinear problem with a new preconditioner, since a restart has no
        other.
        """
        solver = self.mixture.block.solver
        if solver and not (self.solid.is_linear and self.fluid.is_linear):
            solver.refactor()

    def _iterate(
        self,
        iteration: int,
        solid_residual: Residual,
        fluid_residuals: tuple[Residual, Residual],
        rates: Rates,
    ) -> None:
        self.mixture.correct(solid_residual, fluid_residuals, rates)
        self.convergence.force_per_rate = self.mixture.force_per_rate
