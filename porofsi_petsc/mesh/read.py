"""Meshes from files: cells in regions, and a name for every boundary facet."""

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..elements import ELEMENTS, Element
from ..errors import InputError, listed
from . import check, overlap
from .cut import cut_prisms, cut_quadratic
from .formats import read_source
from .generate import DEFAULT_REGION
from .groups import named_sets, one_each
from .mesh import Mesh
from .sides import named_sides, require_joined
from .source import numbered
from .tags import joined, part
from .topology import facet_groups, locate_facets, shares


@dataclass(frozen=True)
class Reading:
    """How a file is read.

    array : the array over the cells with the numbers of the groups, None where the file decides.
    groups : the names of the groups that count, all if empty; a cell or facet in several of them
    belongs to the first.  scale : metres in the unit of length of the file.  facets : a further
    file with tagged facets.  values : arrays over the cells that are taken along.
    """

    array: str | None = None
    groups: Sequence[str] = ()
    scale: float = 1.0
    facets: str | None = None
    values: Sequence[str] = ()


@dataclass
class _Body:
    """The cells of a mesh, and what is found out about it."""

    path: Path
    element: Element
    points: np.ndarray
    cells: np.ndarray
    notes: list[str] = field(default_factory=list)
    facet_group: np.ndarray = field(init=False)

    def require_usable(self) -> None:
        """Raise InputError for cells that cannot be solved on, and set `facet_group`."""
        self.cells = check.oriented(self.points, self.cells, self.element, self.path)
        cells = self.points, self.cells, self.element
        check.require_positive_jacobian(*cells, self.path)
        self.facet_group = facet_groups(self.cells, self.element)
        check.require_shared_nodes(*cells, self.path)
        for require in (
            check.require_manifold,
            overlap.require_unfolded,
            overlap.require_disjoint,
        ):
            require(*cells, self.facet_group, self.path)

    def facets(self, keys: np.ndarray) -> np.ndarray:
        """Return the nodes, (F, Af), of facets with the keys cell * (facets of a cell) + local."""
        cell, local = np.divmod(keys, len(self.element.facets))
        return self.cells[cell[:, None], np.array(self.element.facets)[local]]

    def corners(self, keys: np.ndarray) -> np.ndarray:
        """Return the vertices of facets, (F, V)."""
        return self.facets(keys)[:, : self.element.cell.facet_vertices]


def read_mesh(path: str | os.PathLike[str], dim: int, reading: Reading | None = None) -> Mesh:
    """Return the mesh of a file: cells in regions, every boundary facet in one named group.

    The nodes that belong to cells keep the order of the file, clockwise cells are reoriented,
    curved mid-edge nodes stay where they are. Names are those of groups and sets, `group_N` where
    there is only a number; cells without one are the region `body`, boundary facets without one
    are named by `sides.named_sides`. Sets of nodes name the boundary facets all of whose vertices
    they have. `Mesh.notes` says what the file has and the mesh does not. Raises InputError (one
    sentence) for everything the solver could not use.
    """
    path = Path(path)
    reading = reading or Reading()
    chosen = bool(reading.groups)
    source, notes = _source(path, dim, reading)
    blocks = [block for block in source.blocks if len(block.data)]
    element = check.volume_element([(block.type, block.dim) for block in blocks], dim, path)
    sets, node_sets = named_sets(source, reading.groups, path)
    cells, of_cells = _gather(source.blocks, sets, element, [element])
    tagged, of_tagged = _gather(source.blocks, sets, element.facet, _facets_of_all_orders(element))
    points, axes = check.plane_points(source.points, np.unique(cells), dim, path)
    if not axes.startswith("xy"):
        notes.append(f"{axes[0]} and {axes[1]} of the file are x and y here")
    body = _Body(path, element, points * reading.scale, cells, notes)
    if not chosen and any(name in of_cells for name in source.sections):
        of_cells = {name: of_cells[name] for name in source.sections if name in of_cells}
    names, cell_region = _regions(body, of_cells, chosen)
    number = _drop_orphans(body)
    body.require_usable()
    found = {name: _located(body, number[tagged[rows]], name) for name, rows in of_tagged.items()}
    if not chosen:
        _leave_out_zero(body, found)
    found = _facets_of_nodes(body, node_sets, number) | found
    first = {name: i for i, name in enumerate(reading.groups)}
    found = dict(sorted(found.items(), key=lambda entry: first.get(entry[0], 0)))
    facets = _named_facets(body, found, chosen)
    values = {name: _values(source, element, name, path) for name in reading.values}
    notes = tuple(body.notes)
    return Mesh(body.points, body.cells, element, names, cell_region, facets, notes, values)


