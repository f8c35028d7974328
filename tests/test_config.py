"""Scenes: defaults, precedence, round trip, shipped scenes, and one sentence for every wrong
input.
"""

import os

import pytest

from porofsi_petsc.config import list_scenes, load_scene, scene_to_toml
from porofsi_petsc.config.fields import Cells
from porofsi_petsc.config.steps import number_of_steps
from porofsi_petsc.errors import InputError

SCENE = """
title = "column"
[mesh]
kind = "rectangle"
x = { points = [0.0, 1.0], cells = [1] }
y = { points = [0.0, 4.0, 10.0], cells = [4, 6], ratios = [1.0, 0.5] }
patches = [{ name = "strip", side = "top", x = [0.0, 0.5] }]
regions = [{ name = "lower", y = [0.0, 4.0] }]
[time]
end = 1.0
step = 0.1
[[material]]
region = ["body", "lower"]
porosity = 0.33
solid = { law = "linear_elastic", young = 2.0, poisson = 0.25, density = 2000.0 }
fluid = { density = 1000, specific_weight = 1e4 }
permeability = { law = "constant", k = 1e-2 }
[[boundary]]
on = "bottom"
displacement = { x = 0, y = 0.0 }
[[boundary]]
on = ["top", "strip"]
pressure = "10*sin(t)*x"
[[boundary]]
on = "left"
[[probe]]
name = "A"
at = [0.5, 10.0]
quantities = ["u_y", "p"]
[figures]
paths = []
[[expect]]
quantity = "A.u_y"
at = 0.5
value = 1.0
tolerance = 0.01
[smoke]
"time.end" = 0.2
"mesh.y.cells" = [2, 2]
"""


@pytest.fixture
def scene_file(tmp_path):
    path = tmp_path / "column.toml"
    path.write_text(SCENE)
    return path


def test_defaults_are_resolved(scene_file):
    scene = load_scene(scene_file)
    assert scene.mesh.x.ratios == (1.0,) and scene.mesh.order == 1 and scene.dim == 2
    assert (
        scene.time.rho_inf == 0.5
        and scene.coupling.accelerator == "iqn_ils"
        and scene.coupling.relaxation is None
    )
    assert scene.boundary[0].on == ("bottom",) and scene.boundary[2].given() == []
    assert scene.material[0].fluid.density == 1000.0
    assert scene.name == "column" and scene.source_path == scene_file.resolve()


def test_young_and_poisson_become_lame_parameters(scene_file):
    solid = load_scene(scene_file).material[0].solid
    assert (solid.lambda_, solid.mu) == pytest.approx((0.8, 0.8), rel=1e-15)


def test_mobility_is_the_same_from_either_permeability(scene_file):
    intrinsic = [
        "material.0.permeability={law='constant', intrinsic=1e-9}",
        "material.0.fluid={density=1000.0, viscosity=1e-3}",
    ]
    assert load_scene(scene_file).material[0].mobility_at(Cells.none()) == pytest.approx(
        1e-6, rel=1e-15
    )
    assert load_scene(scene_file, intrinsic).material[0].mobility_at(Cells.none()) == pytest.approx(
        1e-6, rel=1e-15
    )


def test_components_are_expressions(scene_file):
    displacement = load_scene(scene_file).boundary[0].displacement
    assert [c.source for c in displacement.components(2)] == [0.0, 0.0]


def test_a_scene_is_frozen(scene_file):
    with pytest.raises(Exception, match="frozen"):
        load_scene(scene_file).time.end = 3.0


def test_command_line_wins_over_smoke_over_file(scene_file):
    assert load_scene(scene_file).time.end == 1.0
    assert load_scene(scene_file, smoke=True).time.end == 0.2
    changed = load_scene(
        scene_file, ["time.end=0.3", "coupling.accelerator=none", "probe.0.at.0=0.25"], smoke=True
    )
    assert (changed.time.end, changed.coupling.accelerator, changed.probe[0].at) == (
        0.3,
        "none",
        (0.25, 10.0),
    )
    assert changed.mesh.y.cells == (2, 2)


