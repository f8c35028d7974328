"""Linear solver: one KSP made once, with its rule for reusing the preconditioner, its statistics
and its errors.
"""

import atexit
import time
from collections.abc import Mapping, Sequence

import numpy as np
from petsc4py import PETSc

from ..errors import ConvergenceError, InputError
from ..log import logger
from ..streams import drop_unread
from .nullspace import NullSpace, NullVector
from .options import has_package, is_default, reason_of, set_defaults
from .stopwatch import stage

REUSE_FACTOR = 1.5
REUSE_OFFSET = 2
# Option of MUMPS with which it counts the negative pivots of all ranks: a root on one of them.
COUNTED = {"mat_mumps_icntl_13": 1}
NEGATIVE_PIVOTS = 12  # which of MUMPS' INFOG is their number
RESTART = 100  # of GMRES; with PETSc's 30 it stalls on matrices that are nearly singular as well
_REASONS = {
    number: name
    for name, number in vars(PETSc.KSP.ConvergedReason).items()
    if not name.startswith("_")
}
_INDEFINITE = (
    PETSc.KSP.ConvergedReason.DIVERGED_INDEFINITE_MAT,
    PETSc.KSP.ConvergedReason.DIVERGED_INDEFINITE_PC,
)
_MISSING = (86, 92)  # PETSC_ERR_UNKNOWN_TYPE, PETSC_ERR_MISSING_FACTOR
_NOT_CONVERGED = 91  # PETSC_ERR_NOT_CONVERGED, instead of a reason with -ksp_error_if_not_converged
_FILES = (65, 66, 67)  # PETSC_ERR_FILE_OPEN, _READ, _WRITE
_UNFIT = (
    56,
    60,
    62,
    73,
    75,
    83,
)  # PETSC_ERR_SUP, _ARG_SIZ, _ARG_WRONG, _ARG_WRONGSTATE, _ARG_INCOMP, _USER
# strong references: the garbage collector runs at different times on the ranks, and an end is
# collective
_living: list = []


@atexit.register
def _destroy_all():
    """Destroy every solver in order of creation: a Python preconditioner alive at exit crashes
    PETSc 3.18.
    """
    for solver in [*_living]:
        solver.destroy()


