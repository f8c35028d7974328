"""Exodus files in classic netCDF and HDF5: orders of nodes and numbers of sides as its library has
them (seacas, ex_get_side_set_node_list.c, whose tables are repeated here).
"""

import h5py
import numpy as np
import pytest
from scipy.io import netcdf_file
from test_mesh_read import MESHES, refused, same_facets

from porofsi_petsc.mesh import read_mesh

# Nodes of the sides 1, 2, ...: the vertices, then the nodes between them, then that inside
SIDES = {
    "T": {2: [(1, 2, 4), (2, 3, 5), (3, 1, 6)]},
    "Q": {2: [(1, 2, 5), (2, 3, 6), (3, 4, 7), (4, 1, 8)]},
    "H": {
        3: [
            (1, 2, 6, 5, 9, 14, 17, 13, 26),
            (2, 3, 7, 6, 10, 15, 18, 14, 25),
            (3, 4, 8, 7, 11, 16, 19, 15, 27),
            (1, 5, 8, 4, 13, 20, 16, 12, 24),
            (1, 4, 3, 2, 12, 11, 10, 9, 22),
            (5, 6, 7, 8, 17, 18, 19, 20, 23),
        ]
    },
}
SIDES["T"][3] = [(1, 2, 4, 5, 9, 8), (2, 3, 4, 6, 10, 9), (1, 4, 3, 8, 10, 7), (1, 3, 2, 7, 6, 5)]
WEDGE = [
    *((1, 2, 5, 4, 7, 11, 13, 10, 16), (2, 3, 6, 5, 8, 12, 14, 11, 17)),
    *((1, 4, 6, 3, 10, 15, 12, 9, 18), (1, 3, 2, 9, 8, 7), (4, 5, 6, 13, 14, 15)),
]
PYRAMID = [
    *((1, 2, 5, 6, 11, 10), (2, 3, 5, 7, 12, 11), (3, 4, 5, 8, 13, 12), (1, 5, 4, 10, 13, 9)),
    (1, 4, 3, 2, 9, 8, 7, 6, 14),
]
TYPE = {"T3": "TRI3", "T6": "tri6", "Q4": "QUAD", "Q8": "QUAD8", "Q9": "QUAD9", "T4": "TETRA"}
TYPE |= {"T10": "TET10", "H8": "HEX8", "H20": "HEX20", "H27": "HEX"}


class Classic:
    """A file of classic netCDF as it is written."""

    def __init__(self, path):
        self.file = netcdf_file(path, "w")

    def add(self, name, values, type_=None):
        values = np.asarray(values)
        for i, n in enumerate(values.shape):
            self.file.createDimension(f"{name}_{i}", n)
        kind = {"S": "c", "f": "d"}.get(values.dtype.kind, values.dtype.kind)
        dims = tuple(f"{name}_{i}" for i in range(values.ndim))
        variable = self.file.createVariable(name, kind, dims)
        variable[:] = values
        if type_:
            variable.elem_type = type_

    def close(self):
        self.file.close()


class Hdf:
    """A file of netCDF 4, which is HDF5."""

    def __init__(self, path):
        self.file = h5py.File(path, "w")

    def add(self, name, values, type_=None):
        self.file[name] = values
        if type_:
            self.file[name].attrs["elem_type"] = np.bytes_(type_)

    def close(self):
        self.file.close()


def letters(names):
    return np.array([list(name.ljust(33, "\0")) for name in names], dtype="S1")


def write(file, points, blocks, sides=(), nodes=(), names=True, block_ids=None):
    """blocks : (name, type, cells in the order of Exodus); sides : (name, elements, sides), and
    nodes : (name, nodes), all counted from 0.
    """
    for axis, x in zip("xyz", points.T, strict=False):
        file.add(f"coord{axis}", x)
    for kind, entries in (("eb", blocks), ("ss", sides), ("ns", nodes)):
        if entries:
            ids = block_ids if kind == "eb" and block_ids else np.arange(len(entries)) + 10
            file.add(f"{kind}_prop1", ids)
            file.add(f"{kind}_names", letters([e[0] if names else "" for e in entries]))
    for i, (_, type_, cells) in enumerate(blocks, 1):
        file.add(f"connect{i}", cells + 1, type_)
    for i, (_, elements, numbers) in enumerate(sides, 1):
        file.add(f"elem_ss{i}", np.asarray(elements) + 1)
        file.add(f"side_ss{i}", np.asarray(numbers) + 1)
    for i, (_, members) in enumerate(nodes, 1):
        file.add(f"node_ns{i}", np.asarray(members) + 1)
    file.close()


