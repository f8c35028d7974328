"""Mesh files: Gmsh 2.2 and 4.1 and others, all elements, and one sentence for everything
unusable.
"""

import os
from pathlib import Path
from types import SimpleNamespace
from unittest import mock

import meshio
import numpy as np
import pytest
from grids import grid

from porofsi_petsc.elements import ELEMENTS
from porofsi_petsc.errors import InputError
from porofsi_petsc.mesh import Mesh, read_mesh
from porofsi_petsc.mesh.read import Reading

AXIS = SimpleNamespace(points=[0.0, 1.0, 2.0], cells=[2, 1], ratios=None)
PATCH = SimpleNamespace(name="strip", side="top", x=[0.0, 1.0])
REGION = SimpleNamespace(name="core", x=[0.0, 1.0], y=None, z=None)
MESHES = {
    name: grid(name, [AXIS] * element.dim, patches=[PATCH], regions=[REGION])
    for name, element in ELEMENTS.items()
}
GMSH_TYPE = {"line": 1, "triangle": 2, "tetra": 4, "line3": 8, "triangle6": 9, "tetra10": 11}
GMSH_TYPE |= {"quad": 3, "hexahedron": 5, "quad9": 10, "hexahedron27": 12}
GMSH_TYPE |= {"quad8": 16, "hexahedron20": 17}
GMSH_TYPE |= {"wedge18": 13, "pyramid14": 14, "wedge15": 18, "pyramid13": 19}
# Gmsh's order of nodes in numbers of VTK's (gmsh.info, "Node ordering").
HEXAHEDRON = [*range(8), *(8, 11, 16, 9, 17, 10, 18, 19, 12, 15, 13, 14)]
WEDGE = [*range(6), 6, 8, 12, 7, 13, 14, 9, 11, 10]
PYRAMID = [*range(5), 5, 8, 9, 6, 10, 7, 11, 12]
GMSH_NODES = {
    "tetra10": [*range(8), 9, 8],
    "hexahedron20": HEXAHEDRON,
    "hexahedron27": [*HEXAHEDRON, *(24, 22, 20, 21, 23, 25, 26)],
    "wedge15": WEDGE,
    "wedge18": [*WEDGE, 15, 17, 16],
    "pyramid13": PYRAMID,
    "pyramid14": [*PYRAMID, 13],
}


def blocks(mesh):
    """Return (meshio kind, dimension, name, nodes) for every named group."""
    groups = [
        (mesh.element.facet.meshio_name, mesh.dim - 1, tag, nodes)
        for tag, nodes in mesh.facets.items()
    ]
    parts = [mesh.cells[mesh.cell_region == i] for i in range(len(mesh.regions))]
    return groups + [
        (mesh.element.meshio_name, mesh.dim, name, nodes)
        for name, nodes in zip(mesh.regions, parts, strict=True)
    ]


def as_meshio(points, groups):
    """Return meshio's mesh with Gmsh physical groups; a name None leaves the elements without a
    group.
    """
    names = list(dict.fromkeys((name, dim) for _, dim, name, _ in groups if name))
    number = {key: i + 1 for i, key in enumerate(names)}
    numbers = [np.full(len(nodes), number.get((name, dim), 0)) for _, dim, name, nodes in groups]
    return meshio.Mesh(
        np.pad(points, ((0, 0), (0, 3 - points.shape[1]))),
        [(kind, nodes) for kind, _, _, nodes in groups],
        cell_data={"gmsh:physical": numbers, "gmsh:geometrical": numbers},
        field_data={name: np.array([number[name, dim], dim]) for name, dim in names},
    )


def write22(path, points, groups):
    as_meshio(points, groups).write(path, file_format="gmsh22", binary=False)


