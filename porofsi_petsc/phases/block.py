"""The linear block of a phase: the matrix of its tangent and its KSP."""

from collections.abc import Callable, Iterable, Sequence

import numpy as np
from petsc4py import PETSc

from ..fem.essential import Transformation
from ..linalg.constrained import BlockMatrix, ConstrainedMatrix
from ..linalg.low_rank import Coupled, LowRankUpdate
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
        new_solver: Callable[[BlockMatrix], LinearSolver],
        constraints: Transformation | None = None,
    ) -> None:
        """Take the setup, the prefix of the options, where an unknown is prescribed, (n_local, m)
        bool, and what makes the KSP of the matrix.

        constraints : of the displacement, the first of the m unknowns
        """
        self._setup = setup
        self._prefix = prefix
        self.mask = mask
        self._new_solver = new_solver
        self._constraints = constraints
        self.matrix: BlockMatrix | None = None
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
            self.matrix = self._new_matrix()
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

    def _new_matrix(self):
        matrix = self._setup.new_matrix(self._prefix, self.mask)
        if self._constraints is None:
            return matrix
        domain = self._setup.domain
        T, P = self._constraints.transformation(domain, self.mask.shape[1])
        return ConstrainedMatrix(matrix, T, P)

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
        found = self._solve_free(rhs[nodes].ravel())
        solution[nodes] = found.reshape(len(nodes), rhs.shape[1])
        # multigrid moves prescribed nodes within its tolerance
        return np.where(self.mask[: len(solution)], 0.0, solution)

    def _solve_free(self, rhs):
        """Return the solution of the unknowns of this rank, (n,), under the constraints."""
        return self.expanded(self.solver.solve(self.reduced(rhs)))

    def reduced(self, rhs: np.ndarray) -> np.ndarray:
        """Return T^T r, both (n,); r itself without constraints (collective)."""
        return self.matrix.free(rhs) if isinstance(self.matrix, ConstrainedMatrix) else rhs

    def expanded(self, q: np.ndarray) -> np.ndarray:
        """Return T q, both (n,); q itself without constraints (collective)."""
        return self.matrix.expand(q) if isinstance(self.matrix, ConstrainedMatrix) else q

    def use(self, matrix: PETSc.Mat) -> None:
        """Solve with another matrix of the same unknowns instead, which has the present values of
        this one, until the next assembly.
        """
        assert self.solver is not None  # after an assembly
        self._update = None
        self.solver.use(matrix)
