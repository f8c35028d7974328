"""From a scene to a distributed mesh, two phases and their coupling."""

import numpy as np

from ..coupling.accelerators import ACCELERATORS
from ..coupling.monolithic import MonolithicCoupling
from ..coupling.porous import GUARDS, PorousCoupling
from ..errors import InputError
from ..fem.boundary import Dirichlet, SurfaceLoad, facet_normals, weak_zero_on
from ..fem.distribute import distribute
from ..fem.domain import Domain
from ..linalg.partition import partition
from ..materials import ELASTIC, PERMEABILITY
from ..materials.porous import PorousMaterial
from ..mesh.check import boundary_tags, require_every_tag, require_regions, require_tags
from ..mesh.generate import box, rectangle
from ..mesh.graph import node_graph
from ..mesh.read import read_mesh
from ..output.files import on_root
from ..phases.fluid import FluidPhase
from ..phases.mixture import DirectMixture, QuasiDirectMixture
from ..phases.setup import FluidSetup, SolidSetup
from ..phases.solid import SolidPhase
from .auto import AutoMedium, auto_terms

AXES = "xyz"
MIXTURES = {"quasi_direct": QuasiDirectMixture, "direct": DirectMixture}
# Nodes above which a 2-D scene is solved by FieldSplit and multigrid instead of MUMPS; 3-D always is.  Measured by
# scripts/bench_solvers (docs/solvers.md): with tangents renewed in every step both take the same time at about 75 000 nodes, with
# kept ones MUMPS is the faster up to 84 000 at least.
DIRECT_NODES_2D = 100_000


def serial_mesh(scene):
    """Return the checked serial mesh of a scene; raises InputError (call it on one rank)."""
    section, where = scene.mesh, str(scene.source_path or "scene")
    if section.kind == "file":
        mesh = read_mesh(section.path, section.dim)
    elif section.kind == "rectangle":
        mesh = rectangle(section.x, section.y, section.order, section.diagonal, section.patches, section.regions)
    else:
        mesh = box(section.x, section.y, section.z, section.order, section.patches, section.regions)
    for i, boundary in enumerate(scene.boundary):
        require_tags(mesh, boundary.on, f"{where} [boundary.{i}.on]")
    require_every_tag(boundary_tags(mesh), [tag for boundary in scene.boundary for tag in boundary.on], where)
    for i, material in enumerate(scene.material):
        if material.region != ("all",):
            require_regions(mesh, material.region, f"{where} [material.{i}.region]")
    _require_materials(mesh, scene, where)
    return mesh


def _require_materials(mesh, scene, where):
    covered = {region for material in scene.material for region in material.region}
    bare = [region for region in mesh.regions if region not in covered and "all" not in covered]
    if bare:
        raise InputError(
            f"{where} [[material]]: region '{bare[0]}' of the mesh has no material; add an entry with region = \"{bare[0]}\""
        )


def local_mesh(scene, comm):
    """Return the `LocalMesh` of every rank (collective)."""
    serial = []
    on_root(comm, lambda: serial.append(serial_mesh(scene)))
    mesh = serial[0] if serial else None
    indptr, indices = node_graph(mesh.cells, len(mesh.points)) if mesh else (None, None)
    owner = partition(comm, indptr, indices, mesh.points if mesh else None)
    return distribute(comm, mesh, owner)


def porous_materials(scene, mesh):
    """Return dict region -> PorousMaterial, without the "auto" terms of the model."""
    materials = {}
    for entry in scene.material:
        for region in mesh.regions if entry.region == ("all",) else entry.region:
            materials[region] = PorousMaterial(
                elastic=ELASTIC[entry.solid.law](entry.solid.lambda_, entry.solid.mu, 1 - entry.porosity),
                n_s0=1 - entry.porosity,
                rho_sR=entry.solid.density,
                rho_fR=entry.fluid.density,
                drag0=1 / entry.mobility,
                permeability=PERMEABILITY[entry.permeability.law],
                exponent=entry.permeability.exponent or 0.0,
                viscosity=entry.fluid.viscosity if scene.model.viscosity is True else 0.0,
                variable_porosity=scene.model.porosity == "variable",
            )
    return materials


def components(vector):
    """Return dict component -> expression of the given components of a `config.Vector`."""
    return {i: getattr(vector, axis) for i, axis in enumerate(AXES) if getattr(vector, axis) is not None}


def _entries(scene, quantity):
    """Return (tag, component, expression) for every prescribed component of a vector quantity."""
    return [(tag, i, e) for b in scene.boundary for tag in b.on for i, e in components(getattr(b, quantity)).items()]


def solid_setup(scene, domain, materials, stopwatch):
    """Return the `SolidSetup` of a scene."""
    mesh, model = domain.mesh, scene.model
    loads = [SurfaceLoad(mesh, tag, components(b.traction)) for b in scene.boundary for tag in b.on if components(b.traction)]
    return SolidSetup(
        domain=domain,
        materials=materials,
        body_force=components(scene.body_force.solid),
        inertia=model.solid_inertia,
        moving_mesh=model.moving_mesh,
        split=_split(scene),
        direct=_is_direct(mesh),
        stopwatch=stopwatch,
        dirichlet=Dirichlet(mesh, mesh.dim, _entries(scene, "displacement")),
        loads=tuple(loads),
        with_hessian=model.viscosity,
        mass_scaling=scene.coupling.mass_scaling,
    )


