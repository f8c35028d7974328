"""Edges and facets of cells: nodes between vertices, the boundary, and the cell behind a facet.

A collapsed cell has a vertex twice or more: a triangle is a quadrilateral of which one side is a
point, `Element.collapsed`.  What is left of such a facet, no line in the plane and no surface in
space, is none.
"""

from itertools import groupby

import numpy as np

from ..elements import Element


def group_rows(rows: np.ndarray) -> np.ndarray:
    """Return the group number of every row, (R,), rows with the same set of integers sharing one.

    rows : (R, k).  The groups are numbered in lexicographic order of their sorted rows, what is in
    a row twice being there once.
    """
    keys = np.sort(rows, axis=1)
    twice = keys[:, 1:] == keys[:, :-1]
    if twice.any():
        keys[:, 1:][twice] = -1
        keys.sort(axis=1)
    order = np.lexsort(keys.T[::-1])
    keys = keys[order]
    new = np.any(keys[1:] != keys[:-1], axis=1)
    group = np.empty(len(rows), dtype=np.int64)
    group[order] = np.concatenate([[0], np.cumsum(new)])[: len(rows)]
    return group


def add_midside_nodes(
    points: np.ndarray, cells: np.ndarray, element: Element
) -> tuple[np.ndarray, np.ndarray]:
    """Return the points and cells of an element made from those of order 1, the nodes between
    vertices numbered after them.

    points : (N, d) -> (N + M, d).  cells : (E, vertices) -> (E, nodes).
    """
    vertices = cells
    for _, alike in groupby(element.supports, len):
        supports = np.array(list(alike))
        around = vertices[:, supports].reshape(-1, supports.shape[1])
        group = group_rows(around)
        first = np.unique(group, return_index=True)[1]
        cells = np.hstack([cells, len(points) + group.reshape(len(cells), -1)])
        points = np.vstack([points, points[around[first]].mean(axis=1)])
    return points, cells


def cell_facets(cells: np.ndarray, element: Element) -> np.ndarray:
    """Return the nodes of every facet of every cell (E, A), (E, number of facets, Af), outward
    orientation.
    """
    return cells[:, np.array(element.facets)]


def is_collapsed(cells: np.ndarray, element: Element) -> np.ndarray:
    """Return which cells (E, A) have a vertex twice, (E,) bool."""
    vertices = np.sort(cells[:, : element.n_vertices], axis=1)
    return (vertices[:, 1:] == vertices[:, :-1]).any(axis=1)


def times_in_cell(cells: np.ndarray) -> np.ndarray:
    """Return how often a cell has each of its nodes, (E, A), of cells (E, A)."""
    times = np.zeros(cells.shape, dtype=np.int64)
    for column in cells.T:
        times += cells == column[:, None]
    return times


def facet_groups(cells: np.ndarray, element: Element) -> np.ndarray:
    """Return the number of every facet of every cell (E, A), (E, number of facets), shared ones
    with one number, -1 for what is none of a collapsed cell.
    """
    vertices = cells[:, element.facet_corners]
    rows = vertices.reshape(-1, vertices.shape[2])
    return np.where(_are_facets(rows, element), group_rows(rows), -1).reshape(vertices.shape[:2])


def _are_facets(rows, element):
    """Return which rows of vertices (R, V) have as many different ones as a facet needs, (R,)."""
    ordered = np.sort(rows, axis=1)
    return (ordered[:, 1:] != ordered[:, :-1]).sum(axis=1) + 1 >= element.dim


def shares(group: np.ndarray) -> np.ndarray:
    """Return how often each number of `facet_groups` is there, (E, number of facets), 0 for -1."""
    return np.where(group < 0, 0, np.bincount(group.ravel() + 1)[group + 1])


def facet_multiplicity(cells: np.ndarray, element: Element) -> np.ndarray:
    """Return by how many cells each facet of cells (E, A) is shared, (E, number of facets), 0 for
    what is none of a collapsed cell.
    """
    return shares(facet_groups(cells, element))


def boundary_facets(cells: np.ndarray, element: Element) -> tuple[np.ndarray, np.ndarray]:
    """Return cell and local number, (F,) each, of the facets that belong to one of the cells (E, A)
    only.
    """
    cell, local = np.nonzero(facet_multiplicity(cells, element) == 1)
    return cell, local


def locate_facets(
    facets: np.ndarray, cells: np.ndarray, element: Element
) -> tuple[np.ndarray, np.ndarray]:
    """Return cell and local number, (F,) each, of the given facets; the lower cell of an interior
    one, -1 where there is none.

    facets : (F, >= vertices) node numbers, the vertices first and in any order.  cells : (E, A).
    """
    queries = facets[:, : element.cell.facet_vertices]
    vertices = cells[:, element.facet_corners]
    wanted = np.zeros(cells.max(initial=queries.max(initial=-1)) + 1, dtype=bool)
    wanted[queries] = True
    cell, local = np.nonzero(wanted[vertices].all(axis=2))
    group = group_rows(np.vstack([vertices[cell, local], queries]))
    group_first = np.unique(group, return_index=True)[1]
    first = group_first[group[len(cell) :]]
    found = (first < len(cell)) & _are_facets(queries, element)
    answer = np.full((2, len(queries)), -1, dtype=np.int64)
    answer[:, found] = cell[first[found]], local[first[found]]
    return answer[0], answer[1]
