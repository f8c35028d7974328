"""From a scene to a distributed mesh, two phases and their coupling."""

from mpi4py import MPI

from ..config import Scene
from ..errors import InputError
from ..fem.distribute import LocalMesh, distribute
from ..fem.domain import Domain
from ..linalg.partition import partition
from ..linalg.stopwatch import Stopwatch
from ..mesh.axis import around_axis, tags_on_axis
from ..mesh.check import boundary_tags, require_every_tag, require_regions, require_tags
from ..mesh.excerpt import excerpt, with_inner
from ..mesh.generate import box, rectangle
from ..mesh.graph import node_graph
from ..mesh.interface import INTERFACE, with_interface, with_interface_of
from ..mesh.mesh import Mesh
from ..mesh.read import Reading, read_mesh
from ..mesh.select import with_tags
from ..output.files import on_root
from .auto import AnyMedium, AutoMedium, auto_terms
from .axis import check_axis
from .excavation import remaining_mesh, remaining_scene
from .fall_back import tried_by_itself
from .interface import InterfaceBuilder
from .locking import require_no_locking
from .porous import PorousBuilder
from .sides import check_dry, check_sides, check_surfaces
from .stage_names import require_effect, require_known_regions, require_known_tags
from .start import put_at_start
from .supports import require_supports


def _reading(scene):
    section = scene.mesh
    choices = section.array, section.groups, section.scale, section.facets
    return Reading(*choices, scene.cell_arrays)


def tagged_mesh(scene: Scene) -> Mesh:
    """Return the serial mesh of a scene with its tags and regions, before what the scene says of
    them is looked at; raises InputError (call it on one rank).
    """
    section = scene.mesh
    where = str(scene.source_path or "scene")
    mesh = (
        read_mesh(section.path, section.dim, _reading(scene))
        if section.kind == "file"
        else _generated(section, where)
    )
    if section.keep:
        mesh = excerpt(mesh, section.keep, where)
    mesh = with_tags(mesh, section.tag, where)
    return around_axis(mesh, where) if scene.axisymmetric else mesh


def serial_mesh(scene: Scene) -> Mesh:
    """Return the serial mesh of a scene, checked for all its stages; raises InputError (call it on
    one rank).
    """
    mesh = tagged_mesh(scene)
    require_known_regions(scene, mesh)
    found = _checked_rest(scene, mesh)
    require_known_tags(scene, {*mesh.facets, *found.facets})
    there = []
    for stage, later in zip(scene.stage, scene.stages[1:], strict=True):
        try:
            there.append({*_checked_rest(later, mesh).facets})
        except InputError as error:
            raise InputError(f"{error} (in the stage '{stage.name}')") from None
    require_effect(scene, there)
    return with_inner(mesh if scene.inactive else found, scene.changing)


def _checked_rest(scene, mesh):
    """Return what is there of the mesh in a stage, where the scene fits it."""
    left = remaining_mesh(scene, mesh)
    return _checked(remaining_scene(scene, mesh.facets, left.facets), left)


