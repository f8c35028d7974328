"""What `porofsi check` says of a scene: what is solved, and the numbers that show whether mesh,
steps and units fit it.

All of it follows from scene and mesh, nothing is solved.  Every function here is collective.
"""

import numpy as np
from mpi4py import MPI
from scipy.spatial import cKDTree

from ..config import Scene
from ..config.stages import REPLACED, SETTINGS
from ..errors import InputError
from ..fem.geometry import shape_quality
from ..mesh.check import place
from .auto import AnyMedium, at_start, auto_terms
from .builder import entries, materials_of
from .conditions import components, nodes_of
from .loop import Clock
from .measures import Measures
from .report import modelled, unknowns

# times at which a formula is looked at, evenly over the run; as many again towards its start
SAMPLES = 40
MANY_STEPS = 100_000  # a growing step is followed up to here
# Distance of nodes over √(c_v Δt) up to which a step of consolidation makes no oscillation (Vermeer
# & Verruijt 1981).
RESOLVED = np.sqrt(6)
# times its Young's modulus that nobody loads a material; large strain with up to 1.4 times is among
# the scenes
UNLIKELY = 10
# Of the whole process: measured 5.7 to 6.4 kB per unknown in 3-D (docs/scale.md), 2 to 4 in 2-D;
# 0.25 GB are Python's.
BYTES_PER_UNKNOWN = {2: 4e3, 3: 6e3}
BYTES_PER_RANK = 0.25e9


def preview(scene: Scene, coupling: AnyMedium, measures: Measures) -> str:
    """Return the text; `measures` of the scene know what it leaves out."""
    mesh = coupling.solid.mesh
    lines = [
        scene.title,
        _size(mesh, coupling),
        f"regions: {', '.join(mesh.regions)}; boundaries: {', '.join(sorted(mesh.facets))}",
        _quality(mesh),
        *(f"mesh: {note}" for note in mesh.notes),
        _terms(scene, measures),
        _time(scene.time),
    ]
    if absent := scene.inactive:
        lines.append(f"not there at the start: {', '.join(absent)}")
    for stage, later in zip(scene.stage, scene.stages[1:], strict=True):
        lines.append(f"stage '{stage.name}': {_time(later.time)}; {_changes(stage)}")
    lines += [*_diffusion(scene, coupling), *_waves(scene, coupling), *_flow(scene, coupling)]
    return "\n".join([*lines, *_loads(scene, coupling), *_initial_stress(scene, coupling)])


def _size(mesh, coupling):
    count = sum(unknowns(coupling.solid, coupling.fluid).values())
    memory = count * BYTES_PER_UNKNOWN[mesh.dim] + mesh.comm.size * BYTES_PER_RANK
    cells = f"{mesh.n_cells_global} elements {mesh.element.name}, {mesh.n_global} nodes"
    return f"{cells}, {count} unknowns, about {memory / 1e9:.1f} GB of memory"


def _quality(mesh):
    """Return the line on the shapes of the cells: mean ratio, the worst one and its place."""
    cells = mesh.cells[mesh.cell_owned]
    X = mesh.X[cells[:, : mesh.element.n_vertices]]
    quality = shape_quality(mesh.element.cell, X)
    least = mesh.comm.allreduce(float(quality.min(initial=np.inf)), MPI.MIN)
    here = np.flatnonzero(quality == least)[:1]
    number = mesh.cell_natural[mesh.cell_owned][here].tolist()
    centre = X[here].mean(axis=1).tolist()
    found = mesh.comm.allgather(list(zip(number, centre, strict=True)))
    _, at = min(cell for of_rank in found for cell in of_rank)
    mean = mesh.comm.allreduce(float(quality.sum())) / mesh.n_cells_global
    return (
        f"cells: mean ratio {mean:.2f} on average, at worst {least:.2g} at {place(np.array(at))} m"
        " (1: equilateral, 0: flat)"
    )


def _terms(scene, measures):
    solved = ", ".join(modelled(scene, at_start(scene).model))
    watched = ", ".join(
        f"{o.name} (up to {o.bound:g})" for o in measures.omissions if o.bound is not None
    )
    waiting = ", ".join(auto_terms(scene.model))
    parts = [f"solved: {solved}", f"switched on when needed: {waiting}" if waiting else ""]
    return "; ".join(filter(None, [*parts, f"left out and watched: {watched}" if watched else ""]))


