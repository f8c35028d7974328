"""The linear block of a phase: the matrix of its tangent and its KSP."""

from collections.abc import Callable, Iterable, Sequence

import numpy as np
from petsc4py import PETSc

from ..linalg.low_rank import Coupled, LowRankUpdate
from ..linalg.matrix import ElementMatrix
from ..linalg.solver import LinearSolver
from .setup import PhaseSetup


class LinearBlock:
    """H δ = r for m unknowns on each node of a domain, H the sum of element matrices and of terms b
    C aᵀ that couple whole surfaces.

    matrix, solver : None before the first assembly; assemblies : of the matrix so far
    """

    def __init__(
        self,
        setup: PhaseSetup,
        prefix: str,
        mask: np.ndarray,
        new_solver: Callable[[ElementMatrix], LinearSolver],
    ) -> None:
        """Take the setup, the prefix of the options, where an unknown is prescribed, (n_local, m)
        bool, and what makes the KSP of the matrix.
        """
        self._setup = setup
        self._prefix = prefix
        self.mask = mask
        self._new_solver = new_solver
        self.matrix: ElementMatrix | None = None
        self.solver: LinearSolver | None = None
        self.assemblies = 0
        self._coupled: tuple[Coupled, ...] = ()
        self._update: LowRankUpdate | None = None

    def assemble(
        self,
        element_matrices: Iterable[tuple[slice, np.ndarray]],
        coupled: Sequence[Coupled] = (),
    ) -> None:
        """Make the matrix of (slice of the elements, (E, A, m, A, m)) for all of them; coupled : on
        all m unknowns.  `refactor` or `renewed` follows (collective).
        """
        if self.matrix is None:
            self.matrix = self._setup.new_matrix(self._prefix, self.mask)
        self.matrix.clear()
        for chunk, values in element_matrices:
            self.matrix.add(chunk, values)
        self.matrix.finish()
        self.assemblies += 1
        self._update = None
        free = ~self.mask[: self._setup.domain.n_owned]
        self._coupled = tuple(term.where(free) for term in coupled if term.factor)
        if self.solver is None:
            self.solver = self._new_solver(self.matrix)

    def renewed(self) -> None:
        """Tell the KSP of new values; the reuse rule decides about the preconditioner."""
        assert self.solver is not None  # after an assembly
        self.solver.update()

    def refactor(self) -> None:
        """Tell the KSP of new values, for which the preconditioner is made anew."""
        assert self.solver is not None  # after an assembly
        self.solver.refactor()

    def solve(self, rhs: np.ndarray) -> np.ndarray:
        """Return δ, zero where it is prescribed and outside of the domain; both (n_owned, m)
        (collective).
        """
        increment = self._solve(rhs)
        if self._coupled:
            if self._update is None:
                comm = self._setup.domain.mesh.comm
                self._update = LowRankUpdate(comm, self._coupled, self._solve)
            increment = self._update.correct(increment)
        return increment

    def _solve(self, rhs):
        solution = np.zeros(rhs.shape)
        domain = self._setup.domain
        if not domain.n_nodes:
            return solution
        nodes = domain.nodes
        found = self.solver.solve(rhs[nodes].ravel())
        solution[nodes] = found.reshape(len(nodes), rhs.shape[1])
        # multigrid moves prescribed nodes within its tolerance
        return np.where(self.mask[: len(solution)], 0.0, solution)

    def use(self, matrix: PETSc.Mat) -> None:
        """Solve with another matrix of the same unknowns instead, which has the present values of
        this one, until the next assembly.
        """
        assert self.solver is not None  # after an assembly
        self._update = None
        self.solver.use(matrix)