def _checked(scene, mesh):
    """Return the mesh with its interface, where the scene fits it."""
    where = str(scene.source_path or "scene")
    on_axis = tags_on_axis(mesh, where)
    for i, material in enumerate(scene.material):
        if material.region != ("all",):
            require_regions(mesh, material.region, f"{where} [material.{i}.region]")
    for i, force in enumerate(scene.body_forces):
        if force.on != ("all",):
            require_regions(mesh, force.on, f"{where} [body_force.{i}.on]")
    _require_materials(mesh, scene, where)
    kinds = _kinds(scene, mesh)
    for i, pair in enumerate(scene.interface):
        require_tags(mesh, pair.fluid, f"{where} [interface.{i}.fluid]")
        require_tags(mesh, pair.solid, f"{where} [interface.{i}.solid]")
    outer = set(boundary_tags(mesh)) - {
        tag for pair in scene.interface for tag in (*pair.fluid, *pair.solid)
    }
    outer -= on_axis
    if scene.precice:
        require_tags(mesh, scene.precice.on, f"{where} [precice.on]")
        outer -= set(scene.precice.on)
    if INTERFACE not in mesh.facets:
        wetted = [tag for pair in scene.interface for tag in pair.fluid]
        mesh = with_interface(
            mesh, {region for region, kind in kinds.items() if kind == "fluid"}, wetted
        )
    mesh = with_interface_of(mesh, kinds, {tag for _, s in scene.named_surfaces for tag in s.on})
    for i, boundary in enumerate(scene.boundary):
        require_tags(mesh, boundary.on, f"{where} [boundary.{i}.on]")
    for i, tie in enumerate(scene.tie):
        require_tags(mesh, (tie.first, tie.second), f"{where} [tie.{i}]")
    require_every_tag(
        sorted(outer), [tag for boundary in scene.boundary for tag in boundary.on], where
    )
    check_axis(scene, on_axis, where)
    if scene.is_porous:
        check_dry(scene, mesh, kinds, where)
    else:
        check_sides(scene, mesh, kinds, where)
    check_surfaces(scene, mesh, kinds, where)
    require_supports(scene, mesh, kinds, where)
    require_no_locking(scene, mesh, where)
    return mesh


def _generated(section, where):
    """Return the mesh that a section describes; an InputError begins with the file."""
    try:
        if section.kind == "rectangle":
            return rectangle(
                section.x,
                section.y,
                section.order,
                section.diagonal,
                section.patches,
                section.regions,
                section.cell_type,
            )
        return box(
            section.x,
            section.y,
            section.z,
            section.order,
            section.patches,
            section.regions,
            section.cell_type,
        )
    except InputError as error:
        raise InputError(f"{where} {error}") from None
    except MemoryError:
        raise InputError(
            f"{where} [mesh]: the memory of this machine does not hold the mesh; take fewer cells"
        ) from None


def _kinds(scene, mesh):
    """Return region -> kind of its material."""
    return {
        region: entry.kind
        for entry in scene.material
        for region in (mesh.regions if entry.region == ("all",) else entry.region)
    }


def _require_materials(mesh, scene, where):
    covered = {region for material in scene.material for region in material.region}
    bare = [region for region in mesh.regions if region not in covered and "all" not in covered]
    if bare:
        raise InputError(
            f"{where} [[material]]: region '{bare[0]}' of the mesh has no material; add an entry"
            f' with region = "{bare[0]}"'
        )


def local_mesh(scene: Scene, comm: MPI.Intracomm) -> LocalMesh:
    """Return the `LocalMesh` of every rank (collective)."""
    serial = []
    on_root(comm, lambda: serial.append(serial_mesh(scene)))
    mesh = serial[0] if serial else None
    indptr, indices = node_graph(mesh.cells, len(mesh.points)) if mesh else (None, None)
    owner = partition(comm, indptr, indices, mesh.points if mesh else None)
    return distribute(comm, mesh, owner)


def build_coupling(scene: Scene, mesh: LocalMesh, stopwatch: Stopwatch) -> AnyMedium:
    """Return the coupling scheme of a scene with its phases in their initial state (collective)."""
    active = [region for region in mesh.regions if region not in scene.inactive]
    domain = Domain(mesh, active) if scene.is_porous else None

    def build(scene):
        builder = (
            PorousBuilder(scene, mesh, stopwatch, domain)
            if domain
            else InterfaceBuilder(scene, mesh, stopwatch)
        )
        medium = builder.medium()
        medium.tried = tried_by_itself(scene) - ({"step"} if scene.precice else set())
        return medium

    if auto_terms(scene.model):
        return AutoMedium(scene, build, _start)
    medium = build(scene)
    if domain:
        _start(medium, scene)
    return medium


def _start(medium, scene):
    put_at_start(scene, medium.solid, medium.fluid)
