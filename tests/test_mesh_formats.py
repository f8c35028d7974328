"""Mesh files of other programs than Gmsh, in the dialects that are found."""

from types import SimpleNamespace

import meshio
import numpy as np
import pytest
from grids import grid
from test_mesh_read import AXIS, MESHES, as_meshio, blocks, refused, same_facets

from porofsi_petsc.mesh import read_mesh
from porofsi_petsc.mesh.read import Reading

ABAQUS = {"T3": "CPE3", "T6": "CPE6P", "Q4": "CAX4P", "Q8": "CPS8R"}
ABAQUS |= {"T4": "C3D4", "T10": "C3D10M", "H8": "C3D8RP", "H20": "C3D20R"}
# Vertices of the faces of Abaqus's elements (Analysis User's Guide, "Solid element library")
QUADRILATERAL = [(1, 2), (2, 3), (3, 4), (4, 1)]
TETRAHEDRON = [(1, 2, 3), (1, 4, 2), (2, 4, 3), (3, 4, 1)]
HEXAHEDRON = [(1, 2, 3, 4), (5, 8, 7, 6), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 8, 4), (4, 8, 5, 1)]
FACES = {"T": {2: [(1, 2), (2, 3), (3, 1)], 3: TETRAHEDRON}, "Q": {2: QUADRILATERAL}}
FACES["H"] = {3: HEXAHEDRON}


def abaqus(mesh, more=(), before=()):
    """Return the text of a mesh, numbers from 11 on: regions as sets of elements, facets as
    surfaces.
    """
    lines = ["*Heading", " a mesh", *before, "** nodes", "*NODE, NSET=Nall"]
    lines += [f"{i + 11}, " + ", ".join(map(repr, x)) for i, x in enumerate(mesh.points.tolist())]
    lines += [f"*Element, type={ABAQUS[mesh.element.name]},", " elset=Eall"]
    for e, nodes in enumerate((mesh.cells + 11).tolist()):
        words = [e + 11, *nodes]
        lines += [", ".join(map(str, words[:12])) + ","] if len(words) > 12 else []
        lines.append(", ".join(map(str, words[12:] if len(words) > 12 else words)))
    for i, name in enumerate(mesh.regions):
        lines += [f"*Elset, elset={name}"]
        lines += [f"{e + 11}," for e in np.flatnonzero(mesh.cell_region == i)]
    faces = FACES[mesh.element.name[0]][mesh.dim]
    of_facet = {
        frozenset(cell[v - 1] for v in face): (e, s)
        for e, cell in enumerate(mesh.cells)
        for s, face in enumerate(faces, start=1)
    }
    for tag, facets in mesh.facets.items():
        lines += [f"*Surface, type=ELEMENT, name={tag}"]
        for nodes in facets[:, : mesh.element.cell.facet_vertices]:
            e, s = of_facet[frozenset(nodes)]
            lines.append(f"{e + 11}, S{s}")
    return "\n".join([*lines, *more, ""])


@pytest.mark.parametrize("name", ABAQUS)
def test_sets_and_surfaces_of_abaqus(tmp_path, name):
    mesh = MESHES[name]
    (tmp_path / "a.inp").write_text(abaqus(mesh))
    read = read_mesh(tmp_path / "a.inp", mesh.dim)
    assert np.array_equal(read.points, mesh.points) and np.array_equal(read.cells, mesh.cells)
    assert same_facets(read.facets, mesh.facets) and set(read.regions) == set(mesh.regions)
    assert read.notes == ("groups of cells left out, all of which are in other groups: Eall",)


def test_an_abaqus_file_by_the_name_that_calculix_gives_it(tmp_path):
    (tmp_path / "all.msh").write_text(abaqus(MESHES["T4"]))
    assert same_facets(read_mesh(tmp_path / "all.msh", 3).facets, MESHES["T4"].facets)