def fluid_setup(scene, domain, materials, stopwatch):
    """Return the `FluidSetup` of a scene."""
    mesh, model, stabilization = domain.mesh, scene.model, scene.stabilization
    pressures = [(tag, 0, b.pressure) for b in scene.boundary for tag in b.on if b.pressure is not None]
    free, drained = _traction_tags(scene, mesh), {tag for tag, _, _ in pressures}
    _require_pressure_level(scene, free, drained)
    fluxes = [SurfaceLoad(mesh, tag, {0: b.flux}) for b in scene.boundary for tag in b.on if b.flux is not None]
    inertia = model.solid_inertia or model.fluid_inertia
    return FluidSetup(
        domain=domain,
        materials=materials,
        body_force=components(scene.body_force.fluid),
        inertia=model.fluid_inertia,
        moving_mesh=model.moving_mesh,
        split=_split(scene),
        direct=_is_direct(mesh),
        stopwatch=stopwatch,
        velocity=Dirichlet(mesh, mesh.dim, _entries(scene, "velocity")),
        pressure=Dirichlet(mesh, 1, pressures),
        fluxes=tuple(fluxes),
        no_slip=_nodes_of(mesh, [tag for b in scene.boundary if b.no_slip for tag in b.on]),
        stress_nodes=_nodes_of(mesh, [tag for tag in free if tag in drained]),
        free_surface=weak_zero_on(domain, [tag for tag in free if tag not in drained]),
        has_auxiliary=inertia and _split(scene) == "corrected",
        convection=model.convection,
        pspg=stabilization.pspg,
        supg=stabilization.supg,
        lsic=stabilization.lsic,
        undrained=stabilization.undrained,
    )


def _nodes_of(mesh, tags):
    """Return the nodes of tagged surfaces, (n_local,) bool with ghosts (collective)."""
    mask = np.zeros(mesh.n_local, dtype=np.uint8)
    for tag in tags:
        mask[mesh.facets[tag].nodes] = 1
    mesh.halo.update(mask)
    return mask.astype(bool)


def _traction_tags(scene, mesh):
    """Return the surfaces on which the normal displacement is not prescribed (collective)."""
    fixed = {tag: set() for b in scene.boundary for tag in b.on}
    for tag, component, _ in _entries(scene, "displacement"):
        fixed[tag].add(component)
    return [tag for tag, held in fixed.items() if not _holds_normal(mesh, tag, sorted(held))]


def _require_pressure_level(scene, free, drained):
    """Raise InputError where neither a pressure nor a traction sets the level of p: any constant solves the equations."""
    if not free and not drained:
        received = "received a prescribed normal displacement and no pressure on every boundary"
        advice = "expected one with a pressure or free to move, because else the pressure has no level; prescribe it on one"
        raise InputError(f"{scene.source_path or 'scene'} [[boundary]]: {received}, {advice}")


def _holds_normal(mesh, tag, held):
    """Return whether the prescribed components hold more than half of the mean squared normal (collective)."""
    normal2 = (facet_normals(mesh, tag)[mesh.facets[tag].owned] ** 2).sum(axis=0)
    normal2 = mesh.comm.allreduce(normal2)
    return normal2[held].sum() > 0.5 * normal2.sum()


def build_coupling(scene, mesh, stopwatch):
    """Return the coupling scheme of a scene with its phases in their initial state (collective)."""
    domain = Domain(mesh)
    if auto_terms(scene.model):
        return AutoMedium(scene, lambda scene: _medium(scene, domain, stopwatch))
    return _medium(scene, domain, stopwatch)


def _medium(scene, domain, stopwatch):
    """Return the coupling scheme of a scene without "auto" terms (collective)."""
    mesh, materials = domain.mesh, porous_materials(scene, domain.mesh)
    setups = [setup(scene, domain, materials, stopwatch) for setup in (solid_setup, fluid_setup)]
    solid, fluid = SolidPhase(setups[0]), FluidPhase(setups[1])
    initial = scene.initial
    solid.set_initial(_field(mesh, initial.displacement), _field(mesh, initial.solid_velocity))
    pressure = initial.pressure(0.0, mesh.X) if initial.pressure else None
    fluid.set_initial(_field(mesh, initial.fluid_velocity), pressure)
    choice = scene.coupling
    common = solid, fluid, mesh.comm, choice.tolerance, choice.max_iterations
    if choice.scheme in MIXTURES:
        return MonolithicCoupling(*common, MIXTURES[choice.scheme](solid, fluid, *setups))

    def accelerator(dot):
        return ACCELERATORS[choice.accelerator](dot, choice.relaxation, GUARDS[choice.split], choice.reuse_steps)

    return PorousCoupling(*common, accelerator, choice.tangent == "newton")


def _split(scene):
    """Return the split of the phases' tangents; those that precondition the monolithic schemes are the corrected ones."""
    choice = scene.coupling
    if choice.scheme in MIXTURES:
        return "corrected"
    return "scaled" if choice.mass_scaling is not None else choice.split


def _is_direct(mesh):
    """Return whether the default solvers are factorizations."""
    return mesh.dim == 2 and mesh.n_global <= DIRECT_NODES_2D


def _field(mesh, vector):
    field = np.zeros((mesh.n_local, mesh.dim))
    for component, expression in components(vector).items():
        field[:, component] = expression(0.0, mesh.X)
    return field