def _time(section):
    """Return the line on the steps."""
    if section.error_tolerance is not None:
        return (
            f"to t = {section.end:g} s, first step {section.step:g} s, then as time.error_tolerance"
            " asks"
        )
    if section.growth == 1:
        return (
            f"to t = {section.end:g} s in"
            f" {np.ceil((section.end - section.begins) / section.step - 1e-9):.0f} steps of"
            f" {section.step:g} s"
        )
    clock = Clock(section)
    clock.t = section.begins
    largest = section.step
    while not clock.finished and clock.step < MANY_STEPS:
        largest = max(largest, clock.nominal)
        clock.advance(clock.next_size(), clock.next_target())
    count = f"{clock.step} steps" if clock.finished else f"more than {MANY_STEPS} steps"
    return (
        f"to t = {section.end:g} s in {count}, growing by {section.growth:g} from {section.step:g}"
        f" s to {largest:g} s"
    )


def _changes(stage):
    """Return what a stage changes, in words."""
    found = [
        f"{verb} {', '.join(names)}"
        for verb, names in (("takes away", stage.inactive), ("places", stage.active))
        if names
    ]
    changed = [
        f"[[{table}]] of {', '.join(dict.fromkeys(names))}"
        for table, names in (
            ("boundary", [tag for entry in stage.boundary for tag in entry.on]),
            ("material", [region for entry in stage.material for region in entry.region]),
        )
        if names
    ]
    changed += [f"[{name}]" for name in (*REPLACED, *SETTINGS[1:]) if getattr(stage, name)]
    found += [f"changes {', '.join(changed)}"] if changed else []
    found += [f"ends [[{name}]]" for name in REPLACED if getattr(stage, name) == ()]
    found += ["all of it little by little"] if stage.gradual else []
    found += ["resets displacements"] if stage.reset_displacement else []
    return "; ".join(found) or "changes nothing but the steps"


def _diffusion(scene, coupling):
    """Yield a line per porous region: c_v = E_c k/γ [m²/s], what it means far from drained
    boundaries and beside them.
    """
    domain = coupling.solid.domain
    drained = _drained(scene, domain)
    where = cKDTree(np.vstack(domain.mesh.comm.allgather(domain.mesh.X[drained])))
    for region, material in _present(scene, domain):
        if material.has_pores:
            c_v, largest = _extremes(domain, region, material.diffusivity)
            layer = np.sqrt(c_v * scene.time.step)
            where_most = " along the most permeable axis" if material.anisotropy else ""
            where_most += f" to {largest:.3g} m²/s; of the least" if largest > c_v else ""
            line = (
                f"{region}: c_v = {c_v:.3g} m²/s{where_most}, the first step drains {layer:.3g} m"
            )
            yield line + (
                _drainage(domain, region, drained, where, c_v, layer)
                if where.n
                else ", no boundary is drained"
            )


def _drainage(domain, region, drained, where, c_v, layer):
    """Return the end of the line: time to drain a region, and whether its elements beside the
    boundary see the first step.

    drained (n_local,) bool; where : tree of all drained nodes
    """
    cells = domain.cells[domain.region_slices[region]]
    path = _largest_of(domain, where.query(domain.mesh.X[np.unique(cells)])[0])
    text = f", all of it ({path:.3g} m from a drained boundary) takes {path**2 / c_v:.3g} s"
    beside = drained[cells].any(axis=1)
    smallest = -_largest_of(domain, -domain.h[domain.region_slices[region]][beside])
    if np.isfinite(smallest) and smallest > RESOLVED * layer:
        text += (
            f"; nodes beside a drained boundary are {smallest:.3g} m apart or more, which does not"
            " resolve the first step: p may oscillate there at first; grade the mesh towards it or"
            " begin with a longer step"
        )
    return text


def _drained(scene, domain):
    """Return the nodes with a prescribed pressure or a seepage face and those at which a free fluid
    takes what flows out, (n_local,) bool.
    """
    mesh = domain.mesh
    materials = materials_of(at_start(scene), mesh)
    free = [mesh.regions.index(r) for r, found in materials.items() if found.is_free_fluid]
    beside = np.zeros(mesh.n_local, dtype=np.uint8)
    beside[mesh.cells[np.isin(mesh.cell_region, free)]] = 1
    mesh.halo.update(beside)
    draining = {"pressure", "seepage"}
    tags = [tag for b in scene.boundary if draining & set(b.given()) for tag in b.on]
    tags += [tag for pair in scene.interface for tag in pair.solid]
    return nodes_of(mesh, tags) | (beside.astype(bool) & domain.holds)