def test_the_file_is_not_changed_by_overrides(scene_file):
    load_scene(scene_file, ["time.end=0.3"])
    assert load_scene(scene_file).time.end == 1.0


@pytest.mark.parametrize("cell_type", ["triangle", "quadrilateral", "serendipity"])
def test_resolved_scene_loads_again_to_an_equal_one(scene_file, tmp_path, cell_type):
    _table(tmp_path)
    overrides = ["boundary.2.flux={table='q.csv'}", f"mesh.cell_type={cell_type}"]
    scene = load_scene(scene_file, overrides)
    other = tmp_path / "elsewhere" / "scene.toml"
    other.parent.mkdir()
    other.write_text(scene_to_toml(scene))
    assert load_scene(other) == scene
    assert load_scene(other, smoke=True) != scene


def _table(folder):
    return (folder / "q.csv").write_text("0,0\n1,2\n")


def test_a_mesh_path_starts_at_the_scene(tmp_path):
    path = tmp_path / "file.toml"
    path.write_text(
        SCENE.split("[mesh]")[0]
        + '[mesh]\nkind = "file"\npath = "meshes/a.msh"\nfacets = "f.xdmf"\ndim = 2\n[time]'
        + SCENE.split("[time]")[1]
    )
    scene = load_scene(path)
    assert scene.mesh.path == str(tmp_path.resolve() / "meshes" / "a.msh")
    assert scene.mesh.facets == str(tmp_path.resolve() / "f.xdmf")


@pytest.mark.parametrize("name, title, path", list_scenes(), ids=lambda value: str(value)[:20])
def test_shipped_scene(name, title, path, tmp_path):
    scene = load_scene(name)
    assert title == scene.title and load_scene(name, smoke=True) != scene
    (tmp_path / "scene.toml").write_text(scene_to_toml(scene))
    assert load_scene(tmp_path / "scene.toml") == scene


