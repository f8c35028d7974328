"""What a phase is made of: domain, materials, boundary data, terms of the model, and how its matrix
and its KSP are made.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..fem.boundary import InterfaceMass
from ..fem.closed import ClosedPart
from ..fem.domain import Domain
from ..fem.essential import Dirichlet, Prescribed
from ..fem.transfer import InterfaceTransfer
from ..linalg.constrained import BlockMatrix
from ..linalg.fieldsplit import fluid_defaults, fluid_fields, rigid_body_modes, solid_defaults
from ..linalg.matrix import ElementMatrix
from ..linalg.nullspace import NullVector
from ..linalg.solver import LinearSolver
from ..linalg.stopwatch import Stopwatch
from ..materials.elastic import ElasticLaw
from ..materials.porous import PorousMaterial
from .initial_stress import InitialStress
from .loads import BodyForce, ConcentratedLoad
from .surface_terms import OnSurface


@dataclass(frozen=True, kw_only=True)
class PhaseSetup:
    """Common to all phases.

    materials : region -> PorousMaterial; body_force : what acts on its mass;
    split : "corrected", "plain" or "scaled" (plain with a scaled mass);
    direct : whether the default solver is a factorization; stopwatch : where its time is counted;
    surfaces : conditions of the momentum balance on surfaces
    """

    domain: Domain
    materials: dict[str, PorousMaterial]
    body_force: tuple[BodyForce, ...]
    inertia: bool
    moving_mesh: bool
    split: str
    direct: bool
    stopwatch: Stopwatch
    surfaces: tuple[OnSurface, ...] = ()

    def material(self, region: str, rows: slice | np.ndarray) -> PorousMaterial:
        """Return the material of some elements of a region."""
        return self.materials[region].at(self.domain.cell_numbers[rows])

    @property
    def has_followers(self) -> bool:
        """Return whether a load follows a surface, so that the tangent need not be symmetric."""
        return any(place.condition.follows for place in self.surfaces)

    @property
    def laws(self) -> dict[str, ElasticLaw]:
        """Return region -> elastic law of those that have one."""
        laws = {region: material.elastic for region, material in self.materials.items()}
        return {region: law for region, law in laws.items() if law is not None}

    @property
    def is_symmetric(self) -> bool:
        """Return whether the tangent of a displacement is symmetric."""
        return not self.has_followers and all(law.symmetric for law in self.laws.values())

    def new_matrix(self, prefix: str, mask: np.ndarray) -> ElementMatrix:
        """Return the empty matrix of a nodal field with m components, prescribed where mask
        (n_local, m) is true.
        """
        domain = self.domain
        return ElementMatrix(
            domain.mesh.comm, domain.cells, domain.numbering, len(domain.nodes), mask, prefix
        )

    def new_tangents(self, components: int) -> np.ndarray:
        """Return element matrices (E, A, m, A, m) of m components, all zero."""
        return np.zeros((self.domain.n_cells, *(2 * (self.domain.cells.shape[1], components))))

    def on(self, domain: Domain) -> "PhaseSetup":
        """Return the same setup on another domain of the mesh."""
        return replace(self, domain=domain)

    def displacement_solver(
        self, matrix: BlockMatrix, prefix: str, counted: bool = False
    ) -> LinearSolver:
        """Return the KSP of a matrix of displacements, symmetric by `is_symmetric`; counted : of
        `solid_defaults` (collective).
        """
        mesh = self.domain.mesh
        symmetric = self.is_symmetric
        if symmetric:
            matrix.declare_symmetric()
        modes = rigid_body_modes(mesh.X[self.domain.nodes], mesh.comm)
        defaults = solid_defaults(mesh.dim, self.direct, symmetric, counted and symmetric)
        return LinearSolver(matrix.mat, prefix, defaults, near_nullspace=modes)


@dataclass(frozen=True, kw_only=True)
class SolidSetup(PhaseSetup):
    """Common to the skeleton and a solid without pores: essential displacement.

    reaction : whether the force on its boundary is kept from step to step; loads : on points and
    lines; initial_stress : beside that of the laws; fading : from when to when a force balances
    what a stage has changed [s]
    """

    dirichlet: Dirichlet
    reaction: bool = False
    loads: tuple[ConcentratedLoad, ...] = ()
    initial_stress: InitialStress | None = None
    fading: tuple[float, float] | None = None

    @property
    def mask(self) -> np.ndarray:
        """Return where the displacement is no unknown of the solver, (n_local, d) bool."""
        return self.dirichlet.mask

    @property
    def is_static(self) -> bool:
        """Return whether the tangent of the elastic forces alone decides the stability."""
        return False

    def new_solver(self, matrix: BlockMatrix) -> LinearSolver:
        """Return the KSP of the block; its matrix is symmetric positive definite up to the state's
        geometric stiffness.
        """
        return self.displacement_solver(matrix, "solid_", self.is_static)


@dataclass(frozen=True, kw_only=True)
class SkeletonSetup(SolidSetup):
    """The skeleton of a porous medium, and solids without pores that share nodes with it.

    fluid : the part of the domain that has pores, itself where all of it has; with_hessian :
    whether the fluid wants second derivatives; mass_scaling : factor of the mass in the tangent of
    the split "scaled", or "optimal"
    """

    fluid: Domain
    with_hessian: bool
    mass_scaling: float | str | None


@dataclass(frozen=True, kw_only=True)
class ElasticSolidSetup(SolidSetup):
    """A solid without pores, or one that a free fluid flows through, of which it feels the drag
    alone.

    immersed : whether it is one of these; fluid_force : what acts on the fluid in its pores;
    robin : of an interface on which α v_s is added to the traction; driven : (n_local,) bool,
    nodes to which an interface tells their velocity
    """

    immersed: bool = False
    fluid_force: tuple[BodyForce, ...] = ()
    robin: InterfaceMass | None = None
    driven: np.ndarray | None = None

    @cached_property
    def mask(self) -> np.ndarray:
        """Return where the displacement is no unknown of the solver, (n_local, d) bool."""
        held = self.dirichlet.mask
        return held if self.driven is None else held | self.driven[:, None]

    @property
    def is_static(self) -> bool:
        """Return whether the tangent of the elastic forces alone decides the stability; that of a
        plastic flow is singular at the collapse load, where its pivots have the sign of round-off.
        """
        flows = any(law.plastic for law in self.laws.values())
        return not (self.inertia or self.immersed or flows)


@dataclass(frozen=True, kw_only=True)
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
    def mask(self) -> np.ndarray:
        """Return where the displacement is prescribed, (n_local, d) bool."""
        return self.dirichlet.mask | self.carried[:, None]

    def new_solver(self, matrix: BlockMatrix) -> LinearSolver:
        """Return the KSP of the motion.

        Its tolerance is relative to the increment of a sweep, and what it leaves is in the right
        side of the next: the mesh converges with the coupling.
        """
        return self.displacement_solver(matrix, "mesh_")


@dataclass(frozen=True, kw_only=True)
class FluidSetup(PhaseSetup):
    """Common to the pore fluid and a free fluid: essential velocity, stabilization.

    no_slip : (n_local,) bool, nodes with v_f = v_s
    """

    velocity: Dirichlet
    no_slip: np.ndarray
    convection: bool
    pspg: bool
    supg: bool
    lsic: bool
    undrained: bool = False

    @property
    def viscous(self) -> bool:
        """Return whether the fluid has a viscous (Brinkman) term."""
        return any(material.viscosity for material in self.materials.values())

    @cached_property
    def has_no_slip(self) -> bool:
        """Return whether this rank has a wall without slip."""
        return bool(self.no_slip.any())

    @property
    def mask(self) -> np.ndarray:
        """Return where (v, p[, s]) is prescribed, (n_local, m) bool."""
        raise NotImplementedError

    @property
    def pressures(self) -> tuple[Prescribed, ...]:
        """Return the prescribed pressures."""
        return ()

    @property
    def solver_mask(self) -> np.ndarray:
        """Return `mask` as the solver sees it."""
        return self.mask

    def velocity_free(self, owned: np.ndarray) -> np.ndarray:
        """Return a copy of (n_owned, d) whose prescribed rows, walls included, are zero."""
        n, d = owned.shape
        return np.where(self.mask[:n, :d], 0.0, owned)

    def pressure_free(self, owned: np.ndarray) -> np.ndarray:
        """Return a copy of (n_owned, 1) whose prescribed rows are zero."""
        n = len(owned)
        d = self.domain.dim
        return np.where(self.mask[:n, d : d + 1], 0.0, owned)

    def linear_solver(
        self,
        matrix: BlockMatrix,
        operators: bool,
        preconditioner: Any = None,
        null_vectors: tuple[NullVector, ...] = (),
    ) -> LinearSolver:
        """Return the KSP of the block with its fields v and p (with s) for a FieldSplit
        preconditioner.

        operators : whether the pressure of an iterative solver has operators of its own;
        preconditioner : object with setUp(pc) and apply(pc, x, y) that uses them
        """
        domain = self.domain
        mesh = self.domain.mesh
        components = self.mask.shape[1]
        fields = fluid_fields(mesh.comm, domain.first, len(domain.nodes), mesh.dim, components)
        steady = operators and self.convection and not self.inertia
        defaults = fluid_defaults(mesh.dim, self.direct, self.viscous, self.pspg, operators, steady)
        return LinearSolver(
            matrix.mat,
            "fluid_",
            defaults,
            fields=fields,
            preconditioner=preconditioner,
            null_vectors=list(null_vectors),
        )


@dataclass(frozen=True, kw_only=True)
class PoreFluidSetup(FluidSetup):
    """The fluid in a porous medium: essential pressure, and what a compression wave asks for.

    fluxes : conditions of the volume balance on surfaces; stress_nodes : (n_local,) bool, nodes
    where the pressure and the total stress are prescribed and so the auxiliary field s is known;
    reaction : whether what both balances leave on nodes is kept from step to step;
    free_surface : elements (F,) and terms (F, A, A) of the surfaces whose normal displacement is
    free while no pressure is prescribed, where s vanishes weakly; has_auxiliary : whether there is
    an s, with inertia in the corrected split
    """

    pressure: Dirichlet
    fluxes: tuple[OnSurface, ...]
    stress_nodes: np.ndarray
    free_surface: tuple[np.ndarray, np.ndarray]
    has_auxiliary: bool
    reaction: bool = False

    @property
    def pressures(self) -> tuple[Prescribed, ...]:
        """Return the prescribed pressures."""
        return tuple(self.pressure.conditions)

    @cached_property
    def mask(self) -> np.ndarray:
        """Return where (v, p[, s]) is prescribed or there are no pores, (n_local, m) bool."""
        velocity = self.velocity.mask | self.no_slip[:, None]
        auxiliary = [self.stress_nodes] if self.has_auxiliary else []
        given = np.column_stack([velocity, self.pressure.mask, *auxiliary])
        return given | ~self.domain.holds[:, None]


@dataclass(frozen=True, kw_only=True)
class FreeFluidSetup(FluidSetup):
    """A free fluid, which may go on into porous solids; its nodes on the interface are without
    slip.

    held : (n_local, d) bool, where the solid's displacement is prescribed: without slip in every
    sweep; robin : of an interface on which α v_f is added to the traction: its nodes are without
    slip at the end of a sweep only; closed : parts of the fluid whose pressure has no level
    """

    held: np.ndarray
    robin: InterfaceMass | None = None
    closed: tuple[ClosedPart, ...] = ()

    @cached_property
    def mask(self) -> np.ndarray:
        """Return where (v, p) is prescribed, (n_local, d + 1) bool: p nowhere."""
        velocity = self.velocity.mask | self.no_slip[:, None]
        return np.column_stack([velocity, np.zeros(len(velocity), dtype=bool)])

    @cached_property
    def solver_mask(self) -> np.ndarray:
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
    def released(self) -> np.ndarray:
        """Return where the velocity of an interface is unknown to the solver, (n_local, d) bool."""
        return (self.mask & ~self.solver_mask)[:, : self.domain.dim]

    def constant_pressures(self, domain: Domain, components: int, p: int) -> tuple[NullVector, ...]:
        """Return the `NullVector`s of closed parts in a matrix on a domain whose nodes have the
        pressure as component p.
        """
        return tuple(_constant_pressure(part, domain, components, p) for part in self.closed)


def _constant_pressure(part, domain, components, p):
    values = np.zeros((len(domain.nodes), components))
    values[:, p] = part.nodes[domain.nodes]
    row = (
        None if part.pin is None else components * int(np.searchsorted(domain.nodes, part.pin)) + p
    )
    return NullVector(values.ravel(), row)