def _source(path, dim, reading):
    """Return the content of a file with cells that elements have, and sentences on what was cut."""
    check.require_file(path)
    source = _content(path, dim)
    if reading.facets is not None:
        source.tags = [*source.tags, *_further(Path(reading.facets), dim)]
    source = joined(source, reading.array, dim, path)
    source, prisms = cut_prisms(source, path)
    source, quadratic = cut_quadratic(source, dim)
    return source, [note for note in (prisms, quadratic) if note]


def _further(path, dim):
    """Return the facets of a further file; raises InputError where none of them are in groups."""
    check.require_file(path, "mesh.facets")
    further = _content(path, dim)
    facets = [part(own, [dim - 1]) for own in (further, *further.tags)]
    if not any(own.sets or own.arrays for own in facets):
        raise InputError(
            f"{path}: mesh.facets, and no facets of it are in groups or have an array of integers;"
            " give a file with tagged facets, or leave the key out"
        )
    return facets


def _content(path, dim):
    """Return what a file says, arrays and numbers of nodes checked."""
    source = read_source(path)
    for own in (source, *source.tags):
        check.require_arrays(own.points, [block.data for block in own.blocks], dim, path)
        for what, of_dim in (("cell", dim), ("facet", dim - 1)):
            for block in own.blocks:
                if block.dim == of_dim:
                    check.require_known_nodes(own.points, block.data, path, what)
    return source


def _facets_of_all_orders(element):
    """Return the facets of the elements of all orders; only their vertices are looked at."""
    facets = [other.facet for other in ELEMENTS.values()]
    return [facet for facet in facets if facet.cell == element.facet.cell]


def _gather(blocks, sets, element, kinds):
    """Return the nodes, (n, A), of all cells of some elements in the form of the element, only
    their common first nodes, and name -> rows of the set.
    """
    forms = {kind.meshio_name: list(range(kind.nodes)) for kind in kinds} | element.collapsed
    chosen = [i for i, block in enumerate(blocks) if block.type in forms and len(block.data)]
    if not chosen:
        return np.empty((0, element.n_vertices), dtype=np.int64), {}
    data = [blocks[i].data[:, forms[blocks[i].type]] for i in chosen]
    width = min(part.shape[1] for part in data)
    first = np.cumsum([0, *map(len, data)])
    rows = {
        name: np.concatenate([first[k] + parts[i] for k, i in enumerate(chosen)])
        for name, parts in sets.items()
    }
    nodes = np.concatenate([part[:, :width] for part in data]).astype(np.int64)
    return nodes, {name: members for name, members in rows.items() if len(members)}


def _values(source, element, name, path):
    """Return the numbers of an array over the cells, (E,), in the order of `_gather`."""
    if name not in source.values:
        known = listed(sorted(source.values)) if source.values else "none that is read"
        raise InputError(
            f"{path}: a material asks for the array '{name}' over the cells, the file has {known};"
            " write the cells with one number each, as VTU or XDMF"
        )
    forms = {element.meshio_name, *element.collapsed}
    return np.concatenate(
        [
            part
            for block, part in zip(source.blocks, source.values[name], strict=True)
            if block.type in forms
        ]
    )


def _drop_orphans(body):
    """Drop the nodes of no cell; return the new number of every node, -1 for those."""
    used = np.zeros(len(body.points), dtype=bool)
    used[body.cells] = True
    number = np.where(used, np.cumsum(used) - 1, -1)
    orphans = np.flatnonzero(~used)
    if len(orphans):
        at = check.place(body.points[orphans[0]])
        body.notes.append(
            f"{len(orphans)} nodes of the file belong to no cell, the first at {at}; they are left"
            " out, the others keep their order"
        )
        body.points = body.points[used]
        body.cells = number[body.cells]
    return number


