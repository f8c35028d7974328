"""Solver options and index sets of the two blocks: velocity-pressure by FieldSplit Schur, displacement by algebraic multigrid.

The fluid matrix has the unknowns (v_1 … v_d, p[, s]) node by node,

    [ A   B^T   .       ]      A   = (rho c + S) mass + viscosity + convection
    [ -B  C+B_m  -B_m   ]      C   = tau n^2 Laplacian
    [ .   -B_m   B_m+B_L]      B_m mass, B_L Laplacian

and is solved by FGMRES with the upper triangular factor; the Schur complement is approximated by C + B lump(A)^-1 B^T (`selfp`).

Measured, P1 on 10 m x 10 m (x 10 m), iterations to rtol 1e-6 at S dt/rho = 0, 1, 1e4, 1e8; the range is over the meshes
16² … 64² (6³ … 12³):

    without s       hypre 2-D 4-6, 3-D 5-7 · GAMG 2-D 4-12, 3-D 5-13 · Jacobi instead of ILU on the velocity twice as many
    lump against diag in the approximation of A^-1: equal or one less

The residual mixes N and m³/s: at dt = 1e-4 s it was met with a pressure wrong by 70 %.  Hence the symmetric diagonal scaling,
after which velocity and pressure agree with a direct solve to ten times the tolerance; counts with it and with s, rtol 1e-6:

    dt, k           1e-3, 1      1e-2, 1e-5   1e-4, 1      1e-5, 1e-2     meshes
    hypre, 2-D      19 31 36     19 28 35     9 17 31      9 11 13        32² 64² 96²
    hypre, 3-D      7 18         11 13        7 8          8 9            6³ 14³
    GAMG, 2-D       20 20 20     18 21 22     23 31 40     24 32 42
    GAMG, 3-D       10 18        10 17        26 59        27 91

On small steps B_m dominates and ties s to p at every node.  hypre must therefore see (p, s) as one scalar field (block size 1:
strong couplings cross from p to s; as two functions it fails at dt <= 1e-4) with strong threshold 0.5 (0.25: 159 in 3-D);
GAMG needs the 2 x 2 blocks with a point-block Jacobi smoother (fails without at dt = 1e-5).
"""

import numpy as np
from petsc4py import PETSc

from .options import has_package
from .solver import direct_defaults

_HYPRE_PRESSURE = {
    "pc_type": "hypre",
    "pc_hypre_boomeramg_strong_threshold": 0.5,
    "pc_hypre_boomeramg_coarsen_type": "HMIS",
    "pc_hypre_boomeramg_interp_type": "ext+i",
}
_GAMG_PRESSURE = {"pc_type": "gamg", "mg_levels_pc_type": "pbjacobi"}
_FIELDSPLIT = {
    "ksp_type": "fgmres",
    "ksp_rtol": 1e-8,
    "ksp_max_it": 500,
    "ksp_gmres_restart": 100,
    "ksp_diagonal_scale": None,
    "ksp_diagonal_scale_fix": None,
    "pc_type": "fieldsplit",
    "pc_fieldsplit_type": "schur",
    "pc_fieldsplit_schur_fact_type": "upper",
    "pc_fieldsplit_schur_precondition": "selfp",
    "fieldsplit_p_mat_schur_complement_ainv_type": "lump",
    "fieldsplit_p_ksp_type": "preonly",
    "fieldsplit_v_ksp_type": "preonly",
}


def fluid_defaults(dim: int, has_auxiliary: bool, direct: bool, viscous: bool = False) -> dict[str, object]:
    """Return the option defaults of the velocity-pressure solver.

    direct : a factorization where this PETSc has one for the number of ranks, else FieldSplit.
    viscous : the velocity block gets multigrid; without viscosity it is mass dominated and block Jacobi with ILU(0) is cheaper.
    """
    factor = direct_defaults() if direct else None
    if factor is not None:
        return factor
    pressure = _HYPRE_PRESSURE if has_package("hypre") else _gamg_pressure(has_auxiliary)
    velocity = _multigrid(dim) if viscous else {"pc_type": "bjacobi"}
    return _FIELDSPLIT | _prefixed("fieldsplit_v_", velocity) | _prefixed("fieldsplit_p_", pressure)


def solid_defaults(dim: int, direct: bool, symmetric: bool = True) -> dict[str, object]:
    """Return the option defaults of the displacement solver: CG with GAMG, or a factorization.

    GAMG takes the rigid-body modes given to `LinearSolver`.  Other choices by option string: `-solid_pc_type hypre`,
    `-solid_pc_type bjacobi -solid_sub_pc_type icc` (best when inertia dominates), or pyamg (see `pyamg_pc`).
    symmetric : false for a matrix that is not, which then gets GMRES (and LU instead of LDL^T).
    """
    factor = direct_defaults(symmetric) if direct else None
    if factor is not None:
        return factor
    return {"ksp_type": "cg" if symmetric else "gmres", "ksp_rtol": 1e-8, "ksp_max_it": 1000, "pc_type": "gamg"}


def fluid_fields(comm, first_node: int, n_owned_nodes: int, dim: int, block_size: int, prefix: str = "fluid_"):
    """Return the index sets (dict name -> PETSc.IS) of "v", the velocity, and "p", the pressure with its auxiliary field.

    The block size of v is dim; that of p is 1 for hypre and block_size - dim for other preconditioners (see above).
    """
    default = "hypre" if has_package("hypre") else "gamg"
    pressure_pc = PETSc.Options(prefix).getString("fieldsplit_p_pc_type", default)
    nodes = block_size * np.arange(first_node, first_node + n_owned_nodes)
    return {
        "v": _field(comm, nodes, np.arange(dim), dim),
        "p": _field(comm, nodes, np.arange(dim, block_size), 1 if pressure_pc == "hypre" else block_size - dim),
    }


def rigid_body_modes(x: np.ndarray, comm) -> list[np.ndarray]:
    """Return the translations and linearized rotations at the owned nodes, orthonormal over all ranks (collective).

    x : (n, d) coordinates of the owned nodes.  3 modes for d = 2, 6 for d = 3, each (n d,).
    """
    total, count = comm.allreduce(x.sum(axis=0)), comm.allreduce(len(x))
    coordinates = PETSc.Vec().createMPI((x.size, PETSc.DETERMINE), bsize=x.shape[1], comm=comm)
    coordinates.setArray((x - total / count).ravel())
    space = PETSc.NullSpace().createRigidBody(coordinates)
    modes = [mode.getArray(readonly=True).copy() for mode in space.getVecs()]
    space.destroy()
    coordinates.destroy()
    return modes


def _field(comm, nodes, components, block_size):
    field = PETSc.IS().createGeneral((nodes[:, None] + components).astype(PETSc.IntType).ravel(), comm=comm)
    field.setBlockSize(block_size)
    return field


def _gamg_pressure(has_auxiliary):
    return _GAMG_PRESSURE if has_auxiliary else {"pc_type": "gamg"}


def _multigrid(dim):
    if not has_package("hypre"):
        return {"pc_type": "gamg"}
    return {"pc_type": "hypre", "pc_hypre_boomeramg_strong_threshold": 0.25 if dim == 2 else 0.5}


def _prefixed(prefix, options):
    return {prefix + name: value for name, value in options.items()}
