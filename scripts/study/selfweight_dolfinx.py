"""End state of configs/selfweight2d.toml by another program: the drained skeleton under its weight,
solved by dolfinx.

Needs dolfinx (0.11: `pip install dolfinx-solver-real` on Python 3.12), not this package:

    python scripts/study/selfweight_dolfinx.py

The three levels of the printed displacements converge with the order of the corners of the base;
their extrapolation by the ratio of the last two differences is what the scene's [[expect]] names.
"""

import numpy as np
import ufl
from dolfinx import fem, mesh
from dolfinx.fem.petsc import assemble_matrix, assemble_vector
from mpi4py import MPI
from petsc4py import PETSc

LAMBDA, MU = 2e4, 1e4  # [Pa]
WEIGHT = 0.67 * 2000 * 4.905  # n_s0 rho_sR b [N/m^3]
LEVELS = (16, 32, 64)
PARTS, TOLERANCE, CAP = 10, 1e-9, 30  # load steps; residual [N/m], Newton iterations of each
POINTS = {"T.u_y": ((0.5, 1.0), 1), "P3.u_y": ((0.5, 0.5), 1), "R.u_x": ((1.0, 0.5), 0)}


def problem(n):
    """Return displacement, load, residual and tangent forms and the boundary condition on n x n
    crossed squares, quadratic.
    """
    square = mesh.create_unit_square(MPI.COMM_SELF, n, n, diagonal=mesh.DiagonalType.crossed)
    V = fem.functionspace(square, ("Lagrange", 2, (2,)))
    u = fem.Function(V)
    load = fem.Constant(square, PETSc.ScalarType(0.0))
    F = ufl.Identity(2) + ufl.grad(u)
    J = ufl.det(F)
    energy = (
        MU / 2 * (ufl.tr(F.T * F) - 2) - MU * ufl.ln(J) + LAMBDA / 2 * ufl.ln(J) ** 2 + load * u[1]
    )
    residual = ufl.derivative(
        energy * ufl.dx(metadata={"quadrature_degree": 6}), u, ufl.TestFunction(V)
    )
    tangent = ufl.derivative(residual, u, ufl.TrialFunction(V))
    base = mesh.locate_entities_boundary(square, 1, lambda x: np.isclose(x[1], 0))
    held = fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, base), V)
    return u, load, fem.form(residual), fem.form(tangent), held


def newton(u, residual, tangent, held):
    """Solve for the present load; raises RuntimeError at the cap."""
    for _ in range(CAP):
        b = assemble_vector(residual)
        b.array[held.dof_indices()[0]] = 0
        if b.norm() < TOLERANCE:
            return
        A = assemble_matrix(tangent, [held])
        A.assemble()
        ksp = PETSc.KSP().create(MPI.COMM_SELF)
        ksp.setOperators(A)
        ksp.setType("preonly")
        ksp.getPC().setType("lu")
        ksp.getPC().setFactorSolverType("mumps")
        increment = A.createVecRight()
        ksp.solve(b, increment)
        u.x.array[:] -= increment.array
    raise RuntimeError(f"Newton's iteration did not converge in {CAP} steps")


def displacements(n):
    """Return the displacements of POINTS [m]."""
    u, load, residual, tangent, held = problem(n)
    for part in np.linspace(0, 1, PARTS + 1)[1:]:
        load.value = WEIGHT * part
        newton(u, residual, tangent, held)
    X = u.function_space.tabulate_dof_coordinates()[:, :2]
    nodes = {
        name: int(np.argmin(np.linalg.norm(X - point, axis=1)))
        for name, (point, _) in POINTS.items()
    }
    return np.array(
        [u.x.array[2 * nodes[name] + component] for name, (_, component) in POINTS.items()]
    )


def main():
    """Print the displacements on all levels and their extrapolation."""
    values = [displacements(n) for n in LEVELS]
    a, b, c = values
    print("level", *POINTS)
    for n, row in zip(LEVELS, values, strict=True):
        print(n, *(f"{value:.7f}" for value in row))
    print("extrapolated", *(f"{value:.7f}" for value in c + (c - b) ** 2 / (b - a - (c - b))))


if __name__ == "__main__":
    main()