class LinearSolver:
    """Solve A x = b repeatedly while the values of A change.

    matrix         : PETSc.Mat, its values replaced in place by the caller
    prefix         : options prefix of the KSP and of the matrix (MUMPS' options hang on the matrix)
    defaults       : options (without the prefix) for what the user leaves open
    near_nullspace : arrays of the owned rows (`rigid_body_modes`), for algebraic multigrid
    fields         : dict name -> PETSc.IS, the splits "v" and "p" of a FieldSplit preconditioner
    preconditioner : object with setUp(pc) and apply(pc, x, y), used where the type is python and no
    -pc_python_type is given:
                     of the whole matrix, or of the field "p" of a FieldSplit
    null_vectors   : `NullVector`s of a singular matrix, orthogonal to each other

    Scaling.  With fields an iterative solver works on D^-½ A D^-½ with a unit diagonal, since rtol
    must weigh newtons and cubic metres per second.  The matrix is scaled in place, once for every
    assembly (PETSc's -ksp_diagonal_scale with _fix does it twice in every solve, which takes time
    and the last digits: docs/solvers.md); the field "p" gets D^½ 1 as its near-null space.

    Reuse rule.  After `update` an iterative solver keeps its old preconditioner as long as the last
    solve took at most 1.5 n + 2 iterations, n the number at the first solve after it was built;
    then, or when a solve with it fails, it is rebuilt.  Measured on 3-D elasticity with GAMG: the
    total time of a Newton sequence halves, since a set-up costs about as much as ten iterations;
    the 2 keeps solvers with few iterations from being rebuilt over one more.  A direct solver
    factors after each `update`; who wants the old factor (modified Newton) does not call it.
    Subdomain solvers of block Jacobi can be ahead of the rule: PETSc lets them see the diagonal
    block itself.

    Indefinite matrices.  Newton's iteration meets them far from the solution.  CG breaks down on
    them, where it is the default; such a solve is done again by GMRES, with the same
    preconditioner.  The next one begins with CG, so that a restart needs to know of none.

    solves, indefinite (solves that GMRES did), broke_down (whether the last one is one of them),
    iterations (of every solve), factorizations (set-ups of the preconditioner), setup_time,
    solve_time [s].
    """

    def __init__(
        self,
        matrix: PETSc.Mat,
        prefix: str,
        defaults: Mapping[str, object],
        near_nullspace: Sequence[np.ndarray] | None = None,
        fields: Mapping[str, PETSc.IS] | None = None,
        preconditioner: object | None = None,
        null_vectors: Sequence[NullVector] = (),
    ) -> None:
        self.matrix = matrix
        self.prefix = prefix
        self.iterations: list[int] = []
        self.factorizations = self.indefinite = 0
        self.setup_time = self.solve_time = 0.0
        self.broke_down = False
        self._build_iterations: int | None = None
        self._changed = self._rebuild = True
        set_defaults(prefix, defaults)
        matrix.setOptionsPrefix(prefix)
        if near_nullspace:
            set_near_nullspace(matrix, near_nullspace)
        self._x, self._b = matrix.createVecs()
        self.ksp = _make_ksp(matrix, prefix, fields)
        self._preconditioner = preconditioner
        self._scaling = DiagonalScaling(matrix, fields["p"]) if fields and not self.direct else None
        self._null = NullSpace(matrix, null_vectors, self.direct) if null_vectors else None
        if self.preconditioned_by_object and not self._splits:
            self.ksp.getPC().setPythonContext(preconditioner)
        _living.append(self)

    @property
    def direct(self) -> bool:
        """Return whether the solver is a factorization without iterations."""
        return self.ksp.getType() == PETSc.KSP.Type.PREONLY

    @property
    def preconditioned_by_object(self) -> bool:
        """Return whether the options leave the given preconditioner its place."""
        if self._preconditioner is None:
            return False
        options = PETSc.Options().getAll()
        block = self.prefix + ("fieldsplit_p_" if self._splits else "")
        return (
            options.get(block + "pc_type") == PETSc.PC.Type.PYTHON
            and block + "pc_python_type" not in options
        )

    @property
    def _splits(self):
        return self.ksp.getPC().getType() == PETSc.PC.Type.FIELDSPLIT

    @property
    def solves(self) -> int:
        """Return the number of solves."""
        return len(self.iterations)

    @property
    def iterations_mean(self) -> float:
        """Return the mean number of iterations per solve."""
        return float(np.mean(self.iterations)) if self.iterations else 0.0

    @property
    def iterations_max(self) -> int:
        """Return the largest number of iterations of a solve."""
        return max(self.iterations, default=0)

    def update(self, matrix_changed: bool = True) -> None:
        """Say that the values of the matrix have changed; the reuse rule decides about the
        preconditioner.
        """
        if matrix_changed:
            self._changed = True
            self._rebuild = self._rebuild or self.direct or self._is_stale()

    def refactor(self) -> None:
        """Build the preconditioner, or the factor, anew at the next solve, of new values of the
        matrix or of the same.
        """
        self._changed = self._rebuild = True

    def use(self, matrix: PETSc.Mat) -> None:
        """Solve with the present values of another matrix of the same layout from now on; only a
        factorization can.
        """
        if not self.direct:
            raise InputError(
                f'coupling.interface = "condensed": received an iterative solver -{self.prefix}…,'
                f" expected a factorization; leave out the options -{self.prefix}… or take"
                ' "dirichlet_neumann"'
            )
        matrix.setOptionsPrefix(self.prefix)
        self.matrix = matrix
        if self._null:
            self._null.use(matrix)
        self.refactor()

    def solve(self, rhs: np.ndarray) -> np.ndarray:
        """Return x with A x = rhs, both (owned rows,) (collective).

        Raise ConvergenceError when the solver does not converge with a new preconditioner either.
        """
        fresh = self._set_up()
        with self._b as b:
            b[:] = np.ravel(rhs)
        if self._scaling:
            self._scaling.apply(self._b)
        if self._null:
            self._null.project(self._b)
        iterations, reason = self._run()
        if reason <= 0 and not fresh:
            self.refactor()
            fresh = self._set_up()
            more, reason = self._run()
            iterations += more
        self.broke_down = reason in _INDEFINITE and is_default(self.prefix + "ksp_type")
        if self.broke_down:
            more, reason = self._run_indefinite()
            iterations += more
        if reason <= 0:
            self._raise(reason)
        self.iterations.append(iterations)
        if fresh:
            self._build_iterations = iterations
        if self._scaling:
            self._scaling.apply(self._x)
        return self._x.getArray(readonly=True).copy()

    def destroy(self) -> None:
        """Free the PETSc objects of the solver, not the matrix (collective)."""
        for thing in (self.ksp, self._x, self._b, self._scaling, self._null):
            if thing is not None:
                thing.destroy()
        if self in _living:
            _living.remove(self)

    def _is_stale(self):
        if self._build_iterations is None or not self.iterations:
            return False
        return self.iterations[-1] > REUSE_FACTOR * self._build_iterations + REUSE_OFFSET

    def _set_up(self):
        """Give the KSP the present matrix; return whether the preconditioner was built anew."""
        if not self._changed:
            self.ksp.getPC().setReusePreconditioner(True)  # new values count when `update` says so
            return False
        start = time.perf_counter()
        fresh = self._rebuild
        with stage("factorization"):
            self._give_matrix(fresh)
        self.factorizations += fresh
        self._changed = self._rebuild = False
        self.setup_time += time.perf_counter() - start
        return fresh

    def _give_matrix(self, fresh):
        """Set the operators and, where it is to be fresh, the preconditioner."""
        if self._scaling:
            self._scaling.scale()
        if self._null:
            self._null.prepare(self._scaling and self._scaling.factor)
        self.ksp.setOperators(self.matrix)
        self.ksp.getPC().setReusePreconditioner(not fresh)
        try:
            self.ksp.setUp()
            if fresh and self._splits:
                self._prepare_pressure()
                self.ksp.setUpOnBlocks()  # counts as set-up instead of as a part of the first solve
        except PETSc.Error as error:
            raise _broken(self.prefix, error, "set-up") from error

    def _prepare_pressure(self):
        """Give the pressure's block, which a FieldSplit has made by now, its near-null space and
        the given object.
        """
        block = self.ksp.getPC().getFieldSplitSubKSP()[1].getPC()
        if self._scaling:
            self._scaling.attach_constants(block.getOperators()[1])
        if self.preconditioned_by_object and block.getPythonContext() is not self._preconditioner:
            block.setPythonContext(self._preconditioner)

    def _run(self):
        """Return the iterations and the converged reason; a direct solve that is not finite counts
        as diverged.
        """
        start = time.perf_counter()
        try:
            with stage("solve"):
                self._solve()
        except PETSc.Error as error:
            if error.ierr != _NOT_CONVERGED:
                raise _broken(self.prefix, error, "solve") from error
        reason = self.ksp.getConvergedReason()
        if reason > 0 and not np.isfinite(self._x.norm()):
            reason = int(PETSc.KSP.ConvergedReason.DIVERGED_NANORINF)
        self.solve_time += time.perf_counter() - start
        return self.ksp.getIterationNumber(), reason

    def _run_indefinite(self):
        """Return the same of GMRES, which takes an indefinite matrix, and a right-hand side that
        CG has left as it was.
        """
        chosen = self.ksp.getType()
        self.ksp.setType(PETSc.KSP.Type.GMRES)
        self.ksp.setGMRESRestart(RESTART)
        iterations, reason = self._run()
        if reason > 0:
            self.ksp.setType(chosen)
            if not self.indefinite:
                text = "%s: CG broke down on an indefinite matrix, solved with GMRES (%s)"
                logger.info(text, self.prefix.rstrip("_"), "said once, counted in summary.json")
            self.indefinite += 1
        return iterations, reason

    def _solve(self):
        """Solve, and again without output when its reader has gone, of which the newest PETSc makes
        an error where it prints.

        Of several ranks one alone cannot repeat.
        """
        try:
            self.ksp.solve(self._b, self._x)
        except PETSc.Error:
            if self.matrix.comm.size > 1 or not drop_unread():
                raise
            self._b, self._x = self._b.copy(), self._x.duplicate()  # PETSc has left them locked
            self.ksp.solve(self._b, self._x)

    def is_indefinite(self) -> bool:
        """Return whether the last matrix is known to be indefinite: CG broke down on it, or its
        LDLᵀ by MUMPS has negative pivots (collective).

        On several ranks MUMPS counts all of them with `COUNTED` alone.
        """
        pc = self.ksp.getPC()
        if self.broke_down or pc.getType() != PETSc.PC.Type.CHOLESKY:
            return self.broke_down
        if not self.factorizations or pc.getFactorSolverType() != "mumps":
            return False
        factor = pc.getFactorMatrix()  # null after a reset
        return bool(factor) and factor.getMumpsInfog(NEGATIVE_PIVOTS) > 0

    def _raise(self, reason):
        error = self._failure(reason)
        if self.direct:
            # a factorization that failed on a matrix that is not finite fails on every later one,
            # too
            self.ksp.reset()
        self.refactor()
        raise error

    def _failure(self, reason):
        text = _REASONS.get(int(reason), str(reason))
        return ConvergenceError(
            f"linear solver {self.prefix} ({self.ksp.getType()}, {self.ksp.getPC().getType()})"
            f" failed with {text} after {self.ksp.getIterationNumber()} iterations, residual"
            f" {self.ksp.getResidualNorm():.3g} (right-hand side {self._b.norm():.3g})",
            self._advice(),
        )

    def _advice(self):
        advice = f"see -{self.prefix}ksp_monitor -{self.prefix}ksp_converged_reason"
        if self.direct and self.ksp.getPC().getType() in (PETSc.PC.Type.LU, PETSc.PC.Type.CHOLESKY):
            return advice
        return (
            f"{advice}, or try a direct solver (-{self.prefix}ksp_type preonly"
            f" -{self.prefix}pc_type lu)"
        )


