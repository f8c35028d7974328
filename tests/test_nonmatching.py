"""Sides of an interface with nodes of their own: interpolation, conservation, and a flap in a mesh of its own."""

from functools import cache

import numpy as np
import pytest
from mpi4py import MPI
from running import SCENES, Job, history, largest_difference, run_here

from porofsi_petsc.config.geometry import Axis, Region
from porofsi_petsc.elements import ELEMENTS
from porofsi_petsc.elements.simplex import FACET
from porofsi_petsc.errors import InputError
from porofsi_petsc.fem.boundary import SurfaceLoad
from porofsi_petsc.fem.closest import closest_points
from porofsi_petsc.fem.distribute import distribute
from porofsi_petsc.fem.transfer import InterfaceTransfer, Pair
from porofsi_petsc.mesh.generate import box, rectangle
from porofsi_petsc.mesh.interface import INTERFACE, with_interface
from porofsi_petsc.mesh.mesh import Mesh
from porofsi_petsc.mesh.write import write_mesh

FLAP = str(SCENES / "flap.toml")
WEAK = "coupling.scheme=weak", "material.0.fluid.density=1.0"
ROUND_OFF = 1e-13  # some sums of products of numbers of size 1


def axis(*points, cells):
    """Return an axis of equal cells in every segment."""
    return Axis.model_validate({"points": list(points), "cells": cells})


def joined(*meshes):
    """Return meshes of one element as one, without common nodes; equal names are one region or tag."""
    first = np.cumsum([0, *(len(mesh.points) for mesh in meshes)])
    regions = tuple(dict.fromkeys(name for mesh in meshes for name in mesh.regions))
    facets = {}
    for mesh, shift in zip(meshes, first, strict=False):
        for tag, nodes in mesh.facets.items():
            facets[tag] = np.vstack([*([facets[tag]] if tag in facets else []), nodes + shift])
    number = [np.array([regions.index(name) for name in mesh.regions])[mesh.cell_region] for mesh in meshes]
    cells = np.vstack([mesh.cells + shift for mesh, shift in zip(meshes, first, strict=False)])
    points = np.vstack([mesh.points for mesh in meshes])
    return Mesh(points, cells, meshes[0].element, regions, np.concatenate(number), facets)


def renamed(mesh, region, **tags):
    """Return a mesh of one region with some tags renamed and all others called "outer"."""
    facets = {}
    for tag, nodes in mesh.facets.items():
        name = tags.get(tag, "outer")
        facets[name] = np.vstack([*([facets[name]] if name in facets else []), nodes])
    return Mesh(mesh.points, mesh.cells, mesh.element, (region,), 0 * mesh.cell_region, facets)


def blocks(dim, order, fluid, solid):
    """Return a block of fluid on one of solid, with a number of cells along their interface y = 0 or z = 0."""
    lower, upper = axis(-1.0, 0.0, cells=[1]), axis(0.0, 1.0, cells=[1])
    if dim == 2:
        sides = [rectangle(axis(0.0, 1.0, cells=[n]), y, order, "right", (), ()) for n, y in ((fluid, upper), (solid, lower))]
    else:
        # cells of different proportions: no diagonals in common
        x, y = axis(0.0, 1.0, cells=[fluid]), axis(0.0, 2.0, cells=[fluid])
        other = axis(0.0, 1.0, cells=[solid]), axis(0.0, 2.0, cells=[solid + 1])
        sides = [box(x, y, upper, order, (), ()), box(*other, lower, order, (), ())]
    return joined(renamed(sides[0], "fluid", bottom="wet_fluid"), renamed(sides[1], "solid", top="wet_solid"))


def transfer_of(mesh, comm=MPI.COMM_SELF):
    """Return the local mesh on one rank and the transfer between the tags wet_fluid and wet_solid."""
    local = distribute(comm, mesh, np.zeros(len(mesh.points), dtype=int))
    pair = Pair(("wet_fluid",), ("wet_solid",), "scene.toml [interface.0]")
    return local, InterfaceTransfer(local, np.zeros(local.n_local, dtype=bool), [pair])


@cache
def transfer_of_blocks(dim, order, fluid, solid):
    """Return `transfer_of` for `blocks`."""
    return transfer_of(blocks(dim, order, fluid, solid))


CASES = [(dim, order, *cells) for dim in (2, 3) for order in (1, 2) for cells in ((3, 3), (6, 3), (3, 6), (5, 3), (3, 5))]


