"""Fields, checkpoints, probes, descriptions and figures of small meshes on one rank."""

import dataclasses
import json
from types import SimpleNamespace

import h5py
import meshio
import numpy as np
import pytest
from grids import grid
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from mpi4py import MPI
from running import SCENES, Job, run_here

from porofsi_petsc.elements import ELEMENTS
from porofsi_petsc.errors import InputError
from porofsi_petsc.fem.distribute import distribute
from porofsi_petsc.output import checkpoint, figures
from porofsi_petsc.output.checkpoint import open_checkpoint, read_arrays, write_checkpoint
from porofsi_petsc.output.field_plots import colour_scale, draw_field
from porofsi_petsc.output.fields import FieldWriter, Snapshot, read_snapshots
from porofsi_petsc.output.figures import choose_snapshots, make_figures
from porofsi_petsc.output.history import History
from porofsi_petsc.output.history_plots import draw_histories
from porofsi_petsc.output.info import describe
from porofsi_petsc.output.probes import Probes
from porofsi_petsc.output.seal import seal
from porofsi_petsc.output.surface import Surface, read_surface, surface_of
from porofsi_petsc.output.units import plain, scaled_unit, significant

COMM = MPI.COMM_SELF
MESHIO = {
    "T3": "triangle",
    "T6": "triangle6",
    "Q4": "quad",
    "Q8": "quad8",
    "Q9": "quad9",
    "T4": "tetra",
    "T10": "tetra10",
    "H8": "hexahedron",
    "H20": "hexahedron20",
    "H27": "hexahedron27",
}


def axis(length, cells):
    return SimpleNamespace(points=[0.0, length], cells=[cells], ratios=[1.0])


def serial_mesh(name):
    """Return a block 2 x 1 (x 1) of the element; order 2 with curved interior edges."""
    element = ELEMENTS[name]
    lengths = (2.0, 1.0, 1.0)[: element.dim]
    mesh = grid(name, [axis(length, int(2 * length)) for length in lengths])
    if element.order == 2:
        bump = np.prod(np.sin(np.pi * mesh.points / lengths), axis=1)
        middle = np.zeros(len(mesh.points), dtype=bool)
        middle[mesh.cells[:, element.n_vertices :]] = True
        mesh.points[middle] += 0.03 * bump[middle, None]
    return mesh


def local_mesh(name):
    mesh = serial_mesh(name)
    return distribute(COMM, mesh, np.zeros(len(mesh.points), dtype=int))


def fields_of(mesh, time):
    X = mesh.X[: mesh.n_owned]
    stress = np.stack([X[:, 0] * i for i in range(6)], axis=1)
    return {"displacement": time * X**2, "pressure": (time * X[:, 0])[:, None], "stress": stress}


@pytest.mark.parametrize("name", ELEMENTS)
def test_fields_open_in_meshio(name, tmp_path):
    mesh = local_mesh(name)
    writer = FieldWriter(tmp_path, mesh)
    for step, time in ((0, 0.0), (10, 0.1)):
        writer.write(step, time, fields_of(mesh, time))
    serial = serial_mesh(name)
    with meshio.xdmf.TimeSeriesReader(tmp_path / "fields.xdmf") as reader:
        points, cells = reader.read_points_cells()
        time, point_data, cell_data = reader.read_data(1)
        assert reader.num_steps == 2
    assert time == 0.1 and cells[0].type == MESHIO[name]
    assert np.array_equal(cells[0].data, serial.cells) and np.array_equal(
        points[:, : serial.dim], serial.points
    )
    assert np.array_equal(point_data["pressure"], 0.1 * serial.points[:, 0])
    assert np.array_equal(point_data["displacement"][:, : serial.dim], 0.1 * serial.points**2)
    assert point_data["displacement"].shape[1] == 3 and point_data["stress"].shape[1] == 6
    assert np.array_equal(cell_data["region"][0], serial.cell_region)