def order(element):
    """Return Exodus's order of nodes, in numbers of VTK's: by the places of nodes on the sides."""
    table = SIDES[element.name[0]][element.dim]
    count = element.nodes
    if count <= element.n_vertices:
        return list(range(count))
    supports = [frozenset((i,)) for i in range(element.n_vertices)]
    supports += [frozenset(s) for s in element.supports]
    place = {support: i for i, support in enumerate(supports)}
    found = dict(enumerate(range(element.n_vertices)))
    for side in table:
        v = element.cell.facet_vertices
        corners = [n - 1 for n in side[:v]]
        for k, n in enumerate(side[v:]):
            inside = k == v or element.dim == 2
            around = corners if inside else [corners[k], corners[(k + 1) % v]]
            if frozenset(around) in place and n <= count:
                found[n - 1] = place[frozenset(around)]
    left = set(range(count)) - set(found.values())
    found |= dict(zip(sorted(set(range(count)) - set(found)), sorted(left), strict=True))
    return [found[i] for i in range(count)]


def of_mesh(mesh):
    """Return blocks, side sets and node sets of a mesh."""
    in_order = mesh.cells[:, order(mesh.element)]
    parts = [np.flatnonzero(mesh.cell_region == i) for i in range(len(mesh.regions))]
    blocks = [
        (n, TYPE[mesh.element.name], in_order[p]) for n, p in zip(mesh.regions, parts, strict=True)
    ]
    cells = np.concatenate([cells for *_, cells in blocks])
    v = mesh.element.cell.facet_vertices
    table = SIDES[mesh.element.name[0]][mesh.dim]
    side_of = {
        frozenset(cell[n - 1] for n in side[:v]): (e, s)
        for e, cell in enumerate(cells)
        for s, side in enumerate(table)
    }
    sides = [
        (tag, *np.transpose([side_of[frozenset(nodes)] for nodes in facets[:, :v]]))
        for tag, facets in mesh.facets.items()
    ]
    return blocks, sides, [(tag, np.unique(facets)) for tag, facets in mesh.facets.items()]


@pytest.mark.parametrize("kind", [Classic, Hdf])
@pytest.mark.parametrize("name", MESHES)
def test_blocks_and_side_sets(tmp_path, name, kind):
    mesh = MESHES[name]
    blocks, sides, nodes = of_mesh(mesh)
    write(kind(tmp_path / "a.e"), mesh.points, blocks, sides, nodes)
    read = read_mesh(tmp_path / "a.e", mesh.dim)
    assert np.array_equal(read.points, mesh.points)
    assert same_facets(read.facets, mesh.facets) and set(read.regions) == set(mesh.regions)
    regions = [read.regions[i] for i in read.cell_region]
    own = [mesh.regions[i] for i in mesh.cell_region]
    assert set(zip(regions, map(tuple, read.cells), strict=True)) == set(
        zip(own, map(tuple, mesh.cells), strict=True)
    )


def test_numbers_of_blocks_and_side_sets_without_names(tmp_path):
    mesh = MESHES["Q4"]
    blocks, sides, _ = of_mesh(mesh)
    write(Classic(tmp_path / "a.exo"), mesh.points, blocks, sides, names=False, block_ids=[7, 3])
    read = read_mesh(tmp_path / "a.exo", 2)
    assert set(read.regions) == {"group_7", "group_3"}
    expected = {f"group_{10 + i}": mesh.facets[tag] for i, (tag, *_) in enumerate(sides)}
    assert same_facets(read.facets, expected)


