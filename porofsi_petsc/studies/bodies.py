"""Bodies of the coupling study in 2-D and 3-D: their mesh, and how they are held, drained and
loaded by a formula of t [Pa].
"""

import atexit
from collections.abc import Sequence
from functools import cache
from itertools import pairwise, permutations, product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from ..elements import FAMILIES
from ..mesh.mesh import Mesh
from ..mesh.topology import add_midside_nodes, boundary_facets, cell_facets
from ..mesh.write import write_mesh
from . import soil
from .soil import Tables

AXES = "xyz"
RADIUS = 5.0  # of the round body [m]
STRIP, WIDTH = 2.5, 20.0  # half width of the strip load, width of the block beside it [m]


def confined(
    cells: int, order: int, dim: int, load: str, regions: Sequence[dict[str, Any]] = ()
) -> tuple[Tables, list[Tables]]:
    """Return the mesh and the boundaries of a block between rollers, one half of its drained top
    loaded.
    """
    return soil.mesh(cells, order, dim, regions), soil.boundary(load, dim)


def free_sides(
    cells: int, order: int, dim: int, load: str, regions: Sequence[dict[str, Any]] = ()
) -> tuple[Tables, list[Tables]]:
    """Return those of a part of a block between planes of symmetry whose other sides are free and
    impermeable.
    """
    held, free = (["left", "front"], ["right", "back"]) if dim == 3 else (["left"], ["right"])
    rollers = zip([*held, "bottom"], AXES[:dim], strict=True)
    walls = [
        {"on": side, "displacement": {axis: 0.0}, "velocity": {axis: 0.0}} for side, axis in rollers
    ]
    return soil.mesh(cells, order, dim, regions), [
        *walls,
        {"on": free},
        *soil.boundary(load, dim)[dim:],
    ]


def strip(
    cells: int, order: int, dim: int, load: str, regions: Sequence[dict[str, Any]] = ()
) -> tuple[Tables, list[Tables]]:
    """Return those of a wide block under an impermeable strip load."""
    mesh = soil.mesh(cells, order, dim, regions)
    under = max(cells // 4, 1)
    mesh["x"] = {
        "points": [0.0, STRIP, WIDTH],
        "cells": [under, cells - under],
        "ratios": [1.0, 4.0],
    }
    mesh["patches"][0]["x"] = [0.0, STRIP]
    footing = {"on": "load", "traction": {AXES[dim - 1]: f"-({load})"}}
    return mesh, [*soil.walls(dim), {"on": "top", "pressure": 0.0}, footing]


def sphere(
    cells: int, order: int, dim: int, load: str, regions: Sequence[dict[str, Any]] = ()
) -> tuple[Tables, list[Tables]]:
    """Return those of Cryer's sphere (in 2-D a cylinder): a part between planes of symmetry, its
    drained surface pressed.
    """
    planes = [
        {"on": f"{axis}0", "displacement": {axis: 0.0}, "velocity": {axis: 0.0}}
        for axis in AXES[:dim]
    ]
    traction = {axis: f"-({load})*{axis}/{RADIUS!r}" for axis in AXES[:dim]}
    mesh = {"kind": "file", "path": str(_sector_file(cells, order, dim)), "dim": dim}
    return mesh, [*planes, {"on": "surface", "pressure": 0.0, "traction": traction}]


BODIES = {"confined": confined, "free sides": free_sides, "sphere": sphere, "strip": strip}


@cache
def _folder():
    folder = TemporaryDirectory(prefix="porofsi_bodies_")
    atexit.register(folder.cleanup)
    return Path(folder.name)


@cache
def _sector_file(cells, order, dim):
    """Return the path of the mesh of a `sector`, which is there until the process ends."""
    path = _folder() / f"sector_{cells}_{order}_{dim}.msh"
    write_mesh(path, sector(cells, order, dim))
    return path


def sector(cells: int, order: int, dim: int, radius: float = RADIUS) -> Mesh:
    """Return the mesh of the quarter of a disc or the eighth of a ball around the origin, of as
    many layers of elements.

    Kuhn's subdivision of 0 <= ξ_d <= ... <= ξ_1 <= 1, taken to the corner Σ x_i <= 1, x_i >= 0,
    whose far side the factor R Σ x_i/|x| makes round, mid-edge nodes included.  Boundaries: the
    planes x0, y0, z0, and the surface.
    """
    corner, elements = _kuhn(cells, dim)
    family = FAMILIES[dim]["triangle" if dim == 2 else "tetrahedron"]
    linear, element = family[0], family[order - 1]
    cell, local = boundary_facets(elements, linear)
    vertices = corner[cell_facets(elements, linear)[cell, local]]
    tags = {f"{axis}0": (vertices[..., i] == 0).all(axis=1) for i, axis in enumerate(AXES[:dim])}
    tags["surface"] = np.isclose(vertices.sum(axis=-1), 1).all(axis=1)
    corner, elements = add_midside_nodes(corner, elements, element)
    nodes = cell_facets(elements, element)[cell, local]
    length = np.linalg.norm(corner, axis=1, keepdims=True)
    points = (
        radius
        * corner
        * np.divide(
            corner.sum(axis=1, keepdims=True), length, out=np.ones_like(length), where=length > 0
        )
    )
    facets = {tag: nodes[chosen] for tag, chosen in tags.items()}
    return Mesh(
        points, elements, element, ("body",), np.zeros(len(elements), dtype=np.int64), facets
    )


def _kuhn(cells, dim):
    """Return the points of the corner Σ x_i <= 1, (N, dim), and its positively oriented simplices,
    (E, dim + 1).
    """
    grid = [c for c in product(range(cells + 1), repeat=dim) if all(a >= b for a, b in pairwise(c))]
    number = {c: i for i, c in enumerate(grid)}
    unit = np.eye(dim, dtype=int)
    simplices = []
    for start, path in product(grid, permutations(range(dim))):
        walk = np.array(start) + np.vstack(
            [np.zeros(dim, dtype=int), np.cumsum(unit[list(path)], axis=0)]
        )
        vertices = [number.get(tuple(point)) for point in walk.tolist()]
        if None not in vertices:
            simplices.append(vertices)
    points = -np.diff(np.pad(grid, ((0, 0), (0, 1))), axis=1) / cells
    simplices = np.array(simplices)
    turned = np.linalg.det(points[simplices[:, 1:]] - points[simplices[:, :1]]) < 0
    simplices[turned, :2] = simplices[turned, 1::-1]
    return points, simplices