def test_fields_continue_after_a_kill(tmp_path):
    mesh = local_mesh("T3")
    writer = FieldWriter(tmp_path, mesh)
    for step in (10, 20, 30):
        writer.write(step, 0.01 * step, fields_of(mesh, step))
    (tmp_path / "fields" / "000040.h5.tmp").write_bytes(b"torn")  # killed before the rename
    again = FieldWriter(tmp_path, mesh)
    assert [s.step for s in again.snapshots] == [10, 20, 30]
    again.truncate(0.2)
    assert [(step, time) for step, time, *_ in read_snapshots(tmp_path)] == [(10, 0.1), (20, 0.2)]
    again.write(25, 0.25, fields_of(mesh, 25))
    again.write(25, 0.25, fields_of(mesh, 25))
    with meshio.xdmf.TimeSeriesReader(tmp_path / "fields.xdmf") as reader:
        reader.read_points_cells()
        assert [reader.read_data(k)[0] for k in range(reader.num_steps)] == [0.1, 0.2, 0.25]


def test_fields_refuse_other_numbers_of_components(tmp_path):
    mesh = local_mesh("T3")
    with pytest.raises(ValueError, match="field q: received 4 components, expected 1, 2 or 6"):
        FieldWriter(tmp_path, mesh).write(0, 0.0, {"q": np.zeros((mesh.n_owned, 4))})


@pytest.mark.parametrize("name", ELEMENTS)
def test_probes_interpolate_on_curved_elements(name):
    mesh = local_mesh(name)
    inside = np.array([1.37, 0.61, 0.23][: mesh.dim])
    centre = mesh.X[mesh.cells[3]].mean(axis=0)
    points = [np.full(mesh.dim, 0.5), np.zeros(mesh.dim), inside, centre]
    probes = Probes(mesh, [(f"P{i}", point) for i, point in enumerate(points)])
    linear = np.hstack(
        [mesh.X, mesh.X @ np.arange(1.0, mesh.dim + 1)[:, None]]
    )  # isoparametric elements keep linear fields
    expected = np.hstack([points, np.array(points) @ np.arange(1.0, mesh.dim + 1)[:, None]])
    assert np.allclose(probes.evaluate(linear), expected, rtol=0, atol=1e-12)


def test_probe_outside_of_the_mesh_is_refused():
    with pytest.raises(
        InputError,
        match=r"\[\[probe\]\] 'A': at = \[2.5, 1\] lies outside of the mesh.*\[0, 2\] x \[0, 1\] m",
    ):
        Probes(local_mesh("T3"), [("B", [1.0, 1.0]), ("A", [2.5, 1.0])])
    with pytest.raises(InputError, match=r"at = \[2.0000001, 1\] lies outside"):
        Probes(local_mesh("T3"), [("A", [2.0000001, 1.0])])


def test_a_probe_a_little_outside_is_shown_with_all_its_digits():
    with pytest.raises(
        InputError, match=r"at = \[2.0000001, 1\] lies outside of the mesh.*\[0, 2\] x \[0, 1\] m"
    ):
        Probes(local_mesh("T3"), [("A", [2.0000001, 1.0])])


def test_no_probes_give_no_values():
    assert Probes(local_mesh("T3"), []).evaluate(np.zeros((15, 2))).shape == (0, 2)


def arrays_of(mesh):
    X = mesh.X[: mesh.n_owned]
    return {
        "u": np.sqrt(X),
        "history": X[:, 0] / 3,
        "plastic": np.tile(X[:, :1, None], (1, 3, 3)),
        "flag": X[:, 0] > 1,
    }


HEADER = {
    "scene": 'title = "block"\n' + "# long\n" * 20000,
    "step": np.int64(7),
    "time": 0.1 + 0.2,
    "omega": [1 / 3],
}


def restored(path, mesh):
    """Return header and arrays of a checkpoint."""
    header = open_checkpoint(path, mesh.comm)
    return header, read_arrays(path, header, mesh)


