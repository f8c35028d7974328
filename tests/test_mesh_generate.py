"""Generated rectangles and boxes: measures, conformity, grading, tags, adjacency."""

import tracemalloc
from types import SimpleNamespace

import numpy as np
import pytest
from grids import PLANE, SOLID, grid

from porofsi_petsc.errors import InputError
from porofsi_petsc.mesh import box, memory, node_graph, rectangle, require_regions, require_tags
from porofsi_petsc.mesh.check import boundary_tags, require_every_tag
from porofsi_petsc.mesh.generate import grid_lines
from porofsi_petsc.mesh.memory import BYTES_PER_GRID_CELL
from porofsi_petsc.mesh.topology import (
    boundary_facets,
    cell_facets,
    facet_multiplicity,
    locate_facets,
)


def axis(points, cells, ratios=None):
    return SimpleNamespace(points=points, cells=cells, ratios=ratios)


def part(name, side=None, **intervals):
    return SimpleNamespace(name=name, side=side, **{"x": None, "y": None, "z": None, **intervals})


X = axis([0.0, 10.0, 11.0, 21.0], [5, 2, 5], [0.25, 1.0, 4.0])
Y = axis([0.0, 10.0], [4], [0.3])
MANY = axis([0.0, 1.0], [2**31 - 1])
Z = axis([-1.0, 0.0, 2.0], [2, 2])
GENERATED = {
    **{
        f"T{3 * order}-{d}": (rectangle, (X, Y, order, d), 210.0)
        for order in (1, 2)
        for d in ("right", "left", "alternating")
    },
    **{name: (grid, (name, (X, Y)), 210.0) for name in PLANE if not name.startswith("T")},
    **{name: (grid, (name, (X, Y, Z)), 630.0) for name in SOLID},
}


@pytest.fixture(params=GENERATED)
def generated(request):
    make, arguments, volume = GENERATED[request.param]
    return make(*arguments), volume


def measures(points, cells, element):
    """Return the volume or area of straight or curved elements, (E,), for facets too."""
    xi, weights = element.cell.quadrature(2)
    J = np.einsum("eai,qaj->eqij", points[cells], element.gradient(xi))
    return np.sqrt(np.linalg.det(np.swapaxes(J, 2, 3) @ J)) @ weights


def test_volume_is_exact_and_every_cell_positive(generated):
    mesh, volume = generated
    assert measures(mesh.points, mesh.cells, mesh.element).sum() == pytest.approx(
        volume, rel=1e-12
    )  # round-off of the sum
    corners = mesh.points[mesh.cells[:, mesh.element.cell.simplices]]
    assert np.linalg.det(corners[:, :, 1:] - corners[:, :, :1]).min() > 0


def test_sides_have_their_exact_measure_and_outward_normal(generated):
    mesh, _ = generated
    lengths = np.ptp(mesh.points, axis=0)
    last = mesh.dim - 1
    for tag, direction, sign in (
        ("left", 0, -1),
        ("right", 0, 1),
        ("bottom", last, -1),
        ("top", last, 1),
    ):
        nodes = mesh.facets[tag]
        area = measures(mesh.points, nodes, mesh.element.facet).sum()
        assert area == pytest.approx(np.prod(np.delete(lengths, direction)), rel=1e-12)
        cell, _ = locate_facets(nodes, mesh.cells, mesh.element)
        inward = (
            mesh.points[mesh.cells[cell, : mesh.element.n_vertices]].mean(axis=1)
            - mesh.points[nodes[:, 0]]
        )
        assert np.all(inward[:, direction] * sign < 0)
        edges = mesh.points[nodes[:, 1 : mesh.dim]] - mesh.points[nodes[:, :1]]
        normal = (
            edges[:, 0, ::-1] * [1, -1] if mesh.dim == 2 else np.cross(edges[:, 0], edges[:, 1])
        )
        assert np.all(normal[:, direction] * sign > 0)


def test_mesh_is_conforming_and_every_boundary_facet_has_one_tag(generated):
    mesh, _ = generated
    multiplicity = facet_multiplicity(mesh.cells, mesh.element)
    assert set(np.unique(multiplicity)) == {1, 2}
    tagged = np.concatenate(
        [locate_facets(nodes, mesh.cells, mesh.element) for nodes in mesh.facets.values()], axis=1
    )
    boundary = np.array(boundary_facets(mesh.cells, mesh.element))
    assert sorted(map(tuple, tagged.T)) == sorted(map(tuple, boundary.T))
    assert np.array_equal(np.unique(mesh.cells), np.arange(len(mesh.points)))
    assert len(np.unique(mesh.points, axis=0)) == len(mesh.points)


