"""Sides of an interface with nodes of their own: interpolation, conservation, and a flap in a mesh
of its own.
"""

from functools import cache

import numpy as np
import pytest
from grids import grid
from mpi4py import MPI
from running import SCENES, Job, history, largest_difference, needs_mpirun, run_here, run_on, state
from surfaces import flux, residual

from porofsi_petsc import load_scene
from porofsi_petsc.config.geometry import Axis, Region
from porofsi_petsc.elements import ELEMENTS
from porofsi_petsc.errors import InputError
from porofsi_petsc.fem.closest import closest_points
from porofsi_petsc.fem.distribute import distribute
from porofsi_petsc.fem.domain import Domain
from porofsi_petsc.fem.geometry import Rule
from porofsi_petsc.fem.projection import SurfaceProjection
from porofsi_petsc.fem.transfer import InterfaceTransfer, Pair
from porofsi_petsc.kernels.surface import facet_normal
from porofsi_petsc.linalg.options import start
from porofsi_petsc.mesh.generate import box, rectangle
from porofsi_petsc.mesh.interface import INTERFACE, with_interface
from porofsi_petsc.mesh.mesh import Mesh
from porofsi_petsc.mesh.write import write_mesh
from porofsi_petsc.simulation import check
from porofsi_petsc.simulation.simulation import Simulation

FLAP = str(SCENES / "flap.toml")
WEAK = "coupling.scheme=weak", "material.0.fluid.density=1.0"
ROUND_OFF = 1e-13  # some sums of products of numbers of size 1


def axis(*points, cells):
    """Return an axis of equal cells in every segment."""
    return Axis.model_validate({"points": list(points), "cells": cells})


def joined(*meshes):
    """Return meshes of one element as one, without common nodes; equal names are one region or
    tag.
    """
    first = np.cumsum([0, *(len(mesh.points) for mesh in meshes)])
    regions = tuple(dict.fromkeys(name for mesh in meshes for name in mesh.regions))
    facets = {}
    for mesh, shift in zip(meshes, first, strict=False):
        for tag, nodes in mesh.facets.items():
            facets[tag] = np.vstack([*([facets[tag]] if tag in facets else []), nodes + shift])
    number = [
        np.array([regions.index(name) for name in mesh.regions])[mesh.cell_region]
        for mesh in meshes
    ]
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
    """Return a block of fluid on one of solid, with a number of cells along their interface y = 0
    or z = 0.
    """
    lower = axis(-1.0, 0.0, cells=[1])
    upper = axis(0.0, 1.0, cells=[1])
    if dim == 2:
        sides = [
            rectangle(axis(0.0, 1.0, cells=[n]), y, order, "right", (), ())
            for n, y in ((fluid, upper), (solid, lower))
        ]
    else:
        # cells of different proportions: no diagonals in common
        x = axis(0.0, 1.0, cells=[fluid])
        y = axis(0.0, 2.0, cells=[fluid])
        other = axis(0.0, 1.0, cells=[solid]), axis(0.0, 2.0, cells=[solid + 1])
        sides = [box(x, y, upper, order, (), ()), box(*other, lower, order, (), ())]
    return joined(
        renamed(sides[0], "fluid", bottom="wet_fluid"), renamed(sides[1], "solid", top="wet_solid")
    )


def transfer_of(mesh, comm=MPI.COMM_SELF):
    """Return the local mesh on one rank and the transfer between the tags wet_fluid and
    wet_solid.
    """
    local = distribute(comm, mesh, np.zeros(len(mesh.points), dtype=int))
    pair = Pair(("wet_fluid",), ("wet_solid",), "scene.toml [interface.0]")
    return local, InterfaceTransfer(local, np.zeros(local.n_local, dtype=bool), [pair])


@cache
def transfer_of_blocks(dim, order, fluid, solid):
    """Return `transfer_of` for `blocks`."""
    return transfer_of(blocks(dim, order, fluid, solid))


CASES = [
    (dim, order, *cells)
    for dim in (2, 3)
    for order in (1, 2)
    for cells in ((3, 3), (6, 3), (3, 6), (5, 3), (3, 5))
]