def test_checkpoint_returns_every_bit(tmp_path):
    mesh = local_mesh("T6")
    write_checkpoint(tmp_path, mesh, HEADER, arrays_of(mesh))
    header, arrays = restored(tmp_path / "checkpoint.h5", mesh)
    assert {key: header[key] for key in HEADER} == HEADER
    assert header["mesh_hash"] == mesh.hash and header["ranks"] == 1
    for name, array in arrays_of(mesh).items():
        assert arrays[name].dtype == array.dtype and np.array_equal(arrays[name], array)
    text = describe(tmp_path / "checkpoint.h5")
    assert (
        mesh.hash in text
        and "block" in text
        and "0.30000000000000004 s" in text
        and "array plastic" in text
    )


def test_the_last_two_checkpoints_are_kept(tmp_path):
    mesh = local_mesh("T3")
    for step in (1, 2, 3):
        write_checkpoint(tmp_path, mesh, {"step": step}, arrays_of(mesh))
    assert open_checkpoint(tmp_path / "checkpoint.h5", COMM)["step"] == 3
    assert open_checkpoint(tmp_path / "checkpoint.previous.h5", COMM)["step"] == 2
    assert len(list(tmp_path.iterdir())) == 2


def test_a_kill_while_writing_leaves_the_last_checkpoint(tmp_path, monkeypatch):
    mesh = local_mesh("T3")
    write_checkpoint(tmp_path, mesh, {"step": 1}, arrays_of(mesh))

    def killed(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(checkpoint, "on_root", killed)
    with pytest.raises(KeyboardInterrupt):
        write_checkpoint(tmp_path, mesh, {"step": 2}, arrays_of(mesh))
    monkeypatch.undo()
    assert open_checkpoint(tmp_path / "checkpoint.h5", COMM)["step"] == 1
    write_checkpoint(tmp_path, mesh, {"step": 3}, arrays_of(mesh))
    assert open_checkpoint(tmp_path / "checkpoint.h5", COMM)["step"] == 3
    assert open_checkpoint(tmp_path / "checkpoint.previous.h5", COMM)["step"] == 1


def spoil(path, kind):
    if kind == "truncated":
        path.write_bytes(path.read_bytes()[:-500])
    if kind == "text":
        path.write_text("not HDF5")
    if kind == "foreign":
        with h5py.File(path, "w") as file:
            file["x"] = np.zeros(3)
    if kind == "newer":
        with h5py.File(path, "a") as file:
            file.attrs["header"] = json.dumps(
                {**json.loads(file.attrs["header"]), "format_version": 99}
            )
        seal(path, COMM)
    if kind == "unreadable":
        path.unlink()
        path.symlink_to("/proc/self/mem")
    if kind == "absent":
        path.unlink()


@pytest.mark.parametrize(
    ("kind", "sentence"),
    [
        (
            "truncated",
            (
                "truncated or damaged, its checksum is not that of its content;"
                " .*checkpoint.previous.h5 is sound"
            ),
        ),
        ("text", "not an HDF5 file, .*checkpoint.previous.h5 is sound"),
        ("foreign", "an HDF5 file, but not a checkpoint .*checkpoint.previous.h5 is sound"),
        ("newer", "received checkpoint format 99, expected at most 2: a newer porofsi wrote it"),
        (
            "absent",
            "no such file, expected a checkpoint; .*checkpoint.previous.h5 is sound, give that",
        ),
        ("unreadable", "not an HDF5 file|could not be read"),
    ],
)
def test_checkpoint_that_cannot_be_used_is_one_sentence(kind, sentence, tmp_path):
    mesh = local_mesh("T3")
    for _ in range(2):
        write_checkpoint(tmp_path, mesh, {"step": 1}, arrays_of(mesh))
    spoil(tmp_path / "checkpoint.h5", kind)
    with pytest.raises(InputError, match=sentence):
        restored(tmp_path / "checkpoint.h5", mesh)


def test_checkpoint_of_another_mesh_states_both(tmp_path):
    mesh = local_mesh("T3")
    other = local_mesh("T6")
    write_checkpoint(tmp_path, mesh, {}, arrays_of(mesh))
    with pytest.raises(InputError, match=f"received mesh hash {mesh.hash}, expected {other.hash}"):
        restored(tmp_path / "checkpoint.h5", other)


def write_results(directory, name, n_steps=4):
    """Write a small result directory with fields, history and scene."""
    mesh = local_mesh(name)
    writer = FieldWriter(directory, mesh)
    history = History(directory, ["A.u_x", "A.u_y", "B.p"], COMM)
    for step in range(1, n_steps + 1):
        writer.write(step, 0.1 * step, fields_of(mesh, 1e-4 * step))
        history.append(0.1 * step, [1e-3 * step, 1e-5 * step**2, -1e5 * step], 3)
    history.close()
    writer.close()
    (directory / "scene.toml").write_text(
        'title = "x"\n[figures]\ntimes = [0.1, 0.32]\npaths = ["A"]\n'
    )
    return mesh


@pytest.mark.parametrize("name", ["T6", "Q9", "Q8", "T10", "H27", "H20"])
def test_figures_are_made_from_the_files(name, tmp_path, monkeypatch):
    monkeypatch.setattr(figures, "DPI", 40)
    write_results(tmp_path, name)
    written = make_figures(tmp_path)
    assert [path.name for path in written] == [
        "pressure.png",
        "displacement.png",
        "histories.png",
        "paths.png",
    ]
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in written)
    assert not list(tmp_path.glob("*.tmp"))