def direct_defaults(symmetric: bool = False) -> dict[str, object] | None:
    """Return the options of a direct solver, None when this PETSc has none for more than one rank.

    MUMPS, else PETSc's own LU on one rank; LDL^T by MUMPS when the matrix is symmetric (half the
    work and memory of LU).  MUMPS gets 80 % of spare work space (default 20-35 %), since badly
    scaled blocks pivot a lot and else end in its error -9. SuperLU_dist is left to the user: slower
    than the iterative solvers, and PETSc 3.18 crashes at exit after it.
    """
    if has_package("mumps"):
        return _factor("cholesky" if symmetric else "lu", "mumps") | {"mat_mumps_icntl_14": 80}
    return _factor("lu", "petsc") if PETSc.COMM_WORLD.size == 1 else None


def set_near_nullspace(matrix: PETSc.Mat, modes: Sequence[np.ndarray]) -> None:
    """Attach near-null vectors, arrays of the owned rows, to a matrix and to its diagonal block
    (collective).

    Subdomain solvers work on the diagonal block, which does not inherit them; there they are
    orthonormalised rank by rank.
    """
    _attach(matrix, np.column_stack(modes))
    block = matrix.getDiagonalBlock()
    if block.handle != matrix.handle:
        _attach(block, np.linalg.qr(np.column_stack(modes))[0])


