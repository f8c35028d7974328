"""What holds the solids of a scene: rigid motions that no prescribed displacement stops are refused
where nothing else does.

A body, cells joined by facets, moves as u = t + ω × (X - c).  Each prescribed component at a node
is one equation for t and ω, so is each direction in which springs hold a facet; bodies with a
common node, a hinge, move alike there.  What these equations leave free a static balance does not
determine.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.linalg import qr
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from ..conditions import CONDITIONS
from ..config import Scene
from ..errors import InputError
from ..fem.constraints import NormalValue, common_nodes
from ..fem.normals import nodal_normals
from ..kernels.surface import facet_normal
from ..mesh.check import place
from ..mesh.mesh import Mesh
from ..mesh.topology import facet_groups, locate_facets
from .conditions import linear_constraints

AXES = "xyz"
PLANES = {
    2: ((0, 1),),
    3: ((1, 2), (2, 0), (0, 1)),
}  # in which a unit rotation turns the first axis to the second
# Distance of an equation from the span of the others, with lengths in sizes of the body, below
# which it says nothing new: digits of the coordinates in a mesh file.
DEPENDENT = 1e-6


def require_supports(scene: Scene, mesh: Mesh, kinds: dict[str, str], where: str | Path) -> None:
    """Raise InputError where a part of the solid can move as a rigid body at no cost.

    kinds : region -> "solid", "fluid" or "porous"
    """
    if scene.model.solid_inertia is True:
        return
    of_solid = np.isin(
        mesh.cell_region, [i for i, name in enumerate(mesh.regions) if kinds[name] != "fluid"]
    )
    cells = mesh.cells[of_solid]
    if not len(cells):
        return
    held = _held(scene, mesh, cells)
    further = _constraints(scene, mesh)
    springs = _springs(scene, mesh, cells)
    if mesh.element.axisymmetric:
        held[:, 0] = True  # the hoop stress holds what moves away from the axis
    part = _joined(cells)
    body = _joined(facet_groups(cells, mesh.element))
    for number in np.unique(part[~_wet(scene, mesh, kinds, of_solid, part)]):
        chosen = np.flatnonzero(part == number)
        found = _free_motion(
            mesh.points, cells[chosen], body[chosen], held, springs.of(chosen), further
        )
        if found:
            cell = chosen[found[0]]
            region = mesh.regions[mesh.cell_region[of_solid][cell]]
            at = place(mesh.points[cells[cell, : mesh.element.n_vertices]].mean(axis=0))
            what = "skeleton" if kinds[region] == "porous" else "solid"
            raise InputError(
                f"{where} [[boundary]]: nothing holds the {what} {found[1]}: region '{region}' at"
                f" {at} m can move as a rigid body without inertia; prescribe a displacement that"
                f" stops it{_alternative(scene)}"
            )


def _alternative(scene):
    """Return how a body that may move is solved."""
    if scene.time.scheme == "steady":
        return ""
    scheme = (
        "" if scene.time.scheme == "generalized_alpha" else ' and time.scheme = "generalized_alpha"'
    )
    return f", or set model.solid_inertia = true{scheme} if it may move"


def _held(scene, mesh, cells):
    """Return where displacements of the solid are prescribed, (N, d) bool."""
    held = np.zeros(mesh.points.shape, dtype=bool)
    for boundary in scene.boundary:
        components = [
            i
            for i, axis in enumerate(AXES[: mesh.dim])
            if getattr(boundary.displacement, axis) is not None
        ]
        for tag in boundary.on if components else ():
            if (locate_facets(mesh.facets[tag], cells, mesh.element)[0] >= 0).any():
                held[np.unique(mesh.facets[tag])[:, None], components] = True
    return held


def _constraints(scene, mesh):
    """Return the linear constraints as pairs of nodes and weights, (n, 2) and (n, d):
    w · (u_first - u_second) = 0, the second -1 where there is none.
    """

    def surface(tag):
        nodes = np.unique(mesh.facets[tag])
        return nodes, mesh.points[nodes]

    ends = [np.zeros((0, 2), dtype=np.int64)]
    weights = [np.zeros((0, mesh.dim))]
    for entry in linear_constraints(scene):
        if isinstance(entry, NormalValue):
            found = nodal_normals(mesh.points, [mesh.facets[t] for t in entry.tags], mesh.element)
            ends.append(np.column_stack([found.node, np.full(len(found.node), -1)]))
            weights.append(found.direction)
            continue
        pairs = common_nodes(entry, surface, scene.source_path or "scene")
        for component in entry.components:
            ends.append(pairs)
            weights.append(np.tile(np.eye(mesh.dim)[component], (len(pairs), 1)))
    return np.concatenate(ends), np.concatenate(weights)


class _Springs(NamedTuple):
    """Points X (R, d) of cells (R,) where conditions on surfaces resist the displacements along
    directions (R, d).
    """

    X: np.ndarray
    cells: np.ndarray
    directions: np.ndarray

    def of(self, chosen: np.ndarray) -> "_Springs":
        """Return those of some cells, numbered by their place among these."""
        rows = np.isin(self.cells, chosen)
        return _Springs(
            self.X[rows], np.searchsorted(chosen, self.cells[rows]), self.directions[rows]
        )


def _springs(scene, mesh, cells):
    """Return what conditions on surfaces hold, facet by facet at its centroid."""
    found = [_Springs(np.zeros((0, mesh.dim)), np.zeros(0, int), np.zeros((0, mesh.dim)))]
    for boundary in scene.boundary:
        for name, given in boundary.surface_conditions().items():
            ways = CONDITIONS[name](**given).holds
            for tag in boundary.on if ways else ():
                facets = mesh.facets[tag]
                behind = locate_facets(facets, cells, mesh.element)[0]
                held = _directions(mesh, facets[behind >= 0], ways)
                cell = behind[behind >= 0]
                found += [_Springs(held.X, cell, directions) for directions in held.directions]
    return _Springs(*(np.concatenate(parts) for parts in zip(*found, strict=True)))


class _Directions(NamedTuple):
    """Centroids X (F, d) of facets and directions there, k arrays (F, d)."""

    X: np.ndarray
    directions: list[np.ndarray]


def _directions(mesh, facets, ways):
    """Return the `_Directions` along which the facets (F, Af) are held: "normal", "tangential"."""
    facet = mesh.element.facet
    N, dN = (f(facet.cell.centroid) for f in (facet.shape, facet.gradient))
    x = mesh.points[facets]
    normal = facet_normal(dN, np.ones(1), x)[:, 0]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    across = np.eye(mesh.dim) - normal[:, :, None] * normal[:, None, :]
    found = [normal] if "normal" in ways else []
    found += [across[:, i] for i in range(mesh.dim)] if "tangential" in ways else []
    return _Directions((N @ x)[:, 0], found)


def _wet(scene, mesh, kinds, of_solid, part):
    """Return which cells of the solid, (E,) bool, belong to a part that a fluid holds: by the
    inertia of what flows through it, or in the same matrix by the viscosity of what is beside it.
    """
    monolithic = scene.coupling.scheme in ("quasi_direct", "direct")
    if scene.is_porous:
        holds, kind = scene.model.fluid_inertia is True, "porous"
    else:
        holds, kind = monolithic and scene.time.scheme != "steady", "fluid"
    if not holds:
        return np.zeros(len(part), dtype=bool)
    number = [i for i, name in enumerate(mesh.regions) if kinds[name] == kind]
    in_fluid = np.zeros(len(mesh.points), dtype=bool)
    in_fluid[mesh.cells[np.isin(mesh.cell_region, number)]] = True
    touching = in_fluid[mesh.cells[of_solid]].any(axis=1)
    return np.isin(part, part[touching])


def _joined(groups):
    """Return the number of the component, (E,), of rows (E, k) that share an entry that is not
    negative.
    """
    rows = len(groups)
    cell, column = np.nonzero(groups >= 0)
    size = rows + groups.max() + 1
    graph = csr_matrix(
        (np.ones(cell.size, dtype=bool), (cell, rows + groups[cell, column])), shape=(size, size)
    )
    return connected_components(graph, directed=False)[1][:rows]


def _free_motion(points, cells, body, held, springs, further):
    """Return a cell of the part and, in words, its free motion; None where the part is held.

    cells (E, A), body (E,), held (N, d) bool; springs : `_Springs` of these cells;
    further : of `_constraints`
    """
    nodes = np.unique(cells)
    centre = points[nodes].mean(axis=0)
    size = np.linalg.norm(points[nodes] - centre, axis=1).max()
    bodies, body = np.unique(body, return_inverse=True)
    pairs = np.unique(np.column_stack([cells.ravel(), np.repeat(body, cells.shape[1])]), axis=0)
    modes = _rigid_modes((points[pairs[:, 0]] - centre) / size)
    along = _rigid_modes((springs.X - centre) / size)
    pushed = np.einsum("rd,rdm->rm", springs.directions, along)
    equations = [
        _equations(pairs, modes, held, len(bodies)),
        _in_columns(pushed, body[springs.cells], len(bodies)),
        _linear_equations(pairs, modes, further, len(bodies)),
    ]
    free = _null_space(np.vstack(equations))
    if not free.shape[1]:
        return None
    motions = free.reshape(len(bodies), modes.shape[2], -1)
    loosest = np.argmax(np.linalg.norm(motions, axis=(1, 2)))
    return int(np.flatnonzero(body == loosest)[0]), _in_words(motions[loosest], centre, size)


def _rigid_modes(X):
    """Return the displacements, (n, d, 3 or 6), of points X (n, d) under unit translations, then
    unit rotations.
    """
    n, d = X.shape
    modes = np.zeros((n, d, d * (d + 1) // 2))
    modes[:, range(d), range(d)] = 1.0
    for number, (i, j) in enumerate(PLANES[d]):
        modes[:, i, d + number] = -X[:, j]
        modes[:, j, d + number] = X[:, i]
    return modes


def _equations(pairs, modes, held, n_bodies):
    """Return the equations for the motions of bodies, (rows, bodies * modes): held components, and
    common nodes.

    pairs (n, 2) : node and body, sorted; modes (n, d, m) : of `_rigid_modes` there
    """
    d, m = modes.shape[1:]
    chosen = held[pairs[:, 0]]
    supports = _in_columns(modes[chosen], np.repeat(pairs[:, 1], chosen.sum(axis=1)), n_bodies)
    hinge = np.flatnonzero(pairs[1:, 0] == pairs[:-1, 0])
    of_hinge = modes[hinge].reshape(-1, m)
    one, other = (
        _in_columns(of_hinge, np.repeat(pairs[rows, 1], d), n_bodies) for rows in (hinge, hinge + 1)
    )
    return np.vstack([supports, one - other])


def _linear_equations(pairs, modes, further, n_bodies):
    """Return the equations of constraints (nodes, weights) whose nodes belong to the bodies."""
    ends, weights = further
    node, first = np.unique(pairs[:, 0], return_index=True)
    at = np.minimum(np.searchsorted(node, ends), len(node) - 1)
    there = node[at] == ends
    inside = there[:, 0] & (there[:, 1] | (ends[:, 1] < 0))
    at, weights, alone = first[at[inside]], weights[inside], ends[inside, 1] < 0
    one, other = (
        _in_columns(
            np.einsum("nd,ndm->nm", weights, modes[at[:, end]]), pairs[at[:, end], 1], n_bodies
        )
        for end in (0, 1)
    )
    return one - np.where(alone[:, None], 0.0, other)


def _in_columns(rows, body, n_bodies):
    """Return rows (n, m) in the columns of their body (n,), (n, n_bodies * m)."""
    wide = np.zeros((len(rows), n_bodies, rows.shape[1]))
    wide[np.arange(len(rows)), body] = rows
    return wide.reshape(len(rows), n_bodies * rows.shape[1])


def _null_space(equations):
    """Return an orthonormal basis, (columns, k), of what satisfies all equations, whose rows are of
    the order of 1.

    The pivots of a QR decomposition do not depend on how many nodes hold the same motion, singular
    values do.
    """
    if not len(equations):
        return np.eye(equations.shape[1])
    basis, triangle, _ = qr(equations.T, pivoting=True)
    return basis[:, int((np.abs(np.diag(triangle)) > DEPENDENT).sum()) :]


def _in_words(motions, centre, size):
    """Return what a body can do, its motions spanned by (m, k): translations along axes if there
    are some, else a rotation.
    """
    d = len(centre)
    span, share, _ = np.linalg.svd(motions, full_matrices=False)
    span = span[:, share > DEPENDENT]
    free = [
        axis
        for axis, row in zip(AXES[:d], span, strict=False)
        if np.linalg.norm(row) > 1 - DEPENDENT
    ]
    if free:
        return "in " + " and ".join(filter(None, [", ".join(free[:-1]), free[-1]]))
    motion = _about_an_axis(span, d)
    t = motion[:d]
    omega = motion[d:]
    if np.linalg.norm(omega) < DEPENDENT:
        return f"along {place(t)}"
    if d == 2:
        return (
            f"against turning about {_point(centre / size + np.array([-t[1], t[0]]) / omega, size)}"
        )
    axis = omega / np.linalg.norm(omega)
    through = centre / size + np.cross(omega, t) / (omega @ omega)
    named = [name for name, share in zip(AXES, np.abs(axis), strict=True) if share > 1 - DEPENDENT]
    direction = f"an axis along {named[0] if named else place(axis)} through"
    return f"against turning about {direction} {_point(through, size)}"


def _point(X, size):
    """Return a point, X in sizes of the body, as text without round-off."""
    return place(np.round(X, 9) * size + 0.0)


def _about_an_axis(span, d):
    """Return a motion (t, ω) out of a span (m, k) that turns about one axis of the coordinates, if
    there is one.
    """
    for omega in np.eye(len(span) - d):
        factors = np.linalg.lstsq(span[d:], omega, rcond=DEPENDENT)[0]
        if np.allclose(span[d:] @ factors, omega, rtol=0, atol=DEPENDENT):
            return span @ factors
    return span[:, 0]