SOLID = "solid = { density = 1.0 }"
FLUID = "fluid = { density = 1.0 }"
PICTURES = {
    "fluid and solid": (
        (FLUID, SOLID),
        {"pressure": "left", "velocity": "left", "displacement": "right"},
    ),
    "fluid": ((FLUID, FLUID), {"pressure": "both", "velocity": "both"}),
    "solid": ((SOLID, SOLID), {"displacement": "both"}),
    "fluid and porous": (
        (FLUID, f"{FLUID}\n{SOLID}"),
        {"pressure": "both", "velocity": "left", "displacement": "right"},
    ),
    "porous": ((f"{FLUID}\n{SOLID}",) * 2, {"pressure": "both", "displacement": "both"}),
}


@pytest.mark.parametrize("case", PICTURES)
def test_a_field_is_drawn_where_the_medium_has_it(case, tmp_path, monkeypatch):
    materials, expected = PICTURES[case]
    serial = serial_mesh("T3")
    right = (serial.points[serial.cells, 0].mean(axis=1) > 1.0).astype(np.int32)
    serial = dataclasses.replace(serial, regions=("left", "right"), cell_region=right)
    mesh = distribute(COMM, serial, np.zeros(len(serial.points), dtype=int))
    FieldWriter(tmp_path, mesh).write(
        1, 0.1, fields_of(mesh, 1.0) | {"fluid velocity": mesh.X[: mesh.n_owned]}
    )
    entries = [
        f'[[material]]\nregion = ["{name}"]\n{text}'
        for name, text in zip(serial.regions, materials, strict=True)
    ]
    (tmp_path / "scene.toml").write_text("\n".join(entries))
    drawn = {}

    def draw(figure, snapshots, values, surface, label, magnification, backdrop):
        x = surface.points[surface.nodes, 0]
        drawn[label[0]] = "both" if np.ptp(x) == 2 else "left" if x.min() == 0 else "right"
        grey = set() if backdrop is None else {tuple(row) for row in backdrop.triangles}
        assert not grey & {tuple(row) for row in surface.triangles}
        assert bool(grey) == (
            drawn[label[0]] == "left"
        )  # what is left of a fluid; a solid is drawn alone

    monkeypatch.setattr(figures, "draw_field", draw)
    monkeypatch.setattr(figures, "DPI", 10)
    assert [path.stem for path in make_figures(tmp_path)] == list(expected)
    assert list(drawn.values()) == list(expected.values())