@pytest.mark.parametrize("dim, order, fluid, solid", CASES)
def test_polynomials_of_the_order_of_the_elements_cross_exactly(dim, order, fluid, solid):
    """Constants (row sums 1), linear and, on quadratic elements, quadratic displacements; the
    solid's own rows stay.
    """
    mesh, transfer = transfer_of_blocks(dim, order, fluid, solid)
    x = mesh.X[:, 0]
    y = mesh.X[:, dim - 2]
    exact = np.column_stack([1 + 0 * x, 3 + 2 * x - y] + [x**2 - x * y + 0.5 * y**2] * (order - 1))
    given = exact.copy()
    given[transfer.fluid_nodes] = 7.0
    crossed = transfer.to_fluid(given)
    assert transfer.fluid_nodes.sum() == transfer.fluid_nodes[mesh.X[:, -1] == 0].sum() > fluid
    assert np.abs(crossed - exact).max() < ROUND_OFF * 10
    assert np.array_equal(crossed[~transfer.fluid_nodes], exact[~transfer.fluid_nodes])


@pytest.mark.parametrize("dim, order, fluid, solid", CASES)
def test_forces_moments_and_work_are_kept(dim, order, fluid, solid):
    """For any force on the fluid's side and any displacement of the solid; nothing remains on the
    fluid's side.
    """
    mesh, transfer = transfer_of_blocks(dim, order, fluid, solid)
    random = np.random.default_rng(0)
    u, force = random.normal(size=(2, mesh.n_local, dim))
    force[~transfer.fluid_nodes] = 0.0
    moved = transfer.to_solid(force)
    assert not moved[~transfer.solid_nodes].any() and moved.any()
    scale = np.abs(force).sum()
    assert np.abs(moved.sum(axis=0) - force.sum(axis=0)).max() < ROUND_OFF * scale
    moments = [
        np.einsum("ai,aj->ij", mesh.X, f) - np.einsum("aj,ai->ij", mesh.X, f)
        for f in (moved, force)
    ]
    assert np.abs(moments[0] - moments[1]).max() < ROUND_OFF * scale
    assert abs(np.vdot(moved, u) - np.vdot(force, transfer.to_fluid(u))) < ROUND_OFF * scale


@pytest.mark.parametrize("dim, order, fluid, solid", CASES)
def test_a_constant_traction_stays_one(dim, order, fluid, solid):
    """The fluid's ∮ N_a t dA becomes the solid's, however much finer that is: exactly where the
    quadrature is exact.

    In the plane where facets are parts of each other; else kinks of the solid's shape functions lie
    between its points.
    """
    mesh, transfer = transfer_of_blocks(dim, order, fluid, solid)
    loads = {}
    domain = Domain(mesh)
    for side in ("fluid", "solid"):
        one = flux(domain, f"wet_{side}", lambda t, x: np.ones(len(x)))
        loads[side] = residual(domain, 1, one, 0.0)
    spread = transfer.to_solid(loads["fluid"])
    expected = loads["solid"]
    error = np.abs(spread - expected).max() / expected.max()
    print(f"{dim}-D, order {order}, {fluid}:{solid}: largest error of a nodal force {error:.1e}")
    nested = dim == 2 and max(fluid, solid) % min(fluid, solid) == 0
    assert error < (ROUND_OFF if nested else 0.02)


def pressure_load(mesh, tag):
    """Return ∮ N_a n dA, (n_owned, d) [m^(d-1)], on one rank; n by the orientation of the
    facets.
    """
    nodes = mesh.facets[tag].nodes
    load = np.zeros((mesh.n_owned, mesh.dim))
    found = pressure_of(mesh.element, nodes, mesh.X[nodes])
    load[: len(found)] = found
    return load


@pytest.mark.parametrize("order", (1, 2))
@pytest.mark.parametrize("fluid, solid", [(1, 2), (2, 1), (1, 3)])
def test_a_pressure_goes_around_corners(fluid, solid, order):
    """Its traction jumps there; on each face of the flap it stays what it is, in facets that are
    parts of each other.
    """
    mesh, transfer = transfer_of(flap_mesh(fluid, solid, order))
    # both sides are oriented as the fluid's
    spread = transfer.to_solid(pressure_load(mesh, "wet_fluid"))
    expected = pressure_load(mesh, "wet_solid")
    assert (
        np.abs(spread - expected).max() < ROUND_OFF * np.abs(expected).max()
        and np.abs(expected).min(axis=1).any()
    )


