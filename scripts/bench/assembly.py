"""Time residual, tangent and insertion into the PETSc matrix per element, on one core; with --peer
beside dolfinx's compiled forms.

Cases: neo_hookean_p1, neo_hookean_p2, flow_p1p1 (triangles of a square), neo_hookean_t4,
neo_hookean_t10, flow_t4 (tetrahedra of a cube).  Neo-Hookean: mu/2 (I1 - 3) - mu ln J + lambda/2
(ln J)^2, plane strain in 2-D.  Flow: Navier-Stokes with Darcy's drag, SUPG and PSPG, velocity and
pressure linear.  Each round assembles residual vector and tangent matrix anew from the nodal
values; the least time of all rounds counts.  Geometry, pattern and stabilization parameters are
kept, as they are in a run.

GFLOP/s count the contraction of the derivatives at the points with the test functions, beside those
of a product of two matrices; GB/s of the insertion count a value read, and one read and written,
for each entry of the element matrices, beside those of the triad y + s x.  Both limits are measured
in the same run on the same core.

--peer : alternate with dolfinx (assembly_dolfinx.py) on the same mesh, state and quadrature, and
compare the norms; --scale S : cells along an edge times S
"""

import json
import sys
import time
from types import SimpleNamespace

import command_line
import numpy as np
from scipy.linalg.blas import daxpy, dgemm

from porofsi_petsc.linalg import options

options.start()

from mpi4py import MPI  # noqa: E402

from porofsi_petsc.fem.distribute import distribute  # noqa: E402
from porofsi_petsc.fem.domain import Domain  # noqa: E402
from porofsi_petsc.kernels import flow, flow_loops, solid  # noqa: E402
from porofsi_petsc.linalg.matrix import ElementMatrix  # noqa: E402
from porofsi_petsc.materials import ELASTIC  # noqa: E402
from porofsi_petsc.materials.drag import Drag  # noqa: E402
from porofsi_petsc.mesh import box, rectangle  # noqa: E402

MU, LAM = 1.0, 4.0  # [Pa]
RHO, VISCOSITY, PERMEABILITY, DT = 1.0, 1e-2, 1e-1, 1e-2  # [kg/m^3], [Pa s], [m^2], [s]


def displacement(x):
    """Return u at coordinates (d, ...)."""
    plane = [0.05 * np.sin(3 * x[0]) * np.cos(2 * x[1]), 0.04 * np.cos(2 * x[0]) * np.sin(3 * x[1])]
    return np.array(plane + ([0.03 * np.sin(2 * x[0]) * np.cos(x[2])] if len(x) == 3 else []))


def velocity(x, factor=1.0):
    """Return v at coordinates (d, ...)."""
    plane = [factor * np.sin(2 * x[1]) + 0.3 * x[0], factor * 0.5 * np.cos(3 * x[0]) - 0.3 * x[1]]
    return np.array(plane + ([factor * 0.4 * np.sin(2 * x[0] + x[2])] if len(x) == 3 else []))


def velocity_before(x):
    """Return v of the step before."""
    return velocity(x, 0.9)


def pressure(x):
    """Return p at coordinates (d, ...)."""
    return np.cos(x[0] * x[1])


def momentum_tau(v0, h):
    """Return the stabilization parameter of the peer's form times 1/rho, at velocities v0 (E, Q,
    d), circumdiameters h (E, 1).
    """
    nu = VISCOSITY / RHO
    squares = (
        (2 / DT) ** 2
        + 4 * (v0**2).sum(axis=-1) / h**2
        + (4 * nu / h**2) ** 2
        + (nu / PERMEABILITY) ** 2
    )
    return 1 / np.sqrt(squares) / RHO


def grid(dim, order, cells):
    """Return the `Domain` of the unit square or cube on this process."""
    axis = SimpleNamespace(points=[0.0, 1.0], cells=[cells], ratios=None)
    mesh = (rectangle if dim == 2 else box)(*[axis] * dim, order=order)
    return Domain(distribute(MPI.COMM_SELF, mesh, np.zeros(len(mesh.points), dtype=int)))


class Problem:
    """A mesh, the state on it and the matrix of a tangent; a kind of problem makes the element
    vectors and matrices.
    """

    def __init__(self, domain, components):
        """Make the pattern of the matrix."""
        self.domain = domain
        free = np.zeros((domain.n_local, components), dtype=bool)
        self.matrix = ElementMatrix(
            MPI.COMM_SELF, domain.cells, domain.numbering, domain.n_owned, free
        )
        self.entries = (domain.cells.shape[1] * components) ** 2  # of an element matrix
        self._kept = [(chunk, K) for chunk, K in self.tangents() if chunk.start == 0][0][1]

    def assemble(self):
        """Return the nodal residual; the matrix is that of the state."""
        self.matrix.clear()
        for chunk, K in self.tangents():
            self.matrix.add(chunk, K)
        self.matrix.finish()
        return self.residual()

    def tangent(self):
        """Make the element matrices and forget them."""
        for _ in self.tangents():
            pass

    def insert(self):
        """Add the element matrices of the first chunk in the places of all chunks."""
        self.matrix.clear()
        for _, chunk in self.chunks():
            self.matrix.add(chunk, self._kept[: chunk.stop - chunk.start])
        self.matrix.finish()

    def chunks(self):
        """Yield (region, slice) of the elements."""
        return self.domain.chunks(self.entries)


