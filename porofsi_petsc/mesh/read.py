"""Meshes from files: every format of meshio, regions and boundaries by physical name."""

import contextlib
import io
import os
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..elements import ELEMENTS
from ..errors import InputError, shown
from . import check, overlap
from .mesh import Mesh
from .topology import cell_facets, facet_groups, locate_facets

GMSH_NUMBERS = "gmsh:physical"
# Formats that have no named boundaries; meshio's readers of most of them do not end on broken
# files.
WITHOUT_GROUPS = (".dat", ".ele", ".node", ".obj", ".off", ".ply", ".stl", ".tec", ".wkt")
NASTRAN = (".bdf", ".fem", ".nas")
NOT_A_TAG = ("gmsh:geometrical", "gmsh:bounding_entities")


def read_mesh(path: str | os.PathLike[str], dim: int) -> Mesh:
    """Return the mesh of a file: cells of one kind in named regions, every boundary facet in one
    named group.

    The node numbers of the file are kept, clockwise cells are reoriented, curved mid-edge nodes
    stay where they are. Names come from Gmsh physical groups or cell sets; a format with only
    integer tags gives the names "1", "2", ... Raises InputError (one sentence) for everything the
    solver could not use.
    """
    path = Path(path)
    check.require_file(path)
    source = _read_quietly(path)
    check.require_arrays(source.points, [block.data for block in source.cells], dim, path)
    blocks = [block for block in source.cells if len(block.data)]
    element = check.volume_element([(block.type, block.dim) for block in blocks], dim, path)
    points = check.plane_points(source.points, dim, path)
    names, tags = _tags(source, path)
    cells, cell_tag = _gather(_of_element(source.cells, element), tags, (element.meshio_name,))
    facet_blocks = _of_element(source.cells, element.facet)
    tagged_facets = _gather(facet_blocks, tags, _facet_kinds(element))
    check.require_known_nodes(points, cells, path)
    check.require_known_nodes(points, tagged_facets[0], path, "facet")
    check.require_no_orphans(points, cells, path)
    check.require_regions_of_cells(points, cells, cell_tag, path)
    cells = check.oriented(points, cells, element, path)
    check.require_positive_jacobian(points, cells, element, path)
    used, cell_region = np.unique(cell_tag, return_inverse=True)
    group = facet_groups(cells, element)
    check.require_shared_nodes(points, cells, element, path)
    for require in (check.require_manifold, overlap.require_unfolded, overlap.require_disjoint):
        require(points, cells, element, group, path)
    facets = _facets(points, cells, element, group, tagged_facets, names, path)
    return Mesh(points, cells, element, tuple(names[i] for i in used), cell_region, facets)


class _Block(NamedTuple):
    """What is asked of one of meshio's blocks of cells."""

    type: str
    data: np.ndarray


def _of_element(blocks, element):
    """Return meshio's blocks of cells, those of kinds that the element has in collapsed form in
    that form.
    """
    return [
        _Block(element.meshio_name, block.data[:, element.collapsed[block.type]])
        if block.type in element.collapsed
        else block
        for block in blocks
    ]


def _facet_kinds(element):
    """Return meshio's names of the facets of all orders; of their nodes only the vertices are
    looked at.
    """
    facets = [other.facet for other in ELEMENTS.values()]
    return {facet.meshio_name for facet in facets if facet.cell == element.facet.cell}


def _read_quietly(path):
    """Return meshio's mesh; meshio prints and exits on a file it cannot read, and its readers raise
    nearly anything.
    """
    import meshio  # slow to import, and most scenes make their mesh themselves

    if path.suffix.lower() in WITHOUT_GROUPS:
        advice = "give a mesh of cells in named groups, such as Gmsh .msh 2.2 or 4.1"
        raise InputError(f"{path}: a {path.suffix} file has no named boundaries; {advice}")
    if (
        path.suffix.lower() in NASTRAN
        and b"ENDDATA" not in path.read_bytes().rpartition(b"BEGIN BULK")[2]
    ):
        # meshio would look for it for ever
        raise InputError(
            f"{path}: no ENDDATA follows on the BEGIN BULK of the Nastran file; write the mesh"
            " again"
        )
    try:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            # of .msh files meshio would try the reader of Ansys first, which has no boundaries and
            # no end on broken files
            return meshio.read(path, file_format="gmsh" if path.suffix == ".msh" else None)
    except (Exception, SystemExit) as error:
        if GMSH_NUMBERS in str(error):
            raise InputError(
                f"{path}: some elements have no physical group; save the mesh with Mesh.SaveAll = 0"
            ) from error
        reason = (
            ""
            if isinstance(error, SystemExit)
            else f" ({type(error).__name__}: {shown(str(error))})"
        )
        message = (
            f"{path}: not readable as a mesh{reason}; give a file that meshio reads, such as Gmsh"
            " .msh 2.2 or 4.1"
        )
        raise InputError(message) from error