def _attach(matrix, columns):
    vectors = []
    for column in columns.T:
        vectors.append(matrix.createVecRight())
        vectors[-1].setArray(column)
    space = PETSc.NullSpace().create(vectors=vectors, comm=matrix.comm)
    matrix.setNearNullSpace(space)
    for thing in (space, *vectors):
        thing.destroy()


class DiagonalScaling:
    """D^-½ of a matrix in the units of its rows and columns, D = |diag A| and 1 where that
    vanishes; and D^½ 1 of its field "p".

    The latter is what the constants become, which span the near-null space of the pressure's block.
    """

    def __init__(self, matrix: PETSc.Mat, pressure: PETSc.IS) -> None:
        """Take a matrix and the index set of its field "p"."""
        self._matrix = matrix
        self._pressure = pressure
        self._state = None
        self._factor = matrix.createVecRight()

    def scale(self) -> None:
        """Replace A by D^-½ A D^-½ unless its values are those that were scaled before
        (collective).

        PETSc counts the changes of an object, as it does to know what a preconditioner was made of.
        """
        if self._matrix.stateGet() == self._state:
            return
        self._matrix.getDiagonal(self._factor)
        self._factor.sqrtabs()
        with self._factor as root:
            root[root == 0] = 1.0
        self._factor.reciprocal()
        self._matrix.diagonalScale(self._factor, self._factor)
        self._state = self._matrix.stateGet()

    def attach_constants(self, block: PETSc.Mat) -> None:
        """Give the pressure's block of the scaled matrix D^½ 1 as its near-null space (collective).

        A new one for every set-up: PETSc locks the vectors of a null space for good.
        """
        field = self._factor.getSubVector(self._pressure)
        constants = field.copy()
        self._factor.restoreSubVector(self._pressure, field)
        constants.reciprocal()
        constants.normalize()
        space = PETSc.NullSpace().create(vectors=[constants], comm=block.comm)
        block.setNearNullSpace(space)
        space.destroy()
        constants.destroy()

    @property
    def factor(self) -> PETSc.Vec:
        """Return D^-½ of the present values."""
        return self._factor

    def apply(self, vector: PETSc.Vec) -> None:
        """Multiply a right-hand side, or the solution of the scaled system, by D^-½ in place."""
        vector.pointwiseMult(vector, self._factor)

    def destroy(self) -> None:
        """Free the vectors (collective)."""
        self._factor.destroy()


