"""The scene: every section of the file with its defaults, and the checks between sections."""

import itertools
from pathlib import Path
from typing import Annotated

from pydantic import Field, PrivateAttr, ValidationInfo, field_validator, model_validator

from ..conditions import CONDITIONS
from ..errors import digits, listed, shown
from ..materials import ELASTIC, PERMEABILITY
from ..materials.fibres import mirrored
from ..quantities import DERIVED_FIELDS, FIELDS, OF_STRESS, PLASTIC_STRAIN, SURFACES
from .conditions import (
    WEIGHT,
    BodyForce,
    BodyForces,
    Boundary,
    Initial,
    RegionalForce,
    Tie,
    WithConditions,
    check_axes,
    check_boundaries,
    check_expressions,
)
from .fields import CellArray
from .geometry import MeshSection
from .material import Material, check_materials
from .precice import Precice
from .reference import FLOWS, Reference
from .sections import (
    LIMIT_OF,
    PERIODIC,
    Community,
    Coupling,
    Expect,
    Figures,
    Force,
    Interface,
    Limits,
    Line,
    Load,
    MeshMotion,
    Model,
    Output,
    Petsc,
    Probe,
    Smoke,
    Stabilization,
    Surface,
    Time,
)
from .stages import Stage, absent_at_start, following
from .types import ListOf, Table, Text, closest, wrong


def _toml(value: bool | str) -> str:
    """Return a switch of [model] as it is written in a scene."""
    return shown(value)


# Exact solutions whose constituents may be compressible.
COMPRESSIBLE = ("terzaghi", "mandel", "cryer", "column_harmonic")