BOUNDARY = "boundary.2={on='left', %s}"
WRONG = [
    # structure of the file and of overrides
    ("time.end", "override 'time.end': expected KEY=VALUE"),
    ("time.end.x=1", "override 'time.end.x': time.end is a single value"),
    (
        "probe.3.name=1",
        "override 'probe.3.name': received '3' below the list probe, expected an index below 1",
    ),
    ("probe.first=1", "received 'first' below the list probe"),
    ("timee.end=1", "[timee]: unknown key 'timee'; did you mean 'time'?"),
    ("time.edn=1", "[time.edn]: unknown key 'edn'; did you mean 'end'?"),
    ("material.0.solid.lam=1", "[material.0.solid.lam]: unknown key 'lam'; did you mean 'lambda'?"),
    ("model=3", "[model]: received 3, expected a table"),
    ("material=[]", "[material]: received a list of length 0, expected at least 1"),
    ("title=3", "[title]: received 3, expected text in quotes"),
    # types and ranges
    ("time.end='long'", "[time.end]: received 'long', expected a number"),
    ("time.end=true", "[time.end]: received true, expected a number"),
    ("time.end=inf", "[time.end]: received inf, expected a finite number"),
    ("time.end=-1", "[time.end]: received -1, expected a number > 0"),
    ("time.step=2", "[time.step]: received 2 s, expected at most time.end = 1 s"),
    ("time.max_step=0.01", "[time.max_step]: received 0.01 s, expected at least time.step"),
    (
        "mesh={kind='rectangle', x={points=[0.0, 1.0], cells=[1]}, y={points=[0.0, 1.0],"
        " cells=[1]}, cell_type='quadrilateral', diagonal='left'}",
        "[mesh.diagonal]: received 'left' with cell_type = 'quadrilateral', which cuts no grid"
        " cells; leave it out",
    ),
    (
        "mesh.cell_type=hexahedron",
        "[mesh.cell_type]: received 'hexahedron', expected one of triangle, quadrilateral",
    ),
    ("time.rho_inf=1.5", "[time.rho_inf]: received 1.5, expected a number <= 1"),
    ("time.growth=0.9", "expected a number >= 1"),
    ("time.growth=1e308", "[time.growth]: received 1e+308, expected"),
    ("time.step=1e-300", "[time.step]: received 1e-300, expected 0 or a size from 1e-40 to 1e+40"),
    ("time.end=1e308", "[time.end]: received 1e+308, expected 0 or a size"),
    (
        "time.step=1e-17",
        (
            "[time.step]: received 1e-17 s, which takes 1.0e+17 steps to time.end = 1 s, expected"
            " at most 1e+09"
        ),
    ),
    (
        "time={end=1.0, step=1e-15, growth=1.0001, max_step=2e-15}",
        "[time.step]: received 1e-15 s, which takes 5.0e+14 steps",
    ),
    (
        "time={end=1, step=0.1, error_tolerance=1e-30}",
        "[time.error_tolerance]: received 1e-30, expected a number >= 1e-12",
    ),
    (
        "time={end=1, step=0.1, error_tolerance=1e-3, min_step=1e-14}",
        "[time.min_step]: received 1e-14 s, expected at least",
    ),
    ("time.step=1.0000001", "[time.step]: received 1.0000001 s, expected at most time.end = 1 s"),
    ("coupling.max_cuts=31", "[coupling.max_cuts]: received 31, expected a number <= 30"),
    (
        "coupling.max_iterations=99999999999",
        "[coupling.max_iterations]: received 99999999999, expected a number <= 2147483647",
    ),
    ("time.scheme=backward_euler", "[time.scheme]: received 'backward_euler' with inertia"),
    ("model.convection=1", "[model.convection]: received 1, expected true, false or 'auto'"),
    (
        "model.porosity=fixed",
        "[model.porosity]: received 'fixed', expected one of constant, variable, auto",
    ),
    ("limits.strain=no", "[limits.strain]: received 'no', expected a positive number or 'report'"),
    ("output.fields_every=0", "[output.fields_every]: received 0, expected a number >= 1"),
    ("output.fields_every=1.5", "[output.fields_every]: received 1.5, expected a whole number"),
    (
        "coupling.mass_scaling=optimal",
        "[coupling.mass_scaling]: received 'optimal' with split = 'corrected'",
    ),
    (
        "coupling={split='plain', mass_scaling=0}",
        "[coupling.mass_scaling]: received 0, expected a positive number or 'optimal'",
    ),
    (
        "coupling.accelerator=atken",
        "expected one of iqn_ils, aitken, anderson, constant, none, auto",
    ),
    # mesh
    ("mesh.kind=sphere", "[mesh.kind]: received 'sphere', expected one of rectangle, box, file"),
    ("mesh={x=1}", "[mesh.kind]: received nothing, expected this key"),
    (
        "mesh={kind='rectangle', x={points=[0, 1], cells=[1]}}",
        "[mesh.y]: received nothing, expected this key",
    ),
    ("mesh.order=3", "[mesh.order]: received 3, expected one of 1, 2"),
    (
        "mesh.x.points=[1.0, 0.0]",
        "[mesh.x.points]: received [1.0, 0.0], expected increasing numbers",
    ),
    ("mesh.x.points=[1.0]", "[mesh.x.points]: received a list of length 1, expected at least 2"),
    ("mesh.x.cells=[1, 2]", "[mesh.x.cells]: received 2 entries, expected 1, one per segment"),
    ("mesh.y.ratios=[1]", "[mesh.y.ratios]: received 1 entries, expected 2"),
    ("mesh.x.cells=4", "[mesh.x.cells]: received 4, expected a list"),
    (
        "mesh.patches.0.side=front",
        "[mesh.patches.0.side]: received 'front', expected one of left, right, bottom, top",
    ),
    (
        "mesh.patches.0.x=[0.0, 2.0]",
        "[mesh.patches.0.x]: received [0.0, 2.0], expected a part of [0.0, 1.0]",
    ),
    ("mesh.patches.0.x=[0.5, 0.5]", "expected [smaller, larger]"),
    ("mesh.patches.0.z=[0.0, 1.0]", "received an interval in a two-dimensional scene"),
    ("mesh.patches.0.name=top", "received 'top' again, expected a name of its own"),
    (
        f"mesh.x.cells=[{10**30}]",
        (
            "[mesh.x.cells.0]: received 1000000000000000000000000000000, expected a number <="
            " 2147483647"
        ),
    ),
    (
        "mesh.x.ratios=[1e300]",
        "[mesh.x.ratios.0]: received 1e+300, expected 0 or a size from 1e-40 to 1e+40",
    ),
    (
        "mesh={kind='file', dim=2, path=\"a\\u0000b\"}",
        "[mesh.path]: received 'a\\x00b', expected the name of a file",
    ),
    # materials
    (
        "material.0.porosity=1e-9",
        "[material.0.porosity]: received 1e-09, expected a number >= 1e-06",
    ),
    ("material.0.porosity=1.0", "[material.0.porosity]: received 1.0, expected a number < 1"),
    (
        "material.0.solid.law=neohookean",
        "[material.0.solid.law]: received 'neohookean', expected one of linear_elastic, saint",
    ),
    (
        "material.0.solid.mu=1.0",
        "[material.0.solid]: received mu, poisson, young, expected either lambda and mu, or young",
    ),
    (
        "material.0.solid.poisson=0.5",
        "[material.0.solid.poisson]: received 0.5, expected a number < 0.5",
    ),
    (
        "material.0.solid={law='linear_elastic', lambda=-1, mu=1, density=1}",
        "[material.0.solid.lambda]: received -1.0",
    ),
    (
        "material.0.permeability.law=markert",
        "[material.0.permeability.exponent]: received nothing, expected this key",
    ),
    ("material.0.permeability.exponent=2", "unknown key 'exponent'; choose from law, k, intrinsic"),
    (
        "material.0.permeability.intrinsic=1e-9",
        "expected exactly one of k [m/s] and intrinsic [m^2]",
    ),
    (
        "material.0.permeability={law='constant', intrinsic=1}",
        "[material.0.fluid.viscosity]: received nothing",
    ),
    ("material.0.fluid={density=1000}", "[material.0.fluid.specific_weight]: received nothing"),
    (
        "model.viscosity=true",
        (
            "[material.0.fluid.viscosity]: received nothing, expected a number [Pa s], which"
            " model.viscosity"
        ),
    ),
    ("material.0.region=['body', 'body']", "[material.0.region]: received 'body' twice"),
    (
        "material.0.region=['body', 'all']",
        "[material.0.region]: received 'all' beside other regions",
    ),
    (f"material.0.region='{'a' * 1000}'", "[material.0.region]: received 'aaa"),
    ("coupling.tolerance=0.999", "[coupling.tolerance]: received 0.999, expected a number <= 0.01"),
    # boundary conditions
    ("boundary.1.priority=0.5", "[boundary.1.priority]: received 0.5, expected a whole number"),
    ("boundary.1.on=[]", "[boundary.1.on]: received a list of length 0"),
    (BOUNDARY % "presure=0", "unknown key 'presure'; did you mean 'pressure'?"),
    (
        BOUNDARY % "pressure='sin(q)'",
        "[boundary.2.pressure]: expression 'sin(q)': unknown name 'q'",
    ),
    (
        BOUNDARY % "pressure=0, flux=0",
        "[boundary.2.flux]: tag 'left' has boundary.2.pressure already",
    ),
    (
        "boundary.2={on='top', pressure=0}",
        "[boundary.2.pressure]: tag 'top' has boundary.1.pressure already",
    ),
    (
        "boundary.2={on='bottom', traction={y=1}}",
        "tag 'bottom' has boundary.0.displacement.y already, which excludes traction.y",
    ),
    (
        BOUNDARY % "no_slip=true",
        "[boundary.2.no_slip]: received true, expected false without model.viscosity",
    ),
    (
        BOUNDARY % "traction={z=1}",
        "[boundary.2.traction.z]: received a component in a two-dimensional scene",
    ),
    (
        BOUNDARY % "pressure='z'",
        "[boundary.2.pressure]: received 'z' in a two-dimensional scene, expected no z",
    ),
    (BOUNDARY % "pressure={table='no.csv'}", "cannot be read: no such file"),
    (
        "initial.pressure='t'",
        "[initial.pressure]: received 't', expected a function of position only",
    ),
    ("body_force.solid.z=1", "[body_force.solid.z]: received a component"),
    # probes, figures, expectations
    ("probe.0.at=[1.0]", "[probe.0.at]: received a list of length 1, expected 2 to 3"),
    ("probe.0.at=[1.0, 2.0, 3.0]", "[probe.0.at]: received 3 coordinates, expected 2"),
    ("probe.0.quantities=['u_z']", "received 'u_z' in a two-dimensional scene"),
    ("probe.0.quantities=['q']", "[probe.0.quantities.0]: received 'q', expected one of u_x, u_y"),
    ("probe.0.quantities=['p', 'p']", "expected each quantity once"),
    ("probe.0.name='A.b'", "[probe.0.name]: received 'A.b', expected a name of letters"),
    (
        "figures.paths=['A']",
        "[figures.paths]: received 'A', expected a probe that records u_x and u_y",
    ),
    (
        "reference={solution='xie_leo', load=1, length=1}",
        "[reference.solution]: received 'xie_leo' with the laws 'linear_elastic'",
    ),
    (
        "expect.0.quantity=A.u_x",
        "[expect.0.quantity]: received 'A.u_x', which no [[probe]] records; did you mean 'A.u_y'?",
    ),
    (
        "expect.0.minus=A.u_x",
        "[expect.0.minus]: received 'A.u_x', which no [[probe]] records; did you mean 'A.u_y'?",
    ),
    (
        "reference={solution='kovasznay', speed=1, length=1}",
        (
            "[reference.solution]: received 'kovasznay' with a porous material, expected a free"
            " fluid; leave the section out"
        ),
    ),
    (
        "reference={solution='taylor_green', length=1}",
        "[reference.speed]: received nothing, expected a positive number",
    ),
    (
        "reference={solution='terzaghi', load=1, length=1, speed=1}",
        "[reference.speed]: received 1, expected nothing",
    ),
    ("expect.0.statistic=max", "[expect.0]: expected exactly one of at = TIME and statistic"),
    (
        "expect=[{quantity='A.u_y', statistic='frequency', value=1, tolerance=1}]",
        "without output.period_of, expected the column",
    ),
    ("expect.0.value=0", "[expect.0.scale]: received nothing, expected a positive number"),
]