def test_closed_surface_has_no_net_normal(generated):
    mesh, _ = generated
    nodes = cell_facets(mesh.cells, mesh.element)[boundary_facets(mesh.cells, mesh.element)]
    edges = mesh.points[nodes[:, 1 : mesh.dim]] - mesh.points[nodes[:, :1]]
    normal = edges[:, 0, ::-1] * [1, -1] if mesh.dim == 2 else np.cross(edges[:, 0], edges[:, 1])
    assert normal.sum(axis=0) == pytest.approx(0, abs=1e-10)


def test_midside_nodes_lie_in_the_middle_and_are_shared(generated):
    mesh, _ = generated
    for node, around in enumerate(mesh.element.supports, start=mesh.element.n_vertices):
        middle = mesh.points[mesh.cells[:, list(around)]].mean(axis=1)
        assert np.abs(mesh.points[mesh.cells[:, node]] - middle).max() < 1e-14  # order of sums


def test_grading_is_geometric_with_the_given_ratio_and_exact_breakpoints():
    lines = grid_lines(X)
    assert set(X.points) <= set(lines)
    sizes = np.diff(lines)[:5]
    assert sizes[-1] / sizes[0] == pytest.approx(0.25)
    assert sizes[1:] / sizes[:-1] == pytest.approx(0.25**0.25)
    assert np.diff(grid_lines(axis([0.0, 1.0], [1], [3.0]))) == pytest.approx(1.0)


def test_patch_is_carved_out_of_its_side():
    patches = [part("strip", "top", x=[10.0, 11.0]), part("foot", "bottom")]
    mesh = rectangle(X, Y, 2, "alternating", patches)
    assert set(mesh.facets) == {"left", "right", "top", "strip", "foot"}
    strip = mesh.points[mesh.facets["strip"]]
    assert strip[..., 0].min() == 10 and strip[..., 0].max() == 11 and np.all(strip[..., 1] == 10)
    assert (
        len(mesh.facets["strip"]) == 2
        and len(mesh.facets["top"]) == 10
        and len(mesh.facets["foot"]) == 12
    )


def test_square_patch_on_a_box():
    mesh = box(
        X,
        Y,
        Z,
        1,
        [part("load", "top", x=[10.0, 11.0], y=[0.0, 10.0]), part("hole", "front", z=[-1.0, 0.0])],
    )
    area = {
        tag: measures(mesh.points, nodes, mesh.element.facet).sum()
        for tag, nodes in mesh.facets.items()
    }
    assert area == pytest.approx(
        {
            "left": 30,
            "right": 30,
            "front": 42,
            "back": 63,
            "bottom": 210,
            "top": 200,
            "load": 10,
            "hole": 21,
        },
        rel=1e-12,
    )


def test_regions_cover_their_intervals_and_the_rest_is_body():
    mesh = rectangle(
        X, Y, regions=[part("core", x=[10.0, 11.0]), part("edge", x=[11.0, 21.0], y=[0.0, 10.0])]
    )
    assert mesh.regions == ("body", "core", "edge")
    areas = np.bincount(mesh.cell_region, weights=measures(mesh.points, mesh.cells, mesh.element))
    assert areas == pytest.approx([100, 10, 100], rel=1e-12)
    assert rectangle(X, Y).regions == ("body",)
    assert rectangle(X, Y, regions=[part("whole")]).regions == ("whole",)


@pytest.mark.parametrize(
    ("patches", "message"),
    [
        (
            [part("strip", "top", x=[10.0, 11.3])],
            r"'strip', x: 11.3 m is not on a mesh line, the nearest is 11 m",
        ),
        ([part("strip", "top", y=[0.0, 10.0])], r"interval of y has no meaning on the side 'top'"),
        ([part("strip", "top", x=[11.0, 11.0])], r"interval \[11, 11\] m is empty"),
        (
            [part("a", "top", x=[0.0, 11.0]), part("b", "top", x=[10.0, 21.0])],
            r"'b': contains 2 facets of another patch",
        ),
    ],
)
def test_wrong_patch_is_refused_in_one_sentence(patches, message):
    with pytest.raises(InputError, match=message):
        rectangle(X, Y, patches=patches)


def test_a_limit_that_misses_a_line_by_little_is_shown_with_all_its_digits():
    with pytest.raises(
        InputError, match=r"10.0000001 m is not on a mesh line, the nearest is 10 m"
    ):
        rectangle(X, Y, patches=[part("strip", "top", x=[10.0000001, 11.0])])