def _largest_of(domain, values):
    return domain.mesh.comm.allreduce(float(values.max(initial=-np.inf)), MPI.MAX)


def _waves(scene, coupling):
    """Yield a line on the waves in solids with inertia: c = √(E_c/ρ) of the fastest one [m/s], its
    Courant number.
    """
    domain = coupling.solid.domain
    found = _present(scene, domain)
    if scene.model.solid_inertia is True and found:
        speeds = [
            _extremes(domain, region, np.sqrt(m.elastic.oedometer_modulus / _density(m)))[1]
            for region, m in found
        ]
        number = max(
            c * scene.time.step / _element_sizes(domain, [r])[0]
            for c, (r, _) in zip(speeds, found, strict=True)
        )
        yield (
            f"waves of the solid: up to {max(speeds):.3g} m/s, Courant number {number:.3g} of the"
            " first step"
        )


def _flow(scene, coupling):
    """Yield a line on a free fluid with a prescribed velocity: its largest one [m/s], Reynolds and
    Courant number.
    """
    domain = coupling.fluid.domain
    speed = _speed(scene, coupling)
    if not speed:
        return
    smallest = _element_sizes(domain, domain.regions)[0]
    side = min(_sides(domain, domain.regions))
    line = f"flow: prescribed velocity up to {speed:.3g} m/s"
    if scene.time.scheme != "steady":  # whose steps are no times
        line += f", Courant number {speed * scene.time.step / smallest:.3g}"
    free = [
        m
        for m in materials_of(at_start(scene), domain.mesh).values()
        if m.is_free_fluid and m.viscosity
    ]
    if free:
        reynolds = max(m.rho_fR * speed * side / m.viscosity for m in free)
        line += f", Reynolds number {reynolds:.3g} over the shortest side of its box ({side:g} m)"
    yield line


def _loads(scene, coupling):
    """Yield the lines on body forces and loads, and a sentence where a load exceeds a modulus."""
    gravity = _body_forces(scene, coupling)
    words = [f"{name} up to {np.linalg.norm(b):.3g} m/s²" for name, b in gravity.items() if b.any()]
    yield f"body force: {', '.join(words) or 'none'}"
    loads = {
        **_surface_loads(scene, coupling),
        **_weights(scene, coupling, gravity),
        **_dynamic_pressure(scene, coupling),
    }
    loads = {name: size for name, size in loads.items() if size}
    if not loads:
        return
    name = max(loads, key=loads.get)
    yield f"largest load: {loads[name]:.3g} Pa ({name})"
    moduli = {
        region: _extremes(coupling.solid.domain, region, _young(material.elastic))[0]
        for region, material in _present(scene, coupling.solid.domain)
    }
    softest = min(moduli, key=moduli.get, default=None)
    if softest and loads[name] > UNLIKELY * moduli[softest]:
        yield (
            f"that exceeds Young's modulus of '{softest}', {moduli[softest]:.3g} Pa,"
            f" {loads[name] / moduli[softest]:.2g} times: compare their units, both are in Pa (5e6,"
            " not 5, for 5 MPa)"
        )


def _initial_stress(scene, coupling):
    """Yield the line on an initial stress: what it leaves of the loads of the first step."""
    if not scene.initial.stress.components(scene.dim):
        return
    schemes, rates = Clock(scene.time).next_schemes(at_start(scene).model)
    coupling.begin_phases(schemes, rates, 0.0)
    flow = coupling.flow(coupling.fluid.residual(coupling.mesh_state()))
    residual, largest = coupling.solid.residual(flow).norms()
    coupling.reset()
    share = residual / largest if largest else 0.0
    yield (
        f"initial stress: at rest it is out of balance with pressure and loads of the first step by"
        f" {share:.2g} of the largest force of the solid"
    )


def _surface_loads(scene, coupling):
    """Return name -> largest |traction| or |pressure| prescribed on a surface [Pa]."""
    mesh = coupling.solid.mesh
    given = [(tag, f"traction on '{tag}'", e) for tag, _, e in entries(scene, "traction")]
    given += [
        (tag, f"pressure on '{tag}'", b.pressure)
        for b in scene.boundary
        for tag in b.on
        if b.pressure is not None
    ]
    return {
        name: _largest(scene, mesh, e, mesh.X[np.unique(mesh.facets[tag].nodes)])
        for tag, name, e in given
    }


