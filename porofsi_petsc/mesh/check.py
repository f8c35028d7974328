"""Checks of a mesh that came from outside; each raises InputError with one sentence."""

import os
from collections.abc import Collection, Iterable, Sequence
from itertools import groupby
from pathlib import Path

import numpy as np

from ..elements import ELEMENTS, Element
from ..errors import InputError, listed
from .mesh import Mesh
from .topology import facet_multiplicity, group_rows, locate_facets, shares, times_in_cell

# det of the edge vectors over (longest edge)^d, at most this for a degenerate element: far under
# any graded mesh, over round-off
DEGENERATE = 1e-12
PLANE = 1e-9  # of the size of a plane mesh, by which its nodes may lie beside the plane
JACOBIAN_CHUNK = 20000
Where = str | Path  # what is named in a message: a file or a section


def place(coordinates: np.ndarray) -> str:
    """Return coordinates (d,) as text, (x, y[, z])."""
    return "(" + ", ".join(f"{x:.6g}" for x in coordinates) + ")"


def require_tags(mesh: Mesh, names: Iterable[str], where: Where) -> None:
    """Raise InputError unless every name is a facet tag of the mesh."""
    _require_names(names, mesh.facets, where, "boundary tag")


def require_regions(mesh: Mesh, names: Iterable[str], where: Where) -> None:
    """Raise InputError unless every name is a region of the mesh."""
    _require_names(names, mesh.regions, where, "region")


def _require_names(names, available, where, kind):
    for name in names:
        if name not in available:
            raise InputError(
                f"{where}: the mesh has no {kind} '{name}'; choose from {listed(sorted(available))}"
            )


def require_file(path: Path, key: str = "mesh.path") -> None:
    """Raise InputError unless the path, of a key in the scene, is a file with content that may be
    read.
    """
    if not path.exists():
        raise InputError(f"{path}: no such mesh file; check {key} in the scene")
    if not path.is_file():
        kind = "a directory" if path.is_dir() else "a device or pipe"
        raise InputError(f"{path}: received {kind}, expected a mesh file; check {key} in the scene")
    if path.stat().st_size == 0:
        raise InputError(f"{path}: the mesh file is empty (0 bytes); write the mesh again")
    if not os.access(path, os.R_OK):
        raise InputError(f"{path}: there is no permission to read the mesh file; change its mode")


def require_arrays(points: np.ndarray, cells: Sequence[np.ndarray], dim: int, where: Where) -> None:
    """Raise InputError unless points are (N, >= dim) and the cells of every block (E, A), as a file
    that is whole gives them.
    """
    whole = (
        np.ndim(points) == 2
        and np.shape(points)[1] >= dim
        and all(np.ndim(block) == 2 for block in cells)
    )
    if not whole:
        raise InputError(
            f"{where}: the mesh file gives no {dim} coordinates for every node; write the mesh"
            " again"
        )


def volume_element(blocks: Sequence[tuple[str, int]], dim: int, where: Where) -> Element:
    """Return the element of the cells of the highest dimension, which must be dim; blocks: pairs
    (meshio name, dimension).
    """
    if not blocks:
        raise InputError(
            f"{where}: the mesh file has no cells; write the mesh again with its elements"
        )
    highest = max(block_dim for _, block_dim in blocks)
    kinds = sorted({kind for kind, block_dim in blocks if block_dim == highest})
    if highest != dim:
        raise InputError(
            f"{where}: the scene is {dim}-D but the mesh {highest}-D ({', '.join(kinds)}); give one"
            f" of {dim}-D"
        )
    supported = {
        element.meshio_name: element for element in ELEMENTS.values() if element.dim == dim
    }
    collapsed = [kind for element in supported.values() for kind in element.collapsed]
    known = list(dict.fromkeys([*supported, *collapsed]))
    unsupported = [kind for kind in kinds if kind not in known]
    if unsupported:
        *others, last = known
        choices = f"{', '.join(others)} or {last}"
        raise InputError(
            f"{where}: unsupported cells of kind {', '.join(unsupported)}; mesh the domain with"
            f" {choices}"
        )
    holds_all = [e for e in supported.values() if {*kinds} <= {e.meshio_name, *e.collapsed}]
    if not holds_all:
        raise InputError(
            f"{where}: mixed cells of kinds {', '.join(kinds)}; mesh the whole domain with"
            " cells of one order"
        )
    return supported[kinds[0]] if kinds[0] in supported and len(kinds) == 1 else holds_all[0]