def test_an_assembly_of_abaqus(tmp_path):
    """Sections say which sets are regions; the set of a surface is none; a part may be moved."""
    mesh = grid("H8", [AXIS] * 3)
    bottom = np.flatnonzero(mesh.points[:, 2] == 0) + 11
    more = ["*Solid Section, elset=EALL, material=clay", "1.,", "*End Part", "*Assembly, name=A"]
    more += ["*Instance, name=I-1, part=P", "1., 2., 3.", "*End Instance"]
    more += ["*Elset, elset=_top_S2, internal, instance=I-1, generate", "29, 37, 1"]
    more += ["*Surface, type=ELEMENT, name=lid", "_top_S2, S2"]
    more += ["*Nset, nset=half, instance=I-1", ", ".join(map(str, bottom[:3])), "*Nset, nset=base"]
    more += ["half,", *(f"{n}," for n in bottom[3:]), "*End Assembly", "*Step", "*End Step"]
    text = abaqus(mesh, more, before=["*Part, name=P"])
    begin = text.index("*Surface, type=ELEMENT, name=left")
    (tmp_path / "a.inp").write_text(text[:begin] + text[text.index("*Solid Section") :])
    read = read_mesh(tmp_path / "a.inp", 3, Reading(groups=("body", "lid", "base")))
    assert np.array_equal(read.points, mesh.points + [1, 2, 3])
    assert same_facets({"b": read.facets["base"]}, {"b": mesh.facets["bottom"]})
    assert same_facets({"t": read.facets["lid"]}, {"t": mesh.facets["top"]})
    assert read.regions == ("body",)
    assert read_mesh(tmp_path / "a.inp", 3).regions == ("Eall",)


def test_numbers_of_nodes_that_two_parts_share_are_refused(tmp_path):
    text = abaqus(MESHES["T3"])
    (tmp_path / "a.inp").write_text(text + text)
    refused(tmp_path / "a.inp", 2, "two nodes with one number, of two parts; write one part")
    (tmp_path / "a.inp").write_text(text.replace("CPE3", "CINPE3"))
    refused(tmp_path / "a.inp", 2, "elements of the type CINPE3; mesh the body with")
    (tmp_path / "a.inp").write_text("*NGEN\n1, 9, 1\n" + text)
    refused(tmp_path / "a.inp", 2, r"\*NGEN makes nodes or elements; write the mesh without it")


def test_sets_that_overlap(tmp_path):
    mesh = MESHES["T3"]
    text = abaqus(mesh) + "*Elset, elset=part\n11, 12\n"
    (tmp_path / "a.inp").write_text(text)
    refused(tmp_path / "a.inp", 2, "in two groups, '(core|body)' and 'part'; leave it in one, or")
    read = read_mesh(tmp_path / "a.inp", 2, Reading(groups=("part", "core", "left")))
    assert read.regions == ("body", "part", "core") and (read.cell_region == 1).sum() == 2


def prisms(n, layers=2):
    """Return the text of a legacy VTK file of a column of prisms over a regular polygon."""
    angle = 2 * np.pi * np.arange(n) / n
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points = [(*x, z) for z in range(layers + 1) for x in ring]
    cells = [np.concatenate([np.arange(n), n + np.arange(n)]) + n * k for k in range(layers)]
    lines = ["# vtk DataFile Version 2.0", "prisms", "ASCII", "DATASET UNSTRUCTURED_GRID"]
    lines += [f"POINTS {len(points)} double", *(" ".join(map(repr, map(float, x))) for x in points)]
    lines += [f"CELLS {layers} {layers * (1 + 2 * n)}"]
    lines += [" ".join(map(str, (2 * n, *cell))) for cell in cells]
    lines += [f"CELL_TYPES {layers}", *[str({5: 15, 6: 16}[n])] * layers, f"CELL_DATA {layers}"]
    lines += ["SCALARS attribute float 1", "LOOKUP_TABLE default", *map(str, range(layers))]
    return "\n".join([*lines, ""])


@pytest.mark.parametrize("n", [5, 6])
def test_prisms_over_polygons_are_cut(tmp_path, n):
    (tmp_path / "a.vtk").write_text(prisms(n))
    mesh = read_mesh(tmp_path / "a.vtk", 3)
    assert mesh.element.name == "H8" and len(mesh.cells) == 2 * (n - 2)
    assert len(mesh.facets["top"]) == len(mesh.facets["bottom"]) == n - 2
    assert sum(map(len, mesh.facets.values())) == 2 * (n - 2) + 2 * n
    assert mesh.notes[0] == "2 prisms over pentagons or hexagons are cut into wedges"


ARRAYS = {  # array over the cells, in which meshio writes numbers
    ".vtk": "MaterialIDs",
    ".vtu": "material_id",
    ".xdmf": "MaterialIDs",
    ".mesh": "medit:ref",
    ".bdf": "nastran:ref",
}