def test_forces_have_their_panel():
    columns = ["A.u_x", "body.f_x", "body.f_y"]
    history = {name: np.array([0.0, 2.0e3]) for name in ("t", *columns, "coupling_iterations")}
    figure = Figure()
    draw_histories(figure, history, plane=True)
    assert [ax.get_ylabel() for ax in figure.axes] == [
        "displacement [m]",
        "force [N/m]",
        "coupling\niterations",
    ]
    figure = Figure()
    draw_histories(figure, history | {"body.f_z": history["t"]})
    assert figure.axes[1].get_ylabel() == "force [N]"


def test_what_surfaces_record_has_panels_with_units():
    columns = ["in.flow_rate", "in.pressure", "wall.wall_shear", "out.volume", "a.stress_xx"]
    history = {name: np.array([0.0, 2.0e3]) for name in ("t", *columns, "coupling_iterations")}
    figure = Figure()
    draw_histories(figure, history, plane=True)
    assert [ax.get_ylabel() for ax in figure.axes[:-1]] == [
        "pressure [kPa]",
        "stress [kPa]",
        "flow rate [m²/s]",
        "volume [m²]",
        "wall shear [kPa]",
    ]


def test_figures_leave_out_what_has_no_data(tmp_path):
    with pytest.raises(InputError, match="no scene.toml"):
        make_figures(tmp_path)
    (tmp_path / "scene.toml").write_text('title = "x"\n')
    assert make_figures(tmp_path) == []


def test_snapshots_nearest_to_the_times_are_taken_once(tmp_path):
    write_results(tmp_path, "T3")
    chosen = choose_snapshots(read_snapshots(tmp_path), [0.09, 0.11, 0.26, 9.0])
    assert [s.step for s in chosen] == [1, 3, 4]
    assert len(choose_snapshots(read_snapshots(tmp_path), [])) == 4


@pytest.mark.parametrize(
    ("name", "polygons", "lines", "outline"),
    [
        ("T3", 16, 30, 12),
        ("T6", 64, 108, 24),
        ("Q4", 8, 22, 12),
        ("Q9", 32, 76, 24),
        ("Q8", 8, 44, 24),
        ("T4", 56, 84, 32),
        ("T10", 224, 336, 64),
        ("H8", 28, 56, 32),
        ("H27", 112, 224, 64),
        ("H20", 28, 112, 64),
    ],
)
def test_surface_is_drawn_completely(name, polygons, lines, outline, tmp_path):
    """Lines: those of the grid and the diagonals; on a closed surface three for two triangles, two
    for a quadrilateral, four for an octagon.
    """
    write_results(tmp_path, name, 1)
    surface = read_surface(tmp_path)
    assert len(surface.polygons) == polygons and len(surface.outline) == outline
    assert len(surface.lines) == lines
    assert len(surface.triangles) == polygons * (surface.polygons.shape[1] - 2)
    assert np.array_equal(np.unique(surface.triangles), surface.nodes)


def test_units_keep_numbers_near_one():
    assert scaled_unit(1.2e5, "Pa") == (1e-3, "kPa")
    assert scaled_unit(1e6, "Pa") == (1e-6, "MPa")
    assert scaled_unit(0.0021, "m") == (1e3, "mm")
    assert scaled_unit(2e4, "m") == (1.0, "m")
    assert scaled_unit(0.0, "Pa") == (1.0, "Pa")
    assert significant(0.0357) == pytest.approx(0.04) and significant(8463.0) == 8000.0
    assert plain(0.02) == "0.02" and plain(8000.0) == "8,000" and plain(5e7) == r"$5\times 10^{7}$"


def test_result_directory_is_described(tmp_path):
    mesh = write_results(tmp_path, "T3")
    write_checkpoint(tmp_path, mesh, {"step": 4, "time": 0.4}, arrays_of(mesh))
    text = describe(tmp_path)
    assert (
        "0.1 s to 0.4 s" in text
        and "A.u_x" in text
        and "displacement" in text
        and mesh.hash in text
    )


