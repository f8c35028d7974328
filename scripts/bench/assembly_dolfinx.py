"""The cases of `bench.assembly` as forms of dolfinx 0.5, compiled with -O3 -march=native
-ffast-math.
"""

import logging
import tempfile

import cffi
import dolfinx
import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc
from mpi4py import MPI

logging.disable(logging.INFO)
NAME = f"dolfinx {dolfinx.__version__}"
JIT = {
    "cffi_extra_compile_args": ["-O3", "-march=native", "-ffast-math"],
    "cache_dir": tempfile.mkdtemp(prefix="ffcx_"),
}
LOOP = """
#include <string.h>
#include <stdint.h>
typedef void (*kernel)(double *, const double *, const double *, const double *, const int *,
                       const uint8_t *);
double loop(uintptr_t f, int elements, int size, const double *w, int n_w, const double *c,
            const double *x, int n_x) {
  double A[2000], sum = 0; int local = 0; uint8_t permutation = 0;
  for (int e = 0; e < elements; ++e) {
    memset(A, 0, sizeof(double) * size);
    ((kernel)f)(A, w + (long)e * n_w, c, x + (long)e * n_x, &local, &permutation);
    sum += A[0] + A[size - 1];
  }
  return sum;
}
"""


class Forms:
    """Residual and tangent of a form in a space of unknowns."""

    def __init__(self, residual, unknown):
        """Compile the forms and make vector and matrix."""
        space = unknown.function_space
        self._F = fem.form(residual, jit_params=JIT)
        self._J = fem.form(
            ufl.derivative(residual, unknown, ufl.TrialFunction(space)), jit_params=JIT
        )
        self._A = petsc.create_matrix(self._J)
        self._b = petsc.create_vector(self._F)
        self.tabulate = self._kernel_loop(space)

    def assemble(self):
        """Assemble both."""
        self._A.zeroEntries()
        petsc.assemble_matrix(self._A, self._J)
        self._A.assemble()
        with self._b.localForm() as local:
            local.set(0)
        petsc.assemble_vector(self._b, self._F)

    def norms(self):
        """Return the norms of residual and tangent."""
        return self._b.norm(), self._A.norm(2)

    def _kernel_loop(self, space):
        """Return a job that runs the tangent's kernel alone, on coefficients and coordinates that
        are packed already.
        """
        ffi = cffi.FFI()
        ffi.cdef(
            "double loop(uintptr_t, int, int, const double *, int, const double *, const double *,"
            " int);"
        )
        folder = tempfile.mkdtemp(prefix="loop_")
        source = cffi.FFI()
        source.cdef(
            "double loop(uintptr_t, int, int, const double *, int, const double *, const double *,"
            " int);"
        )
        source.set_source("_loop", LOOP, extra_compile_args=["-O3", "-march=native"])
        library = ffi.dlopen(source.compile(tmpdir=folder))
        integral = self._J.ufcx_form.integrals(0)[0]
        pointer = int(cffi.FFI().cast("uintptr_t", integral.tabulate_tensor_float64))
        cells = space.mesh.topology.index_map(space.mesh.topology.dim).size_local
        w = np.ascontiguousarray(
            dolfinx.cpp.fem.pack_coefficients(self._J)[(fem.IntegralType.cell, -1)]
        )
        c = np.ascontiguousarray(dolfinx.cpp.fem.pack_constants(self._J))
        c = c if len(c) else np.zeros(1)
        x = np.ascontiguousarray(
            space.mesh.geometry.x[space.mesh.geometry.dofmap.array.reshape(cells, -1)].reshape(
                cells, -1
            )
        )
        size = (space.dofmap.dof_layout.num_dofs * space.dofmap.bs) ** 2
        pointers = [ffi.cast("const double *", array.ctypes.data) for array in (w, c, x)]
        keep = w, c, x, library
        return lambda: (
            keep
            and library.loop(
                pointer, cells, size, pointers[0], w.shape[1], pointers[1], pointers[2], x.shape[1]
            )
        )


def same_mesh(domain):
    """Return the mesh of a `Domain` with straight sides."""
    d = domain.dim
    cells = domain.cells[:, : d + 1].astype(np.int64)
    used, compact = np.unique(cells, return_inverse=True)
    cell = ufl.Cell({2: "triangle", 3: "tetrahedron"}[d])
    shape = ufl.Mesh(ufl.VectorElement("Lagrange", cell, 1))
    return dolfinx.mesh.create_mesh(
        MPI.COMM_SELF, compact.reshape(cells.shape).astype(np.int64), domain.mesh.X[used], shape
    )


def case(kind, ours, problem):
    """Return the `Forms` of a case of `bench.assembly`: its class, the object and the module with
    data and states.
    """
    return {"NeoHookean": _neo_hookean, "Flow": _flow}[kind](ours.domain, problem)


def _neo_hookean(domain, problem):
    mesh = same_mesh(domain)
    d = domain.dim
    order = domain.element.order
    V = fem.VectorFunctionSpace(mesh, ("CG", order))
    u = fem.Function(V)
    u.interpolate(lambda x: problem.displacement(x[:d]))
    mu = fem.Constant(mesh, problem.MU)
    lam = fem.Constant(mesh, problem.LAM)
    F = ufl.Identity(d) + ufl.grad(u)
    turned = ufl.inv(F).T
    P = mu * (F - turned) + lam * ufl.ln(ufl.det(F)) * turned
    dx = ufl.dx(metadata={"quadrature_degree": max(2 * (order - 1), 1)})
    return Forms(ufl.inner(P, ufl.grad(ufl.TestFunction(V))) * dx, u)


def _flow(domain, problem):
    mesh = same_mesh(domain)
    d = domain.dim
    V = fem.VectorFunctionSpace(mesh, ("CG", 1), dim=d + 1)
    U = fem.Function(V)
    U0 = fem.Function(V)
    U.interpolate(lambda x: np.vstack([problem.velocity(x[:d]), problem.pressure(x[:d])[None]]))
    U0.interpolate(lambda x: np.vstack([problem.velocity_before(x[:d]), 0 * x[:1]]))
    (v, p), (v0, _), (w, q) = (_split(X, d) for X in (U, U0, ufl.TestFunction(V)))
    data = problem.RHO, problem.VISCOSITY, problem.PERMEABILITY, problem.DT
    rho, mu, K, dt = (fem.Constant(mesh, value) for value in data)
    h = 2 * ufl.Circumradius(mesh)
    nu = mu / rho
    tau = 1 / ufl.sqrt(
        (2 / dt) ** 2 + 4 * ufl.dot(v0, v0) / h**2 + (4 * nu / h**2) ** 2 + (nu / K) ** 2
    )
    inertia = rho * (v - v0) / dt + rho * ufl.dot(ufl.grad(v), v)
    strong = inertia + ufl.grad(p) + mu / K * v
    dx = ufl.dx(metadata={"quadrature_degree": 2})
    galerkin = (
        ufl.inner(inertia + mu / K * v, w)
        + 2 * mu * ufl.inner(ufl.sym(ufl.grad(v)), ufl.grad(w))
        - p * ufl.div(w)
    )
    stabilized = tau * ufl.inner(ufl.dot(ufl.grad(w), v) + ufl.grad(q) / rho, strong)
    return Forms((galerkin + q * ufl.div(v) + stabilized) * dx, U)


def _split(U, d):
    return ufl.as_vector([U[i] for i in range(d)]), U[d]