@pytest.mark.parametrize("dim, order, fluid, solid", CASES)
def test_polynomials_of_the_order_of_the_elements_cross_exactly(dim, order, fluid, solid):
    """Constants (row sums 1), linear and, on quadratic elements, quadratic displacements; the solid's own rows stay."""
    mesh, transfer = transfer_of_blocks(dim, order, fluid, solid)
    x, y = mesh.X[:, 0], mesh.X[:, dim - 2]
    exact = np.column_stack([1 + 0 * x, 3 + 2 * x - y] + [x**2 - x * y + 0.5 * y**2] * (order - 1))
    given = exact.copy()
    given[transfer.fluid_nodes] = 7.0
    crossed = transfer.to_fluid(given)
    assert transfer.fluid_nodes.sum() == transfer.fluid_nodes[mesh.X[:, -1] == 0].sum() > fluid
    assert np.abs(crossed - exact).max() < ROUND_OFF * 10
    assert np.array_equal(crossed[~transfer.fluid_nodes], exact[~transfer.fluid_nodes])


@pytest.mark.parametrize("dim, order, fluid, solid", CASES)
def test_forces_moments_and_work_are_kept(dim, order, fluid, solid):
    """For any force on the fluid's side and any displacement of the solid; nothing remains on the fluid's side."""
    mesh, transfer = transfer_of_blocks(dim, order, fluid, solid)
    random = np.random.default_rng(0)
    u, force = random.normal(size=(2, mesh.n_local, dim))
    force[~transfer.fluid_nodes] = 0.0
    moved = transfer.to_solid(force)
    assert not moved[~transfer.solid_nodes].any() and moved.any()
    scale = np.abs(force).sum()
    assert np.abs(moved.sum(axis=0) - force.sum(axis=0)).max() < ROUND_OFF * scale
    moments = [np.einsum("ai,aj->ij", mesh.X, f) - np.einsum("aj,ai->ij", mesh.X, f) for f in (moved, force)]
    assert np.abs(moments[0] - moments[1]).max() < ROUND_OFF * scale
    assert abs(np.vdot(moved, u) - np.vdot(force, transfer.to_fluid(u))) < ROUND_OFF * scale


@pytest.mark.parametrize("dim, order, fluid, solid", CASES)
def test_a_constant_traction_stays_one(dim, order, fluid, solid):
    """The fluid's ∮ N_a t dA becomes the solid's, however much finer that is: exactly where the quadrature is exact.

    In the plane where facets are parts of each other; else kinks of the solid's shape functions lie between its points.
    """
    mesh, transfer = transfer_of_blocks(dim, order, fluid, solid)
    loads = {}
    for side in ("fluid", "solid"):
        loads[side] = np.zeros((mesh.n_owned, 1))
        SurfaceLoad(mesh, f"wet_{side}", {0: lambda t, x: np.ones(len(x))}).add_to(loads[side], 0.0)
    spread, expected = transfer.to_solid(loads["fluid"]), loads["solid"]
    error = np.abs(spread - expected).max() / expected.max()
    print(f"{dim}-D, order {order}, {fluid}:{solid}: largest error of a nodal force {error:.1e}")
    nested = dim == 2 and max(fluid, solid) % min(fluid, solid) == 0
    assert error < (ROUND_OFF if nested else 0.05)


@pytest.mark.parametrize("order", (1, 2))
def test_curved_sides_meet_up_to_their_sagitta(order):
    """Points of a circle, and chords or parabolas through others of its points: distances O(h²) and O(h⁴)."""
    found = []
    for n in (8, 16, 32):
        angle = np.linspace(0, np.pi / 2, order * n + 1)
        nodes = np.column_stack([np.cos(angle), np.sin(angle)])
        first = order * np.arange(n)
        facets = np.stack([first, first + order, first + 1][: order + 1], axis=1)
        points = np.column_stack([np.cos(t := np.linspace(0.1, 1.5, 37)), np.sin(t)])
        facet, N, distance = closest_points(ELEMENTS[{1: "T3", 2: "T6"}[order]], nodes[facets], points)
        reached = np.einsum("pa,pai->pi", N, nodes[facets[facet]])
        assert np.allclose(np.linalg.norm(points - reached, axis=1), distance, rtol=1e-9, atol=1e-15)
        found.append(distance.max())
    rates = np.log2(np.array(found[:-1]) / found[1:])
    print(f"order {order}: distances {found}, rates {rates}")
    assert rates.min() > 2 * order - 0.3  # the points lie anywhere on the facets


