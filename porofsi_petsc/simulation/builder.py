"""What the builders of all scenes share: materials, conditions, loads and terms of the model on a
distributed mesh.
"""

from collections.abc import Collection, Iterable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from mpi4py import MPI

from ..accelerators import ACCELERATORS
from ..conditions import CONDITIONS
from ..config import Scene
from ..config.expressions import Expression
from ..config.fields import Cells
from ..config.material import Material
from ..config.sections import Model
from ..coupling.medium import Medium
from ..errors import InputError
from ..fem.constraints import LinearConstraints, NormalValue
from ..fem.distribute import LocalMesh
from ..fem.domain import Domain
from ..fem.essential import Dirichlet, Essential
from ..fem.surface import Surface
from ..linalg.stopwatch import Stopwatch
from ..materials import PERMEABILITY
from ..materials.drag import Anisotropy
from ..materials.graded import graded
from ..materials.oriented import oriented
from ..materials.porous import PorousMaterial
from ..phases.initial_stress import InitialStress
from ..phases.loads import BodyForce
from ..phases.surface_terms import OnSurface
from ..registry import parameters
from .conditions import components, dirichlet, essentials, linear_constraints
from .continuation import LoadFactor
from .drainage import holds_normal

# Nodes above which a 2-D scene is solved by FieldSplit and multigrid instead of MUMPS; 3-D always
# is.  Measured by `scripts/run bench solvers` (docs/solvers.md): with tangents renewed in every
# step both take the same time at about 75 000 nodes, with kept ones MUMPS is the faster up to
# 84 000 at least.
DIRECT_NODES_2D = 100_000
MONOLITHIC = ("quasi_direct", "direct")


def materials_of(scene: Scene, mesh: LocalMesh) -> dict[str, PorousMaterial]:
    """Return dict region -> PorousMaterial, without the "auto" terms of the model (collective).

    A coefficient that is a field has the value at the centre of a cell in all of it.
    """
    return {
        region: _in_regions(entry, scene, mesh, regions)
        for entry in scene.material
        for regions in [mesh.regions if entry.region == ("all",) else entry.region]
        for region in regions
    }


def _in_regions(entry, scene, mesh, regions):
    """Return the material of an entry in the cells of its regions (collective)."""
    if entry.is_uniform:
        return material_of(entry, scene.model)
    numbers = [mesh.regions.index(region) for region in regions]
    cells = np.flatnonzero(np.isin(mesh.cell_region, numbers))
    centres = mesh.X[mesh.cells[cells]].mean(axis=1)
    values = {name: array[cells] for name, array in mesh.values.items()}
    try:
        found, reason = Coefficients.of(entry, Cells(centres, values)), None
    except InputError as error:
        found, reason = None, str(error)
    reasons = [text for text in mesh.comm.allgather(reason) if text]
    if reasons or found is None:
        raise InputError(f"{scene.source_path or 'scene'} {reasons[0]}")
    lam, mu = found.moduli
    ratio = mesh.comm.allreduce(float(np.max(lam / mu, initial=-np.inf)), MPI.MAX)
    n_cells = len(mesh.cells)
    material = material_of(entry, scene.model, found.over(cells, n_cells), ratio)
    if entry.orientation is None:
        return material
    centres = mesh.X[mesh.cells].mean(axis=1)
    law = oriented(material.elastic, _axes(entry.orientation, mesh.values), centres)
    return replace(material, elastic=law)


def _axes(orientation, values):
    """Return the function of points and cells that gives the axes of an orientation."""

    def axes(X, cells):
        E, P, d = X.shape
        arrays = {name: np.repeat(array[cells], P) for name, array in values.items()}
        return orientation.at(Cells(X.reshape(-1, d), arrays)).reshape(E, P, 3, 3)

    return axes


class Coefficients(NamedTuple):
    """Those of a material that may be fields, numbers or (n, 1): porosity, λ and μ [Pa], density of
    the solid [kg/m³] and mobility [m^4/(N s)].
    """

    porosity: Any
    moduli: tuple[Any, Any]
    density: Any
    mobility: Any

    @classmethod
    def of(cls, entry: Material, cells: Cells) -> "Coefficients":
        """Return those of a material with a solid in cells."""
        assert entry.solid  # nobody asks a fluid
        mobility = entry.mobility_at(cells) if entry.permeability else np.inf
        moduli = entry.solid.lame(cells)
        if entry.orientation:
            entry.orientation.require_in(cells, "solid.orientation")
        return cls(entry.porosity_at(cells), moduli, entry.density_at(cells), mobility)

    def over(self, cells: np.ndarray, n_cells: int) -> "Coefficients":
        """Return fields over all cells of a mesh, NaN in others than those of the points."""

        def everywhere(values):
            if not np.ndim(values):
                return values
            found = np.full((n_cells, 1), np.nan)
            found[cells] = values
            return found

        moduli = everywhere(self.moduli[0]), everywhere(self.moduli[1])
        return Coefficients(
            everywhere(self.porosity), moduli, everywhere(self.density), everywhere(self.mobility)
        )