def write41(path, points, groups):
    """Write Gmsh 4.1 ASCII, one entity per group; a group name is a string, a tuple of strings, or
    None.
    """
    tuples = [(k, d, (n,) if isinstance(n, str) else n or (), c) for k, d, n, c in groups]
    physical = {
        key: i + 1
        for i, key in enumerate(dict.fromkeys((d, n) for _, d, names, _ in tuples for n in names))
    }
    lines = ["$MeshFormat", "4.1 0 8", "$EndMeshFormat", "$PhysicalNames", str(len(physical))]
    lines += [f'{d} {i} "{n}"' for (d, n), i in physical.items()]
    lines += [
        "$EndPhysicalNames",
        "$Entities",
        " ".join(str(sum(d == k for _, d, _, _ in tuples)) for k in range(4)),
    ]
    for number, (_, dim, names, _) in sorted(enumerate(tuples, 1), key=lambda item: item[1][1]):
        lines.append(
            f"{number} 0 0 0 1 1 1 {len(names)} "
            + " ".join(str(physical[dim, n]) for n in names)
            + " 0"
        )
    lines += [
        "$EndEntities",
        "$Nodes",
        f"1 {len(points)} 1 {len(points)}",
        f"{tuples[-1][1]} {len(tuples)} 0 {len(points)}",
    ]
    lines += [str(i + 1) for i in range(len(points))] + [
        " ".join(map(repr, map(float, (*p, 0.0)[:3]))) for p in points
    ]
    total = sum(len(cells) for *_, cells in tuples)
    lines += ["$EndNodes", "$Elements", f"{len(tuples)} {total} 1 {total}"]
    element = 0
    for number, (kind, dim, _, cells) in enumerate(tuples, 1):
        lines.append(f"{dim} {number} {GMSH_TYPE[kind]} {len(cells)}")
        for nodes in cells[:, GMSH_NODES.get(kind, slice(None))]:
            element += 1
            lines.append(" ".join(map(str, (element, *(nodes + 1)))))
    path.write_text("\n".join([*lines, "$EndElements", ""]))


def same_facets(first, second):
    return {tag: set(map(tuple, nodes)) for tag, nodes in first.items()} == {
        tag: set(map(tuple, n)) for tag, n in second.items()
    }


@pytest.mark.parametrize("name", MESHES)
@pytest.mark.parametrize("write", [write22, write41])
def test_gmsh_files_come_back_by_name_in_their_own_numbering(tmp_path, name, write):
    mesh = MESHES[name]
    write(tmp_path / "a.msh", mesh.points, blocks(mesh))
    read = read_mesh(tmp_path / "a.msh", mesh.dim)
    assert isinstance(read, Mesh) and read.element is mesh.element
    assert np.array_equal(read.points, mesh.points)
    assert same_facets(read.facets, mesh.facets)
    assert sorted(read.regions) == sorted(mesh.regions)
    named = {
        (read.regions[r], *nodes) for r, nodes in zip(read.cell_region, read.cells, strict=True)
    }
    assert named == {
        (mesh.regions[r], *nodes) for r, nodes in zip(mesh.cell_region, mesh.cells, strict=True)
    }


def test_groups_of_another_format_that_have_only_numbers(tmp_path):
    mesh = MESHES["T3"]
    source = as_meshio(mesh.points, blocks(mesh))
    numbers = source.cell_data["gmsh:physical"]
    meshio.Mesh(source.points, source.cells, cell_data={"tag": numbers}).write(
        tmp_path / "a.vtu", binary=False
    )
    read = read_mesh(tmp_path / "a.vtu", 2)
    assert sorted(read.facets) == [f"group_{i}" for i in range(1, 6)]
    assert read.regions == ("group_6", "group_7")
    other = [np.full(len(numbers_of), 3) for numbers_of in numbers]
    cell = np.split(np.arange(sum(map(len, numbers))), np.cumsum([*map(len, numbers)])[:-1])
    arrays = {"tag": numbers, "other": other, "number of the cell": cell}
    meshio.Mesh(source.points, source.cells, cell_data=arrays).write(tmp_path / "b.vtu")
    refused(tmp_path / "b.vtu", 2, r"several integer arrays over the cells \(tag, other\)")
    named = read_mesh(tmp_path / "b.vtu", 2, Reading(array="tag"))
    assert same_facets(named.facets, read.facets) and named.regions == read.regions
    with pytest.raises(InputError, match="mesh.array = 'tags', but .*; choose from tag, other"):
        read_mesh(tmp_path / "b.vtu", 2, Reading(array="tags"))
    arrays["MaterialIDs"] = arrays.pop("tag")
    meshio.Mesh(source.points, source.cells, cell_data=arrays).write(tmp_path / "c.vtu")
    assert read_mesh(tmp_path / "c.vtu", 2).regions == read.regions