def _regions(body, sets, chosen):
    """Return the names of the regions that have cells and the index of each cell's region."""
    kept, left_out, overlapping = one_each(sets, len(body.cells), chosen, alike=True)
    if overlapping is not None:
        first, second, cell = overlapping
        at = check.place(body.points[body.cells[cell]].mean(axis=0))
        raise _in_two(body, f"the cell at {at}", first, second)
    _note_left_out(body, left_out, "cells")
    names = [DEFAULT_REGION, *(name for name in kept if name != DEFAULT_REGION)]
    index = np.zeros(len(body.cells), dtype=np.int64)
    for name, cells in kept.items():
        index[cells] = names.index(name)
    used, cell_region = np.unique(index, return_inverse=True)
    return tuple(names[i] for i in used), cell_region


def _in_two(body, what, first, second):
    return InputError(
        f"{body.path}: {what} is in two groups, '{first}' and '{second}'; leave it in one, or list"
        " the groups that count, the first of two before the other, in mesh.groups"
    )


def _note_left_out(body, names, what):
    if names:
        body.notes.append(
            f"groups of {what} left out, all of which are in other groups: {listed(names)}"
        )


def _located(body, rows, name):
    """Return the keys of the facets of a set, each once."""
    cell, local = locate_facets(rows, body.cells, body.element)
    lost = np.flatnonzero(cell < 0)
    if len(lost):
        nodes = rows[lost[0]]
        at = f", the first at {check.place(body.points[nodes].mean(axis=0))}"
        raise InputError(
            f"{body.path}: {len(lost)} facets of '{name}' belong to no cell"
            f"{at if (nodes >= 0).all() else ''}; remove them, or list the groups that count in"
            " mesh.groups"
        )
    return np.unique(cell * len(body.element.facets) + local)


def _leave_out_zero(body, found):
    """Leave out the facets of number 0 if some are inside the body, where it says no group."""
    zero = found.get(numbered(0))
    if zero is not None and not np.isin(zero, _boundary(body)).all():
        del found[numbered(0)]
        body.notes.append(f"{len(zero)} facets of number 0, inside the body too, are in no group")


def _facets_of_nodes(body, node_sets, number):
    """Return name -> keys of the boundary facets all of whose vertices are in a set of nodes."""
    keys = _boundary(body)
    corners = body.corners(keys)
    found = {}
    for name, nodes in node_sets.items():
        inside = np.zeros(len(body.points) + 1, dtype=bool)
        inside[number[nodes]] = True
        inside[-1] = False
        chosen = keys[inside[corners].all(axis=1)]
        if len(chosen) and not inside[:-1].all():
            found[name] = chosen
    return found


def _boundary(body):
    cell, local = np.nonzero(shares(body.facet_group) == 1)
    return cell * len(body.element.facets) + local


def _named_facets(body, sets, chosen):
    """Return the facets by name with the nodes and the outward orientation of their cell, those of
    the boundary without a name by that of their side.
    """
    boundary = _boundary(body)
    keys = np.unique(np.concatenate([boundary, *sets.values()]))
    places = {name: np.searchsorted(keys, own) for name, own in sets.items()}
    kept, left_out, overlapping = one_each(places, len(keys), chosen, alike=False)
    if overlapping is not None:
        first, second, facet = overlapping
        at = check.place(body.points[body.corners(keys[[facet]])[0]].mean(axis=0))
        raise _in_two(body, f"the facet at {at}", first, second)
    _note_left_out(body, left_out, "facets")
    named = np.zeros(len(keys), dtype=bool)
    for own in kept.values():
        named[own] = True
    bare = ~named[np.searchsorted(keys, boundary)]
    require_joined(body.points, body.corners(boundary), bare, body.path)
    place_of = tuple(np.divmod(boundary[bare], len(body.element.facets)))
    rest = named_sides(body.points, body.cells, body.element, place_of, set(kept))
    if rest:
        body.notes.append(
            f"{bare.sum()} boundary facets have no name in the file, by their place they are"
            f" {listed(rest)}"
        )
    facets = {name: body.facets(keys[own]) for name, own in sorted(kept.items())}
    return facets | {name: body.facets(boundary[bare][own]) for name, own in rest.items()}
