"""Tags and regions that a scene gives by place, on every kind of mesh."""

import numpy as np
import pytest
from grids import grid
from mixed import cut, unit_grid, write_mixed
from test_mesh_read import AXIS, MESHES, blocks, same_facets, write22

from porofsi_petsc import load_scene
from porofsi_petsc.errors import InputError
from porofsi_petsc.mesh import read_mesh
from porofsi_petsc.mesh.select import with_tags

RECTANGLE = "mesh={kind='rectangle',x={points=[0,2],cells=[4]},y={points=[0,1],cells=[2]}"
BOX = RECTANGLE.replace("rectangle", "box") + ",z={points=[0,1],cells=[2]}"


def selectors(tags, dim):
    """Return the selectors of a scene from the text of their list."""
    mesh = f"{(RECTANGLE, BOX)[dim - 2]},tag=[{tags}]}}"
    return load_scene("terzaghi", [mesh, "probe=[]", "line=[]"]).mesh.tag


def named(mesh, tags):
    return with_tags(mesh, selectors(tags, mesh.dim), "a.toml")


def places(mesh, tag):
    return np.unique(mesh.points[mesh.facets[tag]].reshape(-1, mesh.dim), axis=0)


@pytest.mark.parametrize("name", MESHES)
def test_planes_normals_and_boxes_are_sides(name):
    """The sides of a rectangle and a box are known: each selector names one of them."""
    mesh = MESHES[name]
    text = "{name='a',plane={x=2.0}},{name='b',box={x=[0,1e-9]}}"
    normal = [0] * (mesh.dim - 1)
    text += f",{{name='c',normal={[*normal, -1]}}},{{name='d',formula='y-x*0-1.999',of='back'}}"
    text = text if mesh.dim == 3 else text.replace("'back'", "'top'")
    read = named(mesh, text)
    upper = "back" if mesh.dim == 3 else "top"
    expected = {"a": "right", "b": "left", "c": "bottom", "d": upper}
    for tag, side in expected.items():
        assert same_facets({"": read.facets[tag]}, {"": mesh.facets[side]})
        assert side not in read.facets
    assert sum(map(len, read.facets.values())) == sum(map(len, mesh.facets.values()))


def test_the_later_entry_wins_and_a_name_may_get_more():
    mesh = named(MESHES["Q8"], "{name='a',plane={y=2}},{name='b',of='a',box={x=[0,1]}}")
    assert places(mesh, "b")[:, 0].max() == 1 and places(mesh, "a")[:, 0].min() == 1
    mesh = named(mesh, "{name='a',plane={x=0}}")
    assert {"left", "top", "strip"}.isdisjoint(mesh.facets) and len(mesh.facets["a"]) == 4


def test_oblique_planes_and_circles():
    mesh = grid("Q4", [AXIS] * 2)
    turned = np.array([[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]])
    mesh.points[:] = mesh.points @ turned.T
    normal, point = turned[:, 0].tolist(), (2 * turned[:, 0]).tolist()
    tags = f"{{name='a',plane={{point={point},normal={normal}}}}}"
    assert same_facets({"": named(mesh, tags).facets["a"]}, {"": mesh.facets["right"]})
    ring = grid("Q9", [AXIS] * 2)
    r, angle = 1 + ring.points[:, 0], ring.points[:, 1]
    ring.points[:] = np.stack([r * np.cos(angle), r * np.sin(angle)], axis=1)
    for radius, side in ((1, "left"), (3, "right")):
        tags = f"{{name='a',cylinder={{point=[0,0],radius={radius},surface=true}}}}"
        assert same_facets({"": named(ring, tags).facets["a"]}, {"": ring.facets[side]})
    assert len(named(ring, "{name='a',cylinder={point=[0,0],radius=3}}").facets) == 1