LONG = "a" * 100_000
WRONG += [
    # values, keys and numbers that do not fit into a sentence
    (f"time.end={LONG}", "[time.end]: received 'aaaa"),
    (f"time.{LONG}=1", "unknown key 'aaaa"),
    (f"time.end={'0x' + 'f' * 5000}", "received a whole number of about 6020 digits"),
    (f"probe.0.name={LONG}", "[probe.0.name]: received 'aaaa"),
    (f"expect.0.quantity={LONG}", "[expect.0.quantity]: received 'aaaa"),
    ('expect.0.minus="a\\nb"', "[expect.0.minus]: received 'a\\nb', which no [[probe]] records"),
    (f"boundary.2={{on='left', pressure='{LONG}'}}", "expression of 100000 characters"),
    (f"{'a.' * 3000}a=1", "received a key of 3001 parts"),
    (f"smoke={{{'a.' * 3000}a=1}}", "received tables nested more than 12 deep"),
    (f"boundary.1.on=['a{chr(10)}b']", "[boundary.1.on"),
    ("'a\nb'=1", "unknown key"),
    ("title=\udcff", "override 'title=\\udcff': received bytes that are not UTF-8"),
    ("probe.²=1", "received '²' below the list probe"),
]


@pytest.mark.parametrize("override, sentence", WRONG, ids=[override[:60] for override, _ in WRONG])
def test_wrong_input_gets_one_sentence(scene_file, override, sentence):
    with pytest.raises(InputError) as caught:
        load_scene(scene_file, [override])
    text = str(caught.value)
    assert sentence in text
    assert text.isprintable() and len(text) < 500
    assert text.startswith("override") or str(scene_file) in text