@pytest.mark.parametrize(
    ("x", "y", "message"),
    [
        (
            axis([0.0, 1.0], [4], [1e30]),
            Y,
            r"\[mesh.x\]: the smallest cell, 1e-30 m, is lost beside coordinates of 1 m",
        ),
        (
            axis([1e12, 1e12 + 1], [4]),
            Y,
            r"\[mesh.x\]: the smallest cell, 0.25 m, is lost beside coordinates of 1e\+12 m",
        ),
        (axis([0.0, 1e-200, 1.0], [1, 1]), Y, r"\[mesh.x\]: the smallest cell, 1e-200 m, is lost"),
        (
            X,
            axis([0.0, 1e-12], [1]),
            r"\[mesh\]: cells of 3.56 m along x and 1e-12 m across are degenerate",
        ),
        (
            MANY,
            MANY,
            r"\[mesh\]: received 4.61e\+18 grid cells, whose mesh alone takes 2.41e\+12 GiB",
        ),
        (
            axis([0.0, 1.0], [9]),
            MANY,
            r"\[mesh\]: received 1.93e\+10 grid cells, .* GiB of the .* GiB of this machine",
        ),
    ],
)
def test_what_gives_no_mesh_is_refused_before_it_is_made(x, y, message):
    with pytest.raises(InputError, match=message):
        rectangle(x, y)


def test_a_box_of_flat_cells_is_refused_and_one_of_long_cells_is_not():
    with pytest.raises(InputError, match=r"cells of 1 m along x and 1e-13 m across are degenerate"):
        box(axis([0.0, 1.0], [1]), axis([0.0, 1.0], [1]), axis([0.0, 1e-13], [1]))
    assert (
        len(box(axis([0.0, 1.0], [1]), axis([0.0, 1e-4], [1]), axis([0.0, 1e-4], [1])).cells) == 6
    )


def test_the_memory_that_a_mesh_is_refused_for_is_what_its_making_takes():
    """The estimate is no more than the peak, so that nothing is refused that could be made, and no
    less than half of it.
    """
    for dim, make, cells in ((2, rectangle, 60), (3, box, 12)):
        tracemalloc.start()
        make(*[axis([0.0, 1.0], [cells])] * dim)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert 0.5 * peak < BYTES_PER_GRID_CELL[dim] * cells**dim < 1.05 * peak


def test_a_limit_of_the_address_space_counts_as_memory(monkeypatch):
    monkeypatch.setattr(memory.resource, "getrlimit", lambda kind: (2**20, 2**20))
    with pytest.raises(InputError, match=r"of the 0.000977 GiB of this machine; take fewer cells"):
        rectangle(axis([0.0, 1.0], [100]), axis([0.0, 1.0], [100]))


def test_overlapping_regions_are_refused():
    with pytest.raises(InputError, match="'b': contains 16 cells of another region, the first at"):
        rectangle(X, Y, regions=[part("a", x=[0.0, 11.0]), part("b", x=[10.0, 21.0])])


def test_unknown_tag_and_region_are_named_with_the_available_ones():
    mesh = rectangle(X, Y)
    require_tags(mesh, ["left", "top"], "scene.toml")
    require_regions(mesh, ["body"], "scene.toml")
    with pytest.raises(
        InputError,
        match=r"\[boundary\]: .* no boundary tag 'lid'; choose from bottom, left, right, top",
    ):
        require_tags(mesh, ["left", "lid"], "scene.toml [boundary]")
    with pytest.raises(InputError, match="no region 'soil'; choose from body"):
        require_regions(mesh, ["soil"], "scene.toml")


def test_boundary_without_an_entry_is_named_and_an_interior_tag_needs_none():
    mesh = rectangle(X, Y)
    facets = cell_facets(mesh.cells, mesh.element).reshape(-1, 2)
    interface = facets[(mesh.points[facets, 0] == 10.0).all(axis=1)]
    mesh.facets["interface"] = interface
    tags = boundary_tags(mesh)
    assert len(interface) and tags == ["left", "right", "bottom", "top"]
    require_every_tag(tags, ["left", "right", "bottom", "top"], "scene.toml")
    with pytest.raises(InputError, match="the boundary 'top' of the mesh has no entry"):
        require_every_tag(tags, ["left", "right", "bottom"], "scene.toml")


def test_hash_tells_meshes_apart_and_is_stable():
    assert rectangle(X, Y).hash == rectangle(X, Y).hash
    others = [
        rectangle(X, Y, 2),
        rectangle(X, Y, 1, "left"),
        rectangle(X, Y, patches=[part("strip", "top", x=[10.0, 11.0])]),
    ]
    assert len({mesh.hash for mesh in [rectangle(X, Y), *others]}) == 4


def test_node_graph_is_the_pattern_of_the_cells(generated):
    mesh, _ = generated
    n = len(mesh.points)
    indptr, indices = node_graph(mesh.cells, n)
    dense = np.zeros((n, n), dtype=bool)
    dense[np.repeat(np.arange(n), np.diff(indptr)), indices] = True
    expected = np.zeros((n, n), dtype=bool)
    expected[mesh.cells[:, :, None], mesh.cells[:, None, :]] = True
    np.fill_diagonal(expected, False)
    assert np.array_equal(dense, expected) and len(indices) == expected.sum()