def test_other_format_with_named_cell_sets(tmp_path):
    mesh = MESHES["T4"]
    groups = blocks(mesh)
    sets = {
        name: [np.arange(len(nodes) * (name == n)) for *_, n, nodes in groups]
        for *_, name, _ in groups
    }
    source = meshio.Mesh(
        mesh.points, [(kind, nodes) for kind, _, _, nodes in groups], cell_sets=sets
    )
    source.write(tmp_path / "a.inp")
    read = read_mesh(tmp_path / "a.inp", 3)
    assert same_facets(read.facets, mesh.facets) and set(read.regions) == {"body", "core"}


@pytest.mark.parametrize("name", MESHES)
def test_clockwise_cells_are_reoriented_with_their_midside_nodes(tmp_path, name):
    mesh = MESHES[name]
    vertex = [0, 2, 1, 3][: mesh.dim + 1]
    corner = [0, 3, 2, 1, 4, 7, 6, 5]
    edges = [11, 10, 9, 8, 15, 14, 13, 12, 16, 19, 18, 17]
    flip = {
        "T3": vertex,
        "T4": vertex,
        "T6": [*vertex, 5, 4, 3],
        "T10": [*vertex, 6, 5, 4, 7, 9, 8],
        "Q4": corner[:4],
        "Q8": [*corner[:4], 7, 6, 5, 4],
        "Q9": [*corner[:4], 7, 6, 5, 4, 8],
        "H8": corner,
        "H20": [*corner, *edges],
        "H27": [*corner, *edges, *(22, 23, 20, 21, 24, 25, 26)],
    }[name]
    flipped = [
        (k, d, n, nodes[:, flip] if d == mesh.dim else nodes) for k, d, n, nodes in blocks(mesh)
    ]
    write22(tmp_path / "a.msh", mesh.points, flipped)
    read = read_mesh(tmp_path / "a.msh", mesh.dim)
    assert {tuple(nodes) for nodes in read.cells} == {tuple(nodes) for nodes in mesh.cells}
    assert same_facets(read.facets, mesh.facets)


def test_curved_midside_nodes_are_kept(tmp_path):
    mesh = MESHES["T6"]
    points = mesh.points.copy()
    points[mesh.facets["strip"][0, 2]] += [0.01, 0.05]
    write22(tmp_path / "a.msh", points, blocks(mesh))
    assert np.array_equal(read_mesh(tmp_path / "a.msh", 2).points, points)


def test_interior_tagged_facets_are_kept_beside_the_lower_cell(tmp_path):
    mesh = MESHES["T3"]
    interior = mesh.cells[mesh.cell_region == 0][:, [0, 1]]
    interior = interior[(mesh.points[interior, 0] == 1).all(axis=1)]
    interior = interior if len(interior) else mesh.cells[:1, [1, 2]]
    write22(
        tmp_path / "a.msh", mesh.points, [("line", 1, "interface", interior[:1]), *blocks(mesh)]
    )
    read = read_mesh(tmp_path / "a.msh", 2)
    assert set(read.facets["interface"][0]) == set(interior[0])


def test_committed_mesh_of_the_pulse_scene():
    mesh = read_mesh(Path(__file__).parents[1] / "configs" / "meshes" / "pulse2d.msh", 2)
    assert mesh.element.name == "T6" and mesh.regions == ("body",)
    assert set(mesh.facets) == {"left", "right", "bottom", "top", "strip"}
    assert 1500 <= len(mesh.cells) <= 2500
    for probe in ((15.5, 10.0), (10.5, 9.0), (10.5, 10.0)):
        assert np.abs(mesh.points - probe).sum(axis=1).min() == 0
    strip = mesh.points[mesh.facets["strip"]]
    assert (strip[..., 0].min(), strip[..., 0].max()) == (10, 11) and np.all(strip[..., 1] == 10)