@pytest.mark.parametrize("name", ["T3", "Q4", "T4", "H8"])
@pytest.mark.parametrize("suffix", ARRAYS)
def test_numbers_of_materials(tmp_path, suffix, name):
    mesh = MESHES[name]
    source = as_meshio(mesh.points, blocks(mesh))
    numbers = source.cell_data["gmsh:physical"]
    other = [np.zeros(len(n), dtype=int) for n in numbers]
    arrays = {ARRAYS[suffix]: numbers} | ({"other": other} if suffix in (".vtk", ".vtu") else {})
    meshio.Mesh(source.points, source.cells, cell_data=arrays).write(tmp_path / f"a{suffix}")
    read = read_mesh(tmp_path / f"a{suffix}", mesh.dim)
    assert np.allclose(read.points, mesh.points, rtol=0, atol=1e-12)
    # numbers that MPI takes: VTU's say explicitly that they are little-endian
    assert [memoryview(array).format for array in (read.points, read.cells)] == ["d", "l"]
    groups = {f"group_{source.field_data[tag][0]}": nodes for tag, nodes in mesh.facets.items()}
    assert same_facets(read.facets, groups)
    assert set(read.regions) == {f"group_{source.field_data[r][0]}" for r in mesh.regions}


@pytest.mark.parametrize("name", ["T6", "T4", "H20"])
def test_families_of_a_med_file(tmp_path, name):
    """A family is in all groups whose names it has; nodes have families too."""
    mesh = MESHES[name]
    groups = blocks(mesh)
    kinds = list(dict.fromkeys(kind for kind, *_ in groups))
    cells = [(k, np.concatenate([c for kind, _, _, c in groups if kind == k])) for k in kinds]
    names = [[n for kind, _, n, _ in groups if kind == k] for k in kinds]
    sizes = [[len(c) for kind, _, _, c in groups if kind == k] for k in kinds]
    families = {
        n: -6 - i for i, n in enumerate(dict.fromkeys(n for of_kind in names for n in of_kind))
    }
    families["top"] = families["bottom"] = 0
    numbers = [
        np.repeat([families[n] for n in of_kind], size)
        for of_kind, size in zip(names, sizes, strict=True)
    ]
    source = meshio.Mesh(mesh.points, cells, cell_data={"cell_tags": numbers})
    own = {f: [n] for n, f in families.items() if f}
    own[families["left"]] += ["sides"]
    own[families["right"]] += ["sides"]
    on_bottom = mesh.points[:, -1] == 0
    source.point_data["point_tags"] = np.where(on_bottom, 3, 0)
    source.cell_tags, source.point_tags = own, {3: ["floor"]}
    source.write(tmp_path / "a.med")
    read = read_mesh(tmp_path / "a.med", mesh.dim)
    expected = mesh.facets | {"floor": mesh.facets["bottom"]}
    expected = {tag: nodes for tag, nodes in expected.items() if tag != "bottom"}
    assert same_facets(read.facets, expected) and set(read.regions) == set(mesh.regions)
    assert "groups of facets left out, all of which are in other groups: sides" in read.notes


def test_a_format_whose_groups_are_not_read(tmp_path):
    (tmp_path / "a.unv").write_text("CDF")
    refused(tmp_path / "a.unv", 3, "not read; save the mesh as Gmsh .msh 2.2 or 4.1, Abaqus")


# Kratos's order of nodes in numbers of VTK's (kratos/geometries/hexahedra_3d_27.h: bottom, sides
# and top have the edges 8, 12 and 16 on, and faces are bottom, front, right, back, left and top)
KRATOS_EDGES = [*range(12), *range(16, 20), *range(12, 16)]
KRATOS = {"H20": KRATOS_EDGES, "H27": [*KRATOS_EDGES, 24, 22, 21, 23, 20, 25, 26]}