@pytest.mark.parametrize("order", (1, 2))
def test_curved_sides_meet_up_to_their_sagitta(order):
    """Points of a circle, and chords or parabolas through others of its points: distances O(h²) and
    O(h⁴).
    """
    found = []
    for n in (8, 16, 32):
        angle = np.linspace(0, np.pi / 2, order * n + 1)
        nodes = np.column_stack([np.cos(angle), np.sin(angle)])
        first = order * np.arange(n)
        facets = np.stack([first, first + order, first + 1][: order + 1], axis=1)
        points = np.column_stack([np.cos(t := np.linspace(0.1, 1.5, 37)), np.sin(t)])
        facet, N, distance = closest_points(
            ELEMENTS[{1: "T3", 2: "T6"}[order]], nodes[facets], points
        )
        reached = np.einsum("pa,pai->pi", N, nodes[facets[facet]])
        assert np.allclose(
            np.linalg.norm(points - reached, axis=1), distance, rtol=1e-9, atol=1e-15
        )
        found.append(distance.max())
    rates = np.log2(np.array(found[:-1]) / found[1:])
    print(f"order {order}: distances {found}, rates {rates}")
    assert rates.min() > 2 * order - 0.3  # the points lie anywhere on the facets


def ring_of_facets(n, order, shift):
    """Return n facets of the unit circle, (n, Af), from a shift in facets, and their
    coordinates.
    """
    nodes = order * np.arange(n)[:, None] + np.array([0, order, 1][: order + 1])
    angle = 2 * np.pi * (nodes + order * shift) / (order * n)
    return nodes % (order * n), np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def pressure_of(element, facets, X):
    """Return ∮ N_a n dA, (n, d), of facets (F, Af) with coordinates X (F, Af, d)."""
    rule = Rule.of(element.facet, 2 * element.order)
    load = np.zeros((facets.max() + 1, element.dim))
    np.add.at(load, facets, rule.N.T @ facet_normal(rule.dN, rule.weights, X))
    return load


@pytest.mark.parametrize("order", (1, 2))
@pytest.mark.parametrize("ratio", (0.5, 1, 2))
def test_a_circle_of_other_facets_is_the_same_one(order, ratio):
    """A rotation crosses to the order of the facets or better, a pressure to the quadrature; the
    force to round-off.
    """
    element = ELEMENTS[{1: "T3", 2: "T6"}[order]]
    errors = []
    for n in (16, 32, 64):
        sides = ring_of_facets(int(ratio * n), order, 0.0), ring_of_facets(n, order, 0.37)
        facets, X = zip(*sides, strict=True)
        projection = SurfaceProjection(element, facets, X)
        nodes = []
        for nodes_of_facets, coordinates in sides:
            nodes.append(np.empty((nodes_of_facets.max() + 1, 2)))
            nodes[-1][nodes_of_facets] = coordinates
        turned = [np.column_stack([-x[:, 1], x[:, 0]]) for x in nodes]
        loads = [pressure_of(element, *side) for side in sides]
        spread = projection.transposed(loads[0])
        pressure = np.abs(spread - loads[1]).max() / np.abs(loads[1]).max()
        assert np.abs(spread.sum(axis=0)).max() < ROUND_OFF
        errors.append(np.abs(projection.project(turned[1]) - turned[0]).max())
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    print(
        f"order {order}, {ratio} facets to one: errors of a rotation {errors}, rates {rates}, of a"
        f" pressure {pressure:.1e}"
    )
    assert (
        pressure < 0.02
    )  # kinks of the solid's shape functions between the points of the quadrature
    assert rates.min() > order + 1 - 0.3  # a sagitta, which is O(h²), on linear facets