def test_a_cylinder_has_a_mantle_and_ends():
    mesh = grid("H8", [AXIS] * 3)
    x, y = mesh.points[:, 0] - 1, mesh.points[:, 1] - 1
    square = np.maximum(np.abs(x), np.abs(y))
    scale = square / np.maximum(np.hypot(x, y), 1e-30)
    mesh.points[:, :2] = np.stack([x * scale, y * scale], axis=1) + 1
    tags = "{name='a',cylinder={point=[1,1,5],axis=[0,0,2],radius=1,surface=true}}"
    mantle = [mesh.facets[side] for side in ("left", "right", "front", "back")]
    assert same_facets({"": named(mesh, tags).facets["a"]}, {"": np.concatenate(mantle)})


@pytest.mark.parametrize("dim", [2, 3])
def test_regions_of_a_mixed_mesh(tmp_path, dim):
    write_mixed(tmp_path / "mixed.msh", *cut(unit_grid(dim, 3)))
    mesh = named(read_mesh(tmp_path / "mixed.msh", dim), "{name='lens',cells=true,formula='0.5-x'}")
    assert mesh.regions == ("body", "lens")
    centres = mesh.points[mesh.cells].mean(axis=1)[:, 0]
    assert np.array_equal(mesh.cell_region == 1, centres < 0.5)
    mesh = named(mesh, "{name='drop',cells=true,of='lens',box={y=[0,0.5]}}")
    assert mesh.regions == ("body", "lens", "drop")
    assert named(mesh, "{name='new',cells=true,box={x=[-1,2]}}").regions == ("new",)


def test_facets_inside_the_body_are_found_by_their_tag(tmp_path):
    mesh = MESHES["T3"]
    inner = [f for f in mesh.cells[:, [1, 2]] if (mesh.points[f, 0] == 1).all()]
    between = ("line", 1, "fault", np.array(inner[:2]))
    write22(tmp_path / "a.msh", mesh.points, [*blocks(mesh), between])
    read = read_mesh(tmp_path / "a.msh", 2)
    split = named(read, "{name='low',of='fault',box={y=[0,0.5]}}")
    assert len(split.facets["low"]) == len(split.facets["fault"]) == 1
    with pytest.raises(InputError, match="'low' gets none of the 12 facets of the boundary"):
        named(read, "{name='low',box={x=[0.9,1.1]}}")


WRONG = [
    ("{name='a',plane={x=0.7}}", r"\[mesh.tag.0\]: 'a' gets none of the 12 facets of the boundary"),
    ("{name='a',plane={x=2.1}}", r"lies in \[0, 2\] x \[0, 2\] m, the centre next .* 0.1 m away"),
    ("{name='a',of='lid',plane={x=2}}", r"\[mesh.tag.0.of\]: the mesh has no boundary tag 'lid'"),
    ("{name='a',cells=true,box={x=[3,4]}}", "'a' gets none of the 18 cells of the mesh"),
    (
        "{name='a'}",
        r"\[mesh.tag.0\]: received no condition, expected plane, box, cylinder, formula",
    ),
    ("{name='a',plane={x=1,y=2}}", r"\[mesh.tag.0.plane\]: expected one coordinate"),
    ("{name='a',normal=[1,0,0]}", r"\[mesh.tag.0.normal\]: received .* expected 2 components"),
    ("{name='a',cells=true,normal=[1,0]}", r"\[mesh.tag.0.normal\]: received one for cells"),
    ("{name='a',formula='t'}", r"\[mesh.tag.0.formula\]: received a formula with t"),
    ("{name='a',formula='z'}", r"\[mesh.tag.0.formula\]: received a formula with z in two dim"),
    ("{name='a',formula='log(x-5)'}", r"a.toml \[mesh.tag.0.formula\]: expression .* received nan"),
    ("{name='a',box={z=[0,1]}}", r"\[mesh.tag.0.box.z\]: received z in a two-dim"),
    ("{name='all',cells=true,box={x=[0,1]}}", r"\[mesh.tag.0.name\]: received 'all'"),
]


@pytest.mark.parametrize(("tags", "message"), WRONG)
def test_what_names_nothing_is_refused(tags, message):
    with pytest.raises(InputError, match=message):
        named(MESHES["T3"], tags)
