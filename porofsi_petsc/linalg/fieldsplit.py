"""Solver options and index sets of the two blocks: velocity-pressure by FieldSplit Schur,
displacement by algebraic multigrid.

The fluid matrix has the unknowns (v_1 … v_d, p[, s]) node by node,

    [ A   B^T   .       ]      A   = (rho c + S) mass + viscosity + convection
    [ -B  C+B_m  -B_m   ]      C   = tau n^2 Laplacian
    [ .   -B_m   B_m+B_L]      B_m mass, B_L Laplacian

and is solved by FGMRES with the upper triangular factor.  The block C + B_m of the matrix itself
stands for the Schur complement C + B A^-1 B^T + B_m: PSPG's tau = ((2 rho/dt)^2 + S^2)^-1/2 is the
size of A^-1, so that the two differ by a factor between 1 and about 2.5 at every wave number,
whatever the step, the drag and the order.  Without PSPG the Schur complement is assembled from
diag(A)^-1 (`selfp`; not from row sums, which vanish at the vertices of quadratic triangles).

In a free fluid (no s, no B_m) tau is the size of A^-1 at the scale of the mesh only, and C far too
small for longer waves where the Courant number or nu dt/h^2 is large.  There
`convection_diffusion_pc` stands for the inverse of the Schur complement.

Scaling: the residual mixes N and m³/s; at dt = 1e-4 s rtol was met with a pressure wrong by 70 %.
`LinearSolver` therefore scales the matrix symmetrically to a unit diagonal, and `pressure_pc`
undoes it for the multigrid, which wants the constants.

Bounds of the iterations by mesh, step and permeability: tests/test_solvers.py,
tests/test_solvers_free.py.
"""

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from .options import has_package
from .solver import COUNTED, direct_defaults

_PRESSURE = {
    "pc_type": "python",
    "pc_python_type": "porofsi_petsc.linalg.pressure_pc.PressureMultigrid",
}
# PETSc's default keeps the first interpolation for good; a restart has none and would go on
# differently
_INTERPOLATION: dict[str, object] = {"pc_gamg_reuse_interpolation": "false"}
_GAMG = {
    "pc_type": "gamg",
    "mg_levels_ksp_type": "richardson",
    "mg_levels_pc_type": "sor",
} | _INTERPOLATION
# rtol of Newton's iteration for a steady flow: half the iterations of 1e-5 in as many sweeps
# (docs/solvers.md). The derivative of the stabilization parameters is left out, so that six digits
# take seven to nine sweeps with solves to 1e-5, too.
NEWTON = 1e-2
_FIELDSPLIT = {
    "ksp_type": "fgmres",
    "ksp_rtol": (
        1e-5
        # the coupling takes as many sweeps as with a factorization; with 1e-4 some more on 3-D
        # quadratic meshes
    ),
    "ksp_max_it": 500,
    "ksp_gmres_restart": 100,
    "pc_type": "fieldsplit",
    "pc_fieldsplit_type": "schur",
    "pc_fieldsplit_schur_fact_type": "upper",
    "pc_fieldsplit_schur_precondition": "a11",
    "fieldsplit_p_ksp_type": "preonly",
    "fieldsplit_v_ksp_type": "preonly",
}


def fluid_defaults(
    dim: int,
    direct: bool,
    viscous: bool = False,
    pspg: bool = True,
    free: bool = False,
    steady: bool = False,
) -> dict[str, object]:
    """Return the option defaults of the velocity-pressure solver.

    direct : a factorization where this PETSc has one for the number of ranks, else FieldSplit.
    viscous : the velocity block gets multigrid; without viscosity it is mass dominated and block
    Jacobi with ILU(0) is cheaper.
        Rows of which the mass makes up three quarters are left to smoothing: the same iterations as
        with hypre's own bound, 0.9; with 0.5 up to four more on quadratic tetrahedra.
    free : the pressure is preconditioned by the `PressureConvectionDiffusion` that `LinearSolver`
    is given.
    steady : the system is a step of Newton's iteration from far away, which is not worth solving
    further than it leads.
    """
    factor = direct_defaults() if direct else None
    if factor is not None:
        return factor
    smoothed = {"pc_hypre_boomeramg_max_row_sum": 0.75} if has_package("hypre") else {}
    velocity = smoothed | _multigrid(dim) if viscous else {"pc_type": "bjacobi"}
    pressure = (
        _convection_diffusion(dim) if free else _PRESSURE | _prefixed("inner_", _multigrid(dim))
    )
    schur = {} if pspg else {"pc_fieldsplit_schur_precondition": "selfp"}
    return (
        _FIELDSPLIT
        | schur
        | ({"ksp_rtol": NEWTON} if steady else {})
        | _prefixed("fieldsplit_v_", velocity)
        | _prefixed("fieldsplit_p_", pressure)
    )


