"""Regions that a stage places: what carries their nodes up to then, and the pressure in them.

A node of such a region that nothing else holds goes along with the ground beside it: its
displacement is the harmonic extension of that of the nodes which the region shares with the rest,
with what the stage prescribes.  Where the extension has taken them the elements of the region are
at rest, see `fem.domain.Domain`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..config import Scene
from ..errors import ConvergenceError
from ..fem.constraints import LinearConstraints
from ..fem.distribute import LocalMesh
from ..fem.domain import Domain
from ..fem.geometry import geometry
from ..fem.transfer import InterfaceTransfer
from ..materials import MESH_MOTION
from ..phases.mesh_motion import MeshMotion
from ..phases.setup import MeshSetup
from .builder import is_direct
from .conditions import dirichlet, essentials, linear_constraints

if TYPE_CHECKING:
    from ..linalg.stopwatch import Stopwatch

TOLERANCE = 1e-13  # of the displacement, which an iterative solver reaches in several solutions
CAP = 40


@dataclass(frozen=True, eq=False)
class Placed:
    """The nodes (n_local,) bool that a stage brings, with their displacement u (n_local, d) [m] and
    pressure p (n_local,) [Pa] when it begins; cells : `LocalMesh.placed` from then on.
    """

    cells: np.ndarray
    nodes: np.ndarray
    u: np.ndarray
    p: np.ndarray


def without_placed(scene: Scene, mesh: LocalMesh) -> LocalMesh:
    """Return the mesh of a run that will place regions, before it has placed any."""
    stages = scene.stages
    laws = (m.elastic_law() for stage in stages for m in stage.material if m.solid)
    finite = any(stage.model.moving_mesh for stage in stages)
    finite |= not all(law.small_strain for law in laws)
    return replace(mesh, placed=np.zeros((*mesh.cells.shape, mesh.dim)), finite=finite)


def place(
    scene: Scene,
    mesh: LocalMesh,
    regions: tuple[str, ...],
    u: np.ndarray,
    stopwatch: Stopwatch,
) -> Placed:
    """Return what is placed with some regions (collective).

    scene, mesh : of the stage that begins, what is not there taken away; u : the displacement at
    its start, (n_local, d) [m].  Raises ConvergenceError where an element would be inverted.
    """
    fresh = Domain(replace(mesh, placed=None), regions)
    others = set(mesh.regions) - {*regions, *scene.inactive}
    carried = Domain(mesh, others).holds
    nodes = fresh.holds & ~carried
    found = np.where(nodes[:, None], _extended(scene, fresh, carried, u, stopwatch), u)
    _require_shape(fresh, found)
    assert mesh.placed is not None  # of every run that places something
    cells = mesh.placed.copy()
    cells[fresh.cell_numbers] = fresh.gather(found)
    given = scene.initial.pressure
    p = np.zeros(mesh.n_local) if given is None else given(0.0, mesh.X)
    return Placed(cells, nodes, found, p)


def _extended(scene, domain, carried, u, stopwatch):
    """Return the displacement of the nodes of a domain that follows carried ones, (n_local, d)
    (collective).
    """
    mesh = domain.mesh
    t = scene.time.begins
    held = dirichlet(scene, mesh, mesh.dim, essentials(scene, "displacement"))
    setup = MeshSetup(
        domain=domain,
        materials={},
        body_force=(),
        inertia=False,
        moving_mesh=True,
        split="plain",
        direct=is_direct(mesh),
        stopwatch=stopwatch,
        law=MESH_MOTION["harmonic"](0.0, 1.0),
        stiffening=0.0,
        carried=carried,
        transfer=InterfaceTransfer(mesh, carried, ()),
        dirichlet=held,
    )
    motion = MeshMotion(setup, domain, with_hessian=False)
    found = _converged(motion, u, t)
    motion.block.solver.destroy()
    if given := linear_constraints(scene):
        where = scene.source_path or "scene"
        LinearConstraints(mesh, held.mask, given, where).apply(found, t)
        mesh.halo.update(found)
    return found


def _converged(motion, u, t):
    """Return the extension of u at a time, (n_local, d) (collective)."""
    found = np.zeros_like(u)
    for _ in range(CAP):
        before = found
        found = motion.extended(u, before, t)
        n = motion.mesh.n_owned
        if motion.relative((found - before)[:n], found) <= TOLERANCE:
            return found
    raise ConvergenceError(
        f"the nodes of regions to place could not be carried to t = {t:g} s in {CAP} solutions",
        "take the default solver of the prefix mesh_, or a tighter tolerance of it",
    )


def _require_shape(domain, u):
    """Raise ConvergenceError where the extension inverts an element (collective)."""
    placed = geometry(domain.mass, domain.gather(domain.mesh.X + u))
    domain.require(placed.dV > 0, _inverted)


def _inverted(place):
    return ConvergenceError(
        f"an element of a region to place would be inverted, at {place}",
        "the ground beside it has moved by more than its elements can follow: mesh it coarser"
        " there, or place it earlier",
    )