def test_node_sets_name_the_boundary_where_there_are_no_side_sets(tmp_path):
    mesh = MESHES["T4"]
    blocks, _, nodes = of_mesh(mesh)
    nodes = [entry for entry in nodes if entry[0] in ("left", "right")]
    write(Classic(tmp_path / "a.g"), mesh.points, blocks, nodes=nodes)
    read = read_mesh(tmp_path / "a.g", 3)
    assert all(same_facets({"x": read.facets[t]}, {"x": mesh.facets[t]}) for t in ("left", "right"))


SHAPES = {  # vertices, sides, numbers of nodes, volume
    "WEDGE": (
        [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (0, 1, 1)],
        WEDGE,
        (6, 15, 18),
        1 / 2,
    ),
    "PYRAMID": (
        [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0.25, 0.25, 1)],
        PYRAMID,
        (5, 13, 14),
        1 / 3,
    ),
}


def places(vertices, sides, count):
    """Return where the nodes of a cell are, (count, 3), by the sides that have them."""
    points = np.full((count, 3), np.nan)
    points[: len(vertices)] = vertices
    for side in sides:
        v = 4 if len(side) > 6 else 3
        corners = np.array(side[:v]) - 1
        for k, n in enumerate(side[v:]):
            ends = corners if k == v else [corners[k], corners[(k + 1) % v]]
            if n <= count:
                points[n - 1] = points[ends].mean(axis=0)
    return points


@pytest.mark.parametrize(
    ("type_", "count"), [(name, n) for name, shape in SHAPES.items() for n in shape[2]]
)
def test_sides_of_prisms_and_pyramids(tmp_path, type_, count):
    vertices, table, _, volume = SHAPES[type_]
    points = places(vertices, table, count)
    assert not np.isnan(points).any()
    sides = [(f"s{i}", [0], [i]) for i in range(5)]
    blocks = [("b", type_, np.arange(count)[None])]
    write(Hdf(tmp_path / "a.e"), points, blocks, sides)
    read = read_mesh(tmp_path / "a.e", 3)
    element = read.element
    at, weights = element.cell.quadrature(4)
    dn = element.gradient(at)
    jacobian = np.einsum("qai,eaj->eqij", dn, read.points[read.cells])
    assert np.isclose((weights * np.linalg.det(jacobian)).sum(), volume, rtol=1e-12)
    for i, side in enumerate(table):
        corners = points[np.array(side[: 4 if len(side) > 6 else 3]) - 1]
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        facets = read.points[read.facets[f"s{i}"]]
        assert np.abs((facets - corners[0]) @ normal).max() < 1e-12


def test_what_is_no_exodus_file_or_has_other_elements_is_refused(tmp_path):
    path = tmp_path / "a.e"
    path.write_bytes(b"CDF\5" + bytes(100))
    refused(path, 3, "no Exodus file in classic netCDF or HDF5; write it again as one of them")
    path.write_bytes(b"CDF\1" + bytes(100))
    refused(path, 3, "not readable as a mesh")
    mesh = MESHES["T3"]
    blocks, sides, _ = of_mesh(mesh)
    write(Classic(path), mesh.points, [(blocks[0][0], "TRI7", blocks[0][2])])
    assert read_mesh(path, 2).element.name == "T3"
    write(Classic(path), mesh.points, [("b", "NSIDED", np.arange(5)[None])])
    refused(path, 2, "polygons or polyhedra; mesh the body with triangles")
    write(Classic(path), mesh.points, [("b", "TRI7", np.arange(7)[None])])
    refused(path, 2, "elements of the type TRI7 with 7 nodes; write TRI3, HEX8")
    write(Classic(path), mesh.points, blocks, [("far", [99], [0])])
    refused(path, 2, "side 1 of an element in side set far is not there")
    in_space = np.pad(mesh.points, ((0, 0), (0, 1)))
    write(Classic(path), in_space, blocks, [(n, e, s + 2) for n, e, s in sides])
    assert same_facets(read_mesh(path, 2).facets, mesh.facets)
    write(Classic(path), in_space, blocks, sides)
    refused(path, 2, "has faces of the plane mesh, no edges; write the mesh in two dimensions")