def test_the_error_of_a_displacement_needs_a_solution_that_has_one(scene_file):
    reference = "reference={solution='strip_footing', load=1e4, length=1.0}"
    with pytest.raises(InputError, match=r"expect.0.quantity\]: received 'error.u'"):
        load_scene(scene_file, [reference, "expect.0.quantity=error.u"])


def test_a_periodic_statistic_needs_a_column_of_the_history(scene_file):
    reference = "reference={solution='column_step', load=1, length=10}"
    expect = "expect=[{quantity='error.u', statistic='frequency', value=1, tolerance=1}]"
    with pytest.raises(
        InputError,
        match=(
            r"expect.0.statistic\]: received 'frequency' of error.u, .* expected a column of hist"
        ),
    ):
        load_scene(scene_file, [reference, "output.period_of=A.u_y", expect])


def test_a_consistent_start_needs_a_skeleton_with_inertia(scene_file):
    with pytest.raises(
        InputError, match=r"time.consistent_start\]: received true with model.solid_inertia = false"
    ):
        load_scene(scene_file, ["time.consistent_start=true", "model.solid_inertia=false"])


EULER = "time={scheme='backward_euler', end=1.0, step=0.5}"


@pytest.mark.parametrize(
    "scene, term", [("cook_membrane", "solid_inertia"), ("cavity", "fluid_inertia")]
)
def test_of_inertia_only_that_of_what_is_there_counts(scene, term):
    with pytest.raises(
        InputError, match=rf"with inertia, expected model\.{term} = false, or scheme"
    ):
        load_scene(scene, [EULER, "model={}", "expect=[]"])
    assert (
        load_scene(scene, [EULER, f"model={{{term}=false}}", "expect=[]"]).time.scheme
        == "backward_euler"
    )