class NeoHookean(Problem):
    """Residual and tangent of the skeleton's stress."""

    def __init__(self, dim, order, cells):
        """Make the mesh, the state and the pattern."""
        domain, self.law = grid(dim, order, cells), ELASTIC["neo_hookean"](lam=LAM, mu=MU)
        self.u = np.ascontiguousarray(displacement(domain.mesh.X.T).T)
        super().__init__(domain, dim)

    def residual(self):
        """Return the nodal residual."""
        nodal = np.zeros(self.u.shape)
        for _, chunk in self.chunks():
            part, u = self.domain.reference_stiffness.part(chunk), self.domain.gather(self.u, chunk)
            self.domain.add(nodal, chunk, solid.stress_residual(part.G, part.dV, self.law, u))
        return nodal

    def tangents(self):
        """Yield (slice, element matrices)."""
        for _, chunk in self.chunks():
            part, u = self.domain.reference_stiffness.part(chunk), self.domain.gather(self.u, chunk)
            yield chunk, solid.stress_tangent(part.G, part.dV, self.law, u)

    @property
    def contraction_flops(self):
        """Return the operations that contract the derivatives at the points of an element with the
        gradients.
        """
        _, points, A, d = self.domain.reference_stiffness.G.shape
        return 2 * points * A * d * (d * A * d)


class Flow(Problem):
    """Residual and tangent of a free fluid with drag, SUPG and PSPG."""

    def __init__(self, dim, order, cells):
        """Make the mesh, the state, the stabilization parameters of the step before and the
        pattern.
        """
        domain = grid(dim, order, cells)
        X = domain.mesh.X.T
        self.v, v0 = np.ascontiguousarray(velocity(X).T), np.ascontiguousarray(velocity_before(X).T)
        self.a, self.p, self.rest = (self.v - v0) / DT, pressure(X), np.zeros(self.v.shape)
        points = domain.reference.dV.shape
        self.one, self.zero, self.force = (
            np.ones(points),
            np.zeros(points),
            np.zeros((*points, dim)),
        )
        h = circumdiameter(domain.mesh.X[domain.cells[:, : dim + 1]])[:, None]
        self.tau = momentum_tau(domain.mass.N @ domain.gather(v0), h)
        super().__init__(domain, dim + 1)

    def residual(self):
        """Return the nodal residual."""
        domain, columns = self.domain, flow.term_columns(self.domain.dim)
        nodal = np.zeros((domain.n_owned, columns))
        for _, chunk in self.chunks():
            terms = np.empty((*domain.cells[chunk].shape, columns))
            flow.flow_residual(self._elements(chunk), self._fields(chunk), terms)
            domain.add(nodal, chunk, terms)
        return nodal @ self.sum_of_terms

    def tangents(self):
        """Yield (slice, element matrices)."""
        for _, chunk in self.chunks():
            yield chunk, flow.flow_tangent(self._elements(chunk), self._fields(chunk), 1 / DT)

    @property
    def contraction_flops(self):
        """Return the operations that contract the derivatives at the points of an element with
        values and gradients.
        """
        A, m = self.domain.cells.shape[1], self.domain.dim + 1
        return 2 * len(self.domain.mass.N) * A * m * (m * A * m)

    @property
    def sum_of_terms(self):
        """Return the matrix of zeros and ones, (terms, d + 1), that adds up the terms of momentum
        and volume balance.
        """
        d = self.domain.dim
        terms = flow_loops.MOMENTUM_TERMS, flow_loops.VOLUME_TERMS
        momentum, volume = (len(names) for names in terms)
        return np.vstack(
            [np.tile(np.eye(d + 1)[:d], (momentum, 1)), np.tile(np.eye(d + 1)[d], (volume, 1))]
        )

    def _fields(self, chunk):
        v, a, rest, p = (
            self.domain.gather(field, chunk) for field in (self.v, self.a, self.rest, self.p)
        )
        return flow.FlowFields(v, a, v, rest, p, p, self.force[chunk])

    def _elements(self, chunk):
        domain, one, tau = self.domain, self.one[chunk], self.tau[chunk]
        return flow.FlowElements(
            N=domain.mass.N,
            geometry=domain.reference.part(chunk),
            n=one,
            rho=RHO * one,
            drag=Drag(VISCOSITY / PERMEABILITY * one),
            mu=VISCOSITY,
            tau=tau,
            tau_supg=tau,
            nu_lsic=self.zero[chunk],
            tau_u=None,
            second=None,
            grad_n=None,
            convection=True,
            order=1,
            free=True,
        )


