"""Tags apart from the mesh: further grids of an XDMF file, and a further file with facets."""

import h5py
import meshio
import numpy as np
import pytest
from test_mesh_read import MESHES, as_meshio, blocks, refused, same_facets, write22

from porofsi_petsc.errors import InputError
from porofsi_petsc.mesh import read_mesh
from porofsi_petsc.mesh.read import Reading

# DOLFINx's names of cells, io/xdmf_utils.cpp, those of order 2 with their number of nodes
TOPOLOGY = {"line": "PolyLine", "line3": "Edge_3", "triangle": "Triangle", "quad": "Quadrilateral"}
TOPOLOGY |= {"triangle6": "Triangle_6", "quad9": "Quadrilateral_9", "tetra": "Tetrahedron"}
TOPOLOGY |= {"tetra10": "Tetrahedron_10", "hexahedron": "Hexahedron"}
TOPOLOGY |= {"hexahedron27": "Hexahedron_27"}
NUMBERS = {tag: i for i, tag in enumerate(("bottom", "top", "left", "right", "front", "back"), 1)}
NUMBERS |= {"strip": 7, "body": 8, "core": 9}


class Xdmf:
    """A file as it is built: XML, and numbers in one of the three ways."""

    def __init__(self, folder, kind="HDF", name="a"):
        self.folder, self.kind, self.name = folder, kind, name
        self.grids = []
        self.count = 0

    def item(self, values):
        self.count += 1
        values = np.ascontiguousarray(values)
        name = (
            "UInt" if values.dtype.kind == "u" else "Int" if values.dtype.kind == "i" else "Float"
        )
        head = f'<DataItem Dimensions="{" ".join(map(str, values.shape))}" Format="{self.kind}"'
        head += f' NumberType="{name}" Precision="{values.dtype.itemsize}"'
        if self.kind == "HDF":
            with h5py.File(self.folder / f"{self.name}.h5", "a") as file:
                file[f"/data/{self.count}"] = values
            return f"{head}>{self.name}.h5:/data/{self.count}</DataItem>"
        if self.kind == "XML":
            return f"{head}>\n{' '.join(map(repr, values.ravel().tolist()))}\n</DataItem>"
        values.astype(values.dtype.newbyteorder(">")).tofile(self.folder / f"{self.count}.bin")
        return f'{head} Endian="Big">{self.count}.bin</DataItem>'

    def topology(self, kind, cells):
        head = f'TopologyType="{TOPOLOGY[kind]}" NumberOfElements="{len(cells)}"'
        return f'<Topology {head} NodesPerElement="{cells.shape[1]}">{self.item(cells)}</Topology>'

    def geometry(self, points):
        kind = "XYZ"[: points.shape[1]]
        return f'<Geometry GeometryType="{kind}">{self.item(points)}</Geometry>'

    def attribute(self, name, values):
        head = f'Name="{name}" AttributeType="Scalar" Center="Cell"'
        return f"<Attribute {head}>{self.item(np.reshape(values, (-1, 1)))}</Attribute>"

    def grid(self, name, *parts):
        self.grids.append(f'<Grid Name="{name}" GridType="Uniform">{"".join(parts)}</Grid>')

    def write(self):
        space = 'xmlns:xi="https://www.w3.org/2001/XInclude"'
        text = f'<Xdmf Version="3.0" {space}><Domain>{"".join(self.grids)}</Domain></Xdmf>'
        path = self.folder / f"{self.name}.xdmf"
        path.write_text('<?xml version="1.0"?>\n<!DOCTYPE Xdmf SYSTEM "Xdmf.dtd" []>\n' + text)
        return path


MESH_OF = "<xi:include xpointer=\"xpointer(/Xdmf/Domain/Grid[@Name='mesh']/Geometry)\" />"


def tagged_facets(mesh):
    facets = np.concatenate(list(mesh.facets.values()))
    numbers = [np.full(len(nodes), NUMBERS[tag]) for tag, nodes in mesh.facets.items()]
    return facets, np.concatenate(numbers).astype(np.int32)


def cell_numbers(mesh):
    return np.array([NUMBERS[name] for name in mesh.regions], dtype=np.int32)[mesh.cell_region]


def same_by_number(read, mesh):
    """Return whether a mesh has the groups of another one by their numbers."""
    facets = {f"group_{NUMBERS[tag]}": nodes for tag, nodes in mesh.facets.items()}
    regions = [read.regions[i] for i in read.cell_region]
    expected = [f"group_{n}" for n in cell_numbers(mesh)]
    return (
        np.array_equal(read.points, mesh.points)
        and np.array_equal(read.cells, mesh.cells)
        and same_facets(read.facets, facets)
        and regions == expected
    )