def test_the_closest_point_is_the_minimum_over_all_points():
    """Of a surface of curved triangles, against the smallest distance to a fine sample of it."""
    mesh = box(
        axis(0.0, 1.0, cells=[2]), axis(0.0, 1.0, cells=[2]), axis(0.0, 1.0, cells=[1]), 2, (), ()
    )
    X = mesh.points[mesh.facets["top"]].copy()
    X[..., 2] += 0.2 * np.sin(3 * X[..., 0]) * np.cos(2 * X[..., 1])
    random = np.random.default_rng(1)
    points = random.uniform(-0.2, 1.2, size=(40, 3)) * [1, 1, 0.2] + [0, 0, 1.0]
    _, _, distance = closest_points(mesh.element, X, points)
    i, j = np.meshgrid(np.arange(81), np.arange(81))
    facet = mesh.element.facet
    xi = np.column_stack([i.ravel(), j.ravel()])[(i + j).ravel() <= 80] / 80
    sample = (facet.shape(xi) @ X).reshape(-1, 3)
    nearest = np.array([np.linalg.norm(sample - point, axis=1).min() for point in points])
    assert (distance <= nearest + 1e-12).all()
    # a point of the sample is within h = 1/160 of the closest one, along the surface
    assert (nearest**2 - distance**2 < (1 / 80) ** 2 * (1 + distance / 0.1)).all()


def test_sides_that_are_apart_are_refused():
    mesh = blocks(2, 1, 4, 3)
    mesh.points[mesh.facets["wet_fluid"].ravel(), 1] += 0.05
    with pytest.raises(
        InputError,
        match=r"\[interface\.0\]: a node of 'wet_fluid' at .* is 0\.05 m away from 'wet_solid'",
    ) as e:
        transfer_of(mesh)
    print(e.value)
    assert "\n" not in str(e.value)


@pytest.mark.parametrize("short, other", [("fluid", "solid"), ("solid", "fluid")])
def test_a_side_without_the_other_is_refused(short, other):
    """On a part of the interface one side is missing: nodes without a facet, or a surface that
    nothing wets.
    """
    mesh = blocks(2, 1, 4, 4)
    mesh.facets[f"wet_{short}"] = mesh.facets[f"wet_{short}"][:-1]
    with pytest.raises(
        InputError,
        match=(
            f"a node of 'wet_{other}' at .* is 0.25 m away from 'wet_{short}'.*; let both surfaces"
        ),
    ):
        transfer_of(mesh)


# -- the flap --------------------------------------------------------------------------------------


def shared_mesh(factor, order=1):
    """Return the mesh of the flap, refined by a factor."""
    x = axis(0.0, 0.4, 0.5, 1.2, cells=[4 * factor, 2 * factor, 6 * factor])
    y = axis(0.0, 0.2, 0.4, cells=[4 * factor, 4 * factor])
    flap = Region(name="flap", x=(0.4, 0.5), y=(0.0, 0.2))
    return with_interface(rectangle(x, y, order, "alternating", (), (flap,)), {"body"}, ())


def flap_mesh(fluid, solid, order=1):
    """Return the mesh of the flap with nodes of its own, each side refined by a factor; the wall
    under both is "bottom".
    """
    body = region_of(shared_mesh(fluid, order), "body", "wet_fluid")
    return joined(body, region_of(shared_mesh(solid, order), "flap", "wet_solid"))


def region_of(mesh, region, wet):
    """Return one region of a mesh, its facets with the others under a tag."""
    cells = mesh.cells[mesh.cell_region == mesh.regions.index(region)]
    nodes, number = np.unique(cells, return_inverse=True)
    facets = {wet if tag == INTERFACE else tag: f for tag, f in mesh.facets.items()}
    own = {tag: f[np.isin(f, nodes).all(axis=1)] for tag, f in facets.items()}
    own = {tag: np.searchsorted(nodes, f) for tag, f in own.items() if len(f)}
    return Mesh(
        mesh.points[nodes],
        number.reshape(cells.shape),
        mesh.element,
        (region,),
        np.zeros(len(cells), int),
        own,
    )


