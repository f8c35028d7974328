"""Meshes of quadrilaterals made of blocks, lattices of points at the ends and middles of cells."""

import numpy as np

from porofsi_petsc.mesh.mesh import Mesh

TOLERANCE = 1e-9  # of coordinates, below which two nodes are one [m]


def middles(ends):
    """Return increasing numbers with the middles between them."""
    ends = np.asarray(ends, dtype=float)
    return np.insert(ends, np.arange(1, len(ends)), (ends[1:] + ends[:-1]) / 2)


def ruled(first, last, t):
    """Return the block of straight lines from points (J, 2) to points (J, 2), (I, J, 2); t (I,)."""
    t = np.asarray(t)[:, None, None]
    return (1 - t) * first + t * last


def joined(blocks, element):
    """Return the mesh of the blocks of each region, name -> [(I, J, 2)], without tags; nodes at one
    place are one.
    """
    grids = [(name, grid) for name, own in blocks.items() for grid in own]
    numbers = np.cumsum([0, *(grid[..., 0].size for _, grid in grids)])
    cells = [
        first + _cells(grid.shape[:2], element)
        for (_, grid), first in zip(grids, numbers[:-1], strict=True)
    ]
    regions = tuple(blocks)
    region = np.repeat([regions.index(name) for name, _ in grids], [len(c) for c in cells])
    points = np.vstack([grid.reshape(-1, 2) for _, grid in grids])
    _, first, number = np.unique(
        (points / TOLERANCE).round(), axis=0, return_index=True, return_inverse=True
    )
    whole = _oriented(points[first], number.ravel()[np.vstack(cells)], element)
    return Mesh(points[first], whole, element, regions, region, {})


def _cells(shape, element):
    """Return the nodes of the cells of a grid of so many points, ends and middles, (E, A)."""
    number = np.arange(shape[0] * shape[1]).reshape(shape)
    steps = np.rint(2 * element.node_coordinates).astype(int)
    return np.stack(
        [number[i : shape[0] - 2 + i : 2, j : shape[1] - 2 + j : 2].ravel() for i, j in steps],
        axis=1,
    )


def _oriented(points, cells, element):
    """Return the cells, those turned over mirrored."""
    X = points[cells[:, : element.n_vertices]]
    turned = np.linalg.det(element.cell.vertex_gradient.T @ X) < 0
    return np.where(turned[:, None], cells[:, element.mirror], cells)
