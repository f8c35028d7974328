"""From a scene of solids and free fluids to the two phases, the motion of the mesh and their
coupling.
"""

from collections.abc import Collection

import numpy as np

from ..conditions.backflow import Backflow
from ..config import Scene
from ..config.expressions import Expression
from ..coupling.condensed import CondensedCoupling
from ..coupling.interface import GUARD, InterfaceCoupling, InterfaceMedium, InterfaceMonolithic
from ..coupling.participant import FluidParticipant, SolidParticipant
from ..coupling.robin import InterfaceConditions, InterfaceMeans
from ..coupling.through_flow import GUARD as GUARD_THROUGH
from ..coupling.through_flow import ThroughFlowCoupling
from ..errors import InputError
from ..fem.boundary import InterfaceMass, InterfacePressure, has_facets, tags_of
from ..fem.closed import closed_nodes
from ..fem.distribute import LocalMesh
from ..fem.domain import Domain
from ..fem.essential import Essential, owned_nodes
from ..fem.surface import Surface
from ..fem.transfer import InterfaceTransfer, Pair
from ..linalg.options import are_factored
from ..linalg.stopwatch import Stopwatch
from ..materials import MESH_MOTION
from ..phases.condensed import CondensedSolid
from ..phases.elastic_solid import ElasticSolid
from ..phases.free_fluid import FreeFluid
from ..phases.interface_monolithic import InterfaceSystem
from ..phases.mesh_motion import MeshMotion
from ..phases.setup import ElasticSolidSetup, FreeFluidSetup, MeshSetup
from ..phases.surface_terms import OnSurface
from .axis import axis_tags
from .builder import MONOLITHIC, Builder, is_direct
from .closed import InterfaceScheme, closed_parts, interface_scheme
from .conditions import linear_constraints
from .inflow import inflows
from .loads import concentrated_loads
from .outlets import open_tags
from .start import put_at_start

# Unknowns of an interface up to which the solid's answer, a dense matrix, is made: one solution for
# each of them.
CONDENSED = 1500
# What the fluid sees of the solid in a scheme.
SEES = {"partitioned": "trial", "weak": "predicted", "one_way": "nothing"}