def given(path, mesh):
    """Write a mesh and return the changes that make the scene of the flap read it."""
    write_mesh(path, mesh)
    return (
        f"mesh={{kind='file', path='{path}', dim=2}}",
        "interface=[{fluid='wet_fluid', solid='wet_solid'}]",
    )


def run(directory, *options):
    """Run the flap and return its summary and its history."""
    summary = run_here(Job(FLAP, str(directory), options, force=True))
    return summary, history(directory)


COLUMNS = ("tip.u_x", "tip.u_y", "flap.f_x", "flap.f_y")


def difference(a, b, columns=COLUMNS):
    """Return column -> largest difference over its largest magnitude."""
    return {name: largest_difference(a[name], b[name]) for name in columns}


@pytest.mark.parametrize(
    "order, options", [(1, ()), (2, ()), (1, ("coupling.scheme=one_way",)), (1, WEAK)]
)
def test_equal_nodes_given_twice_are_the_shared_ones(order, options, tmp_path):
    """P is the identity then: to the tolerance of the coupling, 1e-10, times a condition of some
    hundreds.
    """
    changes = *options, f"mesh.order={order}", "time.end=0.05", "coupling.tolerance=1e-10"
    shared = run(tmp_path / "shared", *changes)[1]
    double = run(
        tmp_path / "double",
        *given(tmp_path / "flap.msh", flap_mesh(1, 1, order)),
        *options,
        *changes[-2:],
    )[1]
    found = difference(double, shared)
    print(found)
    assert max(found.values()) < 1e-7 and np.abs(shared["tip.u_x"]).max() > 1e-4


STEPS = ("time.end=0.05", "coupling.tolerance=1e-8")


@pytest.fixture(scope="module")
def finest(tmp_path_factory):
    """Return the history of the flap on a mesh with common nodes, finer than all others."""
    cells = "mesh.x.cells=[24, 12, 36]", "mesh.y.cells=[24, 24]"
    return run(tmp_path_factory.mktemp("finest"), *cells, *STEPS)[1]


@pytest.mark.parametrize("fluid, solid", [(1, 1), (2, 1), (1, 2)])
def test_both_sides_refined_tend_to_the_common_solution(fluid, solid, finest, tmp_path):
    """Half the element sizes: at most 0.6 of the difference to a fine mesh with common nodes.

    The pressure is singular at the corners of the flap, which leaves the first order; that mesh has
    0.6 % of it left.
    """
    errors = []
    for level in (1, 2):
        mesh = flap_mesh(level * fluid, level * solid)
        summary, rows = run(tmp_path / "run", *given(tmp_path / "flap.msh", mesh), *STEPS)
        errors.append({name: abs(rows[name][-1] / finest[name][-1] - 1) for name in COLUMNS[:3]})
        found = ", ".join(f"{name} {error:.3f}" for name, error in errors[-1].items())
        print(
            f"{level * fluid}:{level * solid}: errors {found},"
            f" {summary['coupling_iterations']['mean']} sweeps"
        )
        # what one side does the other gets: nothing is lost over the interface but by the tolerance
        # of the sweeps
        assert summary["energy"]["balance_error_relative"] < 1e-7
    coarse, fine = (error["tip.u_x"] for error in errors)
    assert fine < 0.6 * coarse and fine < 0.1


def column(fluid, solid):
    """Return a 3-D column of fluid on one of solid, between slip walls, with cells across on each
    side.
    """
    walls = {side: "walls" for side in ("left", "right", "front", "back")}
    across = {n: axis(0.0, 1.0, cells=[n]) for n in (fluid, solid)}
    upper = box(across[fluid], across[fluid], axis(0.0, 1.0, cells=[2]), 1, (), ())
    lower = box(across[solid], across[solid], axis(-1.0, 0.0, cells=[2]), 1, (), ())
    sides = (
        renamed(upper, "body", bottom="wet_fluid", top="lid", **walls),
        renamed(lower, "flap", top="wet_solid", bottom="base", **walls),
    )
    return joined(*sides)