def refused(path, dim, message):
    """Require one sentence that begins with the file and matches the message."""
    with pytest.raises(InputError, match=message) as caught:
        read_mesh(path, dim)
    assert str(caught.value).startswith(f"{path}: ") and "\n" not in str(caught.value)


def refused_groups(tmp_path, points, groups, message, dim=2, write=write22):
    write(tmp_path / "a.msh", points, groups)
    refused(tmp_path / "a.msh", dim, message)


def test_missing_and_empty_file(tmp_path):
    refused(tmp_path / "none.msh", 2, "no such mesh file")
    (tmp_path / "empty.msh").touch()
    refused(tmp_path / "empty.msh", 2, "the mesh file is empty")
    write22(
        tmp_path / "points.msh", MESHES["T3"].points, [("line", 1, "left", np.empty((0, 2), int))]
    )
    refused(tmp_path / "points.msh", 2, "no cells|not readable")


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.msh", "this is no mesh"),
        ("a.xyz", "1 2 3"),
        ("a.vtu", "<x"),
        ("a.msh", "$MeshFormat\n4.1 0 8\n"),
    ],
)
def test_unreadable_file_says_so_and_prints_nothing(tmp_path, capfd, name, text):
    (tmp_path / name).write_text(text)
    refused(tmp_path / name, 2, "not readable as a mesh")
    assert capfd.readouterr() == ("", "")


def test_what_is_no_file_is_not_opened(tmp_path):
    os.mkfifo(tmp_path / "pipe.msh")
    refused(tmp_path / "pipe.msh", 2, "received a device or pipe, expected a mesh file")
    refused(tmp_path, 2, "received a directory, expected a mesh file")
    (tmp_path / "a.msh").write_text("x")
    with mock.patch("os.access", lambda path, mode: False):  # root may read everything
        refused(tmp_path / "a.msh", 2, "no permission to read")


READ = [
    ".msh",
    ".vtk",
    ".vtu",
    ".xdmf",
    ".med",
    ".inp",
    ".mesh",
    ".vol",
    ".su2",
    ".cgns",
    ".mdpa",
    ".feb",
    ".nothing",
]


@pytest.mark.parametrize("suffix", READ)
def test_binary_junk_is_refused_in_a_short_line(tmp_path, capfd, suffix):
    path = tmp_path / f"a{suffix}"
    path.write_bytes(np.random.default_rng(0).bytes(3000))
    refused(path, 2, "not readable as a mesh")
    with pytest.raises(InputError) as caught:
        read_mesh(path, 2)
    assert str(caught.value).isprintable() and len(str(caught.value)) < 400
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("suffix", [".ply", ".wkt", ".tec", ".dat", ".STL", ".node"])
def test_formats_without_boundaries_are_not_read(tmp_path, suffix):
    """Of broken files of these meshio's readers find no end."""
    path = tmp_path / f"a{suffix}"
    path.write_text("ply\nformat ascii 1.0\n")
    refused(path, 2, "has no named boundaries; give a mesh of cells in named groups")


@pytest.mark.parametrize(
    "text", ["", "BEGIN BULK\n", "ENDDATA\nBEGIN BULK\n", "BEGIN BULK\n$ nothing\n"]
)
def test_a_file_of_nastran_that_does_not_end_is_refused(tmp_path, text):
    (tmp_path / "a.bdf").write_text("$ mesh\n" + text)
    refused(tmp_path / "a.bdf", 2, "no ENDDATA follows on the BEGIN BULK")


def test_a_file_of_ansys_that_does_not_end_is_refused(tmp_path):
    (tmp_path / "a.msh").write_text(
        "(0 grid)\n(2 2)\n(10 (0 1 4 0 2))\n(10 (1 1 4 1 2)(\n0 0\n1 0\n1 1\n0 1\n"
    )
    refused(tmp_path / "a.msh", 2, "not readable as a mesh")


