"""From a scene of porous media, and solids without pores that share nodes with them, to skeleton,
pore fluid and their coupling.
"""

from ..conditions import CONDITIONS
from ..config import Scene
from ..coupling.medium import Medium
from ..coupling.monolithic import MonolithicCoupling
from ..coupling.porous import GUARDS, PorousCoupling
from ..errors import InputError
from ..fem.boundary import tags_of, weak_zero_on
from ..fem.distribute import LocalMesh
from ..fem.domain import Domain
from ..linalg.stopwatch import Stopwatch
from ..phases.monolithic import DirectSystem, QuasiDirectSystem
from ..phases.pore_fluid import PoreFluid
from ..phases.setup import PoreFluidSetup, SkeletonSetup
from ..phases.skeleton import Skeleton
from .axis import axis_tags
from .builder import MONOLITHIC, Builder, entries
from .conditions import AXES, no_slip_nodes, nodes_of
from .drainage import holds_normal, require_one_drainage
from .loads import concentrated_loads

SYSTEMS = {"quasi_direct": QuasiDirectSystem, "direct": DirectSystem}


class PorousBuilder(Builder):
    """The skeleton and the solids without pores on all of the mesh, the fluid in its pores."""

    def __init__(
        self, scene: Scene, mesh: LocalMesh, stopwatch: Stopwatch, domain: Domain | None = None
    ) -> None:
        """Take what every builder takes; domain : where there is one of the mesh (collective)."""
        super().__init__(scene, mesh, stopwatch)
        self.domain = domain or Domain(mesh)
        self._porous = {name: m for name, m in self.materials.items() if m.has_pores}
        self._is_dry = len(self._porous) < len(self.materials)
        self._pores = Domain(mesh, self._porous) if self._is_dry else self.domain

    def medium(self) -> Medium:
        """Return the coupling scheme with its phases (collective)."""
        solid = Skeleton(self.skeleton())
        fluid = PoreFluid(self.fluid())
        choice = self.scene.coupling
        common = solid, fluid, self.mesh.comm, choice.tolerance, choice.max_iterations
        if choice.scheme in SYSTEMS:
            return MonolithicCoupling(*common, SYSTEMS[choice.scheme](solid, fluid))

        def accelerator(dot, name=choice.accelerator):
            return self.accelerator(dot, name, choice.relaxation, GUARDS[choice.split])

        return PorousCoupling(*common, accelerator, self.scene.full_newton)

    def skeleton(self) -> SkeletonSetup:
        """Return the setup of the skeleton (collective)."""
        scene = self.scene
        model = scene.model
        surfaces = self.surfaces(self.domain, "momentum", self.mesh.facets)
        displacements = self.essentials("displacement")
        self.require_normal_motion(surfaces, displacements, "displacement")
        return SkeletonSetup(
            inertia=model.solid_inertia,
            moving_mesh=model.moving_mesh,
            dirichlet=self.displacement(),
            surfaces=surfaces,
            loads=concentrated_loads(scene, self.domain, self.components),
            initial_stress=self.initial_stress(self.domain),
            fading=self.fading,
            fluid=self._pores,
            with_hessian=model.viscosity,
            mass_scaling=scene.coupling.mass_scaling,
            reaction=self._is_kept,
            **self.common(self.domain, self.materials, "solid", self._split),
        )

    def fluid(self) -> PoreFluidSetup:
        """Return the setup of the pore fluid (collective)."""
        scene = self.scene
        mesh = self.mesh
        model = scene.model
        pressures = self.essentials("pressure")
        free = self._free_tags()
        drained = {entry.tag for entry in pressures}
        self._require_pressure_level(free, drained)
        wet = tags_of(mesh, self._pores.row_of_cell)
        loaded = [tag for tag in free if tag in wet and tag not in self._rigid_tags()]
        require_one_drainage(scene, mesh)
        fluxes = self.surfaces(self._pores, "volume", mesh.facets)
        self._require_contracting_split(fluxes)
        inertia = model.solid_inertia or model.fluid_inertia
        return PoreFluidSetup(
            moving_mesh=model.moving_mesh,
            velocity=self.dirichlet(mesh.dim, self.essentials("velocity")),
            pressure=self.dirichlet(1, pressures),
            fluxes=fluxes,
            no_slip=no_slip_nodes(scene, mesh),
            stress_nodes=nodes_of(mesh, [tag for tag in loaded if tag in drained]),
            free_surface=weak_zero_on(self._pores, [tag for tag in loaded if tag not in drained]),
            has_auxiliary=inertia and self._split == "corrected",
            undrained=scene.stabilization.undrained,
            reaction=self._is_kept,
            **self.of_fluid(),
            **self.common(self._pores, self._porous, "fluid", self._split),
        )

    @property
    def _is_kept(self):
        """Return whether a surface wants what the balances leave on its nodes."""
        asked = {name for surface in self.scene.surfaces for name in surface.quantities}
        return bool(asked & {"force", "skeleton_force", "flow_rate", "volume"})

    @property
    def _split(self):
        """Return the split of the phases' tangents; those that precondition the monolithic schemes
        are the corrected ones.
        """
        choice = self.scene.coupling
        if choice.scheme in MONOLITHIC:
            return "corrected"
        return "scaled" if choice.mass_scaling is not None else choice.split

    def _require_contracting_split(self, fluxes):
        """Raise InputError where a condition that acts on one side alone meets a split whose
        iterates stray: their volume rates would be the scale of the convergence test.
        """
        places = [place for place in fluxes if place.condition.unilateral]
        if places and self._split != "corrected":
            key = places[0].key.rpartition(":")[0]
            raise InputError(
                f"{self.scene.source_path or 'scene'} [{key}]: received the {self._split} split of"
                " [coupling], expected split = 'corrected' without mass_scaling, or a monolithic"
                " scheme, beside a condition that acts on one side alone"
            )

    def _free_tags(self):
        """Return the surfaces on which the normal stress is given, not the displacement, and the
        pressure does not push from outside (collective).
        """
        fixed: dict[str, set[int]] = {tag: set() for b in self.scene.boundary for tag in b.on}
        for tag, component, _ in entries(self.scene, "displacement"):
            fixed[tag].add(component)
        mesh = self.mesh
        pushed = [
            tag
            for boundary in self.scene.boundary
            if any(CONDITIONS[name].carries_pressure for name in boundary.surface_conditions())
            for tag in boundary.on
        ]
        for tag in (*axis_tags(mesh), *pushed):
            fixed.pop(tag, None)
        for boundary in self.scene.boundary:
            if boundary.normal_displacement is not None:
                for tag in boundary.on:
                    fixed.pop(tag, None)
        return [tag for tag, held in fixed.items() if not holds_normal(mesh, tag, sorted(held))]

    def _rigid_tags(self):
        """Return the surfaces whose nodes have their normal displacement in common (collective)."""
        return {
            tag
            for boundary in self.scene.boundary
            for tag in (boundary.on if boundary.equal_displacement else ())
            if holds_normal(self.mesh, tag, [*map(AXES.index, boundary.equal_displacement)])
        }

    def _require_pressure_level(self, free, drained):
        """Raise InputError where neither a pressure nor a traction, nor a solid without pores that
        gives way, sets the level of p: any constant solves the equations.
        """
        stored = all(material.is_compressible for material in self._porous.values())
        if not (free or drained or stored or self._is_dry):
            received = "received a prescribed normal displacement and no pressure on every boundary"
            advice = (
                "expected one with a pressure or free to move, because else the pressure has no"
                " level; prescribe it on one"
            )
            where = self.scene.source_path or "scene"
            raise InputError(f"{where} [[boundary]]: {received}, {advice}")