@pytest.mark.parametrize("fluid, solid", [(4, 2), (2, 4)])
def test_a_column_in_space_moves_as_one(fluid, solid, tmp_path):
    """Without inertia a load on the fluid strains the solid evenly, whatever the facets: as with
    equal nodes, up to 1e-10.
    """
    walls = "{on='walls', velocity={x=0, y=0}, displacement={x=0, y=0}}"
    boundary = (
        f"boundary=[{walls}, {{on='lid', traction={{z='-500*t'}}}}, {{on='base',"
        " displacement={x=0, y=0, z=0}}]"
    )
    probe = (
        "probe=[{name='A', at=[0.5, 0.5, 0], quantities=['u_z', 'p']}, {name='B', at=[0.1, 0.2, 0],"
        " quantities=['u_z']}]"
    )
    direct = " ".join(
        f"-{block}_ksp_type preonly -{block}_pc_type lu" for block in ("fluid", "solid", "mesh")
    )
    still = "model.solid_inertia=false", "model.fluid_inertia=false", "limits.inertia=report"
    changes = (
        boundary,
        probe,
        *still,
        "time.end=0.03",
        "coupling.tolerance=1e-10",
        f"petsc.options={direct}",
    )
    rows = {}
    for mesh in ((2, 2), (fluid, solid)):
        read, tags = given(tmp_path / "column.msh", column(*mesh))
        rows[mesh] = run(tmp_path / "run", read.replace("dim=2", "dim=3"), tags, *changes)[1]
    found = difference(rows[fluid, solid], rows[2, 2], ("A.u_z", "B.u_z", "flap.f_z"))
    print(f"{fluid}:{solid}: {found}, u_z {rows[2, 2]['A.u_z'][-1]:.3e} m")
    assert max(found.values()) < 1e-7 and rows[2, 2]["A.u_z"][-1] < -1e-6


@pytest.mark.parametrize("order", (1, 2))
def test_the_initial_state_crosses_too(order, tmp_path):
    """A sheared flap, with a velocity: the fluid's side of the interface starts there, its mesh
    follows.
    """
    start()
    initial = "initial={displacement={x='0.1*y', y=0}, solid_velocity={x='2*y'}}"
    scene = load_scene(FLAP, (*given(tmp_path / "flap.msh", flap_mesh(3, 2, order)), initial))
    medium = Simulation(scene, MPI.COMM_SELF).coupling
    mesh = medium.solid.mesh
    here = medium.fluid.setup.no_slip
    assert (
        here.sum() == order * 3 * 10 + 1
    )  # 4 + 2 + 4 facets of the flap, cut in three, of some nodes each
    for field, slope in ((medium.motion.u, 0.1), (medium.motion.v, 2.0), (medium.fluid.v, 2.0)):
        assert np.abs(field[here, 0] - slope * mesh.X[here, 1]).max() < ROUND_OFF * slope
    assert medium.motion.accepted_mesh_state().configuration.J.min() > 0.5


SHORT = (
    "coupling.tolerance=1e-10",
    "time.end=0.04",
    "output.checkpoint_every=2",
    "material.0.fluid.density=200.0",
)


def test_a_run_continued_in_its_middle_is_the_whole_one(tmp_path):
    """To the last bit."""
    changes = *given(tmp_path / "flap.msh", flap_mesh(3, 2)), *SHORT
    run(tmp_path / "whole", *changes)
    run(tmp_path / "half", *changes, "time.end=0.02")
    run_here(
        Job(FLAP, str(tmp_path / "half"), changes, restart=str(tmp_path / "half/checkpoint.h5"))
    )
    assert (tmp_path / "whole/history.csv").read_text() == (
        tmp_path / "half/history.csv"
    ).read_text()
    expected, computed = (state(tmp_path / name / "checkpoint.h5") for name in ("whole", "half"))
    assert [name for name in expected if not np.array_equal(expected[name], computed[name])] == []