def test_the_closest_point_is_the_minimum_over_all_points():
    """Of a surface of curved triangles, against the smallest distance to a fine sample of it."""
    mesh = box(axis(0.0, 1.0, cells=[2]), axis(0.0, 1.0, cells=[2]), axis(0.0, 1.0, cells=[1]), 2, (), ())
    X = mesh.points[mesh.facets["top"]].copy()
    X[..., 2] += 0.2 * np.sin(3 * X[..., 0]) * np.cos(2 * X[..., 1])
    random = np.random.default_rng(1)
    points = random.uniform(-0.2, 1.2, size=(40, 3)) * [1, 1, 0.2] + [0, 0, 1.0]
    _, _, distance = closest_points(mesh.element, X, points)
    i, j = np.meshgrid(np.arange(81), np.arange(81))
    facet = FACET[mesh.element.name]
    xi = np.column_stack([i.ravel(), j.ravel()])[(i + j).ravel() <= 80] / 80
    sample = (facet.shape(xi) @ X).reshape(-1, 3)
    nearest = np.array([np.linalg.norm(sample - point, axis=1).min() for point in points])
    assert (distance <= nearest + 1e-12).all()
    # a point of the sample is within h = 1/160 of the closest one, along the surface
    assert (nearest**2 - distance**2 < (1 / 80) ** 2 * (1 + distance / 0.1)).all()


def test_sides_that_are_apart_are_refused():
    mesh = blocks(2, 1, 4, 3)
    mesh.points[mesh.facets["wet_fluid"].ravel(), 1] += 0.05
    with pytest.raises(InputError, match=r"\[interface\.0\]: a node of 'wet_fluid' at .* is 0\.05 m away from 'wet_solid'") as e:
        transfer_of(mesh)
    print(e.value)
    assert "\n" not in str(e.value)


@pytest.mark.parametrize("short, other", [("fluid", "solid"), ("solid", "fluid")])
def test_a_side_without_the_other_is_refused(short, other):
    """On a part of the interface one side is missing: nodes without a facet, or a surface that nothing wets."""
    mesh = blocks(2, 1, 4, 4)
    mesh.facets[f"wet_{short}"] = mesh.facets[f"wet_{short}"][:-1]
    with pytest.raises(InputError, match=f"a node of 'wet_{other}' at .* is 0.25 m away from 'wet_{short}'.*; let both surfaces"):
        transfer_of(mesh)


# -- the flap --------------------------------------------------------------------------------------------------------------


def flap_mesh(fluid, solid, order=1):
    """Return the mesh of the flap with nodes of its own, each side refined by a factor; the wall under both is "bottom"."""

    def part(factor, region, wet):
        x = axis(0.0, 0.4, 0.5, 1.2, cells=[4 * factor, 2 * factor, 6 * factor])
        y = axis(0.0, 0.2, 0.4, cells=[4 * factor, 4 * factor])
        flap = Region(name="flap", x=(0.4, 0.5), y=(0.0, 0.2))
        whole = with_interface(rectangle(x, y, order, "alternating", (), (flap,)), {"body"}, ())
        return region_of(whole, region, wet)

    return joined(part(fluid, "body", "wet_fluid"), part(solid, "flap", "wet_solid"))


def region_of(mesh, region, wet):
    """Return one region of a mesh, its facets with the others under a tag."""
    cells = mesh.cells[mesh.cell_region == mesh.regions.index(region)]
    nodes, number = np.unique(cells, return_inverse=True)
    facets = {wet if tag == INTERFACE else tag: f for tag, f in mesh.facets.items()}
    own = {tag: f[np.isin(f, nodes).all(axis=1)] for tag, f in facets.items()}
    own = {tag: np.searchsorted(nodes, f) for tag, f in own.items() if len(f)}
    return Mesh(mesh.points[nodes], number.reshape(cells.shape), mesh.element, (region,), np.zeros(len(cells), int), own)


def given(path, mesh):
    """Write a mesh and return the changes that make the scene of the flap read it."""
    write_mesh(path, mesh)
    return f"mesh={{kind='file', path='{path}', dim=2}}", "interface=[{fluid='wet_fluid', solid='wet_solid'}]"


def run(directory, *options):
    """Run the flap and return its summary and its history."""
    summary = run_here(Job(FLAP, str(directory), options, force=True))
    return summary, history(directory)


COLUMNS = ("tip.u_x", "tip.u_y", "flap.f_x", "flap.f_y")


def difference(a, b, columns=COLUMNS):
    """Return column -> largest difference over its largest magnitude."""
    return {name: largest_difference(a[name], b[name]) for name in columns}


@pytest.mark.parametrize("order, options", [(1, ()), (2, ()), (1, ("coupling.scheme=one_way",)), (1, WEAK)])
def test_equal_nodes_given_twice_are_the_shared_ones(order, options, tmp_path):
    """P is the identity then: to the tolerance of the coupling, 1e-10, times a condition of some hundreds."""
    changes = *options, f"mesh.order={order}", "time.end=0.05", "coupling.tolerance=1e-10"
    shared = run(tmp_path / "shared", *changes)[1]
    double = run(tmp_path / "double", *given(tmp_path / "flap.msh", flap_mesh(1, 1, order)), *options, *changes[-2:])[1]
    found = difference(double, shared)
    print(found)
    assert max(found.values()) < 1e-7 and np.abs(shared["tip.u_x"]).max() > 1e-4