@pytest.mark.parametrize("kind", ["HDF", "XML", "Binary"])
@pytest.mark.parametrize("name", ["T3", "T6", "Q4", "Q9", "T4", "T10", "H8", "H27"])
def test_tags_in_further_grids_as_dolfinx_writes_them(tmp_path, name, kind):
    """The geometry is that of the first grid; the tagged cells come in another order."""
    mesh = MESHES[name]
    file = Xdmf(tmp_path, kind)
    cells = mesh.element.meshio_name
    file.grid("mesh", file.topology(cells, mesh.cells), file.geometry(mesh.points))
    order = np.random.default_rng(0).permutation(len(mesh.cells))
    values = file.attribute("cell_tags", cell_numbers(mesh)[order])
    file.grid("cell_tags", MESH_OF, file.topology(cells, mesh.cells[order]), values)
    facets, numbers = tagged_facets(mesh)
    of_facets = file.topology(mesh.element.facet.meshio_name, facets)
    plain = '<xi:include xpointer="xpointer(/Xdmf/Domain/Grid/Geometry)" />'
    file.grid("facet_tags", plain, of_facets, file.attribute("facet_tags", numbers))
    assert same_by_number(read_mesh(file.write(), mesh.dim), mesh)


@pytest.mark.parametrize("unmarked", [0, np.iinfo(np.uint64).max])
@pytest.mark.parametrize("name", ["T3", "T4"])
def test_functions_on_all_facets_as_legacy_fenics_writes_them(tmp_path, name, unmarked):
    """Their number for none of the groups is no group; topologies may be referred to."""
    mesh = MESHES[name]
    file = Xdmf(tmp_path)
    reference = '<{0} Reference="XML">/Xdmf/Domain/Grid[1]/{0}</{0}>'
    values = file.attribute("f", cell_numbers(mesh).astype(np.uint64))
    body = file.topology(mesh.element.meshio_name, mesh.cells)
    file.grid("mesh", body, file.geometry(mesh.points))
    file.grid("f", reference.format("Topology"), reference.format("Geometry"), values)
    all_facets = mesh.cells[:, np.array(mesh.element.facets)].reshape(-1, mesh.dim)
    all_facets = np.unique(np.sort(all_facets, axis=1), axis=0)
    number = {tuple(sorted(row)): n for row, n in zip(*tagged_facets(mesh), strict=True)}
    numbers = np.array([number.get(tuple(row), unmarked) for row in all_facets], dtype=np.uint64)
    assert (numbers == unmarked).any()
    facets = file.topology(mesh.element.facet.meshio_name, all_facets)
    file.grid("f", facets, file.geometry(mesh.points), file.attribute("f", numbers))
    read = read_mesh(file.write(), mesh.dim)
    assert same_by_number(read, mesh)
    assert (unmarked == 0) == any("of number 0, inside the body too" in n for n in read.notes)


@pytest.mark.parametrize("renumbered", [False, True])
@pytest.mark.parametrize("name", ["T3", "Q4", "T10", "H8"])
def test_a_pair_of_files_as_meshio_makes_it_of_one_of_gmsh(tmp_path, name, renumbered):
    """Nodes of other numbers, those of no facet left out, are found by their place."""
    mesh = MESHES[name]
    key = "name_to_read"
    of_cells = {key: [cell_numbers(mesh)]}
    cells = [(mesh.element.meshio_name, mesh.cells)]
    meshio.Mesh(mesh.points, cells, cell_data=of_cells).write(tmp_path / "mesh.xdmf")
    facets, numbers = tagged_facets(mesh)
    points = np.pad(mesh.points, ((0, 0), (0, 3 - mesh.dim)))
    if renumbered:
        used, facets = np.unique(facets, return_inverse=True)
        facets = facets.reshape(len(numbers), -1)
        points = points[used]
    cells = [(mesh.element.facet.meshio_name, facets)]
    meshio.Mesh(points, cells, cell_data={key: [numbers]}).write(tmp_path / "facets.xdmf")
    reading = Reading(facets=str(tmp_path / "facets.xdmf"))
    assert same_by_number(read_mesh(tmp_path / "mesh.xdmf", mesh.dim, reading), mesh)
    reading = Reading(array=key, facets=str(tmp_path / "facets.xdmf"))
    assert same_by_number(read_mesh(tmp_path / "mesh.xdmf", mesh.dim, reading), mesh)