def test_two_probes_of_one_name(tmp_path):
    path = tmp_path / "twice.toml"
    path.write_text(
        SCENE.replace(
            "[figures]", '[[probe]]\nname = "A"\nat = [0.0, 0.0]\nquantities = ["p"]\n[figures]'
        )
    )
    with pytest.raises(InputError, match=r"\[probe.1.name\]: received 'A', the name of probe.0"):
        load_scene(path)


@pytest.mark.parametrize(
    "content, sentence",
    [
        (b"title = \n", r"not valid TOML: Invalid value \(at line 1, column 9\)"),
        (b"\x89PNG\xff\xfe", "byte 0x89 in line 1 is not UTF-8"),
        (
            "# Übung\ntitle = 'é'".encode("latin-1"),
            "byte 0xdc in line 1 is not UTF-8, expected a scene in TOML; save",
        ),
        (SCENE.encode("utf-16"), "byte 0xff in line 1 is not UTF-8"),
        (b"x = " + b"[" * 5000, "not valid TOML"),
        (b"a." * 3000 + b"a = 1", "received tables nested more than 12 deep"),
        (b"title = " + b"9" * 50, "received 99999999"),
        (b"", "received an empty file"),
        (b"title = 'a'\n", r"\[mesh\]: received nothing"),
    ],
)
def test_wrong_files(tmp_path, content, sentence):
    path = tmp_path / "a.toml"
    path.write_bytes(content)
    with pytest.raises(InputError, match=sentence):
        load_scene(path)


def test_paths_that_are_no_scene(tmp_path, scene_file):
    with pytest.raises(InputError, match="no such file"):
        load_scene(tmp_path / "none.toml")
    with pytest.raises(InputError, match="received a directory"):
        load_scene(tmp_path)
    with pytest.raises(
        InputError, match="neither a file nor a shipped scene; did you mean 'pulse2d'"
    ):
        load_scene("puls2d")
    scene_file.write_text(SCENE.split("[smoke]")[0])
    with pytest.raises(InputError, match=r"\[smoke\]: received nothing"):
        load_scene(scene_file, smoke=True)


