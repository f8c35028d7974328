"""What a scene says of its phases: materials, boundary data, terms of the model, on a distributed
mesh.
"""

from ..config import Scene
from ..config.expressions import Expression
from ..config.material import Material
from ..errors import InputError
from ..fem.boundary import SurfaceLoad, weak_zero_on
from ..fem.distribute import LocalMesh
from ..fem.domain import Domain
from ..linalg.stopwatch import Stopwatch
from ..materials import ELASTIC, PERMEABILITY
from ..materials.elastic import ElasticLaw
from ..materials.porous import PorousMaterial
from ..phases.setup import FluidSetup, SolidSetup
from .conditions import components, dirichlet, essentials, no_slip_nodes, nodes_of
from .drainage import holds_normal, require_one_drainage

# Nodes above which a 2-D scene is solved by FieldSplit and multigrid instead of MUMPS; 3-D always
# is.  Measured by scripts/bench_solvers (docs/solvers.md): with tangents renewed in every step both
# take the same time at about 75 000 nodes, with kept ones MUMPS is the faster up to 84 000 at
# least.
DIRECT_NODES_2D = 100_000
MONOLITHIC = ("quasi_direct", "direct")


def materials_of(scene: Scene, mesh: LocalMesh) -> dict[str, PorousMaterial]:
    """Return dict region -> PorousMaterial, without the "auto" terms of the model."""
    return {
        region: _material(entry, scene.model)
        for entry in scene.material
        for region in (mesh.regions if entry.region == ("all",) else entry.region)
    }


def elastic_law(entry: Material) -> ElasticLaw:
    """Return the law of a [[material]] with a solid."""
    solid = entry.solid
    assert solid is not None  # nobody asks a fluid
    return ELASTIC[solid.law](
        solid.lambda_, solid.mu, 1 - (entry.porosity or 0.0), **solid.of_law()
    )


def _material(entry, model):
    viscosity = entry.fluid.viscosity if entry.fluid and model.viscosity is True else 0.0
    if entry.kind == "fluid":
        return PorousMaterial.free_fluid(entry.fluid.density, viscosity)
    solid = entry.solid
    elastic = elastic_law(entry)
    if entry.kind == "solid":
        return PorousMaterial.dense_solid(elastic, solid.density)
    return PorousMaterial(
        elastic=elastic,
        n_s0=elastic.n_s0,
        rho_sR=solid.density,
        rho_fR=entry.fluid.density,
        drag0=1 / entry.mobility,
        permeability=PERMEABILITY[entry.permeability.law](**entry.permeability.of_law()),
        viscosity=viscosity,
        variable_porosity=model.porosity == "variable",
    )


def entries(scene: Scene, quantity: str) -> list[tuple[str, int, Expression]]:
    """Return (tag, component, expression) for every prescribed component of a vector quantity."""
    return [
        (tag, i, e)
        for b in scene.boundary
        for tag in b.on
        for i, e in components(getattr(b, quantity)).items()
    ]


def solid_setup(
    scene: Scene, domain: Domain, materials: dict[str, PorousMaterial], stopwatch: Stopwatch
) -> SolidSetup:
    """Return the `SolidSetup` of a scene."""
    mesh = domain.mesh
    model = scene.model
    loads = [
        SurfaceLoad(mesh, tag, components(b.traction))
        for b in scene.boundary
        for tag in b.on
        if components(b.traction)
    ]
    return SolidSetup(
        body_force=components(scene.body_force.solid),
        inertia=model.solid_inertia,
        dirichlet=dirichlet(scene, mesh, mesh.dim, essentials(scene, "displacement")),
        loads=tuple(loads),
        with_hessian=model.viscosity,
        mass_scaling=scene.coupling.mass_scaling,
        **_common(scene, domain, materials, stopwatch),
    )


def fluid_setup(
    scene: Scene, domain: Domain, materials: dict[str, PorousMaterial], stopwatch: Stopwatch
) -> FluidSetup:
    """Return the `FluidSetup` of a scene."""
    mesh = domain.mesh
    model = scene.model
    stabilization = scene.stabilization
    pressures = essentials(scene, "pressure")
    free = _traction_tags(scene, mesh)
    drained = {entry.tag for entry in pressures}
    _require_pressure_level(scene, free, drained)
    require_one_drainage(scene, mesh)
    fluxes = [
        SurfaceLoad(mesh, tag, {0: b.flux})
        for b in scene.boundary
        for tag in b.on
        if b.flux is not None
    ]
    inertia = model.solid_inertia or model.fluid_inertia
    return FluidSetup(
        body_force=components(scene.body_force.fluid),
        inertia=model.fluid_inertia,
        velocity=dirichlet(scene, mesh, mesh.dim, essentials(scene, "velocity")),
        pressure=dirichlet(scene, mesh, 1, pressures),
        loads=(),
        fluxes=tuple(fluxes),
        no_slip=no_slip_nodes(scene, mesh),
        stress_nodes=nodes_of(mesh, [tag for tag in free if tag in drained]),
        free_surface=weak_zero_on(domain, [tag for tag in free if tag not in drained]),
        has_auxiliary=inertia and _split(scene) == "corrected",
        convection=model.convection,
        pspg=stabilization.pspg,
        supg=stabilization.supg,
        lsic=stabilization.lsic,
        undrained=stabilization.undrained,
        **_common(scene, domain, materials, stopwatch),
    )


def _common(scene, domain, materials, stopwatch):
    """Return what the setups of both phases have in common, by keyword."""
    common = {"domain": domain, "materials": materials, "stopwatch": stopwatch}
    return common | {
        "moving_mesh": scene.model.moving_mesh,
        "split": _split(scene),
        "direct": is_direct(domain.mesh),
    }


def _traction_tags(scene, mesh):
    """Return the surfaces on which the normal displacement is not prescribed (collective)."""
    fixed = {tag: set() for b in scene.boundary for tag in b.on}
    for tag, component, _ in entries(scene, "displacement"):
        fixed[tag].add(component)
    return [tag for tag, held in fixed.items() if not holds_normal(mesh, tag, sorted(held))]


def _require_pressure_level(scene, free, drained):
    """Raise InputError where neither a pressure nor a traction sets the level of p: any constant
    solves the equations.
    """
    if not free and not drained:
        received = "received a prescribed normal displacement and no pressure on every boundary"
        advice = (
            "expected one with a pressure or free to move, because else the pressure has no level;"
            " prescribe it on one"
        )
        raise InputError(f"{scene.source_path or 'scene'} [[boundary]]: {received}, {advice}")


def _split(scene):
    """Return the split of the phases' tangents; those that precondition the monolithic schemes are
    the corrected ones.
    """
    choice = scene.coupling
    if choice.scheme in MONOLITHIC:
        return "corrected"
    return "scaled" if choice.mass_scaling is not None else choice.split


def is_direct(mesh: LocalMesh) -> bool:
    """Return whether the default solvers are factorizations."""
    return mesh.dim == 2 and mesh.n_global <= DIRECT_NODES_2D