def kratos(mesh, more=""):
    """Return the text of a mesh for Kratos, its parts one in the other, numbers from 11 on."""
    order = KRATOS.get(mesh.element.name, list(range(mesh.element.nodes)))
    lines = ["Begin ModelPartData", "End ModelPartData // none", "Begin Nodes"]
    for i, x in enumerate(mesh.points.tolist(), 11):
        lines.append(" ".join(map(repr, (i, *(*x, 0.0)[:3]))))
    lines += ["End Nodes", f"Begin Elements SmallDisplacementElement{mesh.dim}D{len(order)}N"]
    lines += [
        " ".join(map(str, (e, 1, *row))) for e, row in enumerate(mesh.cells[:, order] + 11, 21)
    ]
    lines.append("End Elements")
    parts, number = [], 31
    for i, name in enumerate(mesh.regions):
        cells = np.flatnonzero(mesh.cell_region == i) + 21
        parts.append((name, "Elements", cells))
    for tag, facets in mesh.facets.items():
        lines.append(f"Begin Conditions FaceLoadCondition{mesh.dim}D{facets.shape[1]}N // {tag}")
        lines += [" ".join(map(str, (number + f, 0, *row))) for f, row in enumerate(facets + 11)]
        lines.append("End Conditions")
        parts.append((tag, "Conditions", number + np.arange(len(facets))))
        number += len(facets)
    lines += ["Begin SubModelPart whole", "Begin SubModelPartData", "X 1", "End SubModelPartData"]
    for name, what, numbers in parts:
        lines += [f"Begin SubModelPart {name}", f"Begin SubModelPart{what}", *map(str, numbers)]
        lines += [f"End SubModelPart{what}", "End SubModelPart"]
    return "\n".join([*lines, "End SubModelPart", more])


@pytest.mark.parametrize("name", MESHES)
def test_sub_model_parts_of_kratos(tmp_path, name):
    mesh = MESHES[name]
    (tmp_path / "a.mdpa").write_text(kratos(mesh))
    read = read_mesh(tmp_path / "a.mdpa", mesh.dim)
    assert np.array_equal(read.points, mesh.points) and np.array_equal(read.cells, mesh.cells)
    assert same_facets(read.facets, mesh.facets) and set(read.regions) == set(mesh.regions)


def test_nodes_of_kratos_and_what_is_refused(tmp_path):
    mesh = MESHES["T4"]
    text = kratos(mesh)
    nodes = "\n".join(str(n + 11) for n in np.unique(mesh.facets["left"]))
    more = f"Begin SubModelPart held\nBegin SubModelPartNodes\n{nodes}\nEnd SubModelPartNodes\n"
    (tmp_path / "a.mdpa").write_text(text.replace("t left", "t x") + more + "End SubModelPart\n")
    read = read_mesh(tmp_path / "a.mdpa", 3, Reading(groups=["held"]))
    assert same_facets({"x": read.facets["held"]}, {"x": mesh.facets["left"]})
    (tmp_path / "a.mdpa").write_text(text + text[text.index("Begin SubModelPart ") :])
    refused(tmp_path / "a.mdpa", 3, "two sub model parts 'whole'; rename one")
    (tmp_path / "a.mdpa").write_text(text.replace("3D4N", "3D").replace("3D3N", "3D"))
    assert same_facets(read_mesh(tmp_path / "a.mdpa", 3).facets, mesh.facets)
    (tmp_path / "a.mdpa").write_text(text.replace("Element3D4N", "Element4N"))
    refused(tmp_path / "a.mdpa", 3, "elements of the type SmallDisplacementElement4N with 4 nodes")


FEBIO = {"T3": "tri3", "T6": "tri6", "Q4": "quad4", "Q8": "quad8", "T4": "tet4", "T10": "tet10"}
FEBIO |= {"H8": "hex8", "H20": "hex20"}


def febio(mesh, one_by_one=False):
    """Return a model of FEBio 4, or of 2.5, in which node sets have an element for each node."""
    lines = ['<febio_spec version="4.0"><Mesh>', '<Nodes name="Object">']
    for i, x in enumerate(mesh.points.tolist(), 11):
        lines.append(f'<node id="{i}">{",".join(map(repr, (*x, 0.0)[:3]))}</node>')
    lines.append("</Nodes>")
    for i, name in enumerate(mesh.regions):
        lines.append(f'<Elements type="{FEBIO[mesh.element.name]}" name="{name}">')
        for e in np.flatnonzero(mesh.cell_region == i):
            lines.append(f'<elem id="{e + 1}">{", ".join(map(str, mesh.cells[e] + 11))}</elem>')
        lines.append("</Elements>")
    for tag, facets in mesh.facets.items():
        nodes = np.unique(facets) + 11
        if tag == "left":
            inside = "".join(f'<node id="{n}"/>' for n in nodes) if one_by_one else str(list(nodes))
            lines.append(f'<NodeSet name="{tag}">{inside.strip("[]")}</NodeSet>')
            continue
        kind = {2: "line2", 3: "line3"} if mesh.dim == 2 else {3: "tri3", 4: "quad4", 6: "tri6"}
        kind = kind.get(facets.shape[1], "quad8")
        rows = [f"<{kind}>{','.join(map(str, row))}</{kind}>" for row in facets + 11]
        lines += [f'<Surface name="{tag}">', *rows, "</Surface>"]
    text = "\n".join([*lines, "</Mesh></febio_spec>"])
    return text.replace("Mesh>", "Geometry>") if one_by_one else text