def test_a_scene_may_begin_with_a_byte_order_mark(scene_file):
    scene_file.write_bytes(b"\xef\xbb\xbf" + SCENE.encode())
    assert load_scene(scene_file).title == "column"


def test_devices_and_pipes_are_not_read(tmp_path):
    os.mkfifo(tmp_path / "a.toml")
    for path in (tmp_path / "a.toml", "/dev/zero"):
        with pytest.raises(InputError, match="received a device or pipe, expected a file"):
            load_scene(path)


def test_names_that_no_file_can_have(tmp_path):
    (tmp_path / "loop").symlink_to("loop")
    for name in ("a" * 5000, "a" * 5000 + ".toml", "a\x00b.toml", str(tmp_path / "loop")):
        with pytest.raises(InputError) as caught:
            load_scene(name)
        assert str(caught.value).isprintable() and len(str(caught.value)) < 400


@pytest.mark.parametrize(
    "end, step, growth, max_step, expected",
    [
        (1.0, 1e-3, 1.0, None, 1000),
        (1023.0, 1.0, 2.0, None, 10),  # 1 + 2 + ... + 512
        (7.0 + 100 * 8.0, 1.0, 2.0, 8.0, 103),  # 1, 2, 4, then eights
    ],
)
def test_steps_are_counted(end, step, growth, max_step, expected):
    assert number_of_steps(end, step, growth, max_step) == pytest.approx(expected, rel=1e-12)


def test_many_mistakes_get_a_line_each(scene_file):
    with pytest.raises(InputError) as caught:
        load_scene(scene_file, ["time.end=no", "mesh.order=3", "title=1"])
    assert len(str(caught.value).splitlines()) == 3


FREE = """
title = "A solid beside a free fluid, without [model]"
[mesh]
kind = "rectangle"
x = { points = [0, 1, 2], cells = [1, 1] }
y = { points = [0, 1], cells = [1] }
regions = [{ name = "flap", x = [1, 2] }]
[time]
end = 1.0
step = 0.5
[[material]]
region = "body"
fluid = { density = 1000.0, viscosity = 1.0 }
[[material]]
region = "flap"
solid = { law = "saint_venant_kirchhoff", young = 1e5, poisson = 0.4, density = 1000.0 }
"""


def test_a_free_fluid_is_by_default_that_of_navier_and_stokes_on_a_mesh_that_follows(tmp_path):
    terms = ("solid_inertia", "fluid_inertia", "convection", "viscosity", "moving_mesh")

    def model_of(*overrides, text=FREE):
        path = tmp_path / "free.toml"
        path.write_text(text)
        scene = load_scene(path, overrides)
        path.write_text(scene_to_toml(scene))
        assert load_scene(path) == scene
        return tuple(getattr(scene.model, term) for term in terms)

    assert model_of() == (True, True, True, True, True)
    assert model_of("time.scheme=steady") == (False, False, True, True, True)
    rigid = ("model.moving_mesh=false", "model.convection=false", "coupling.scheme=one_way")
    assert model_of(*rigid) == (True, True, False, True, False)
    with pytest.raises(
        InputError, match=r"\[model.moving_mesh\]: received false with a solid beside the fluid"
    ):
        model_of(*rigid[:2])
    ideal = FREE.replace(", viscosity = 1.0", "")
    assert model_of("model.viscosity=false", text=ideal) == (True, True, True, False, True)
    with pytest.raises(InputError, match="received no viscosity of the free fluid of material.0"):
        model_of(text=ideal)  # forgotten, mostly: no wall would hold the flow
    alone = 'material=[{region="all", fluid={density=1000.0, viscosity=1.0}}]'
    assert model_of(alone) == (True, True, True, True, False)
    solid = (
        'material=[{region="all", solid={law="neo_hookean", young=1e5, poisson=0.4,'
        " density=1000.0}}]"
    )
    assert model_of(solid) == (True, True, False, False, False)