def plane_points(
    points: np.ndarray, used: np.ndarray, dim: int, where: Where
) -> tuple[np.ndarray, str]:
    """Return points (N, >= dim) without the constant coordinate of a plane mesh, (N, dim), and the
    names of those that are left; of a solid mesh as they are.

    used : numbers of the nodes of cells, among which the coordinate is constant.
    """
    finite = np.isfinite(points).all(axis=1)
    if not finite.all():
        first = np.flatnonzero(~finite)[0]
        raise InputError(
            f"{where}: node {first} (counted from 0) has the coordinates {place(points[first])};"
            " write finite ones"
        )
    kept = list(range(points.shape[1]))
    if dim < len(kept):
        spans = np.ptp(points[used], axis=0)
        round_off = PLANE * spans.max() + 8 * np.finfo(float).eps * np.abs(points[used]).max()
        flat = np.flatnonzero(spans <= round_off)
        if not len(flat):
            x, y, z = (f"{span:.3g}" for span in spans)
            raise InputError(
                f"{where}: the nodes of the 2-D mesh span {x} x {y} x {z} m, expected a plane in"
                " which x, y or z is constant; turn the mesh into one"
            )
        kept.remove(flat[-1])
    # a copy: one that says little-endian, as VTU files do, is no number to MPI
    return points[:, kept].astype(float, order="C"), "".join("xyz"[i] for i in kept)


def oriented(points: np.ndarray, cells: np.ndarray, element: Element, where: Where) -> np.ndarray:
    """Return the cells (E, A) mirrored, first and second reference coordinate swapped, where the
    determinant of the edges is negative.
    """
    edges = _legs(points[cells], element)
    det = np.linalg.det(edges)
    size = np.sqrt((edges**2).sum(axis=2).max(axis=1)) ** element.dim
    degenerate = np.flatnonzero(np.abs(det) <= DEGENERATE * size)
    if len(degenerate):
        e = degenerate[0]
        corners = ", ".join(place(x) for x in points[cells[e, : element.n_vertices]])
        raise InputError(
            f"{where}: cell {e} (counted from 0) is degenerate, its vertices are {corners}; repair"
            " the mesh"
        )
    return np.where(det[:, None] < 0, cells[:, element.mirror], cells)


def _legs(X, element):
    """Return dx/dxi_m, (E, d, d), at the centroids of straight elements (E, A, d): the edges at
    vertex 0 of a simplex, means of parallel edges of others.
    """
    return element.cell.vertex_gradient.T @ X[:, : element.n_vertices]


def require_positive_jacobian(
    points: np.ndarray, cells: np.ndarray, element: Element, where: Where
) -> None:
    """Raise InputError where det dx/dxi <= 0 at a node or quadrature point of an element that is
    not affine; points (N, d) [m], cells (E, A).
    """
    if element.is_affine:
        return
    xi = np.vstack([element.node_coordinates, element.cell.quadrature(2 * element.order)[0]])
    gradient = element.gradient(xi)
    for start in range(0, len(cells), JACOBIAN_CHUNK):
        X = points[cells[start : start + JACOBIAN_CHUNK]]
        det = np.linalg.det(np.einsum("eai,qaj->eqij", X, gradient, optimize=True))
        folded = det <= 0
        # where a side is a point it is zero
        once = times_in_cell(cells[start : start + JACOBIAN_CHUNK]) == 1
        folded[:, : element.nodes] &= once
        bad = np.argwhere(folded)
        if len(bad):
            e, q = bad[0]
            at = place(element.shape(xi[q : q + 1])[0] @ X[e])
            curved = "curved " if element.order > 1 else ""
            advice = (
                "refine the mesh there or straighten the curved edge"
                if curved
                else "its angles must be less than 180 degrees"
            )
            raise InputError(
                f"{where}: the {curved}cell {start + e} (counted from 0) is folded, its Jacobian is"
                f" {det[e, q]:.3g} at {at}; {advice}"
            )


def require_known_nodes(
    points: np.ndarray, cells: np.ndarray, where: Where, what: str = "cell"
) -> None:
    """Raise InputError when a cell (E, A), or what else has a row of nodes, has one that the file
    does not list; points (N, d).
    """
    unknown = np.flatnonzero(((cells < 0) | (cells >= len(points))).any(axis=1))
    if len(unknown):
        raise InputError(
            f"{where}: {what} {unknown[0]} (counted from 0) has a node missing in the file; write"
            " the mesh again"
        )