def _tags(source, path):
    """Return the names and for each block of cells the index of each cell's name, -1 for none."""
    sets = {name: members for name, members in source.cell_sets.items() if name not in NOT_A_TAG}
    if sets:
        return _tags_from_sets(sets, source, path)
    return _tags_from_numbers(source, path)


def _tags_from_sets(sets, source, path):
    tags = _untagged(source.cells)
    names = list(sets)
    for index, members in enumerate(sets.values()):
        for block, tag, chosen in zip(source.cells, tags, members, strict=True):
            chosen = np.asarray([] if chosen is None else chosen, dtype=np.int64)
            doubled = chosen[tag[chosen] >= 0]
            if len(doubled):
                at = check.place(source.points[block.data[doubled[0]]].mean(axis=0))
                both = f"'{names[tag[doubled[0]]]}' and '{names[index]}'"
                raise InputError(
                    f"{path}: the {block.type} at {at} is in two groups, {both}; leave it in one"
                )
            tag[chosen] = index
    return names, tags


def _tags_from_numbers(source, path):
    key = _number_key(source, path)
    if key is None:
        return [], _untagged(source.cells)
    named = (
        {(int(dim), int(number)): name for name, (number, dim) in source.field_data.items()}
        if key == GMSH_NUMBERS
        else {}
    )
    names = []
    tags = _untagged(source.cells)
    for block, numbers, tag in zip(source.cells, source.cell_data[key], tags, strict=True):
        for number in np.unique(numbers).tolist():
            name = named.get((block.dim, number)) if key == GMSH_NUMBERS else str(number)
            if name is not None:
                if name not in names:
                    names.append(name)
                tag[numbers == number] = names.index(name)
    return names, tags


def _untagged(blocks):
    return [np.full(len(block.data), -1, dtype=np.int64) for block in blocks]


def _number_key(source, path):
    """Return the key of the integer array over the cells that holds the tags, None when there is
    none.
    """
    if GMSH_NUMBERS in source.cell_data:
        return GMSH_NUMBERS
    keys = [
        key
        for key, arrays in source.cell_data.items()
        if key not in NOT_A_TAG
        and all(np.issubdtype(np.asarray(a).dtype, np.integer) and np.ndim(a) == 1 for a in arrays)
    ]
    if len(keys) > 1:
        raise InputError(
            f"{path}: several integer arrays over the cells ({', '.join(keys)}); keep only the one"
            " with the tags"
        )
    return keys[0] if keys else None


def _gather(blocks, tags, kinds):
    """Return nodes, (n, A), and tag index, (n,), of all cells of the kinds; only their common first
    nodes.
    """
    chosen = [
        (block.data, tag)
        for block, tag in zip(blocks, tags, strict=True)
        if block.type in kinds and len(tag)
    ]
    if not chosen:
        return np.empty((0, 0), dtype=np.int64), np.empty(0, dtype=np.int64)
    width = min(data.shape[1] for data, _ in chosen)
    return np.concatenate([data[:, :width] for data, _ in chosen]).astype(np.int64), np.concatenate(
        [tag for _, tag in chosen]
    )


def _facets(points, cells, element, group, tagged_facets, names, path):
    """Return the tagged facets by name, each once, with the nodes and the outward orientation of
    its cell.
    """
    nodes, tag = (array[tagged_facets[1] >= 0] for array in tagged_facets)
    n_facets = len(element.facets)
    tagged = np.zeros((len(cells), n_facets), dtype=bool)
    facets = {}
    if len(tag):
        cell, local = locate_facets(nodes, cells, element)
        _require_located(points, nodes, tag, cell, names, path)
        unique = np.unique(np.stack([cell * n_facets + local, tag], axis=1), axis=0)
        (cell, local), tag = np.divmod(unique[:, 0], n_facets), unique[:, 1]
        nodes = cell_facets(cells, element)[cell, local]
        _require_one_tag(points, nodes, unique, names, path)
        tagged[cell, local] = True
        facets = {names[i]: nodes[tag == i] for i in np.unique(tag)}
    check.require_tagged_boundary(points, cells, element, group, tagged, path)
    return facets


def _require_located(points, nodes, tag, cell, names, path):
    lost = np.flatnonzero(cell < 0)
    if len(lost):
        at = check.place(points[nodes[lost[0]]].mean(axis=0))
        name = names[tag[lost[0]]]
        raise InputError(
            f"{path}: {len(lost)} facets of '{name}' belong to no cell, the first at {at}; remove"
            " them"
        )


def _require_one_tag(points, nodes, unique, names, path):
    doubled = np.flatnonzero(unique[1:, 0] == unique[:-1, 0])
    if len(doubled):
        both = " and ".join(f"'{names[i]}'" for i in unique[doubled[0] : doubled[0] + 2, 1])
        at = check.place(points[nodes[doubled[0]]].mean(axis=0))
        raise InputError(
            f"{path}: {len(doubled)} facets carry two tags, the first ({both}) at {at}; leave each"
            " in one group"
        )