def material_of(
    entry: Material, model: Model, given: Coefficients | None = None, ratio: float = 0.0
) -> PorousMaterial:
    """Return what a [[material]] is under a [model].

    given : coefficients of an entry with fields, over all cells; ratio : its largest λ/μ
    """
    solid, fluid, permeability = entry.solid, entry.fluid, entry.permeability
    viscosity = fluid.brinkman_viscosity if fluid and model.viscosity is True else 0.0
    if not solid:
        assert fluid  # a material has one of them
        return PorousMaterial.free_fluid(fluid.density, viscosity)
    given = given or Coefficients.of(entry, Cells.none())
    elastic = _elastic_law(entry, given.moduli, ratio)
    if not fluid:
        return PorousMaterial.dense_solid(elastic, given.density)
    assert permeability  # with both of them
    return PorousMaterial(
        elastic=elastic,
        n_s0=1 - given.porosity,
        rho_sR=given.density,
        rho_fR=fluid.density,
        drag0=1 / given.mobility,
        permeability=PERMEABILITY[permeability.law](**permeability.of_law()),
        viscosity=viscosity,
        variable_porosity=model.porosity == "variable",
        anisotropy=_anisotropy(permeability),
        biot=entry.biot_coefficient,
        fluid_compliance=1 / fluid.bulk_modulus if fluid.bulk_modulus else 0.0,
    )


def _elastic_law(entry, moduli, ratio):
    """Return the law of an entry, a `Graded` one where λ and μ are fields."""
    solid = entry.solid
    if not solid.is_graded:
        return entry.elastic_law()
    number = solid.poisson if isinstance(solid.poisson, float) else None
    try:
        return graded(entry.elastic_law, *moduli, ratio, number)
    except ValueError as error:
        key = next(key for key in entry.fields if key.startswith("solid."))
        place = entry.fields[key].place
        advice = "expected young as a formula and poisson as a number, or numbers"
        raise InputError(f"{place}{error}, {advice}") from None


def _anisotropy(permeability):
    """Return the principal axes of a permeability, None of an isotropic one."""
    factors = permeability.anisotropy
    return None if factors is None else Anisotropy(factors, permeability.principal_axes)


def is_direct(mesh: LocalMesh) -> bool:
    """Return whether the default solvers are factorizations."""
    return mesh.dim == 2 and mesh.n_global <= DIRECT_NODES_2D


def entries(scene: Scene, quantity: str) -> list[tuple[str, int, Expression]]:
    """Return (tag, component, expression) for every prescribed component of a vector quantity."""
    return [
        (tag, i, e)
        for b in scene.boundary
        for tag in b.on
        for i, e in components(getattr(b, quantity)).items()
    ]