def test_facets_of_a_file_of_gmsh_keep_their_names(tmp_path):
    mesh = MESHES["T6"]
    meshio.Mesh(mesh.points, [("triangle6", mesh.cells)]).write(tmp_path / "mesh.vtu")
    write22(tmp_path / "all.msh", mesh.points, blocks(mesh))
    reading = Reading(facets=str(tmp_path / "all.msh"))
    read = read_mesh(tmp_path / "mesh.vtu", 2, reading)
    assert same_facets(read.facets, mesh.facets) and read.regions == ("body",)


def test_cells_of_several_kinds_in_one_grid(tmp_path):
    """Kinds by number, those of lines with the number of nodes behind it."""
    mesh = MESHES["T3"]
    source = as_meshio(mesh.points, blocks(mesh))
    data = {"MaterialIDs": source.cell_data["gmsh:physical"]}
    for suffix in ("HDF", "XML"):
        written = meshio.Mesh(source.points, source.cells, cell_data=data)
        meshio.write(tmp_path / "a.xdmf", written, data_format=suffix)
        read = read_mesh(tmp_path / "a.xdmf", 2)
        groups = {f"group_{source.field_data[tag][0]}": n for tag, n in mesh.facets.items()}
        assert same_facets(read.facets, groups) and len(read.regions) == 2


def test_what_does_not_fit_is_refused(tmp_path):
    mesh = MESHES["T3"]
    facets, numbers = tagged_facets(mesh)

    def pair(points, arrays, name="mesh.xdmf"):
        data = {name: [values] for name, values in arrays.items()}
        written = meshio.Mesh(points, [("line", facets)], cell_data=data)
        written.write(tmp_path / "facets.xdmf")
        return read_mesh(tmp_path / name, 2, Reading(facets=str(tmp_path / "facets.xdmf")))

    meshio.Mesh(mesh.points, [("triangle", mesh.cells)]).write(tmp_path / "mesh.xdmf")
    with pytest.raises(
        InputError, match="1[0-9] nodes of the tags are none of the mesh, the first"
    ):
        pair(mesh.points * 2 + 0.1, {"f": numbers})
    with pytest.raises(InputError, match="none.xdmf: no such mesh file; check mesh.facets in the"):
        read_mesh(tmp_path / "mesh.xdmf", 2, Reading(facets=str(tmp_path / "none.xdmf")))
    with pytest.raises(InputError, match="facets.xdmf: mesh.facets, and no facets of it are in"):
        pair(mesh.points, {})
    doubled = np.vstack([mesh.points, mesh.points[:1]])
    written = meshio.Mesh(doubled, [("triangle", mesh.cells)])
    written.write(tmp_path / "twice.xdmf")
    with pytest.raises(InputError, match="1 nodes of the tags are at two nodes of the mesh, the"):
        pair(mesh.points, {"f": numbers}, "twice.xdmf")
    with pytest.raises(InputError, match=r"several integer arrays over the cells \(f, g\)"):
        pair(mesh.points, {"f": numbers, "g": numbers * 0 + 1})
    with pytest.raises(InputError, match=r"mesh.array = 'h', but the file .* choose from f"):
        pair(mesh.points, {"f": numbers})
        facets_file = str(tmp_path / "facets.xdmf")
        read_mesh(tmp_path / "mesh.xdmf", 2, Reading(array="h", facets=facets_file))
    file = Xdmf(tmp_path)
    body = file.topology("triangle", mesh.cells)
    file.grid("mesh", body, file.geometry(mesh.points), file.attribute("f", cell_numbers(mesh)))
    values = file.attribute("g", cell_numbers(mesh))
    file.grid("tags", MESH_OF, file.topology("triangle", mesh.cells), values)
    path = file.write()
    refused(
        path, 2, r"several arrays of integers over the cells \(f, g\); leave one with the groups"
    )
    assert len(read_mesh(path, 2, Reading(array="g")).regions) == 2
    (tmp_path / "a.h5").unlink()
    refused(path, 2, "its numbers are in a.h5, and there is no such file beside it")
    file = Xdmf(tmp_path, "XML", "b")
    file.grid("mesh", file.topology("triangle", mesh.cells), file.geometry(mesh.points))
    other = file.topology("triangle", mesh.cells[:, [0, 1, 1]])
    file.grid("tags", MESH_OF, other, file.attribute("f", cell_numbers(mesh)))
    refused(file.write(), 2, "tagged cells are none of the mesh, the first at")