def circumdiameter(vertices):
    """Return the diameter of the sphere through the vertices (E, d + 1, d), (E,)."""
    arms = vertices[:, 1:] - vertices[:, :1]
    centre = np.linalg.solve(arms, (arms**2).sum(axis=-1)[..., None] / 2)[..., 0]
    return 2 * np.linalg.norm(centre, axis=-1)


CASES = {
    "neo_hookean_p1": (NeoHookean, 2, 1, 256),
    "neo_hookean_p2": (NeoHookean, 2, 2, 128),
    "flow_p1p1": (Flow, 2, 1, 256),
    "neo_hookean_t4": (NeoHookean, 3, 1, 28),
    "neo_hookean_t10": (NeoHookean, 3, 2, 14),
    "flow_t4": (Flow, 3, 1, 28),
}


def least_seconds(rounds, *jobs):
    """Return the least time of every job over alternating rounds, after one to warm up."""
    best = [np.inf] * len(jobs)
    for turn in range(rounds + 1):
        for k, job in enumerate(jobs):
            start = time.perf_counter()
            job()
            if turn:
                best[k] = min(best[k], time.perf_counter() - start)
    return best


def machine_limits():
    """Return the GB/s of the triad y + s x of 80 MB each and the GFLOP/s of the product of two
    matrices of order 1500, the best of 10.
    """
    x, y, A = np.ones(10_000_000), np.ones(10_000_000), np.ones((1500, 1500), order="F")
    triad, product = least_seconds(10, lambda: daxpy(x, y, a=1e-9), lambda: dgemm(1.0, A, A))
    return {
        "triad_gigabytes_per_second": 1e-9 * 24 * x.size / triad,
        "dgemm_gigaflops": 1e-9 * 2 * len(A) ** 3 / product,
    }


def measure(name, arguments):
    """Return the record of a case."""
    kind, dim, order, cells = CASES[name]
    case = kind(dim, order, max(2, round(cells * arguments.scale)))
    record, elements = {"case": name, "elements": case.domain.n_cells}, case.domain.n_cells
    jobs = [case.assemble, case.tangent, case.insert, case.residual]
    if arguments.peer:
        from bench import assembly_dolfinx as peer

        other = peer.case(kind.__name__, case, sys.modules[__name__])
        jobs += [other.assemble, other.tabulate]
    whole, tangent, insertion, residual, *peers = [
        1e6 * s / elements for s in least_seconds(arguments.rounds, *jobs)
    ]
    record |= {
        "microseconds_per_element": whole,
        "tangent_microseconds": tangent,
        "insertion_microseconds": insertion,
    }
    record["residual_microseconds"] = residual
    record["tangent_gigaflops"] = 1e-3 * case.contraction_flops / tangent
    record["insertion_gigabytes_per_second"] = 1e-3 * 24 * case.entries / insertion
    norms = float(np.linalg.norm(case.assemble())), case.matrix.mat.norm(2)
    record |= {"residual_norm": norms[0], "tangent_norm": norms[1]}
    if arguments.peer:
        record |= {
            "peer": peer.NAME,
            "peer_microseconds_per_element": peers[0],
            "peer_kernel_microseconds": peers[1],
        }
        record["ratio"] = whole / peers[0]
        record["norm_difference"] = max(
            abs(a / b - 1) for a, b in zip(norms, other.norms(), strict=True)
        )
    return record


def main():
    """Print a line, or with --json an object, for each case."""
    parser = command_line.parser("bench assembly", __doc__)
    parser.add_argument("cases", nargs="*", metavar="CASE", help=", ".join(CASES))
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--peer", action="store_true")
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--scale", type=float, default=1.0)
    arguments = parser.parse_args()
    unknown = [name for name in arguments.cases if name not in CASES]
    if unknown:
        parser.error(f"unknown case '{unknown[0]}'; choose from {', '.join(CASES)}")
    records, limits = [], machine_limits()
    for name in arguments.cases or CASES:
        records.append(measure(name, arguments) | limits)
        if not arguments.json:
            print(
                "  ".join(
                    f"{k} {v:.4g}" if isinstance(v, float) else f"{k} {v}"
                    for k, v in records[-1].items()
                ),
                flush=True,
            )
    if arguments.json:
        print(json.dumps(records, indent=2))


if __name__ == "__main__":
    main()