@needs_mpirun
def test_ranks_do_not_matter(tmp_path):
    """Facets and nodes of the two sides are on different ranks; the solvers differ by round-off,
    the sweeps end at 1e-10.
    """
    changes = *given(tmp_path / "flap.msh", flap_mesh(1, 2)), *SHORT, "time.end=0.02"
    run(tmp_path / "1", *changes)
    expected = history(tmp_path / "1")
    arrays = state(tmp_path / "1/checkpoint.h5")
    for ranks in (2, 3):
        run_on(ranks, [Job(FLAP, str(tmp_path / str(ranks)), changes)], tmp_path)
        rows = history(tmp_path / str(ranks))
        others = state(tmp_path / str(ranks) / "checkpoint.h5")
        fields = [
            name for name in arrays if "tangent" not in name and not name.startswith("accelerator")
        ]
        found = difference(rows, expected) | {
            name: largest_difference(others[name], arrays[name]) for name in fields
        }
        worst = max(found, key=found.get)
        print(f"{ranks} ranks: largest difference {found[worst]:.1e} in {worst}")
        assert found[worst] < 1e-7


# -- wrong input -----------------------------------------------------------------------------------


def sides(fluid="wet_fluid", solid="wet_solid"):
    """Return the change that names the sides of the interface."""
    return f"interface=[{{fluid='{fluid}', solid='{solid}'}}]"