def _body_forces(scene, coupling):
    """Return phase -> largest |b_i| of its components in its domain, (d,) [m/s²]."""
    mesh = coupling.solid.mesh
    found = {}
    for name, phase in (("solid", coupling.solid), ("fluid", coupling.fluid)):
        X = mesh.X[phase.domain.holds]
        found[name] = np.zeros(mesh.dim)
        for force in scene.body_forces:
            for i, given in components(getattr(force, name)).items():
                found[name][i] = max(found[name][i], _largest(scene, mesh, given, X))
    return found


def _weights(scene, coupling, gravity):
    """Return name -> weight of what stands on the lowest point of the solid [Pa]."""
    domain = coupling.solid.domain
    if not domain.regions:
        return {}
    density = max(
        _extremes(domain, region, material.rho_s)[1] for region, material in _present(scene, domain)
    )
    return {"weight": density * float(np.max(gravity["solid"] * _sides(domain, domain.regions)))}


def _dynamic_pressure(scene, coupling):
    """Return name -> ρ v² of the largest prescribed velocity of a free fluid [Pa]."""
    materials = materials_of(at_start(scene), coupling.solid.mesh).values()
    density = max((m.rho_fR for m in materials if m.is_free_fluid), default=0.0)
    return {"dynamic pressure of the flow": density * _speed(scene, coupling) ** 2}


def _speed(scene, coupling):
    """Return the largest prescribed velocity component of a free fluid [m/s], 0 without one."""
    if scene.is_porous:
        return 0.0
    mesh = coupling.solid.mesh
    given = coupling.fluid.setup.velocity.conditions
    return max(
        (_largest(scene, mesh, c.given.expression, mesh.X[c.nodes]) for c in given), default=0.0
    )


def _largest(scene, mesh, expression, X):
    """Return the largest |value| of an expression at points X (n, d) of all ranks, at times over
    the whole run.
    """
    end = scene.time.end
    largest = 0.0
    for t in (
        [*np.linspace(0, end, SAMPLES + 1), *(end * np.logspace(-6, 0, SAMPLES))]
        if getattr(expression, "depends_on_time", True)
        else [0.0]
    ):
        try:
            largest = max(largest, float(np.abs(expression(t, X)).max(initial=0.0)))
        except InputError:  # where it is not finite, perhaps only at t = 0, the run will tell
            continue
    return mesh.comm.allreduce(largest, MPI.MAX)


def _present(scene, domain):
    """Return (region, material) of the regions of a domain that have a skeleton, the material that
    of its elements.
    """
    materials = materials_of(at_start(scene), domain.mesh)
    return [
        (region, materials[region].at(domain.cell_numbers[domain.region_slices[region]]))
        for region in domain.regions
        if not materials[region].is_free_fluid
    ]


def _extremes(domain, region, values):
    """Return the least and the largest of values of the elements of a region, (E, 1); of a number
    itself twice (collective).
    """
    if not np.ndim(values):
        return values, values
    comm = domain.mesh.comm
    least = comm.allreduce(values.min(initial=np.inf), MPI.MIN)
    return least, comm.allreduce(values.max(initial=-np.inf), MPI.MAX)


def _density(material):
    """Return the density of a solid with the fluid in its pores [kg/m³]."""
    return material.rho_s + (1 - material.n_s0) * material.rho_fR


def _young(law):
    """Return E = μ (3 λ + 2 μ)/(λ + μ) [Pa]."""
    return law.mu * (3 * law.lam + 2 * law.mu) / (law.lam + law.mu)


def _element_sizes(domain, regions):
    """Return the smallest and the largest size, `Domain.h`, of the elements of regions [m]."""
    h = np.concatenate([domain.h[domain.region_slices[region]] for region in regions])
    comm = domain.mesh.comm
    return comm.allreduce(h.min(initial=np.inf), MPI.MIN), comm.allreduce(
        h.max(initial=0.0), MPI.MAX
    )


def _sides(domain, regions):
    """Return the sides of the box around regions, d lengths [m]."""
    cells = np.concatenate([domain.cells[domain.region_slices[region]] for region in regions])
    X = domain.mesh.X[np.unique(cells)]
    low = np.empty(domain.dim)
    high = np.empty(domain.dim)
    domain.mesh.comm.Allreduce(X.min(axis=0, initial=np.inf), low, MPI.MIN)
    domain.mesh.comm.Allreduce(X.max(axis=0, initial=-np.inf), high, MPI.MAX)
    return (high - low).tolist()