def test_mesh_file_is_described(tmp_path):
    path = tmp_path / "mesh.msh"
    tags = [np.array([1, 1]), np.array([2, 2, 3, 3])]
    meshio.Mesh(
        [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]],
        [("triangle", [[0, 1, 2], [0, 2, 3]]), ("line", [[0, 1], [1, 2], [2, 3], [3, 0]])],
        cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
        field_data={"soil": np.array([1, 2]), "wall": np.array([2, 1]), "top": np.array([3, 1])},
    ).write(path, file_format="gmsh22", binary=False)
    text = describe(path)
    assert "2 T3" in text and "region soil" in text and "tag top" in text
    path.write_text("nothing")
    with pytest.raises(InputError, match="^[^;]*: not readable as a mesh"):
        describe(path)


def test_a_faint_panel_changes_the_colour_scale_for_all():
    loud = np.array([-9e3, 1e4])
    faint = np.array([-1e3, 2e3])
    assert not colour_scale([loud, loud / 2], "Pa").root
    scale = colour_scale([loud, faint], "Pa")
    assert scale.root and (scale.unit, scale.low, scale.high) == ("kPa", -10.0, 10.0)
    colour = scale.mapping["norm"]
    assert (
        colour(0.0) == pytest.approx(0.5)
        and colour(2.5) == pytest.approx(0.75)
        and colour(-10.0) == 0.0
    )


@pytest.mark.parametrize("text", ["displacement magnitude", "displacement magnitude " * 4])
def test_no_label_of_a_figure_is_clipped(text):
    """Of a wide and flat domain with four pictures, a faint one among them."""

    points = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.01], [0.0, 0.01]])
    outline = np.array([[0, 1], [1, 2], [2, 3], [3, 0]])
    surface = Surface(points, np.array([[0, 1, 2], [0, 2, 3]]), outline)
    times = [Snapshot(i, float(i), None, {}) for i in range(4)]
    figure = Figure(layout="constrained")
    FigureCanvasAgg(figure)
    values = [np.array([0.0, 0.1, 0.2, scale]) for scale in (0.3, 0.3, 0.3, 1.0)]
    draw_field(figure, times, values, surface, (text, "m"), 1.0)
    figure.canvas.draw()
    labels = [axis.label for ax in figure.axes for axis in (ax.xaxis, ax.yaxis)]
    for label in [*labels, *figure.texts]:
        box = label.get_window_extent()
        if label.get_text():
            assert box.x0 >= 0 and box.y0 >= 0, label
            assert box.x1 <= figure.bbox.width and box.y1 <= figure.bbox.height, label


def test_a_solid_domain_is_drawn_behind_the_cut_or_whole_where_nothing_would_be_left():
    mesh = serial_mesh("T4")
    whole, half, beyond = (
        surface_of(mesh.points, mesh.cells, mesh.element, cut) for cut in (0.0, None, 5.0)
    )
    assert whole.cut == 0.0 and half.cut == 0.5 and beyond.cut == 0.0
    assert mesh.points[whole.nodes, 1].min() == 0.0 and len(half.triangles) < len(
        whole.triangles
    ) == len(beyond.triangles)


def test_a_single_layer_of_cells_is_drawn_whole():
    mesh = grid("H8", [axis(2.0, 2), axis(1.0, 1), axis(1.0, 1)])
    surface = surface_of(mesh.points, mesh.cells, mesh.element)
    assert surface.cut == 0.0 and len(surface.polygons) == 10


@pytest.mark.parametrize(
    "scene, expected",
    [
        ("bar", {"displacement", "solid velocity", "stress"}),
        ("free_fluid", {"pressure", "fluid velocity"}),
    ],
)
def test_a_run_writes_the_fields_of_its_phases_only(tmp_path, petsc, scene, expected):
    """A field of zeros would say that there is none of it: a fluid has a stress, which is not
    written.
    """
    run_here(Job(str(SCENES / f"{scene}.toml"), str(tmp_path / "run"), ("output.fields_every=1",)))
    snapshots = read_snapshots(tmp_path / "run")
    assert len(snapshots) > 1 and all(snapshot.shapes.keys() == expected for snapshot in snapshots)