def require_no_orphans(points: np.ndarray, cells: np.ndarray, where: Where) -> None:
    """Raise InputError when a node of points (N, d) [m] belongs to no cell (E, A)."""
    used = np.zeros(len(points), dtype=bool)
    used[cells] = True
    orphans = np.flatnonzero(~used)
    if len(orphans):
        first = f"node {orphans[0]} (counted from 0) at {place(points[orphans[0]])}"
        raise InputError(
            f"{where}: {len(orphans)} nodes belong to no cell, the first is {first}; remove them"
        )


def require_regions_of_cells(
    points: np.ndarray, cells: np.ndarray, cell_region: np.ndarray, where: Where
) -> None:
    """Raise InputError when a cell (E, A) has no region, cell_region (E,) being -1."""
    bare = np.flatnonzero(cell_region < 0)
    if len(bare):
        at = place(points[cells[bare[0]]].mean(axis=0))
        raise InputError(
            f"{where}: {len(bare)} of {len(cells)} cells have no named physical group, the first is"
            f" cell {bare[0]} (counted from 0) at {at}; put every cell into a named physical group"
        )


def require_shared_nodes(
    points: np.ndarray, cells: np.ndarray, element: Element, where: Where
) -> None:
    """Raise InputError where cells share an edge or a face, but not the node in its middle: the
    body would be split there.
    """
    numbered = enumerate(element.supports, element.n_vertices)
    for _, alike in groupby(numbered, lambda entry: len(entry[1])):
        numbers, supports = (list(column) for column in zip(*alike, strict=True))
        group = group_rows(cells[:, np.array(supports)].reshape(-1, len(supports[0])))
        middle = cells[:, numbers].ravel()
        one = np.empty(group.max(initial=0) + 1, dtype=middle.dtype)
        one[group] = middle
        other = np.flatnonzero(one[group] != middle)
        if len(other):
            raise InputError(
                f"{where}: cells share an edge or a face without its middle node, at"
                f" {place(points[middle[other[0]]])} m, expected one node there; merge duplicate"
                " nodes in the program that wrote the mesh"
            )


def require_manifold(
    points: np.ndarray, cells: np.ndarray, element: Element, group: np.ndarray, where: Where
) -> None:
    """Raise InputError for a facet of three cells.

    points : (N, d) [m].  cells : (E, A).  group : number of each facet, (E, facets of a cell).
    """
    what = "facets are shared by more than two cells, the first at {}; remove the doubled cells"
    _require_none(shares(group) > 2, what, points, cells, element, where)


def require_tagged_boundary(
    points: np.ndarray,
    cells: np.ndarray,
    element: Element,
    group: np.ndarray,
    tagged: np.ndarray,
    where: Where,
) -> None:
    """Raise InputError for a boundary facet without a tag.

    points : (N, d) [m].  cells : (E, A).  group, tagged (bool) : (E, facets of a cell).
    """
    what = (
        "boundary facets have no tag, the first at {}; put every boundary facet into a named"
        " physical group"
    )
    untagged = (shares(group) == 1) & ~tagged
    _require_none(untagged, what, points, cells, element, where)


def _require_none(wrong, what, points, cells, element, where):
    cell, local = np.nonzero(wrong)
    if len(cell):
        corners = cells[cell[0], element.facet_corners[local[0]]]
        raise InputError(f"{where}: {len(cell)} {what.format(place(points[corners].mean(axis=0)))}")


def boundary_tags(mesh: Mesh) -> list[str]:
    """Return the tags that lie on the boundary of the mesh, at least with one facet."""
    multiplicity = facet_multiplicity(mesh.cells, mesh.element)
    places = {
        tag: locate_facets(nodes, mesh.cells, mesh.element) for tag, nodes in mesh.facets.items()
    }
    return [
        tag for tag, cell_and_local in places.items() if (multiplicity[cell_and_local] == 1).any()
    ]


def require_every_tag(tags: Iterable[str], used: Collection[str], where: Where) -> None:
    """Raise InputError when a boundary tag of the mesh has no [[boundary]] entry."""
    for tag in tags:
        if tag not in used:
            advice = (
                f"add an entry with on = '{tag}' (with nothing else it is free of traction; a"
                " porous medium is impermeable there, a free fluid flows through)"
            )
            raise InputError(
                f"{where} [[boundary]]: the boundary '{tag}' of the mesh has no entry; {advice}"
            )