@pytest.mark.parametrize("name", FEBIO)
def test_elements_surfaces_and_node_sets_of_febio(tmp_path, name):
    mesh = MESHES[name]
    for one_by_one in (False, True):
        (tmp_path / "a.feb").write_text(febio(mesh, one_by_one))
        read = read_mesh(tmp_path / "a.feb", mesh.dim)
        assert np.array_equal(read.points, mesh.points)
        assert same_facets(read.facets, mesh.facets) and set(read.regions) == set(mesh.regions)
        assert {*map(tuple, read.cells)} == {*map(tuple, mesh.cells)}


def test_what_is_refused_of_febio(tmp_path):
    text = febio(MESHES["T4"])
    (tmp_path / "a.feb").write_text(text.replace("tet4", "tet5"))
    refused(tmp_path / "a.feb", 3, "elements of the type tet5; mesh the body with tet4, hex8, ...")
    (tmp_path / "a.feb").write_text('<febio_spec><Mesh from="b.feb"/></febio_spec>')
    refused(tmp_path / "a.feb", 3, "a model whose mesh is in another file or in parts; write it in")


SU2 = {"T3": (5, 3), "Q4": (9, 3), "T4": (10, 5), "H8": (12, 9)}


@pytest.mark.parametrize("name", SU2)
def test_markers_of_su2(tmp_path, name):
    mesh = MESHES[name]
    body, facet = SU2[name]
    lines = ["% a mesh", f"NDIME= {mesh.dim}", f"NELEM={len(mesh.cells)}"]
    lines += [" ".join(map(str, (body, *row, e))) for e, row in enumerate(mesh.cells)]
    lines += [f"NPOIN= {len(mesh.points)} {len(mesh.points)}"]
    lines += [" ".join(map(repr, (*x, i))) for i, x in enumerate(mesh.points.tolist())]
    lines += [f"NMARK= {len(mesh.facets)}"]
    for tag, facets in mesh.facets.items():
        lines += [f"MARKER_TAG= {tag} % a marker", f"MARKER_ELEMS= {len(facets)}"]
        lines += [" ".join(map(str, (facet, *row))) for row in facets]
    path = tmp_path / "a.su2"
    path.write_text("\n".join([*lines, "SEND_RECV= 1", "1 0 0", ""]))
    read = read_mesh(path, mesh.dim)
    assert np.array_equal(read.points, mesh.points) and np.array_equal(read.cells, mesh.cells)
    assert same_facets(read.facets, mesh.facets) and read.regions == ("body",)
    path.write_text("\n".join(["NZONE= 2", *lines]))
    refused(path, mesh.dim, "a mesh of 2 zones; write one zone")


def test_polyhedra_are_refused(tmp_path):
    mesh = grid("H8", [SimpleNamespace(points=[0.0, 1.0], cells=[1], ratios=None)] * 3)
    faces = mesh.cells[0][np.array(mesh.element.facets)].tolist()
    message = "it has polyhedra, of which no element is made; mesh the body with tetra"
    source = meshio.Mesh(mesh.points, [("polyhedron8", [faces])])
    source.write(tmp_path / "a.vtu", binary=False)
    refused(tmp_path / "a.vtu", 3, message)
    lines = ["# vtk DataFile Version 3.0", "cube", "ASCII", "DATASET UNSTRUCTURED_GRID"]
    lines += ["POINTS 8 double", *(" ".join(map(str, x)) for x in mesh.points), "CELLS 1 32"]
    lines += [" ".join(map(str, [31, 6, *(n for face in faces for n in (4, *face))]))]
    (tmp_path / "a.vtk").write_text("\n".join([*lines, "CELL_TYPES 1", "42", ""]))
    refused(tmp_path / "a.vtk", 3, message)
