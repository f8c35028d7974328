"""What a phase is made of: domain, materials, boundary data, terms of the model, and how its matrix
and its KSP are made.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..fem.boundary import InterfaceMass
from ..fem.domain import Domain
from ..fem.essential import Dirichlet
from ..fem.transfer import InterfaceTransfer
from ..linalg.fieldsplit import fluid_defaults, fluid_fields, rigid_body_modes, solid_defaults
from ..linalg.matrix import ElementMatrix
from ..linalg.nullspace import NullVector
from ..linalg.solver import LinearSolver
from ..linalg.stopwatch import Stopwatch
from ..materials.elastic import ElasticLaw


@dataclass(frozen=True)
class PhaseSetup:
    """Common to both phases.

    materials : dict region -> PorousMaterial; body_force : dict component -> expression of b
    [m/s²];
    split : "corrected", "plain" or "scaled" (plain with a scaled mass);
    direct : whether the default solver is a factorization; stopwatch : where its time is counted
    """

    domain: Domain
    materials: dict
    body_force: dict
    inertia: bool
    moving_mesh: bool
    split: str
    direct: bool
    stopwatch: Stopwatch

    @property
    def porous(self):
        """Return whether a material has solid and fluid."""
        return any(0 < material.n_s0 < 1 for material in self.materials.values())

    def new_matrix(self, prefix, components, mask):
        """Return the empty `ElementMatrix` of a nodal field with m components, prescribed where
        mask (n_local, m) is true.
        """
        domain = self.domain
        return ElementMatrix(
            domain.mesh.comm, domain.cells, domain.numbering, len(domain.nodes), mask, prefix
        )

    def new_tangents(self, components):
        """Return element matrices (E, A, m, A, m) of m components, all zero."""
        return np.zeros((self.domain.n_cells, *(2 * (self.domain.cells.shape[1], components))))

    def on(self, domain):
        """Return the same setup on another domain of the mesh."""
        return replace(self, domain=domain)

    def displacement_solver(self, matrix, prefix, counted=False):
        """Return the KSP of a symmetric matrix of displacements; counted : of `solid_defaults`
        (collective).
        """
        mesh = self.domain.mesh
        matrix.declare_symmetric()
        modes = rigid_body_modes(mesh.X[self.domain.nodes], mesh.comm)
        defaults = solid_defaults(mesh.dim, self.direct, counted=counted)
        return LinearSolver(matrix.mat, prefix, defaults, near_nullspace=modes)

    def solve(self, solver, rhs):
        """Return the solution on the owned nodes for a right side, both (n_owned, m); zero outside
        of the domain (collective).
        """
        solution = np.zeros(rhs.shape)
        nodes = self.domain.nodes
        if not self.domain.n_nodes:
            return solution
        solution[nodes] = solver.solve(rhs[nodes].ravel()).reshape(len(nodes), rhs.shape[1])
        return solution


@dataclass(frozen=True)
class SolidSetup(PhaseSetup):
    """The skeleton: essential displacement and surface tractions of the mixture [Pa].

    mass_scaling : factor of the mass in the tangent of the split "scaled", or "optimal"
    immersed : a porous solid that a free fluid flows through, of which it feels the drag alone;
    robin : of an interface on which α v_s is added to the traction; driven : (n_local,) bool, nodes
    to which an interface tells their velocity; reaction : whether the force on its boundary is kept
    from step to step
    """

    dirichlet: Dirichlet
    loads: tuple
    with_hessian: bool
    mass_scaling: float | str | None
    immersed: bool = False
    robin: InterfaceMass | None = None
    driven: np.ndarray | None = None
    reaction: bool = False

    @cached_property
    def mask(self):
        """Return where the displacement is no unknown of the solver, (n_local, d) bool."""
        held = self.dirichlet.mask
        return held if self.driven is None else held | self.driven[:, None]

    def new_solver(self, matrix):
        """Return the KSP of the block; its matrix is symmetric positive definite up to the state's
        geometric stiffness.
        """
        return self.displacement_solver(matrix, "solid_", self.is_static)

    @property
    def is_static(self):
        """Return whether the tangent of the elastic forces alone decides the stability."""
        return not (self.inertia or self.porous)


@dataclass(frozen=True)
class MeshSetup(PhaseSetup):
    """The motion of a free fluid's mesh: an elastic law on the reference configuration, stiffer on
    small elements.

    carried : (n_local,) bool, nodes of the solid and of the interface, which carry the mesh;
    transfer : to those of the fluid;
    dirichlet : prescribed displacement, fixed boundaries included;
    stiffening : exponent χ of (V_mean/V_e)^χ, the factor of the law in element e (Stein, Tezduyar &
    Benney 2003)
    """

    law: ElasticLaw
    stiffening: float
    carried: np.ndarray
    transfer: InterfaceTransfer
    dirichlet: Dirichlet

    @cached_property
    def mask(self):
        """Return where the displacement is prescribed, (n_local, d) bool."""
        return self.dirichlet.mask | self.carried[:, None]

    def new_solver(self, matrix):
        """Return the KSP of the motion.

        Its tolerance is relative to the increment of a sweep, and what it leaves is in the right
        side of the next: the mesh converges with the coupling.
        """
        return self.displacement_solver(matrix, "mesh_")


@dataclass(frozen=True)
class FluidSetup(PhaseSetup):
    """The fluid: essential velocity and pressure, tractions on a free fluid [Pa], seepage fluxes
    [m/s], stabilization.

    no_slip : (n_local,) bool, nodes with v_f = v_s; stress_nodes : (n_local,) bool, nodes where the
    pressure and the total stress are prescribed and so the auxiliary field s is known; free_surface
    : elements (F,) and terms (F, A, A) of the surfaces whose normal displacement is free while no
    pressure is prescribed, where s vanishes weakly;
    robin : of an interface on which α v_f is added to the traction: its nodes are without slip at
    the end of a sweep only;
    held : (n_local, d) bool, where the solid's displacement is prescribed: without slip in every
    sweep;
    open_boundaries : `fem.boundary.OpenBoundary`s of a free fluid; closed :
    `fem.closed.ClosedPart`s of it
    """

    velocity: Dirichlet
    pressure: Dirichlet
    loads: tuple
    fluxes: tuple
    no_slip: np.ndarray
    stress_nodes: np.ndarray
    free_surface: tuple
    has_auxiliary: bool
    convection: bool
    pspg: bool
    supg: bool
    lsic: bool
    undrained: bool
    robin: InterfaceMass | None = None
    held: np.ndarray | None = None
    open_boundaries: tuple = ()
    closed: tuple = ()

    @property
    def viscous(self):
        """Return whether the fluid has a viscous (Brinkman) term."""
        return any(material.viscosity for material in self.materials.values())

    @cached_property
    def has_no_slip(self):
        """Return whether this rank has a wall without slip."""
        return bool(self.no_slip.any())

    @cached_property
    def mask(self):
        """Return where (v, p[, s]) is prescribed, (n_local, m) bool."""
        velocity = self.velocity.mask | self.no_slip[:, None]
        auxiliary = [self.stress_nodes] if self.has_auxiliary else []
        return np.column_stack([velocity, self.pressure.mask, *auxiliary])

    @cached_property
    def solver_mask(self):
        """Return `mask` as the solver sees it: with a Robin condition the velocity of the interface
        is unknown.

        Not where the solid is held: what it takes there is no balance of solid and fluid, but the
        reaction of a support.
        """
        if self.robin is None:
            return self.mask
        mask = self.mask.copy()
        mask[:, : self.domain.dim] = self.velocity.mask | (self.held & self.no_slip[:, None])
        return mask

    @cached_property
    def released(self):
        """Return where the velocity of an interface is unknown to the solver, (n_local, d) bool."""
        return (self.mask & ~self.solver_mask)[:, : self.domain.dim]

    def velocity_free(self, owned):
        """Return a copy of (n_owned, d) whose prescribed rows, walls included, are zero."""
        n, d = owned.shape
        return np.where(self.mask[:n, :d], 0.0, owned)

    @property
    def has_pressure_operators(self):
        """Return whether the pressure of an iterative solver is preconditioned by operators of its
        own: in a free fluid.
        """
        return self.pspg and any(material.is_free_fluid for material in self.materials.values())

    def new_solver(self, matrix, components, preconditioner=None):
        """Return the KSP of the block with its fields v and p (with s) for a FieldSplit
        preconditioner.

        preconditioner : object with setUp(pc) and apply(pc, x, y) for the pressure, where it has
        operators of its own
        """
        domain = self.domain
        mesh = self.domain.mesh
        fields = fluid_fields(mesh.comm, domain.first, len(domain.nodes), mesh.dim, components)
        free = self.has_pressure_operators
        steady = free and self.convection and not self.inertia
        defaults = fluid_defaults(mesh.dim, self.direct, self.viscous, self.pspg, free, steady)
        null = self.constant_pressures(domain, components, mesh.dim)
        return LinearSolver(
            matrix.mat,
            "fluid_",
            defaults,
            fields=fields,
            preconditioner=preconditioner,
            null_vectors=null,
        )

    def constant_pressures(self, domain, components, p):
        """Return the `NullVector`s of closed parts in a matrix on a domain whose nodes have the
        pressure as component p.
        """
        return [_constant_pressure(part, domain, components, p) for part in self.closed]


def _constant_pressure(part, domain, components, p):
    values = np.zeros((len(domain.nodes), components))
    values[:, p] = part.nodes[domain.nodes]
    row = (
        None if part.pin is None else components * int(np.searchsorted(domain.nodes, part.pin)) + p
    )
    return NullVector(values.ravel(), row)
