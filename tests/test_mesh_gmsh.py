"""Gmsh 4.0, text and binary, and partitioned files of 4.1."""

import numpy as np
import pytest
from test_mesh_read import GMSH_NODES, GMSH_TYPE, MESHES, blocks, refused, same_facets, write41

from porofsi_petsc.mesh import read_mesh


class Numbers:
    """Numbers of a file in text, or in binary: i of 4, n and d of 8 bytes."""

    def __init__(self, is_text):
        self.is_text = is_text
        self.data = b""

    def add(self, kinds, *values):
        for kind, value in zip(kinds, values, strict=True):
            if self.is_text:
                self.data += f"{value!r} ".encode()
            else:
                self.data += np.array(value, {"i": "<i4", "n": "<u8", "d": "<f8"}[kind]).tobytes()
        if self.is_text:
            self.data += b"\n"


def write40(path, points, groups, is_text, parametric=False):
    """Write Gmsh 4.0 (reference manual of Gmsh 4.0, "MSH file format"), one entity per group, a
    point of the geometry among them, which has a box as the others have.
    """
    nodes, elements, entities = Numbers(is_text), Numbers(is_text), Numbers(is_text)
    dims = [0, *(dim for _, dim, _, _ in groups)]
    entities.add("nnnn", *(dims.count(dim) for dim in range(4)))
    for tag, dim in sorted(enumerate(dims), key=lambda entry: entry[1]):
        entities.add("idddddd", tag, *[0.0] * 6)
        entities.add("ni", 1, 50 + tag) if dim else entities.add("n", 0)
        entities.add("ni", 1, 0) if dim else None
    nodes.add("nn", 1, len(points))
    dim = dims[-1]
    nodes.add("iiin", len(groups), dim, int(parametric), len(points))
    for i, x in enumerate(points.tolist()):
        more = [0.5] * (dim if parametric else 0)
        nodes.add("i" + "d" * (3 + len(more)), i + 11, *(*x, 0.0)[:3], *more)
    elements.add("nn", len(groups), sum(len(cells) for *_, cells in groups))
    for tag, (kind, dim, _, cells) in enumerate(groups, 1):
        elements.add("iiin", tag, dim, GMSH_TYPE[kind], len(cells))
        for e, row in enumerate(cells[:, GMSH_NODES.get(kind, slice(None))].tolist(), 1):
            elements.add("i" * (1 + len(row)), e, *(n + 11 for n in row))
    names = "".join(
        f'{dim} {50 + tag} "{name}"\n' for tag, (_, dim, name, _) in enumerate(groups, 1)
    )
    head = b"0" if is_text else b"1"
    text = b"$MeshFormat\n4 " + head + b" 8\n" + (b"" if is_text else b"\1\0\0\0\n")
    text += f"$EndMeshFormat\n$PhysicalNames\n{len(groups)}\n{names}$EndPhysicalNames\n".encode()
    for name, numbers in (("Entities", entities), ("Nodes", nodes), ("Elements", elements)):
        text += f"${name}\n".encode() + numbers.data + f"\n$End{name}\n".encode()
    path.write_bytes(text)


@pytest.mark.parametrize("is_text", [True, False])
@pytest.mark.parametrize("name", ["T3", "Q9", "T10", "H20"])
def test_version_4_0(tmp_path, name, is_text):
    mesh = MESHES[name]
    write40(tmp_path / "a.msh", mesh.points, blocks(mesh), is_text, parametric=name == "Q9")
    read = read_mesh(tmp_path / "a.msh", mesh.dim)
    assert np.array_equal(read.points, mesh.points)
    assert same_facets(read.facets, mesh.facets) and set(read.regions) == set(mesh.regions)
    assert {*map(tuple, read.cells)} == {*map(tuple, mesh.cells)}


def partitioned(path, mesh, both=True):
    """Write Gmsh 4.1 with every group cut in two, and an edge between the parts in no group."""
    halves = [
        (kind, dim, name, nodes[i::2]) for kind, dim, name, nodes in blocks(mesh) for i in (0, 1)
    ]
    between = ("line", 1, None, mesh.cells[:1, [0, 1]])
    write41(path, mesh.points, [between, *halves])
    text = path.read_text()
    begin, end = text.index("$Entities"), text.index("$EndEntities")
    _, counts, *lines = text[begin:end].splitlines()
    entities = [line.split() for line in lines]
    whole = [" ".join([str(int(tag) + 100), *rest]) for tag, *rest in entities]
    dims = {i: dim for i, (_, dim, _, _) in enumerate([between, *halves], 1)}
    parts = ["2", "1", "7 1", counts]
    for tag in (int(words[0]) for words in entities):
        parent = (2, 102) if tag == 1 else (dims[tag], tag + 100)
        of = "2 1 2" if tag == 1 and both else f"1 {1 + tag % 2 * both}"
        parts.append(f"{tag} {parent[0]} {parent[1]} {of} 0 0 0 1 1 1 0 0")
    section = ["$Entities", counts, *whole, "$EndEntities", "$PartitionedEntities", *parts]
    section = "\n".join([*section, "$EndPartitionedEntities"])
    path.write_text(text[:begin] + section + text[end + len("$EndEntities") :])


@pytest.mark.parametrize("name", ["T3", "Q4"])
def test_parts_are_in_the_groups_of_what_they_are_part_of(tmp_path, name):
    mesh = MESHES[name]
    partitioned(tmp_path / "a.msh", mesh)
    read = read_mesh(tmp_path / "a.msh", 2)
    assert same_facets(read.facets, mesh.facets) and set(read.regions) == set(mesh.regions)
    partitioned(tmp_path / "a.msh", mesh, both=False)
    refused(tmp_path / "a.msh", 2, "part 1 of 2 of a mesh; save it in one file")