class Scene(Table):
    """One simulation, frozen and complete; equal scenes have equal content wherever they were
    loaded from.
    """

    title: Text
    community: Community | None = None
    source: Text = ""
    description: Text = ""
    mesh: MeshSection
    limits: Limits = Limits()
    time: Time
    material: Annotated[tuple[Material, ...], ListOf(shortest=1)]
    model: Model = Field(
        default=Model(), validate_default=True
    )  # after what its defaults depend on
    boundary: Annotated[tuple[Annotated[Boundary, WithConditions()], ...], ListOf()] = ()
    body_force: BodyForces = BodyForce()
    load: Annotated[tuple[Load, ...], ListOf()] = ()
    initial: Initial = Initial()
    stabilization: Stabilization = Stabilization()
    coupling: Coupling = Coupling()
    mesh_motion: MeshMotion = MeshMotion()
    petsc: Petsc = Petsc()
    probe: Annotated[tuple[Probe, ...], ListOf()] = ()
    line: Annotated[tuple[Line, ...], ListOf()] = ()
    force: Annotated[tuple[Force, ...], ListOf()] = ()
    surface: Annotated[tuple[Surface, ...], ListOf()] = ()
    interface: Annotated[tuple[Interface, ...], ListOf()] = ()
    tie: Annotated[tuple[Tie, ...], ListOf()] = ()
    precice: Precice | None = None
    output: Output = Output()
    figures: Figures = Figures()
    reference: Reference | None = None
    stage: Annotated[tuple[Stage, ...], ListOf()] = ()
    expect: Annotated[tuple[Expect, ...], ListOf()] = ()
    smoke: Smoke = {}

    _source_path: Path | None = PrivateAttr(None)
    _inactive: tuple[str, ...] = PrivateAttr(())
    _placed: tuple[str, ...] = PrivateAttr(())
    _changing: tuple[str, ...] = PrivateAttr(())
    _gradual: bool = PrivateAttr(False)
    _absent_kinds: tuple[tuple[str, str], ...] = PrivateAttr(())

    @property
    def dim(self) -> int:
        """Return the space dimension, 2 or 3."""
        return self.mesh.dim

    @property
    def axisymmetric(self) -> bool:
        """Return whether the plane mesh is the section of a body around the axis x = 0."""
        return self.mesh.axisymmetric

    @property
    def columns(self) -> list[str]:
        """Return the names of the quantities that the history records."""
        probes = [
            f"{probe.name}.{quantity}" for probe in self.probe for quantity in probe.quantities
        ]
        surfaces = [
            f"{surface.name}.{column}"
            for surface in self.surfaces
            for quantity in surface.quantities
            for column in SURFACES[quantity].columns(self.dim)
        ]
        return probes + surfaces + self.condition_columns

    @property
    def surfaces(self) -> tuple[Force | Surface, ...]:
        """Return the surfaces that the history records something of, forces first."""
        return (*self.force, *self.surface)

    @property
    def named_surfaces(self) -> list[tuple[str, Force | Surface]]:
        """Return them with their keys."""
        forces = [f"force.{i}" for i in range(len(self.force))]
        keys = [*forces, *(f"surface.{i}" for i in range(len(self.surface)))]
        return list(zip(keys, self.surfaces, strict=True))

    @property
    def condition_columns(self) -> list[str]:
        """Return those of conditions on surfaces, tag and column."""
        return [
            f"{tag}.{column}"
            for boundary in self.boundary
            for tag in boundary.on
            for name in boundary.surface_conditions()
            for column in CONDITIONS[name].columns
        ]

    @property
    def body_forces(self) -> tuple[RegionalForce, ...]:
        """Return all body forces with their regions."""
        given = self.body_force
        if isinstance(given, BodyForce):
            return (RegionalForce(on=("all",), solid=given.solid, fluid=given.fluid),)
        return given

    @property
    def cell_arrays(self) -> tuple[str, ...]:
        """Return the names of the arrays over the cells that materials take from the mesh file."""
        fields = [field for material in self.material for field in material.fields.values()]
        return tuple(sorted({field.cell for field in fields if isinstance(field, CellArray)}))

    @property
    def phases(self) -> tuple[bool, bool]:
        """Return whether there is a solid, and whether there is a fluid."""
        kinds = {material.kind for material in self.material}
        return bool(kinds & {"solid", "porous"}), bool(kinds & {"fluid", "porous"})

    @property
    def has_pores(self) -> bool:
        """Return whether a material is porous, beside a free fluid or not."""
        return any(material.kind == "porous" for material in self.material)

    @property
    def is_porous(self) -> bool:
        """Return whether there are porous media and no free fluid; beside them there may be solids
        without pores.
        """
        kinds = {material.kind for material in self.material}
        return "porous" in kinds and "fluid" not in kinds

    @property
    def is_plastic(self) -> bool:
        """Return whether a solid or skeleton is plastic, in some stage."""
        later = (material for stage in self.stage for material in stage.material)
        return any(m.elastic_law().plastic for m in (*self.material, *later) if m.solid)

    @property
    def field_names(self) -> tuple[str, ...]:
        """Return the nodal fields that the scene has; what it has no phase for is no field of
        it.
        """
        solids, fluids = self.phases
        absent = set() if solids else {"displacement", "solid velocity", "stress"}
        absent |= set() if fluids else {"pressure", "fluid velocity"}
        absent |= set() if self.is_porous else {"porosity"}
        absent |= set() if self.is_plastic else {PLASTIC_STRAIN}
        return tuple(name for name in FIELDS if name not in absent)

    @property
    def derived_field_names(self) -> tuple[str, ...]:
        """Return what can be made of the fields of the scene."""
        solids, fluids = self.phases
        of_fluid = {"vorticity"}
        of_pores = {"total stress", "Darcy velocity"}
        absent = of_pores if not self.is_porous else set()
        absent |= set() if fluids else of_fluid
        absent |= set() if solids else DERIVED_FIELDS.keys() - of_fluid
        return tuple(name for name in DERIVED_FIELDS if name not in absent)

    @property
    def full_newton(self) -> bool:
        """Return whether tangents are new in every iteration: from rest to a steady flow a lagged
        one is too far away.
        """
        tangent = self.coupling.tangent
        return tangent == "newton" or (tangent == "auto" and self.time.scheme == "steady")

    @property
    def stages(self) -> tuple["Scene", ...]:
        """Return the complete scenes of all stages in turn, this one first."""
        found = [self]
        for i, stage in enumerate(self.stage):
            found.append(following(found[-1], stage, i))
        return tuple(found)

    @property
    def inactive(self) -> tuple[str, ...]:
        """Return the regions that are not there: taken away in this stage or before it, or placed
        in a later one.
        """
        changes = [(stage.inactive, stage.active) for stage in self.stage]
        return (*self._inactive, *absent_at_start(changes))

    @property
    def gradual(self) -> bool:
        """Return whether what the stage changes comes over its duration."""
        return self._gradual

    @property
    def kinds_there(self) -> set[str]:
        """Return the kinds of the materials that are there."""
        return {material.kind for material in self._materials_there}

    @property
    def _materials_there(self):
        return [m for m in self.material if not set(m.region) <= set(self.inactive)]

    @property
    def absent_kinds(self) -> tuple[tuple[str, str], ...]:
        """Return the regions that are not there with the kinds of their materials, of the scene of
        what is.
        """
        return self._absent_kinds

    @property
    def placed(self) -> tuple[str, ...]:
        """Return the regions that have been placed in this stage or before it."""
        return self._placed

    @property
    def changing(self) -> tuple[str, ...]:
        """Return the regions that are not there in some stage of the run."""
        stages = self.stage
        named = (name for stage in stages for name in (*stage.inactive, *stage.active))
        return tuple(dict.fromkeys((*self._changing, *named)))

    @property
    def end(self) -> float:
        """Return the time at the end of the last stage [s]."""
        return self.stages[-1].time.end

    @property
    def source_path(self) -> Path | None:
        """Return the path of the file the scene was loaded from, None when it was made
        otherwise.
        """
        return self._source_path

    @property
    def name(self) -> str:
        """Return the stem of the scene's file name."""
        return self._source_path.stem if self._source_path else "scene"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Scene) and self.model_dump() == other.model_dump()

    __hash__ = None  # type: ignore[assignment]  # how Python says that there is none

    @field_validator("model", mode="after")
    @classmethod
    def _complete_model(cls, model: Model, info: ValidationInfo) -> Model:
        if not {"time", "material"} <= info.data.keys():
            return model
        if "viscosity" not in model.model_fields_set:
            _require_viscosity(info.data["material"])
        return model.completed(info.data["material"], info.data["time"].scheme == "steady")

    @model_validator(mode="after")
    def _complete_time(self):
        """Take rho_inf = 0 by default where nothing has inertia.

        With alpha_f = 1/(1 + rho_inf) < 1 what is known at alpha_f, such as the displacement that
        balances a sudden load, is overshot by 1/alpha_f at the end of the step and rings as
        (-rho_inf)^n, for any size of the step.
        """
        has_solid, has_fluid = self.phases
        inertia = (has_solid and self.model.solid_inertia) or (
            has_fluid and not has_solid and self.model.fluid_inertia
        )
        if inertia or "rho_inf" in self.time.model_fields_set:
            return self
        return self.model_copy(update={"time": self.time.model_copy(update={"rho_inf": 0.0})})

    @model_validator(mode="after")
    def _sections_agree(self):
        check_materials(self.material, self.model.viscosity)
        check_boundaries(self.boundary, self.model.viscosity is True, self.is_porous)
        for i, boundary in enumerate(self.boundary):
            check_expressions(boundary, self.dim, f"boundary.{i}")
            check_axes(boundary.equal_displacement, self.dim, f"boundary.{i}.equal_displacement")
        for i, material in enumerate(self.material):
            check_expressions(material, self.dim, f"material.{i}", position_only=True)
            self._check_fields(material, i)
            if material.orientation:
                self._check_orientation(material.orientation, f"material.{i}.solid.orientation")
        for i, tie in enumerate(self.tie):
            check_axes(tie.components, self.dim, f"tie.{i}.components")
        if isinstance(self.body_force, BodyForce):
            check_expressions(self.body_force, self.dim, "body_force")
        else:
            for i, force in enumerate(self.body_force):
                check_expressions(force, self.dim, f"body_force.{i}")
        self._check_loads()
        check_expressions(self.initial, self.dim, "initial", position_only=True)
        self._check_initial_stress()
        self._check_kinds()
        self._check_anisotropy()
        self._check_interfaces()
        self._check_precice()
        self._check_auto()
        self._check_time_scheme()
        self._check_unilateral()
        self._check_mass_scaling()
        self._check_surface_columns()
        self._check_probes()
        self._check_lines()
        self._check_reference()
        self._check_expectations()
        self._check_public()
        self._check_stages()
        return self

    def _check_stages(self):
        """Refuse a stage whose scene is none."""
        names = [stage.name for stage in self.stage]
        for i, name in enumerate(names):
            if name in names[:i]:
                raise wrong(f"received '{name}' twice, expected another name", f"stage.{i}.name")
        for i, scene in enumerate(self.stages):
            if scene.is_porous and scene.inactive and "porous" not in scene.kinds_there:
                text = "received all porous media as regions that are not there"
                key = f"stage.{i - 1}.inactive" if i else "stage"
                raise wrong(f"{text}, expected some in every stage; keep one", key)
        self._check_fields_of_stages()

    def _check_fields_of_stages(self):
        """Refuse one file with the same fields at all times where they come and go with stages."""
        if self.output.format != "vtkhdf":
            return
        found = [scene._written_fields() for scene in self.stages]
        at_times = set.union(*found) - set.intersection(*found)
        if at_times:
            raise wrong(
                "received 'vtkhdf', whose fields are the same at all times, with"
                f" {listed(sorted(at_times))} in some stages only; expected 'xdmf', or"
                " output.fields without it",
                "output.format",
            )

    def _written_fields(self):
        """Return the names of the fields that this stage writes."""
        there = {*self.field_names, *self.derived_field_names}
        if not any(m.elastic_law().plastic for m in self._materials_there if m.solid):
            there.discard(PLASTIC_STRAIN)
        return there & set(self.output.fields or FIELDS)

    def _check_initial_stress(self):
        """Refuse an initial stress without a solid, out of the plane, or under a law that has to
        know it.
        """
        given = self.initial.stress.components(self.dim)
        if not given:
            return
        key = "initial.stress"
        if not self.phases[0]:
            raise wrong("received one without a solid; leave it out", key)
        if self.initial.stress.vertical == WEIGHT and "fluid" in {m.kind for m in self.material}:
            text = f"received '{WEIGHT}' beside a free fluid, whose pressure it does not know"
            raise wrong(f"{text}, expected a formula", f"{key}.vertical")
        if self.dim == 2 and any(pair in given for pair in ((0, 2), (1, 2))):
            raise wrong("received xz or yz in a two-dimensional scene; leave them out", key)
        if self.reference:
            raise wrong(
                f"received one with [reference] '{self.reference.solution}', which has none; leave"
                " one of the two out",
                key,
            )
        for material in self.material:
            law = material.elastic_law() if material.solid else None
            if law and law.memory and not law.prony:
                raise wrong(
                    f"received one with the law '{material.solid.law}', whose state depends on the"
                    " whole stress, expected an elastic one",
                    key,
                )

    def _check_fields(self, material, i):
        """Refuse coefficients that are fields where what asks for them knows numbers alone."""
        key = next(iter(material.fields), None)
        arrays = [key for key, field in material.fields.items() if isinstance(field, CellArray)]
        if arrays and self.mesh.kind != "file":
            text = f"received an array of a mesh file with mesh.kind = '{self.mesh.kind}'"
            raise wrong(f"{text}, expected a formula or a table", f"material.{i}.{arrays[0]}")
        if key and self.reference:
            raise wrong(
                f"received a formula with [reference] '{self.reference.solution}', whose material"
                " is uniform; leave the section out and give [[expect]]",
                f"material.{i}.{key}",
            )

    def _check_orientation(self, orientation, key):
        """Refuse axes where the directions are those of a ring, or nobody turns them."""
        orientation.check(self.dim, key)
        if self.axisymmetric:
            raise wrong(
                "received one around an axis, where directions are along r, z and θ already; leave"
                " it out",
                key,
            )

    def _check_public(self):
        """Refuse a public problem that does not say where it is from."""
        if self.community is None:
            return
        if not any(kind in self.source for kind in ("doi:", "https://", "ISBN ")):
            text = "expected a citation with 'doi:', 'https://' or 'ISBN ' beside community"
            raise wrong(f"received {shown(self.source)}, {text}", "source")

    def _check_loads(self):
        """Refuse loads without a solid, of another dimension, and along lines in a plane."""
        for i, load in enumerate(self.load):
            check_expressions(load, self.dim, f"load.{i}")
            if not self.phases[0]:
                raise wrong("received one without a solid; leave it out", f"load.{i}")
            if load.line and self.dim == 2:
                text = "expected a point, at = [x, y], which stands for a line across the plane"
                raise wrong(f"received a line in a two-dimensional scene, {text}", f"load.{i}.line")
            for point in load.line or (load.at,):
                if len(point) != self.dim:
                    text = f"received {len(point)} coordinates, expected {self.dim}"
                    raise wrong(text, f"load.{i}.{'line' if load.line else 'at'}")
            if load.line and load.line[0] == load.line[1]:
                text = "received one point twice, expected two ends; give it by `at`"
                raise wrong(text, f"load.{i}.line")

    def _check_kinds(self):
        """Refuse what belongs to porous media in a scene without, and the other way round."""
        if self.is_porous:
            for name, value in (
                ("coupling.scheme", self.coupling.scheme),
                ("time.scheme", self.time.scheme),
            ):
                if value in ("weak", "one_way", "steady"):
                    raise wrong(
                        f"received '{value}' with porous materials, expected it with free fluids"
                        " and solids only",
                        name,
                    )
            return
        self._check_no_auto()
        self._check_viscosity()
        self._check_inflows()
        self._check_moving_mesh()
        if self.has_pores:
            self._check_pores_beside_fluid()
        else:
            self._check_no_porosity()
        if self.coupling.interface not in ("auto", "dirichlet_neumann"):
            if self.phases != (True, True):
                text = "expected a solid and a free fluid, between which it stands; leave it out"
                raise wrong(f"received '{self.coupling.interface}', {text}", "coupling.interface")
            if self.time.scheme != "generalized_alpha" or not self.model.solid_inertia:
                text = (
                    "expected 'dirichlet_neumann' without inertia of the solid, from which the"
                    " other conditions are made"
                )
                raise wrong(f"received '{self.coupling.interface}', {text}", "coupling.interface")
        if self.coupling.interface == "condensed" and self.coupling.scheme in ("weak", "one_way"):
            text = (
                f"expected 'dirichlet_neumann' with scheme = '{self.coupling.scheme}'; leave it out"
            )
            raise wrong(f"received 'condensed', {text}", "coupling.interface")
        self._check_conditions_of_pores()

    def _check_no_auto(self):
        """Refuse terms that a run decides on, which only that of a porous medium alone does."""
        where = "beside a free fluid" if self.has_pores else "without porous materials"
        for term, value in self.model:
            if value == "auto":
                expected = "'constant' or 'variable'" if term == "porosity" else "true or false"
                raise wrong(f"received 'auto' {where}, expected {expected}", f"model.{term}")

    def _check_conditions_of_pores(self):
        """Refuse conditions of porous media in a scene without."""
        for i, boundary in enumerate(self.boundary):
            advice = {"pressure": "prescribe a traction", "no_slip": "prescribe a velocity"} | {
                name: CONDITIONS[name].otherwise
                for name in boundary.surface_conditions()
                if CONDITIONS[name].behind == ("porous",)
            }
            for name in sorted(advice.keys() & set(boundary.given())):
                raise wrong(
                    f"received one without porous materials; {advice[name]}",
                    f"boundary.{i}.{name}",
                )

    def _check_interfaces(self):
        """Refuse sides of an interface where there are none, and conditions that need common nodes
        on it.
        """
        if not self.interface:
            return
        if {material.kind for material in self.material} != {"solid", "fluid"}:
            text = "expected a free fluid and a solid without pores beside it; leave it out"
            raise wrong(f"received two surfaces without such materials, {text}", "interface.0")
        if self.coupling.interface in ("condensed", "neumann_dirichlet"):
            text = (
                "with [[interface]], whose sides cannot tell each other all of a motion; expected"
                " 'dirichlet_neumann', 'robin_neumann' or 'robin_robin', or coupling.scheme ="
                " 'direct'"
            )
            raise wrong(f"received '{self.coupling.interface}' {text}", "coupling.interface")
        taken = {}
        for i, pair in enumerate(self.interface):
            for side in ("fluid", "solid"):
                for tag in getattr(pair, side):
                    if tag in taken:
                        text = (
                            f"received '{tag}', which {taken[tag]} has already, expected each"
                            " surface once"
                        )
                        raise wrong(text, f"interface.{i}.{side}")
                    taken[tag] = f"interface.{i}.{side}"

    def _check_precice(self):
        """Refuse a participant that is not one phase with one Cartesian interface, whose steps are
        not time windows, or whose mesh does not follow.
        """
        if not self.precice:
            return
        if {material.kind for material in self.material} not in ({"solid"}, {"fluid"}):
            text = "expected solids without pores alone, or a free fluid alone"
            raise wrong(f"received one with other materials, {text}", "precice")
        time = self.time
        for key, value, wanted in (
            ("time.scheme", time.scheme, "generalized_alpha"),
            ("time.growth", time.growth, 1.0),
            ("time.consistent_start", time.consistent_start, False),
            ("time.error_tolerance", time.error_tolerance, None),
            ("coupling.scheme", self.coupling.scheme, "partitioned"),
            ("mesh.axisymmetric", self.axisymmetric, False),
        ):
            if value != wanted:
                text = f"received {shown(value)} with [precice]"
                raise wrong(f"{text}, expected {shown(wanted)}; leave it out", key)
        if self.phases[1] and not self.model.moving_mesh:
            text = "received false with [precice], whose interface moves, expected true"
            raise wrong(text, "model.moving_mesh")

    def _check_moving_mesh(self):
        """Refuse a mesh at rest where fluid and solid see each other: the velocity of the solid
        comes with the mesh.
        """
        kinds = {material.kind for material in self.material}
        if (
            not self.model.moving_mesh
            and {"fluid", "solid"} <= kinds
            and self.coupling.scheme != "one_way"
        ):
            text = (
                "received false with a solid beside the fluid, which would not feel its velocity,"
                " expected true"
            )
            raise wrong(f"{text}; or take coupling.scheme = 'one_way'", "model.moving_mesh")

    def _check_viscosity(self):
        """Refuse a free fluid whose viscosity would not be used: without it no wall holds the
        flow.
        """
        for i, material in enumerate(self.material):
            if material.kind == "fluid" and material.fluid.viscosity and not self.model.viscosity:
                received = (
                    f"received false with a free fluid of material.{i}.fluid.viscosity ="
                    f" {material.fluid.viscosity:g} Pa s"
                )
                raise wrong(
                    f"{received}, expected true, or a fluid without viscosity", "model.viscosity"
                )

    def _check_inflows(self):
        """Refuse a profile that oscillates where the fluid has no inertia or no viscosity."""
        for i, boundary in enumerate(self.boundary):
            if boundary.inflow is None or boundary.inflow.profile != "womersley":
                continue
            for term in ("fluid_inertia", "viscosity"):
                if not getattr(self.model, term):
                    raise wrong(
                        f"received 'womersley' with model.{term} = false, expected true, or the"
                        f" profile '{'parabolic' if term == 'fluid_inertia' else 'plug'}'",
                        f"boundary.{i}.inflow.profile",
                    )

    def _check_no_porosity(self):
        if self.model.porosity != "constant":
            raise wrong(
                f"received '{self.model.porosity}' without porous materials; leave it out",
                "model.porosity",
            )
        for i, probe in enumerate(self.probe):
            if "n_f" in probe.quantities:
                raise wrong(
                    "received 'n_f' without porous materials; leave it out", f"probe.{i}.quantities"
                )

    def _check_pores_beside_fluid(self):
        """Refuse what a porous solid that a free fluid flows through does not have."""
        where = "with a porous material beside a free fluid, expected"
        if self.coupling.scheme in ("weak", "one_way"):
            text = f"received '{self.coupling.scheme}' {where} 'partitioned', 'quasi_direct' or"
            raise wrong(f"{text} 'direct'", "coupling.scheme")
        if self.coupling.interface not in ("auto", "dirichlet_neumann"):
            text = f"received '{self.coupling.interface}' {where} 'dirichlet_neumann'; leave it out"
            raise wrong(text, "coupling.interface")
        if self.coupling.mass_scaling is not None:
            text = f"received {shown(self.coupling.mass_scaling)} {where} none; leave it out"
            raise wrong(text, "coupling.mass_scaling")
        for i, material in enumerate(self.material):
            if material.biot_coefficient != 1.0 or (
                material.kind == "porous" and material.fluid.bulk_modulus
            ):
                raise wrong(
                    "received compressible constituents beside a free fluid, expected"
                    " incompressible ones; leave biot_coefficient and bulk_modulus out",
                    f"material.{i}",
                )
            if (
                material.kind == "porous"
                and material.permeability.law != "constant"
                and not self.model.moving_mesh
            ):
                text = (
                    f"received '{material.permeability.law}' with model.moving_mesh = false, where"
                    " J = 1 and the law has no effect, expected 'constant', or true"
                )
                raise wrong(text, f"material.{i}.permeability.law")

    def _check_anisotropy(self):
        for i, material in enumerate(self.material):
            factors = material.permeability and material.permeability.anisotropy
            if factors and len(factors) != self.dim:
                raise wrong(
                    f"received {len(factors)} factors, expected {self.dim}, one of each principal"
                    " axis",
                    f"material.{i}.permeability.anisotropy",
                )
            law = material.elastic_law() if material.solid else None
            if law and law.anisotropic:
                self._check_directions(law, i)

    def _check_directions(self, law, i):
        key = f"material.{i}.solid.axis"
        if self.dim == 2 and not mirrored(law.axes):
            raise wrong(
                "received a direction out of the plane without its mirror image, with which a load"
                " in the plane moves points out of it; expected one in the plane, or [0, 0, 1], or"
                " a second one with the opposite third component",
                key,
            )
        if any(boundary.absorbing for boundary in self.boundary):
            raise wrong(
                f"received '{self.material[i].solid.law}' beside an absorbing boundary, whose"
                " impedances are those of isotropic materials; expected an isotropic law, or no"
                " absorbing boundary",
                f"material.{i}.solid.law",
            )

    def _check_auto(self):
        for term, limit in LIMIT_OF.items():
            if getattr(self.model, term) == "auto" and getattr(self.limits, limit) == "report":
                text = (
                    f"received 'report', expected a positive number, at which model.{term} = 'auto'"
                    " switches the term on"
                )
                raise wrong(text, f"limits.{limit}")
        if self.model.porosity == "auto" and self.model.moving_mesh is False:
            text = (
                "received 'auto' with model.moving_mesh = false, where n_s = n_s0/J has no effect;"
                " set that to true or 'auto'"
            )
            raise wrong(text, "model.porosity")

    def _check_unilateral(self):
        """Refuse conditions that open and close beside rates that are not those at the end of a
        step.

        A surface that closes holds the flux on the collocation level, where 1.5 v1 - 0.5 v0 is zero
        with v1 = v0/3: without inertia, in steps as long as the consolidation, what flows out
        meanwhile is of the order of all.
        """
        if self.model.solid_inertia is True or self.time.scheme == "backward_euler":
            return
        for i, boundary in enumerate(self.boundary):
            for name in boundary.surface_conditions():
                if CONDITIONS[name].unilateral:
                    received = f"received '{self.time.scheme}' with boundary.{i}.{name}"
                    text = "and without model.solid_inertia = true, expected 'backward_euler'"
                    raise wrong(f"{received} {text}", "time.scheme")

    def _check_time_scheme(self):
        present = zip(("solid_inertia", "fluid_inertia"), self.phases, strict=True)
        terms = [term for term, exists in present if exists]
        if self.time.scheme != "generalized_alpha" and any(
            getattr(self.model, term) for term in terms
        ):
            received = f"received '{self.time.scheme}' with inertia"
            text = f"expected {' and '.join(f'model.{term} = false' for term in terms)}"
            raise wrong(f"{received}, {text}, or scheme = 'generalized_alpha'", "time.scheme")
        alone = self.phases == (False, True)  # a free fluid has the acceleration
        term, body = ("fluid_inertia", "fluid") if alone else ("solid_inertia", "skeleton")
        inertia = getattr(self.model, term)
        if self.time.consistent_start and inertia is not True:
            received = f"received true with model.{term} = {_toml(inertia)}"
            raise wrong(
                f"{received}, expected a {body} that has an acceleration; leave it out",
                "time.consistent_start",
            )
        if self.time.consistent_start and self.model.fluid_inertia == "auto":
            text = (
                "received true with model.fluid_inertia = 'auto', expected true or false: the start"
                " depends on it"
            )
            raise wrong(text, "time.consistent_start")

    def _check_mass_scaling(self):
        if self.coupling.mass_scaling is not None and self.model.solid_inertia is not True:
            received = (
                f"received {shown(self.coupling.mass_scaling)} with model.solid_inertia ="
                f" {_toml(self.model.solid_inertia)}"
            )
            raise wrong(
                f"{received}, expected a skeleton with a mass to scale; leave it out",
                "coupling.mass_scaling",
            )

    def _check_surface_columns(self):
        """Refuse columns of the history that two conditions would write, or that a comma breaks."""
        taken = {
            f"{entry.name}.{column}": key
            for key, entry in self.named_surfaces
            for quantity in entry.quantities
            for column in SURFACES[quantity].columns(self.dim)
        }
        for i, boundary in enumerate(self.boundary):
            for name in boundary.surface_conditions():
                key = f"boundary.{i}.{name}"
                for tag, column in itertools.product(boundary.on, CONDITIONS[name].columns):
                    whole = f"{tag}.{column}"
                    if "," in whole:
                        text = "which a column of history.csv has in its name, expected no comma"
                        raise wrong(f"received the tag or column '{whole}', {text}", key)
                    if whole in taken:
                        text = f"received the column '{whole}', which {taken[whole]} records"
                        raise wrong(f"{text}, expected another; give each a tag of its own", key)
                    taken[whole] = key

    def _check_probes(self):
        names = [probe.name for probe in self.probe]
        taken = set(names)
        for key, surface in self.named_surfaces:
            if surface.name in taken:
                raise wrong(
                    f"received '{surface.name}', the name of another probe, force or surface,"
                    " expected another",
                    f"{key}.name",
                )
            taken.add(surface.name)
            if self.time.scheme == "steady" and "volume" in surface.quantities:
                raise wrong(
                    "received 'volume' with time.scheme = 'steady', which has no time, expected"
                    " 'flow_rate'",
                    f"{key}.quantities",
                )
        for i, probe in enumerate(self.probe):
            if probe.name in names[:i]:
                text = (
                    f"received '{probe.name}', the name of probe.{names.index(probe.name)},"
                    " expected another"
                )
                raise wrong(text, f"probe.{i}.name")
            if len(probe.at) != self.dim:
                raise wrong(
                    f"received {len(probe.at)} coordinates, expected {self.dim}", f"probe.{i}.at"
                )
            self._check_quantities(probe, f"probe.{i}.quantities")

    def _check_lines(self):
        names = [line.name for line in self.line]
        for i, line in enumerate(self.line):
            if line.name in names[:i]:
                text = f"received '{line.name}', the name of line.{names.index(line.name)}"
                raise wrong(f"{text}, expected another", f"line.{i}.name")
            for key, point in (("from", line.start), ("to", line.to)):
                if len(point) != self.dim:
                    text = f"received {len(point)} coordinates, expected {self.dim}"
                    raise wrong(text, f"line.{i}.{key}")
            if line.start == line.to:
                raise wrong("received the point of 'from', expected another", f"line.{i}.to")
            self._check_quantities(line, f"line.{i}.quantities")

    def _check_quantities(self, entry, key):
        """Refuse quantities of a probe or a line that the scene has not."""
        for quantity in entry.quantities:
            self._require_phase_of(quantity, key)
            if self.dim == 2 and quantity.endswith(("_z", "_xz", "_yz")):
                raise wrong(f"received '{quantity}' in a two-dimensional scene", key)

    def _require_phase_of(self, quantity, key):
        """Refuse the motion of a solid, or of a mesh, where there is none."""
        name, _, axis = quantity.rpartition("_")
        if quantity in OF_STRESS and not self.phases[0]:
            raise wrong(
                f"received '{quantity}' without a solid, expected p or a component of vf", key
            )
        if quantity == PLASTIC_STRAIN and not self.is_plastic:
            raise wrong(f"received '{quantity}' without a plastic law, expected another", key)
        if name == "total" and not self.is_porous:
            raise wrong(
                f"received '{quantity}' without pores everywhere, expected 'stress_{axis}'", key
            )
        if name in ("u", "v") and not (self.phases[0] or self.model.moving_mesh):
            advice = f"; did you mean 'vf_{axis}'?" if name == "v" else ""
            raise wrong(
                f"received '{quantity}' with a free fluid alone, whose mesh is at rest, expected"
                f" p or a component of vf{advice}",
                key,
            )

    def _check_reference(self):
        if self.reference is None:
            return
        if len(self.material) != 1:
            raise wrong(
                f"received {len(self.material)} materials, expected one, from which the solution is"
                " made",
                "reference",
            )
        solution = self.reference.solution
        kind = self.material[0].kind
        if kind != ("fluid" if solution in FLOWS else "porous"):
            of = "a free fluid" if solution in FLOWS else "a porous medium"
            text = (
                f"received '{solution}' with a {kind} material, expected {of}; leave the"
                " section out"
            )
            raise wrong(text, "reference.solution")
        of_one_dimension = {"mandel": 2, "strip_footing": 2, "seabed": 2, "cryer": 3}
        of_one_dimension |= {"kovasznay": 2, "taylor_green": 2, "ethier_steinman": 3}
        of_one_dimension |= {"womersley_channel": 2, "womersley_pipe": 3}
        in_space = {"ethier_steinman"} if self.axisymmetric else set()  # not around an axis
        dim = 3 if self.axisymmetric else self.dim
        if of_one_dimension.get(solution, dim) != dim or solution in in_space:
            words = {2: "a two-dimensional", 3: "a three-dimensional"}
            where = "an axisymmetric" if self.axisymmetric else words[self.dim]
            raise wrong(f"received '{solution}' in {where} scene", "reference.solution")
        if "error" in [probe.name for probe in self.probe]:
            raise wrong(
                "received a probe named 'error', expected another name beside [reference]", "probe"
            )
        if solution not in FLOWS:
            self._check_soil()
        elif not self.material[0].fluid.viscosity:
            raise wrong(
                f"received '{solution}' with a fluid without viscosity, expected one",
                "reference.solution",
            )

    def _check_soil(self):
        if self.material[0].elastic_law().anisotropic:
            raise wrong(
                f"received '{self.reference.solution}' with the law"
                f" '{self.material[0].solid.law}', expected an isotropic one; leave the section out"
                " and give [[expect]]",
                "reference.solution",
            )
        if self.material[0].permeability.anisotropy:
            raise wrong(
                f"received '{self.reference.solution}' with material.permeability.anisotropy,"
                " expected an isotropic permeability; leave one of the two out",
                "reference.solution",
            )
        material = self.material[0]
        if material.solid.prony or self.is_plastic:
            received = "material.solid.prony" if material.solid.prony else "a plastic law"
            raise wrong(
                f"received '{self.reference.solution}' with {received}, expected an elastic soil;"
                " leave one of the two out",
                "reference.solution",
            )
        stores = material.biot_coefficient != 1.0 or material.fluid.bulk_modulus
        if stores and self.reference.solution not in COMPRESSIBLE:
            raise wrong(
                f"received '{self.reference.solution}' with compressible constituents, expected"
                f" {listed(COMPRESSIBLE)} or incompressible ones",
                "reference.solution",
            )
        laws = self.material[0].solid.law, self.material[0].permeability.law
        if self.reference.solution == "xie_leo" and laws != ("xie_leo", "xie_leo"):
            received = f"received 'xie_leo' with the laws '{laws[0]}' and '{laws[1]}'"
            raise wrong(
                f"{received}, expected 'xie_leo' for skeleton and permeability",
                "reference.solution",
            )
        if self.reference.solution == "selfweight" and not (
            isinstance(self.body_force, BodyForce)
            and getattr(self.body_force.solid, "xyz"[self.dim - 1])
        ):
            raise wrong(
                "received no vertical body_force.solid of all regions, expected the weight that"
                " 'selfweight'"
                " needs",
                "reference.solution",
            )

    def _check_expectations(self):
        recorded = self.columns
        if self.reference:
            vector = {"strip_footing": []} | dict.fromkeys(FLOWS, ["error.v"])
            recorded += [*vector.get(self.reference.solution, ["error.u"]), "error.p"]
        for i, expect in enumerate(self.expect):
            if expect.quantity not in recorded:
                text = (
                    f"received {shown(expect.quantity)}, which no [[probe]] records;"
                    f" {closest(expect.quantity, recorded)}"
                )
                raise wrong(text, f"expect.{i}.quantity")
            self._check_difference(expect, f"expect.{i}.minus")
            if (
                expect.quantity.startswith("error.")
                and expect.at is not None
                and expect.at not in self.reference.times
            ):
                raise wrong(
                    f"received {digits(expect.at)}, expected one of reference.times, when errors"
                    " are taken",
                    f"expect.{i}.at",
                )
            if expect.statistic in PERIODIC:
                self._check_periodic(expect, f"expect.{i}.statistic")
        if self.output.period_of is not None and self.output.period_of not in recorded:
            received = f"received {shown(self.output.period_of)}, which is not recorded"
            raise wrong(
                f"{received}; {closest(self.output.period_of, recorded)}", "output.period_of"
            )
        known = (*self.field_names, *self.derived_field_names)
        for name in self.output.fields:
            if name not in known:
                text = f"which the scene has not; choose from {listed(known)}"
                raise wrong(f"received {shown(name)}, {text}", "output.fields")
        self._check_paths(recorded)

    def _check_difference(self, expect, where):
        if expect.minus is None:
            return
        if expect.minus not in self.columns:
            text = (
                f"received {shown(expect.minus)}, which no [[probe]] records;"
                f" {closest(expect.minus, self.columns)}"
            )
            raise wrong(text, where)
        if expect.quantity not in self.columns or expect.statistic in PERIODIC:
            text = (
                f"received '{expect.minus}', expected two columns of history.csv and no statistic"
                " of a period; leave it out"
            )
            raise wrong(text, where)

    def _check_periodic(self, expect, where):
        if self.output.period_of is None:
            text = (
                "without output.period_of, expected the column there whose last full period counts"
            )
            raise wrong(f"received '{expect.statistic}' {text}", where)
        if expect.quantity not in self.columns:
            text = "which is taken at a few times only, expected a column of history.csv"
            raise wrong(f"received '{expect.statistic}' of {expect.quantity}, {text}", where)

    def _check_paths(self, recorded):
        for name in self.figures.paths:
            if not {f"{name}.u_x", f"{name}.u_y"} <= set(recorded):
                raise wrong(
                    f"received '{name}', expected a probe that records u_x and u_y", "figures.paths"
                )


def _require_viscosity(materials):
    """Refuse a free fluid whose viscosity was forgotten: no wall would hold the flow."""
    for i, material in enumerate(materials):
        if material.kind == "fluid" and material.fluid.viscosity is None:
            raise wrong(
                f"received no viscosity of the free fluid of material.{i}, expected"
                f" material.{i}.fluid.viscosity [Pa s], or model.viscosity = false for an ideal"
                " fluid"
            )


def _renew() -> None:
    """Make the schema of scenes again, with the laws that have come since."""
    for table in (Material, Stage, Scene):
        table.model_rebuild(force=True)


CONDITIONS.reserve(dir(Boundary))
for registry in (ELASTIC, PERMEABILITY, CONDITIONS):
    registry.changed.append(_renew)