def _make_ksp(matrix, prefix, fields):
    ksp = PETSc.KSP().create(matrix.comm)
    ksp.setOptionsPrefix(prefix)
    ksp.setOperators(matrix)
    try:
        ksp.setFromOptions()
    except PETSc.Error as error:
        raise _unmade(prefix, error) from error
    if fields and ksp.getPC().getType() == PETSc.PC.Type.FIELDSPLIT:
        ksp.getPC().setFieldSplitIS(*fields.items())
    return ksp


def _factor(kind, package):
    return {"ksp_type": "preonly", "pc_type": kind, "pc_factor_mat_solver_type": package}


def _broken(prefix, error, stage_name):
    """Return the error of the user for one of PETSc: of options that cannot work, else of this
    matrix.
    """
    if error.ierr in _FILES + _MISSING:
        return _unmade(prefix, error)
    if error.ierr in _UNFIT:
        what = f"PETSc options: a solver -{prefix}… cannot work: {reason_of(error)}"
        return InputError(f"{what}; choose another -{prefix}ksp_type or -{prefix}pc_type")
    return ConvergenceError(f"linear solver {prefix}: its {stage_name} failed: {reason_of(error)}")


def _unmade(prefix, error):
    """Return the error of the user for one of PETSc while it reads a solver's options, newer ones
    with the files in them.
    """
    if error.ierr in _FILES:
        return InputError(
            f"PETSc options: {reason_of(error)}; correct the file of an option -{prefix}…"
        )
    what = f"PETSc options: a solver -{prefix}… cannot be made: {reason_of(error)}"
    return InputError(f"{what}; choose another or a PETSc that has it")