ONLY_FLUID = "material=[{region='all', fluid={density=1e3, viscosity=1.0}}]"
# changes -> what the sentence says
WRONG = {
    "unknown tag": (
        [sides("lid")],
        r"\[interface\.0\.fluid\]: the mesh has no boundary tag 'lid'; choose from bottom, left, ",
    ),
    "wrong side": (
        [sides("wet_solid", "wet_fluid")],
        (
            r"\[interface\.0\.fluid\]: tag 'wet_solid' is on solid, expected a surface of the fluid"
            r" alone"
        ),
    ),
    "a surface of both": (
        [sides("wet_fluid", "bottom"), "boundary=[{on=['left', 'right', 'top', 'wet_solid']}]"],
        (
            r"\[interface\.0\.solid\]: tag 'bottom' is on fluid and solid, expected a surface of"
            r" the solid alone"
        ),
    ),
    "not the other side": (
        [
            sides("right"),
            "boundary=[{on=['left', 'top', 'bottom', 'wet_fluid'], velocity={x=0, y=0}}]",
        ],
        (
            r"\[interface\.0\]: a node of 'right' at \(1\.2, .*\) m is 0\.\d+ m away from"
            r" 'wet_solid', expected at most 0\.1 of"
        ),
    ),
    "one surface twice": (
        ["interface=[{fluid='wet_fluid', solid='wet_solid'}, {fluid='wet_fluid', solid='top'}]"],
        (
            r"\[interface\.1\.fluid\]: received 'wet_fluid', which interface\.0\.fluid has already,"
            r" expected each surface once"
        ),
    ),
    "a condition on a side": (
        ["boundary=[{on=['left', 'right', 'top', 'bottom']}, {on='wet_fluid', velocity={x=0}}]"],
        (
            r"\[boundary\.1\.on\]: tag 'wet_fluid' is a side of an interface, where solid and fluid"
            r" set the conditions; remove it"
        ),
    ),
    "a force on the solid": (
        ["force=[{name='F', on='wet_solid'}]"],
        (
            r"\[force\.0\.on\]: tag 'wet_solid' is on the solid's side of an interface, expected"
            r" the fluid's, whose force it is"
        ),
    ),
    "the answer of the solid": (
        ["coupling.interface=condensed"],
        (
            r"\[coupling\.interface\]: received 'condensed' with \[\[interface\]\], whose sides"
            r" cannot .*; expected 'dirichlet_neumann', 'robin_neumann' or"
        ),
    ),
    "a velocity for the solid": (
        ["coupling.interface=neumann_dirichlet"],
        (
            r"\[coupling\.interface\]: received 'neumann_dirichlet' with \[\[interface\]\], whose"
            r" sides cannot .*; expected 'dirichlet_neumann', 'robin_neumann' or"
        ),
    ),
    "no solid": (
        [ONLY_FLUID],
        (
            r"\[interface\.0\]: received two surfaces without such materials, expected a free fluid"
            r" and a"
        ),
    ),
    "no interface": (
        [
            "interface=[]",
            "boundary=[{on=['left', 'right', 'top', 'bottom', 'wet_fluid', 'wet_solid']}]",
            "force=[]",
        ],
        (
            r"\[\[material\]\]: the regions of solid and fluid have no surface in common; give them"
            r" common nodes there, or an \[\["
        ),
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_input_is_one_sentence(case, tmp_path):
    changes, sentence = WRONG[case]
    start()
    with pytest.raises(InputError, match=sentence) as error:
        check(load_scene(FLAP, (*given(tmp_path / "flap.msh", flap_mesh(2, 1)), *changes)))
    print(error.value)
    assert "\n" not in str(error.value) and "flap.toml" in str(error.value)


def test_a_surface_with_common_nodes_is_no_side(tmp_path):
    start()
    with pytest.raises(
        InputError,
        match=(
            r"\[interface\.0\.fluid\]: tag 'wet' lies inside of the mesh, expected its boundary; "
        ),
    ):
        mesh = shared_mesh(1)
        mesh.facets["wet"] = mesh.facets.pop(INTERFACE)
        check(load_scene(FLAP, (*given(tmp_path / "flap.msh", mesh), sides("wet", "bottom"))))


def saddle(element, cells, moved=0.0):
    """Return the facets, (F, Af), of a hexahedral mesh on the saddle z = 1 + x y/4, and their
    coordinates.

    moved : of the inner lines, along x; both families of lines stay straight
    """
    axes = [axis(0.0, 1.0, cells=[n]) for n in (*cells, 1)]
    mesh = grid(element.name, axes)
    X = mesh.points.copy()
    X[:, 0] += moved * X[:, 0] * (1 - X[:, 0]) * (element.order == 1)
    X[:, 2] += X[:, 2] * X[:, 0] * X[:, 1] / 4
    nodes, facets = np.unique(mesh.facets["top"], return_inverse=True)
    facets = facets.reshape(mesh.facets["top"].shape)
    return facets, X[nodes][facets]


@pytest.mark.parametrize("name", ["H8", "H27", "H20"])
def test_bilinear_fields_cross_between_quadrilaterals_of_a_saddle(name):
    """Both meshes have the saddle itself, and 1, x, y and z on it, whose forces keep their sum and
    moment.
    """
    element = ELEMENTS[name]
    sides = saddle(element, (3, 2), 0.3), saddle(element, (2, 4))
    facets, X = zip(*sides, strict=True)
    projection = SurfaceProjection(element, facets, X)
    target, source = (np.empty((f.max() + 1, 3)) for f in facets)
    target[facets[0]], source[facets[1]] = X
    assert np.abs(projection.project(source) - target).max() < 1e-11  # where Gauss and Newton end
    force = np.random.default_rng(51).standard_normal(target.shape)
    spread = projection.transposed(force)
    assert np.allclose(spread.sum(axis=0), force.sum(axis=0), rtol=0, atol=1e-11)
    moments = (np.cross(x, f).sum(axis=0) for x, f in ((source, spread), (target, force)))
    assert np.allclose(*moments, rtol=0, atol=1e-11)


@pytest.mark.parametrize("name", ["H8", "H27", "H20"])
def test_the_closest_point_of_a_saddle_is_no_farther_than_a_thousand_others(name):
    element = ELEMENTS[name]
    _, X = saddle(element, (3, 2), 0.3)
    rng = np.random.default_rng(52)
    points = rng.uniform(-0.2, 1.2, (40, 3)) * [1, 1, 0.2] + [0, 0, 1.05]
    facet, N, distance = closest_points(element, X, points)
    reached = np.einsum("pa,pai->pi", N, X[facet])
    assert np.allclose(np.linalg.norm(points - reached, axis=1), distance, rtol=1e-12, atol=1e-12)
    grid = np.stack(np.meshgrid(*[np.linspace(0, 1, 33)] * 2), axis=-1).reshape(-1, 2)
    others = (element.facet.shape(grid) @ X).reshape(-1, 3)
    brute = np.linalg.norm(points[:, None] - others, axis=2).min(axis=1)
    assert np.all(distance <= brute + 1e-12)
    assert np.all(brute - distance < 0.02)  # the spacing of the grid is 1/64 to 1/100