class InterfaceBuilder(Builder):
    """Solids and free fluids on their parts of a mesh, and the motion of the fluid's mesh."""

    def __init__(self, scene: Scene, mesh: LocalMesh, stopwatch: Stopwatch) -> None:
        """Find the phases and what they share (collective)."""
        super().__init__(scene, mesh, stopwatch)
        materials = self.materials
        self._free = {region: m for region, m in materials.items() if m.is_free_fluid}
        self._solids = {
            region: m.immersed for region, m in materials.items() if not m.is_free_fluid
        }
        self._pores = [region for region, m in materials.items() if m.has_pores]
        self._fluids = self._free | {region: materials[region].pore_fluid for region in self._pores}
        self._solid_domain = Domain(mesh, self._solids)
        self._fluid_domain = Domain(mesh, self._fluids)
        self._solid_tags, self._fluid_tags = (
            tags_of(mesh, domain.row_of_cell) for domain in self._domains
        )
        dense = Domain(mesh, [region for region in self._solids if region not in self._pores])
        where = scene.source_path or "scene"
        pairs = [
            Pair(pair.fluid, pair.solid, f"{where} [interface.{i}]")
            for i, pair in enumerate(scene.interface)
        ]
        shared = dense.holds & self._fluid_domain.holds | self._told_by_another()
        self.transfer = InterfaceTransfer(mesh, shared, pairs)
        sticking = self.transfer.fluid_nodes
        self._inflows = inflows(scene, mesh, materials, sticking, self._scaled)
        self._velocity = self._dirichlet("velocity", self._fluid_tags)
        held = self._dirichlet("displacement", self._solid_tags).mask
        self._held = self.transfer.held(held)
        self._sticks = sticking[:, None]
        chosen = self._scheme()
        self.scheme = chosen.scheme
        self._pair = chosen.pair
        if self._constraints and self._pair != "dirichlet_neumann":
            raise InputError(
                f"{where} [{self._constraints[0].name}]: received it with coupling.interface ="
                f" '{self._pair}', expected 'dirichlet_neumann' or coupling.scheme = 'direct'"
            )
        self.notices = chosen.notices
        solid_tags, fluid_tags = (
            [tag for pair in pairs for tag in getattr(pair, side)] for side in ("solid", "fluid")
        )
        solid, fluid = self._domains
        self._masses = (
            InterfaceMass.between(fluid, solid, fluid_tags),
            InterfaceMass.between(solid, fluid, solid_tags),
        )
        self.pressure = (
            InterfacePressure(fluid, solid, fluid_tags) if self.scheme == "one_way" else None
        )

    def medium(self) -> InterfaceMedium:
        """Return the coupling scheme with its phases in their initial state (collective)."""
        solid = ElasticSolid(self.solid())
        fluid = FreeFluid(self.fluid())
        motion = MeshMotion(self.motion(), fluid.domain, self.scene.model.viscosity)
        put_at_start(self.scene, solid, fluid, motion, self.transfer)
        coupling = self._coupling(solid, fluid, motion)
        coupling.load_factor = self.load_factor
        coupling.notices = self.notices
        return coupling

    def _through_flow(self, medium, both):
        """Return the sweeps over porous solids and the fluid that flows through them."""
        choice = self.scene.coupling

        def accelerator(dot, name=choice.accelerator):
            return self.accelerator(dot, name, choice.relaxation, GUARD_THROUGH)

        return ThroughFlowCoupling(*medium, accelerator, self.scene.full_newton, **both)

    def _coupling(self, solid, fluid, motion):
        """Return the coupling scheme of the phases (collective)."""
        choice = self.scene.coupling
        conditions = self.conditions()
        transfer = self.transfer

        def accelerator(dot, name=choice.accelerator):
            first = conditions.first_factor if choice.relaxation is None else choice.relaxation
            return self.accelerator(dot, name, first, GUARD)

        medium = solid, fluid, solid.mesh.comm, choice.tolerance, choice.max_iterations
        both = {"motion": motion, "transfer": transfer}
        if self.scheme in MONOLITHIC:
            system = InterfaceSystem(solid, fluid, motion, transfer, self.scheme == "direct")
            return InterfaceMonolithic(*medium, system, **both)
        if self.scene.precice:
            side = FluidParticipant if self._fluid_domain.n_nodes else SolidParticipant
            return side(
                *medium,
                accelerator,
                self.scene.full_newton,
                conditions=conditions,
                **both,
            )
        if self._pores:
            return self._through_flow(medium, both)
        if self._pair == "condensed":
            answer = CondensedSolid(solid, fluid)
            return CondensedCoupling(*medium, self.scene.full_newton, answer=answer, **both)
        return InterfaceCoupling(
            *medium,
            accelerator,
            self.scene.full_newton,
            sees=SEES[self.scheme],
            conditions=conditions,
            pressure=self.pressure,
            **both,
        )

    def _shared_with_another(self):
        """Return the owned nodes of the interface with another program, (N,) ascending."""
        tags = self.scene.precice.on if self.scene.precice else ()
        nodes = [owned_nodes(self.mesh, tag) for tag in tags]
        return np.unique(np.concatenate(nodes)) if nodes else np.empty(0, dtype=int)

    def _told_by_another(self):
        """Return the nodes of the fluid whose motion another program tells, (n_local,) bool
        (collective).
        """
        told = np.zeros((self.mesh.n_local, 1))
        told[self._shared_with_another()] = 1.0
        self.mesh.halo.update(told)
        return (told[:, 0] > 0) & self._fluid_domain.holds

    def _scheme(self):
        """Return the `closed.InterfaceScheme` of the scene (collective)."""
        if self.scene.precice:
            return self._scheme_of_participant()
        choice = self.scene.coupling
        if choice.interface == "condensed" and (missing := self._lacks_for_condensing()):
            where = f"{self.scene.source_path or 'scene'} [coupling.interface]"
            raise InputError(f"{where}: received 'condensed' {missing}; take 'dirichlet_neumann'")
        if choice.interface == "auto" and self._can_condense(choice):
            return InterfaceScheme(choice.scheme, "condensed")
        direct = is_direct(self.mesh) or bool(self._pores)  # Robin conditions know no pores
        return interface_scheme(self.scene, self._closed_by_solid(), direct)

    def _scheme_of_participant(self):
        if self._closed_by_solid():
            raise InputError(
                f"{self.scene.source_path or 'scene'} [precice]: received a fluid that the"
                " interface closes, expected one with an open boundary: told its velocity all"
                " around, its pressure has no level"
            )
        return InterfaceScheme("partitioned", "dirichlet_neumann")

    def _can_condense(self, choice):
        time = self.scene.time.scheme
        inertia = self.scene.model.solid_inertia
        dynamic = choice.scheme == "partitioned" and time == "generalized_alpha" and inertia
        return dynamic and not self.scene.interface and not self._lacks_for_condensing()

    def _lacks_for_condensing(self):
        """Return why the solid's answer is not condensed to the interface, "" where it can be
        (collective).
        """
        held = int(self.transfer.fluid_nodes[: self.mesh.n_owned].sum())
        unknowns = self.mesh.dim * self.mesh.comm.allreduce(held)
        if self._pores:
            return "beside a porous solid, expected one without pores"
        if any(law.plastic for m in self._solids.values() if (law := m.elastic)):
            return "with a plastic solid, expected an elastic one"
        if self._constraints:
            return f"beside [{self._constraints[0].name}], expected single components of it"
        if not (is_direct(self.mesh) and are_factored("solid_", "fluid_")):
            return (
                "with iterative solvers, expected factorizations of solid and fluid (2-D, no"
                " options against them)"
            )
        if unknowns > CONDENSED:
            return (
                f"with {unknowns} unknowns on the interface, expected {CONDENSED} at most: the"
                " answer is a dense matrix"
            )
        return (
            "" if unknowns else "without a node that solid and fluid share, expected an interface"
        )

    @property
    def _constraints(self):
        return linear_constraints(self.scene, self._solid_tags)

    @property
    def _domains(self):
        return self._solid_domain, self._fluid_domain

    @property
    def _moving(self):
        model = self.scene.model.moving_mesh and self.scheme != "one_way"
        return bool(model and self._fluid_domain.n_nodes)

    def _closed_by_solid(self):
        """Return whether a part of the fluid is closed, but not by what is held or has a prescribed
        velocity (collective).
        """
        parts = [
            closed_nodes(self._fluid_domain, self._velocity.mask | known) for known in self._known
        ]
        return len(parts[0]) > len(parts[1])

    @property
    def _known(self):
        """Return where the solid tells the fluid its velocity, and where that is prescribed,
        (n_local, d) bool.
        """
        return self._sticks, self._sticks & self._held

    def essentials(self, quantity: str, tags: Collection[str] | None = None) -> list[Essential]:
        """Return the `Essential`s of a quantity, on some tags if they are given; of the velocity
        those of inlets with a flow rate too.
        """
        found = super().essentials(quantity, tags)
        return found + self._inflows if quantity == "velocity" else found

    def _dirichlet(self, quantity, tags):
        return self.dirichlet(self.mesh.dim, self.essentials(quantity, tags))

    def solid(self) -> ElasticSolidSetup:
        """Return the setup of the solid (collective)."""
        domain = self._solid_domain
        surfaces = self.surfaces(domain, "momentum", self._solid_tags)
        given = self.essentials("displacement", self._solid_tags)
        self.require_normal_motion(surfaces, given, "displacement")
        return ElasticSolidSetup(
            inertia=self.scene.model.solid_inertia,
            moving_mesh=self._moving and bool(self._pores),
            immersed=bool(self._pores),
            fluid_force=self._body_forces("fluid") if self._pores else (),
            dirichlet=self.displacement(self._solid_tags),
            surfaces=surfaces,
            loads=concentrated_loads(self.scene, domain, self.components),
            initial_stress=self.initial_stress(domain),
            fading=self.fading,
            robin=self._masses[1] if self._pair == "robin_robin" else None,
            driven=self.transfer.fluid_nodes if self._pair == "neumann_dirichlet" else None,
            reaction=not all(
                [
                    has_facets(self._fluid_domain, surface.on)
                    for surface in self.scene.surfaces
                    if "force" in surface.quantities
                ]
            ),
            **self.common(domain, self._solids, "solid", "plain"),
        )

    def fluid(self) -> FreeFluidSetup:
        """Return the setup of the fluid, its velocity prescribed by the solid on the interface
        (collective).
        """
        domain = self._fluid_domain
        given = self.essentials("velocity", self._fluid_tags)
        surfaces = self.surfaces(domain, "momentum", self._fluid_tags)
        self.require_normal_motion(surfaces, given, "velocity")
        surfaces += self._backflow_by_default(given)
        known = self._known[1]
        return FreeFluidSetup(
            moving_mesh=self._moving,
            velocity=self._velocity,
            surfaces=surfaces,
            no_slip=self.transfer.fluid_nodes,
            robin=None if self._pair == "dirichlet_neumann" else self._masses[0],
            held=self._held,
            closed=closed_parts(self.scene, domain, self._velocity, given, known),
            **self.of_fluid(),
            **self.common(domain, self._fluids, "fluid", "plain"),
        )

    def _backflow_by_default(self, given):
        """Return the backflow terms of surfaces through which fluid would carry energy in that
        nothing gives (collective).
        """
        model = self.scene.model
        wanted = self.scene.stabilization.backflow
        if not (wanted and model.convection and model.fluid_inertia):
            return ()
        free = tags_of(self.mesh, Domain(self.mesh, self._free).row_of_cell)
        porous = tags_of(self.mesh, Domain(self.mesh, self._pores).row_of_cell)
        tags = open_tags(self.scene, self.mesh, free - porous - axis_tags(self.mesh), given)
        return tuple(
            OnSurface(
                Backflow(value=1.0),
                Surface(self._fluid_domain, tag, self.materials),
                f"backflow:{tag}",
            )
            for tag in tags
        )

    def conditions(self) -> InterfaceConditions:
        """Return the `coupling.robin.InterfaceConditions` of the interface."""
        choice = self.scene.coupling
        mesh = self.mesh
        mass = self._masses[0]
        power = 1 / (self.mesh.dim - 1)
        if not mass.area:
            return InterfaceConditions(self._pair, None, choice.robin, mass, self.transfer)
        volume, modulus, rho_s = self._means(
            self._solid_domain, lambda m: (m.elastic.oedometer_modulus, m.rho_s)
        )
        _, rho_f = self._means(self._fluid_domain, lambda m: (m.rho_fR,))
        facets = mesh.comm.allreduce(int(self._fluid_domain.owned[mass.rows].sum()))
        interface = InterfaceMeans(
            modulus,
            rho_s,
            rho_f,
            volume / mass.area,
            mass.extent**power,
            (mass.extent / facets) ** power,
        )
        return InterfaceConditions(self._pair, interface, choice.robin, mass, self.transfer)

    def _means(self, domain, properties):
        """Return the volume of a domain and the means over it of what properties(material) gives
        (collective).
        """
        sums = np.zeros(1)
        for region, span in domain.region_slices.items():
            volumes = (domain.reference.dV[span].sum(axis=1) * domain.owned[span])[:, None]
            material = self.materials[region].at(domain.cell_numbers[span])
            sums = sums + np.array(
                [(value * volumes).sum() for value in (1.0, *properties(material))]
            )
        sums = self.mesh.comm.allreduce(sums)
        return sums[0], *(sums[1:] / sums[0])

    def motion(self) -> MeshSetup:
        """Return the `MeshSetup`: a boundary of the fluid without a prescribed displacement is
        fixed up to the next one with.
        """
        section = self.scene.mesh_motion
        given = self.essentials("displacement", self._fluid_tags)
        fixed = self._fluid_tags - {entry.tag for entry in given} - axis_tags(self.mesh)
        given += [
            Essential(tag, i, Expression(0.0), -np.inf)
            for tag in fixed
            for i in range(self.mesh.dim)
        ]
        poisson = section.poisson
        return MeshSetup(
            domain=Domain(self.mesh, self._free) if self._pores else self._fluid_domain,
            materials=self._free,
            body_force=(),
            inertia=False,
            moving_mesh=self._moving,
            split="plain",
            direct=is_direct(self.mesh),
            stopwatch=self.stopwatch,
            law=MESH_MOTION[section.law](poisson / (1 - 2 * poisson), 0.5),
            stiffening=section.stiffening,
            carried=self._solid_domain.holds | self.transfer.fluid_nodes,
            transfer=self.transfer,
            dirichlet=self.dirichlet(self.mesh.dim, given),
        )