def solid_defaults(
    dim: int, direct: bool, symmetric: bool = True, counted: bool = False
) -> dict[str, object]:
    """Return the option defaults of the displacement solver: CG with GAMG, or a factorization.

    GAMG takes the rigid-body modes given to `LinearSolver`.  Other choices by option string:
    `-solid_pc_type hypre`, `-solid_pc_type bjacobi -solid_sub_pc_type icc` (best when inertia
    dominates), or pyamg (see `pyamg_pc`).
    symmetric : false for a matrix that is not, which then gets GMRES (and LU instead of LDL^T);
    counted : whether MUMPS counts negative pivots (`LinearSolver.is_indefinite`).
    """
    factor = direct_defaults(symmetric) if direct else None
    if factor is not None:
        return factor | (COUNTED if counted and has_package("mumps") else {})
    return {
        "ksp_type": "cg" if symmetric else "gmres",
        "ksp_rtol": 1e-4,
        "ksp_max_it": 1000,
        "pc_type": "gamg",
    } | _INTERPOLATION


def monolithic_defaults(direct: bool) -> dict[str, object]:
    """Return the option defaults of the matrix of both phases: a factorization, or FGMRES around
    one sweep over the phases.

    rtol : Newton's next iteration starts where the solver ends, 1e-6 of the residual, which is the
    coupling's tolerance.
    """
    factor = direct_defaults() if direct else None
    return factor or {
        "ksp_type": "fgmres",
        "ksp_rtol": 1e-6,
        "ksp_max_it": 200,
        "ksp_gmres_restart": 100,
        "pc_type": "python",
    }


def fluid_fields(
    comm: MPI.Comm,
    first_node: int,
    n_owned_nodes: int,
    dim: int,
    block_size: int,
    prefix: str = "fluid_",
) -> dict[str, PETSc.IS]:
    """Return the index sets (dict name -> PETSc.IS) of "v", the velocity, and "p", the pressure
    with its auxiliary field.

    The block size of v is dim; that of p is block_size - dim, and 1 if the user asks for hypre
    there (see above).
    """
    scalar = PETSc.Options().getAll().get(prefix + "fieldsplit_p_pc_type") == "hypre"
    nodes = block_size * np.arange(first_node, first_node + n_owned_nodes)
    return {
        "v": _field(comm, nodes, np.arange(dim), dim),
        "p": _field(comm, nodes, np.arange(dim, block_size), 1 if scalar else block_size - dim),
    }


def rigid_body_modes(x: np.ndarray, comm: MPI.Comm) -> list[np.ndarray]:
    """Return the translations and linearized rotations at the owned nodes, orthonormal over all
    ranks (collective).

    x : (n, d) coordinates of the owned nodes.  3 modes for d = 2, 6 for d = 3, each (n d,).
    """
    total = comm.allreduce(x.sum(axis=0))
    count = comm.allreduce(len(x))
    coordinates = PETSc.Vec().createMPI((x.size, PETSc.DETERMINE), bsize=x.shape[1], comm=comm)
    coordinates.setArray((x - total / count).ravel())
    space = PETSc.NullSpace().createRigidBody(coordinates)
    modes = [mode.getArray(readonly=True).copy() for mode in space.getVecs()]
    space.destroy()
    coordinates.destroy()
    return modes


def _field(comm, nodes, components, block_size):
    field = PETSc.IS().createGeneral(
        (nodes[:, None] + components).astype(PETSc.IntType).ravel(), comm=comm
    )
    field.setBlockSize(block_size)
    return field


def _multigrid(dim):
    if not has_package("hypre"):
        return _GAMG
    return {"pc_type": "hypre", "pc_hypre_boomeramg_strong_threshold": 0.25 if dim == 2 else 0.5}


def _convection_diffusion(dim):
    cycle = {"ksp_type": "preonly"} | _multigrid(dim)
    return {"pc_type": "python"} | _prefixed("compliance_", cycle) | _prefixed("laplacian_", cycle)


def _prefixed(prefix, options):
    return {prefix + name: value for name, value in options.items()}
