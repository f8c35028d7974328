"""PETSc Python preconditioner of the pressure block: multigrid in unscaled variables in which the
auxiliary field is not tied.

    P = [ C + B_m   -B_m       ]     B_m mass, C and B_L Laplacians (without the auxiliary field s
    only C + B_m)
        [ -B_m      B_m + B_L  ]

On small steps B_m is hundreds of times C and B_L at the scale of the mesh: p and s move together
and the weak sum carries the problem.  Multigrid does not see it: hypre counts only the ties as
strong, smoothed aggregation divides by a diagonal that holds only the tie.  In the variables (p, q
= p - s) the tie is a mass matrix in q alone and p keeps a Laplacian,

    TᵀPT = [ C + B_L   -B_L      ]     T = [ 1   0 ]
           [ -B_L      B_m + B_L ]         [ 1  -1 ]

On large steps B_L >> B_m, and there (p, s) are the decoupled ones.  The mean tie decides for the
whole mesh: nodes with different pairs side by side cost more than the wrong pair (a choice node by
node took up to 76 iterations on quadratic triangles). `LinearSolver` solves for D^½ x (a unit
diagonal), in which the constants that multigrid wants are not constant: W = D^½ T.
"""

import numpy as np
from petsc4py import PETSc

# The pair is (p, p - s) above this mean of B_m/(B_m + B_L).  Chosen on quadratic triangles, where
# it matters: at 0.96 … 0.97 (p, s) takes 15 … 20 iterations and (p, p - s) up to 47, at 0.98 … 0.99
# they take 22 … 47 and 10 … 17.  Linear ones at most 10.
TIED = 0.975


class PressureMultigrid:
    """Precondition P by W M⁻¹ Wᵀ, M⁻¹ a multigrid cycle on WᵀPW; the inner preconditioner has this
    one's prefix and `inner_`.

    The near-null space of the matrix, where it has one, is the image D^½ 1 of the constants (see
    `solver.LinearSolver`).
    """

    def create(self, pc: PETSc.PC) -> None:
        """Start without an inner preconditioner."""
        self._parts: tuple[PETSc.Object, ...] = ()

    def setUp(self, pc: PETSc.PC) -> None:
        """Change the variables and set the inner preconditioner up (collective)."""
        matrix = pc.getOperators()[1]
        self.destroy(pc)
        self._inner = PETSc.PC().create(matrix.comm)
        self._inner.setOptionsPrefix((pc.getOptionsPrefix() or "") + "inner_")
        self._inner.setFromOptions()
        # hypre takes blocks for separate functions and then does not see the couplings between them
        # (fails on small steps)
        block_size = 1 if self._inner.getType() == PETSc.PC.Type.HYPRE else matrix.getBlockSize()
        self._W = _change_of_variables(matrix, block_size)
        self._changed = matrix.PtAP(self._W)
        self._inner.setOperators(self._changed)
        self._inner.setUp()
        self._x, self._y = self._changed.createVecs()
        self._parts = self._inner, self._changed, self._W, self._x, self._y

    def apply(self, pc: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Set y to W M⁻¹ Wᵀ x."""
        self._W.multTranspose(x, self._x)
        self._inner.apply(self._x, self._y)
        self._W.mult(self._y, y)

    def destroy(self, pc: PETSc.PC) -> None:
        """Free the PETSc objects (collective)."""
        for part in self._parts:
            part.destroy()
        self._parts = ()


def _change_of_variables(matrix, block_size):
    """Return W with node blocks t_p (without s), diag(t_p, t_s), or [t_p 0; t_s -t_s] where the
    ties are strong (collective).
    """
    scale = _scale(matrix)
    first = matrix.getOwnershipRange()[0]
    row = np.arange(len(scale))
    indptr = np.arange(len(scale) + 1)
    columns = first + row
    values = scale
    if matrix.getBlockSize() == 2:
        ties = _ties(matrix, scale)
        total, count = matrix.comm.tompi4py().allreduce(
            np.array([ties.sum(), np.count_nonzero(ties)])
        )
        tied = np.where(ties > 0, 1.0, 0.0) if total > TIED * count else np.zeros(len(ties))
        p = first + row[::2]
        indptr = np.r_[0, np.column_stack([3 * row[::2] // 2 + 1, 3 * row[::2] // 2 + 3]).ravel()]
        columns = np.column_stack([p, p, p + 1])
        values = np.column_stack([scale[::2], tied * scale[1::2], (1 - 2 * tied) * scale[1::2]])
    csr = indptr.astype(PETSc.IntType), columns.ravel().astype(PETSc.IntType), values.ravel()
    return PETSc.Mat().createAIJ(matrix.getSizes(), bsize=block_size, csr=csr, comm=matrix.comm)


def _scale(matrix):
    """Return D^½ of the owned rows up to a factor; 1 where the matrix has no near-null space."""
    space = matrix.getNearNullSpace()
    vectors = space.getVecs() if space.handle else []
    return (
        vectors[0].getArray(readonly=True).copy() if vectors else np.ones(matrix.getLocalSize()[0])
    )


def _ties(matrix, scale):
    """Return B_m/(B_m + B_L) = -P_sp/P_ss of the unscaled matrix at the owned nodes, (n,); 0 where
    p or s is prescribed.
    """
    indptr, indices, values = matrix.getDiagonalBlock().getValuesCSR()
    row = np.repeat(np.arange(len(indptr) - 1), np.diff(indptr))
    tie = np.zeros(len(indptr) // 2)
    own = (row % 2 == 1) & (indices == row - 1)
    tie[row[own] // 2] = -values[own]
    return tie * scale[::2] / (scale[1::2] * matrix.getDiagonal().getArray(readonly=True)[1::2])
