"""The saturated porous medium solved as one system: Newton's iteration with all off-diagonal
tangents (quasi-direct, direct).
"""

from mpi4py import MPI

from ..linalg.solver import LinearSolver
from ..phases.residual import Residual
from ..phases.transfer import Rates, Skeleton
from .medium import Medium
from .protocols import Block, Fluid, Mixture, Solid


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
    def blocks(self) -> dict[str, Block]:
        """Return what assembles and solves, name -> object with `solver` and `assemblies`."""
        return super().blocks | {"mixture": self.mixture}

    @property
    def solvers(self) -> list[LinearSolver]:
        """Return the mixture's solver, whose time contains those of the phases."""
        return [self.mixture.solver] if self.mixture.solver else []

    def _begin(self, t: float, rates: Rates, accepted: Skeleton) -> None:
        """Start every step of a nonlinear problem with a new preconditioner, since a restart has no
        other.
        """
        if self.mixture.solver and not (self.solid.is_linear and self.fluid.is_linear):
            self.mixture.solver.refactor()

    def _iterate(
        self,
        iteration: int,
        solid_residual: Residual,
        fluid_residuals: tuple[Residual, Residual],
        rates: Rates,
    ) -> None:
        self.mixture.correct(solid_residual, fluid_residuals, rates)
        self.convergence.force_per_rate = self.mixture.force_per_rate