def test_a_file_without_coordinates(tmp_path):
    (tmp_path / "a.vol").write_text("mesh3d\ndimension\n2\npoints\n0\n")
    refused(tmp_path / "a.vol", 2, "gives no 2 coordinates for every node|not readable as a mesh")


def test_truncated_file(tmp_path):
    mesh = MESHES["T6"]
    write41(tmp_path / "a.msh", mesh.points, blocks(mesh))
    text = (tmp_path / "a.msh").read_text()
    (tmp_path / "a.msh").write_text(text[: len(text) // 2])
    refused(tmp_path / "a.msh", 2, "not readable as a mesh")


def test_wrong_dimension(tmp_path):
    flat = MESHES["T3"]
    solid = MESHES["T4"]
    refused_groups(
        tmp_path,
        flat.points,
        blocks(flat),
        r"the scene is 3-D but the mesh 2-D \(triangle\)",
        dim=3,
    )
    refused_groups(
        tmp_path, solid.points, blocks(solid), r"the scene is 2-D but the mesh 3-D \(tetra\)", dim=2
    )


def test_unsupported_and_mixed_cells(tmp_path):
    points = np.array([[0.0, 0.0], [1, 0], [1, 1], [0, 1], [2, 0], [3, 0], [3, 1], [2, 1]])
    triangle = ("triangle", 2, "body", np.array([[1, 4, 2]]))
    cubic = ("triangle10", 2, "body", np.arange(10)[None])
    refused_groups(
        tmp_path,
        np.vstack([points, points[:2]]),
        [cubic],
        "unsupported cells of kind triangle10; mesh the domain with triangle, triangle6, quad,"
        " quad9 or quad8$",
    )
    curved = ("triangle6", 2, "body", np.array([[0, 1, 2, 3, 4, 5]]))
    refused_groups(
        tmp_path,
        np.random.default_rng(0).random((6, 2)),
        [curved, triangle],
        "mixed cells of kinds triangle, tri",
    )
    cubic = ("tetra20", 3, "body", np.arange(20)[None])
    refused_groups(
        tmp_path,
        np.random.default_rng(0).random((20, 3)),
        [cubic],
        "unsupported cells of kind tetra20; mesh the domain with tetra, tetra10, hexahedron,"
        " hexahedron27, hexahedron20, wedge or pyramid$",
        dim=3,
    )


@pytest.mark.parametrize("name, vertex", [("Q4", 2), ("H8", 6)])
def test_a_cell_with_an_angle_of_more_than_180_degrees_is_refused(tmp_path, name, vertex):
    mesh = MESHES[name]
    points = mesh.points.copy()
    cell = mesh.cells[0]
    points[cell[vertex]] = 0.7 * points[cell[0]] + 0.3 * points[cell[vertex]]
    refused_groups(
        tmp_path,
        points,
        blocks(mesh),
        r"the cell \d+ \(counted from 0\) is folded, its Jacobian is .*; its angles must be less",
        dim=mesh.dim,
    )


def test_degenerate_cell_is_named_with_its_vertices(tmp_path):
    mesh = MESHES["T3"]
    points = mesh.points.copy()
    a, b, c = mesh.cells[0]
    points[c] = (points[a] + points[b]) / 2
    refused_groups(
        tmp_path,
        points,
        blocks(mesh),
        r"cell \d+ \(counted from 0\) is degenerate, its vertices are \(0, 0\)",
    )


@pytest.mark.parametrize("name", ["T6", "T10"])
def test_folded_curved_cell_is_named_with_the_place(tmp_path, name):
    mesh = MESHES[name]
    points = mesh.points.copy()
    a, b = mesh.element.cell.edges[0]
    points[mesh.cells[0, mesh.dim + 1]] = (
        0.1 * points[mesh.cells[0, a]] + 0.9 * points[mesh.cells[0, b]]
    )
    refused_groups(
        tmp_path,
        points,
        blocks(mesh),
        r"curved cell \d+ .* folded, its Jacobian is -?[\d.e-]+ at \(",
        dim=mesh.dim,
    )


def test_nodes_of_no_cell_are_left_out_and_counted(tmp_path):
    mesh = MESHES["T6"]
    points = np.vstack([[[5.0, 5.0]], mesh.points, [[6.0, 6.0]]])
    moved = [(kind, dim, name, nodes + 1) for kind, dim, name, nodes in blocks(mesh)]
    write22(tmp_path / "a.msh", points, moved)
    read = read_mesh(tmp_path / "a.msh", 2)
    assert np.array_equal(read.points, mesh.points) and same_facets(read.facets, mesh.facets)
    assert len(read.notes) == 1 and read.notes[0].startswith(
        "2 nodes of the file belong to no cell, the first at (5, 5)"
    )


@pytest.mark.parametrize("write", [write22, write41])
@pytest.mark.parametrize("name", MESHES)
def test_what_is_in_no_group_has_a_name_by_its_place(tmp_path, name, write):
    mesh = MESHES[name]
    groups = [(kind, dim, None, nodes) for kind, dim, name, nodes in blocks(mesh) if name != "top"]
    write(tmp_path / "a.msh", mesh.points, groups)
    read = read_mesh(tmp_path / "a.msh", mesh.dim)
    top = np.concatenate([mesh.facets["top"], mesh.facets["strip"]])
    sides = {tag: nodes for tag, nodes in mesh.facets.items() if tag != "strip"} | {"top": top}
    assert same_facets(read.facets, sides) and read.regions == ("body",)
    assert "boundary facets have no name in the file" in read.notes[0]


@pytest.mark.parametrize("write", [write22, write41])
def test_groups_beside_what_is_in_none(tmp_path, write):
    """The part of the top that has no name does not become one with a group of that name."""
    mesh = MESHES["T4"]
    kept = {"strip": "top", "left": "left", "core": "core"}
    groups = [(kind, dim, kept.get(name), nodes) for kind, dim, name, nodes in blocks(mesh)]
    write(tmp_path / "a.msh", mesh.points, groups)
    read = read_mesh(tmp_path / "a.msh", 3)
    assert read.regions == ("body", "core")
    assert {*read.facets} == {"top", "left", "right", "front", "back", "bottom", "side_1"}
    expected = {**mesh.facets, "side_1": mesh.facets["top"], "top": mesh.facets["strip"]}
    assert same_facets(read.facets, {tag: n for tag, n in expected.items() if tag != "strip"})


@pytest.mark.parametrize("write", [write22, write41])
def test_groups_without_names_have_their_numbers(tmp_path, write):
    mesh = MESHES["Q4"]
    write(tmp_path / "a.msh", mesh.points, blocks(mesh))
    text = (tmp_path / "a.msh").read_text()
    begin, end = text.index("$PhysicalNames"), text.index("$EndPhysicalNames\n") + 18
    (tmp_path / "a.msh").write_text(text[:begin] + text[end:])
    read = read_mesh(tmp_path / "a.msh", 2)
    assert sorted(read.facets) == [f"group_{i}" for i in range(1, 6)]
    assert sorted(read.regions) == ["group_6", "group_7"]


@pytest.mark.parametrize("file_format", ["gmsh22", "gmsh"])
@pytest.mark.parametrize("name", ["Q9", "T10", "H20", "H27"])
def test_binary_files_of_gmsh(tmp_path, name, file_format):
    mesh = MESHES[name]
    source = as_meshio(mesh.points, blocks(mesh))
    if file_format == "gmsh":  # 4.1, of which meshio sorts the nodes by their entities
        entities = [(block.dim, 1 + i) for i, block in enumerate(source.cells)]
        source.point_data["gmsh:dim_tags"] = np.resize(entities, (len(mesh.points), 2))
        source.cell_data["gmsh:geometrical"] = [
            np.full(len(block.data), i) for i, block in enumerate(source.cells, start=1)
        ]
    source.write(tmp_path / "a.msh", file_format=file_format, binary=True)
    read = read_mesh(tmp_path / "a.msh", mesh.dim)
    place = {tuple(x): i for i, x in enumerate(mesh.points)}
    number = np.array([place[tuple(x)] for x in read.points])
    assert same_facets({tag: number[nodes] for tag, nodes in read.facets.items()}, mesh.facets)
    assert set(map(tuple, number[read.cells])) == set(map(tuple, mesh.cells))
    assert set(read.regions) == set(mesh.regions)


def test_two_groups_of_one_name_in_two_dimensions(tmp_path):
    mesh = MESHES["T3"]
    groups = [(k, d, "core" if n == "strip" else n, c) for k, d, n, c in blocks(mesh)]
    write41(tmp_path / "a.msh", mesh.points, groups)
    read = read_mesh(tmp_path / "a.msh", 2)
    assert set(read.regions) == {"body", "core"}
    assert same_facets({"core": read.facets["core"]}, {"core": mesh.facets["strip"]})


def test_a_body_split_by_doubled_nodes_is_refused(tmp_path):
    """Sides that lie on each other would be free where nobody says so."""
    mesh = MESHES["T3"]
    right = mesh.points[mesh.cells].mean(axis=1)[:, 0] > 1
    points = np.vstack([mesh.points, mesh.points])
    cells = mesh.cells + right[:, None] * len(mesh.points)
    split = [("triangle", 2, None, cells)]
    refused_groups(tmp_path, points, split, r"6 boundary facets .* on others, the first at \(1, ")


@pytest.mark.parametrize("name", ["Q4", "H8"])
def test_cells_that_do_not_fit_together_are_refused(tmp_path, name):
    """One cell is cut into 2^d, its neighbours are not."""
    mesh = grid(name, [AXIS] * MESHES[name].dim)
    one = SimpleNamespace(points=[0.0, 1.0], cells=[2], ratios=None)
    fine = grid(name, [one] * mesh.dim)
    fine.points[:] *= 0.5
    place = {tuple(x): i for i, x in enumerate(mesh.points)}
    points, number = [*mesh.points], []
    for x in fine.points:
        number.append(place.setdefault(tuple(x), len(points)))
        points += [x] if number[-1] == len(points) else []
    (first,) = np.flatnonzero(mesh.points[mesh.cells].max(axis=(1, 2)) <= 0.5)
    cells = np.vstack([np.delete(mesh.cells, first, axis=0), np.array(number)[fine.cells]])
    group = (mesh.element.meshio_name, mesh.dim, "body", cells)
    message = "nodes lie on boundary facets without a name that have other vertices, the first at"
    refused_groups(tmp_path, np.array(points), [group], message, mesh.dim)


def test_facet_with_two_tags(tmp_path):
    mesh = MESHES["T3"]
    doubled = ("line", 1, "second", mesh.facets["strip"][:1, ::-1])
    refused_groups(
        tmp_path,
        mesh.points,
        [doubled, *blocks(mesh)],
        r"the facet at \(.*\) is in two groups, '(strip|second)' and '(strip|second)'; leave",
    )
    groups = [(k, d, ("strip", "lid") if n == "strip" else n, c) for k, d, n, c in blocks(mesh)]
    refused_groups(
        tmp_path,
        mesh.points,
        groups,
        r"the facet at \(.*\) is in two groups, 'strip' and 'lid'",
        write=write41,
    )
    read = read_mesh(tmp_path / "a.msh", 2, Reading(groups=("lid", "strip", "left", "right")))
    assert {*read.facets} == {"lid", "left", "right", "bottom", "top"}
    assert same_facets({"": read.facets["lid"]}, {"": mesh.facets["strip"]})
    with pytest.raises(InputError, match="mesh.groups names 'lids', which the file does not have"):
        read_mesh(tmp_path / "a.msh", 2, Reading(groups=("lids",)))


def test_facet_of_no_cell_and_doubled_cell(tmp_path):
    mesh = MESHES["T3"]
    stray = ("line", 1, "stray", np.array([[0, len(mesh.points) - 1]]))
    refused_groups(
        tmp_path,
        mesh.points,
        [*blocks(mesh), stray],
        r"1 facets of 'stray' belong to no cell, the first at \(1, 1\)",
    )
    twice = ("triangle", 2, "body", np.repeat(mesh.cells[8:9], 2, axis=0))
    refused_groups(tmp_path, mesh.points, [*blocks(mesh), twice], "shared by more than two cells")


def test_bent_plane_mesh_and_infinite_coordinates(tmp_path):
    mesh = MESHES["T3"]
    bent = np.column_stack([mesh.points, mesh.points[:, 0]])
    message = "the nodes of the 2-D mesh span 2 x 2 x 2 m, expected a plane in which x, y or z is"
    refused_groups(tmp_path, bent, blocks(mesh), message)
    broken = mesh.points.copy()
    broken[3, 0] = np.nan
    refused_groups(
        tmp_path, broken, blocks(mesh), r"node 3 \(counted from 0\) has the coordinates \(nan,"
    )


@pytest.mark.parametrize("far", [0.0, 1048576.0])
@pytest.mark.parametrize("axes", [(0, 1), (0, 2), (1, 2)], ids=["xy", "xz", "yz"])
def test_a_plane_mesh_in_another_plane_and_unit(tmp_path, axes, far):
    """A node of no cell may lie beside the plane."""
    mesh = MESHES["Q9"]
    points = np.full((len(mesh.points) + 1, 3), 7.0)
    points[:-1, axes] = 512 * mesh.points + far
    points[-1] = 0.0
    write22(tmp_path / "a.msh", points, blocks(mesh))
    read = read_mesh(tmp_path / "a.msh", 2, Reading(scale=1 / 512))
    assert np.array_equal(read.points, mesh.points + far / 512)
    assert same_facets(read.facets, mesh.facets)
    said = " and ".join("xyz"[i] for i in axes) + " of the file are x and y here"
    assert (said in read.notes) == (axes != (0, 1))


@pytest.mark.parametrize("node", [10**12, -1])
def test_facet_with_an_unlisted_node(tmp_path, node):
    """The number of a node is no size of an array: 10^12 asked for a terabyte."""
    mesh = MESHES["T3"]
    broken = [
        (k, d, n, np.where(np.arange(len(c))[:, None] == 0, node, c) if n == "left" else c)
        for k, d, n, c in blocks(mesh)
    ]
    write22(tmp_path / "a.msh", mesh.points, broken)
    refused(tmp_path / "a.msh", 2, r"facet \d+ \(counted from 0\) has a node missing in the file")


def test_cell_with_an_unlisted_node(tmp_path):
    mesh = MESHES["T3"]
    write22(tmp_path / "a.msh", mesh.points, blocks(mesh))
    text = (tmp_path / "a.msh").read_text()
    last = len(mesh.points)
    lines = text.splitlines()
    start = lines.index("$Nodes")
    lines[start + 1] = str(last - 1)
    del lines[start + 1 + last]
    (tmp_path / "a.msh").write_text("\n".join([*lines, ""]))
    refused(tmp_path / "a.msh", 2, "not list|missing in the file|not readable")


@pytest.mark.parametrize("name", ["T6", "Q9", "T10"])
def test_cells_that_share_an_edge_without_its_middle_node(tmp_path, name):
    """Each cell has middle nodes of its own: corners alone would join them, and the body split."""
    mesh = MESHES[name]
    vertices = mesh.element.n_vertices
    own = next(n for n in mesh.cells[0, vertices:] if (mesh.cells[1:] == n).any())
    points = np.vstack([mesh.points, mesh.points[own]])
    cells = mesh.cells.copy()
    cells[0] = np.where(cells[0] == own, len(mesh.points), cells[0])
    split = [
        (k, d, n, cells[mesh.cell_region == mesh.regions.index(n)] if d == mesh.dim else c)
        for k, d, n, c in blocks(mesh)
    ]
    dim = mesh.dim
    refused_groups(tmp_path, points, split, "share an edge or a face without its middle node", dim)