class Builder:
    """From a scene without "auto" terms to its phases and their coupling; `PorousBuilder` and
    `InterfaceBuilder` have their own phases.

    load_factor : of all data of a steady scene, None of others
    """

    def __init__(self, scene: Scene, mesh: LocalMesh, stopwatch: Stopwatch) -> None:
        """Take the scene, its mesh and where time is counted (collective)."""
        self.scene = scene
        self.mesh = mesh
        self.stopwatch = stopwatch
        self.materials = {
            region: material
            for region, material in materials_of(scene, mesh).items()
            if region not in scene.inactive
        }
        self.load_factor = LoadFactor() if scene.time.scheme == "steady" else None

    def initial_stress(self, domain: Domain) -> InitialStress | None:
        """Return the initial stress of the solids of a domain, None without one."""
        given = self.scene.initial.stress.components(self.scene.dim)

        def times(factor, formula):
            return lambda t, x: factor * formula(t, x)

        formulas = {pair: times(*entry) for pair, entry in given.items()}
        return InitialStress(domain, formulas, self.scene.placed) if formulas else None

    @property
    def fading(self) -> tuple[float, float] | None:
        """Return begin and end of a stage whose changes come little by little [s], else None."""
        time = self.scene.time
        return (time.begins, time.end) if self.scene.gradual else None

    def medium(self) -> Medium:
        """Return the coupling scheme with its phases (collective)."""
        raise NotImplementedError

    def common(
        self, domain: Domain, materials: dict[str, PorousMaterial], body: str, split: str
    ) -> dict[str, Any]:
        """Return what the setups of solid and fluid have in common, by keyword; body : key of
        [body_force].
        """
        return {
            "domain": domain,
            "materials": materials,
            "stopwatch": self.stopwatch,
            "split": split,
            "direct": is_direct(self.mesh),
            "body_force": self._body_forces(body),
        }

    def _body_forces(self, body):
        """Return the `BodyForce`s of a key of [body_force]; one of all regions without formulas is
        none.
        """
        found = []
        for entry in self.scene.body_forces:
            regions = None if entry.on == ("all",) else entry.on
            expressions = self.components(getattr(entry, body))
            found += [BodyForce(expressions, regions)] if expressions else []
        return tuple(found)

    def of_fluid(self) -> dict[str, Any]:
        """Return what the setups of all fluids have in common beside that, by keyword."""
        model = self.scene.model
        stabilization = self.scene.stabilization
        return {
            "inertia": model.fluid_inertia,
            "convection": model.convection,
            "pspg": stabilization.pspg,
            "supg": stabilization.supg,
            "lsic": stabilization.lsic,
        }

    def accelerator(self, dot: Any, name: str, first: float | None, guard: Any) -> Any:
        """Return the accelerator of a name; first : its factor, None for its own."""
        return ACCELERATORS[name](dot, first, guard, self.scene.coupling.reuse_steps)

    # -- data on the boundary ----------------------------------------------------------------------

    def essentials(self, quantity: str, tags: Collection[str] | None = None) -> list[Essential]:
        """Return the `Essential`s of a quantity, on some tags if they are given."""
        found = essentials(self.scene, quantity, tags)
        return [entry._replace(expression=self._scaled(entry.expression)) for entry in found]

    def dirichlet(self, k: int, given: list[Essential]) -> Dirichlet:
        """Return the `Dirichlet` of a field with k components (collective)."""
        return dirichlet(self.scene, self.mesh, k, given)

    def displacement(self, tags: Collection[str] | None = None) -> Dirichlet:
        """Return what is prescribed of the displacement, on some tags if they are given
        (collective).
        """
        found = self.dirichlet(self.mesh.dim, self.essentials("displacement", tags))
        given = [
            entry._replace(expression=self._scaled(entry.expression))
            if isinstance(entry, NormalValue)
            else entry
            for entry in linear_constraints(self.scene, tags)
        ]
        if given:
            where = self.scene.source_path or "scene"
            found.constraints = LinearConstraints(self.mesh, found.mask, given, where)
        return found

    def components(self, vector: Any) -> dict[int, Any]:
        """Return component -> expression of a `config.Vector`."""
        return {i: self._scaled(expression) for i, expression in components(vector).items()}

    def _scaled(self, value):
        """Return a formula times the load factor; a number as it is."""
        if isinstance(value, dict):
            return {key: self._scaled(entry) for key, entry in value.items()}
        of_load = self.load_factor is not None and isinstance(value, Expression)
        return self.load_factor.of(value) if of_load else value

    def surfaces(
        self, domain: Domain, balance: str, tags: Collection[str]
    ) -> tuple[OnSurface, ...]:
        """Return the conditions of a balance on those of some tags, in the order of the scene."""
        return tuple(
            OnSurface(
                condition(**{key: self._scaled(given[key]) for key in parameters(condition)}),
                Surface(domain, tag, self.materials),
                f"boundary.{i}.{name}:{tag}",
            )
            for i, boundary in enumerate(self.scene.boundary)
            for name, given in boundary.surface_conditions().items()
            for condition in (CONDITIONS[name], *CONDITIONS[name].beside)
            if condition.balance == balance
            for tag in boundary.on
            if tag in tags
        )

    def require_normal_motion(
        self, surfaces: Iterable[OnSurface], given: Iterable[Essential], quantity: str
    ) -> None:
        """Raise InputError where the normal component of a prescribed quantity leaves a condition
        that wants it free without effect (collective).
        """
        normal = {
            tag
            for boundary in self.scene.boundary
            if quantity == "displacement" and boundary.normal_displacement is not None
            for tag in boundary.on
        }
        for place in surfaces:
            tag = place.surface.tag
            held = sorted({entry.component for entry in given if entry.tag == tag})
            wants = place.condition.wants_normal_motion
            if wants and (tag in normal or holds_normal(self.mesh, tag, held)):
                key = place.key.rpartition(":")[0]
                raise InputError(
                    f"{self.scene.source_path or 'scene'} [{key}]: tag '{tag}' has a prescribed"
                    f" normal {quantity}, beside which it is without effect; prescribe the"
                    " components along the surface alone, or none"
                )
