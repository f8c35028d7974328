"""A scene as one participant of a coupled run: beside a stand-in of preCICE that replays what the
other side did in a run of both, and over the library where it is installed.
"""

import importlib
import os
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import tomli_w
from mpi4py import MPI
from running import SCENES

from porofsi_petsc import Simulation, load_scene
from porofsi_petsc.config.toml import read_toml
from porofsi_petsc.errors import ConvergenceError, InputError
from porofsi_petsc.output.history import read_history
from porofsi_petsc.simulation.precice_config import Configuration, Iterations

FLAP = SCENES / "flap.toml"
SHIPPED = Path(__file__).resolve().parents[1] / "configs" / "precice"
CONFIGURATION = SHIPPED / "precice-config.xml"
STEP = 0.01
# Steps and data that all runs have; with rho_inf = 0 the collocation level is the end of the step.
SAME = {"end": 5 * STEP, "step": STEP, "rho_inf": 0.0}
# The replayed motion is converged to 1e-9 of the forces, and so is the answer of the fluid to it.
TIGHT = {"tolerance": 1e-9, "interface": "dirichlet_neumann"}
AGREE = 1e-7


def has_library():
    """Return whether preCICE and its Python bindings are installed."""
    try:
        importlib.import_module("precice")
    except ImportError:
        return False
    return True


class StandIn:
    """What the package uses of `precice.Participant`: every window is done twice, and the other
    side's values are those of a function (t, X) at its end.
    """

    dim = 2
    window = STEP
    end = SAME["end"]
    values = None  # (t, X (N, d)) -> (N, d)
    connected = False  # whether a mapping asks for facets
    pieces = None  # of the interface: the places of their corners
    told = None  # what was written, at the start and in every iteration

    def __init__(self, *names):
        self.t, self.repeat, self.written = 0.0, True, []
        type(self).told = self.written

    def get_mesh_dimensions(self, mesh):
        return self.dim

    def get_data_dimensions(self, mesh, data):
        return self.dim

    def set_mesh_vertices(self, mesh, X):
        self.X = X
        return np.arange(len(X))

    def requires_mesh_connectivity_for(self, mesh):
        return self.connected

    def set_mesh_edges(self, mesh, vertices):
        type(self).pieces = self.X[vertices]

    set_mesh_triangles = set_mesh_edges

    def requires_initial_data(self):
        return True

    def initialize(self):
        assert self.written  # zeros

    def is_coupling_ongoing(self):
        return self.t < self.end - 1e-9

    def get_max_time_step_size(self):
        return self.window

    def requires_writing_checkpoint(self):
        return self.repeat

    def read_data(self, mesh, data, vertices, dt):
        first_guess = 0.5 if self.repeat else 1.0
        return first_guess * type(self).values(self.t + dt, self.X)

    def write_data(self, mesh, data, vertices, values):
        self.written.append(values)

    def advance(self, dt):
        self.t += 0.0 if self.repeat else dt
        self.repeat = not self.repeat

    def requires_reading_checkpoint(self):
        return not self.repeat

    def finalize(self):
        self.repeat = None


@pytest.fixture
def stand_in(monkeypatch):
    participant = type("Participant", (StandIn,), {})
    monkeypatch.setitem(sys.modules, "precice", SimpleNamespace(Participant=participant))
    return participant


def side(region, **changes):
    """Return the scene of one side of the flap as a dict."""
    scene = read_toml(FLAP)
    wet = {"body": "flap", "flap": "body"}[region]
    boundary = scene["boundary"] if region == "body" else [HELD]
    scene |= {
        "mesh": scene["mesh"] | {"keep": [region]},
        "material": [entry for entry in scene["material"] if entry["region"] == region],
        "boundary": boundary,
        "time": SAME,
        "coupling": {"tolerance": 1e-9},
        "force": [{"name": "flap", "on": wet}] if region == "body" else [],
        "probe": [] if region == "body" else [TIP],
        "precice": {
            "config": str(CONFIGURATION),
            "participant": "Fluid" if region == "body" else "Solid",
            "mesh": "Mesh",
            "on": wet,
            "read": "Displacement" if region == "body" else "Force",
            "write": "Force" if region == "body" else "Displacement",
        },
    }
    return scene | changes


HELD = {"on": "bottom", "displacement": {"x": 0.0, "y": 0.0}}
TIP = {"name": "tip", "at": [0.5, 0.2], "quantities": ["u_x", "u_y"]}


def both_sides(**changes):
    """Return history and, at the end of every step, displacement and force at places on the
    interface, of one scene with both.
    """
    scene = read_toml(FLAP) | {"time": SAME, "coupling": TIGHT} | changes
    found = {}

    def keep(simulation):
        coupling = simulation.coupling
        mesh = coupling.solid.mesh
        n = mesh.n_owned
        values = np.column_stack([coupling.displacement()[:n], coupling.fluid.force])
        rows = mesh.comm.allgather((mesh.X[:n], values))
        places = np.round(np.concatenate([X for X, _ in rows]), 9)
        values = np.concatenate([value for _, value in rows])
        found[round(simulation.time / STEP)] = dict(zip(map(tuple, places), values, strict=True))

    with Simulation.from_scene(scene) as simulation:
        simulation.run(callbacks=[keep])
        return simulation.history, found


def replayed(found, columns):
    """Return the function of the stand-in that gives some columns of `both_sides`."""

    def values(t, X):
        at = found[round(t / STEP)]
        rows = [at[tuple(place)][columns] for place in np.round(X, 9)]
        return np.array(rows).reshape(-1, 2)

    return staticmethod(values)


def require_same(found, expected, columns):
    """Compare columns of two histories, over the largest value of each."""
    for column in columns:
        size = np.abs(expected[column]).max()
        assert np.abs(found[column] - expected[column]).max() < AGREE * size, column


@pytest.mark.mpi
@pytest.mark.parametrize(
    "region, told, columns",
    [
        ("body", slice(0, 2), ("flap.f_x", "flap.f_y")),
        ("flap", slice(2, 4), ("tip.u_x", "tip.u_y")),
    ],
    ids=["fluid told the displacement", "solid told the force"],
)
def test_a_side_told_what_the_other_did_answers_as_one_scene_with_both(
    stand_in, region, told, columns
):
    history, found = both_sides()
    stand_in.values = replayed(found, told)
    with Simulation.from_scene(side(region)) as simulation:
        simulation.run()
        require_same(simulation.history, history, columns)


def test_a_force_is_that_on_the_collocation_level(stand_in):
    """As that of a load on a point, which is evaluated there."""
    tip = np.array([0.5, 0.2])

    def force(t, X):
        at_tip = (abs(X - tip) < 1e-9).all(axis=1)
        return np.column_stack([np.where(at_tip, 300 * t, 0.0), 0 * X[:, 0]])

    stand_in.values = staticmethod(force)
    load = {"at": [0.5, 0.2], "force": {"x": "300*t"}}
    changes = {"time": SAME | {"rho_inf": 0.5}}
    alone = side("flap", **changes, load=[load], boundary=[HELD, {"on": "body"}])
    del alone["precice"]
    told, loaded = (_end(scene, "tip.u_x") for scene in (side("flap", **changes), alone))
    assert told == pytest.approx(loaded, rel=1e-8)  # both converged to 1e-9


def test_forces_at_the_ends_of_windows_have_the_impulse_of_a_sudden_start(stand_in):
    """F_n + (1 - α_f)(F_n - F_{n-1}) of collocated forces F_n, F_0 = 0, add up to their sum and
    (1 - α_f) F_N; α_f = 2/3.
    """
    stand_in.values = staticmethod(lambda t, X: 0 * X)
    scene = side("body", time=SAME | {"rho_inf": 0.5})
    scene["mesh"]["order"] = 2
    scene["boundary"][0] = {"on": "left", "velocity": {"x": "20*y*(0.4 - y)", "y": 0.0}}
    collocated = []

    def keep(simulation):
        mesh = simulation.coupling.fluid.mesh
        nodes = np.unique(mesh.facets["flap"].nodes)
        force = simulation.coupling.fluid.state()["force_collocated"]
        collocated.append(force[nodes].sum(axis=0))

    with Simulation.from_scene(scene) as simulation:
        simulation.run(callbacks=[keep])
    accepted = stand_in.told[2::2]
    impulse = np.sum(accepted, axis=(0, 1))
    expected = np.sum(collocated, axis=0) + collocated[-1] / 3
    assert impulse == pytest.approx(expected, rel=1e-9)
    assert collocated[0][0] > 5 * collocated[-1][0]  # the start is sudden


def _end(scene, column):
    with Simulation.from_scene(scene) as simulation:
        simulation.run()
        return simulation.history[column][-1]


def test_windows_of_another_size_or_another_end_are_refused(stand_in):
    stand_in.values = staticmethod(lambda t, X: 0 * X)
    for name, value, text in (
        ("window", 2 * STEP, "time windows of 0.02 s, expected steps of this program, 0.01 s"),
        ("end", 3 * STEP, "the coupling has ended before time.end"),
        ("end", 9 * STEP, "the coupling goes on after time.end"),
        ("dim", 3, "'Mesh' of dimension 3, expected a mesh of dimension 2"),
    ):
        kept = getattr(stand_in, name)
        setattr(stand_in, name, value)
        with (
            Simulation.from_scene(side("flap")) as simulation,
            pytest.raises(InputError, match=re.escape(text)),
        ):
            simulation.run()
        setattr(stand_in, name, kept)


SOFT = {"law": "linear_elastic", "young": 1e5, "poisson": 0.3, "density": 1000.0}
BAR = {
    "mesh": {
        "kind": "box",
        "order": 2,
        "x": {"points": [0.0, 2.0], "cells": [2]},
        "y": {"points": [0.0, 1.0], "cells": [1]},
        "z": {"points": [0.0, 1.0], "cells": [1]},
    },
    "material": [{"region": "body", "solid": SOFT}],
    "boundary": [{"on": "left", "displacement": {"x": 0.0, "y": 0.0, "z": 0.0}}],
    "model": {"solid_inertia": False},
    "probe": [],
}


@pytest.mark.parametrize("order, parts", [(1, 1), (2, 2)])
def test_a_mapping_that_asks_for_facets_gets_the_whole_interface(stand_in, order, parts):
    """In pieces between nodes: each is there once, and they are as long as its three sides."""
    stand_in.values = staticmethod(lambda t, X: 0 * X)
    stand_in.connected = True
    scene = side("flap")
    scene["mesh"]["order"] = order
    with Simulation.from_scene(scene) as simulation:
        simulation.step()
        facets = simulation.coupling.solid.mesh.facets["body"]
    pieces = stand_in.pieces
    assert len(pieces) == parts * len(facets.nodes)
    length = np.linalg.norm(pieces[:, 1] - pieces[:, 0], axis=1).sum()
    assert length == pytest.approx(0.2 + 0.1 + 0.2, rel=1e-12)


def test_facets_in_space_are_triangles(stand_in):
    """Those of a bar of length 2 and section 1 that is held at one end."""
    stand_in.values = staticmethod(lambda t, X: 0 * X)
    stand_in.connected = True
    stand_in.dim = 3
    scene = side("flap", **BAR)
    scene["precice"]["on"] = ["right", "bottom", "top", "front", "back"]
    with Simulation.from_scene(scene) as simulation:
        simulation.step()
    a, b, c = np.swapaxes(stand_in.pieces, 0, 1)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    assert area == pytest.approx(4 * 2 + 1, rel=1e-12)


def configuration(folder, **replaced):
    """Write the shipped configuration of preCICE with other values of some elements."""
    text = CONFIGURATION.read_text()
    for key, value in replaced.items():
        name = key.replace("_", "-")
        text = re.sub(f'<{name} value="[^"]+"', f'<{name} value="{value}"', text)
    path = folder / "precice-config.xml"
    path.write_text(text)
    return path


def test_a_window_that_takes_all_iterations_may_not_agree(stand_in, tmp_path):
    """Unless the measures are strict, with which preCICE itself ends the run; the stand-in does
    every window twice.
    """
    stand_in.values = staticmethod(lambda t, X: 0 * X)
    path = configuration(tmp_path, max_iterations=2)
    scene = side("flap")
    scene["precice"]["config"] = str(path)
    with Simulation.from_scene(scene) as simulation:
        simulation.step()
    path.write_text(path.read_text().replace('strict="true"', 'strict="off"'))
    with (
        Simulation.from_scene(scene) as simulation,
        pytest.raises(ConvergenceError, match="took all 2 iterations that max-iterations"),
    ):
        simulation.step()


@pytest.mark.parametrize("region", ["body", "flap"])
@pytest.mark.parametrize(
    "old, new, message",
    [
        ("conservative", "consistent", "'consistent' in the mapping of forces from 'Fluid-Mesh'"),
        ("consistent", "conservative", "'conservative' in the mapping of displacements from"),
    ],
)
def test_forces_are_mapped_as_forces(stand_in, tmp_path, region, old, new, message):
    stand_in.values = staticmethod(lambda t, X: 0 * X)
    path = configuration(tmp_path)
    path.write_text(path.read_text().replace(f'constraint="{old}"', f'constraint="{new}"'))
    scene = side(region)
    mesh = {"body": "Fluid-Mesh", "flap": "Solid-Mesh"}[region]
    scene["precice"] |= {"config": str(path), "mesh": mesh}
    with (
        Simulation.from_scene(scene) as simulation,
        pytest.raises(InputError, match=message),
    ):
        simulation.step()


def test_a_strict_measure_that_is_not_met_is_a_failed_iteration(stand_in, tmp_path, monkeypatch):
    stand_in.values = staticmethod(lambda t, X: 0 * X)
    scene = side("flap")
    scene["precice"]["config"] = str(configuration(tmp_path, max_iterations=1))

    def ends(self, dt):
        raise RuntimeError("The strict convergence measure did not converge")

    monkeypatch.setattr(stand_in, "advance", ends)
    with (
        Simulation.from_scene(scene) as simulation,
        pytest.raises(ConvergenceError, match="took all 1 iterations"),
    ):
        simulation.step()


@pytest.mark.parametrize(
    "scheme, expected",
    [
        ('serial-explicit><participants first="A" second="B"/>', Iterations()),
        (
            'parallel-implicit><participants first="C" second="B"/><max-iterations value="3"/>',
            Iterations(),
        ),
        (
            'multi><participant name="A" control="yes"/><max-iterations value="9"/>'
            '<absolute-convergence-measure strict="1"/><residual-relative-convergence-measure/>',
            Iterations(9, strict=False),
        ),
        (
            'serial-implicit><participants first="B" second="A"/><max-iterations value="7"/>'
            '<absolute-or-relative-convergence-measure strict="on"/>',
            Iterations(7, strict=True),
        ),
    ],
    ids=["explicit", "of others", "several", "strict"],
)
def test_the_iterations_of_a_window_are_those_of_the_scheme_of_the_participant(
    tmp_path, scheme, expected
):
    name = scheme.partition(">")[0]
    path = tmp_path / "precice-config.xml"
    path.write_text(
        f"<precice-configuration><coupling-scheme:{scheme}</coupling-scheme:{name}>"
        '<participant name="A"/></precice-configuration>'
    )
    assert Configuration(path).iterations("A") == expected


def test_what_the_library_refuses_and_a_missing_one_are_told(stand_in, monkeypatch):
    def refuses(self, *arguments):
        raise RuntimeError("the mesh is unknown")

    monkeypatch.setattr(stand_in, "set_mesh_vertices", refuses)
    with (
        Simulation.from_scene(side("flap")) as simulation,
        pytest.raises(InputError, match=r"\[precice\]: preCICE says: the mesh is unknown"),
    ):
        simulation.run()
    monkeypatch.setitem(sys.modules, "precice", None)
    with (
        Simulation.from_scene(side("flap")) as simulation,
        pytest.raises(InputError, match="install the library and pyprecice"),
    ):
        simulation.run()


def test_a_restart_is_refused(stand_in, tmp_path):
    stand_in.values = staticmethod(lambda t, X: 0 * X)
    with Simulation.from_scene(side("flap")) as simulation:
        simulation.run()
        path = simulation.checkpoint(tmp_path)
    with pytest.raises(InputError, match="the coupling begins at t = 0; start anew"):
        Simulation.from_scene(side("flap"), restart=path)


@pytest.mark.parametrize(
    "region, changes, message",
    [
        ("flap", {"time": SAME | {"growth": 1.1}}, "received 1.1 with [precice], expected 1.0"),
        ("flap", {"coupling": {"scheme": "direct"}}, "received 'direct' with [precice]"),
        ("body", {"model": {"moving_mesh": False}}, "whose interface moves, expected true"),
    ],
)
def test_what_a_participant_cannot_have_is_refused(region, changes, message):
    with pytest.raises(InputError, match=re.escape(message)):
        load_scene(side(region, **changes))


def test_a_fluid_that_the_interface_closes_is_refused():
    scene = side("body")
    scene["boundary"] = [scene["boundary"][1] | {"on": ["bottom", "top", "left", "right"]}]
    with pytest.raises(InputError, match="received a fluid that the interface closes"):
        Simulation.from_scene(scene)


def test_regions_that_are_no_part_of_the_mesh_are_refused():
    scene = side("body")
    scene["mesh"]["keep"] = ["steel"]
    with pytest.raises(InputError, match=re.escape("expected regions of the mesh: body, flap")):
        Simulation.from_scene(scene)


# -- over the library ------------------------------------------------------------------------------

BOTH_DATA = """
<data name="Force" mesh="Solid-Mesh"/>
<data name="Displacement" mesh="Solid-Mesh"/>
<preconditioner type="residual-sum"/>
"""
needs_library = pytest.mark.skipif(
    MPI.COMM_WORLD.size > 1 or not has_library(), reason="starts two runs over preCICE"
)


def run_both(folder, scenes):
    """Run both participants with a configuration in a folder; return exit codes and output."""
    command = [sys.executable, "-m", "porofsi_petsc", "run"]
    runs = [
        subprocess.Popen(
            [*command, str(folder / f"{name}.toml"), "--output", str(folder / name)],
            cwd=folder,
            env=os.environ | {"OMP_NUM_THREADS": "1"},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        for name in scenes
    ]
    said = [run.communicate(timeout=300)[0] for run in runs]
    return [run.returncode for run in runs], said


def write_both(folder, replaced):
    """Write the scenes of both participants and their configuration, a text with replacements."""
    path = configuration(folder, max_time=SAME["end"], time_window_size=STEP)
    text = path.read_text()
    for old, new in replaced:
        assert old in text
        text = text.replace(old, new)
    path.write_text(text)
    for region, name in (("body", "fluid"), ("flap", "solid")):
        scene = side(region)
        scene["precice"] |= {"config": path.name, "mesh": f"{name.capitalize()}-Mesh"}
        (folder / f"{name}.toml").write_text(tomli_w.dumps(scene))


@needs_library
@pytest.mark.parametrize(
    "replaced",
    [
        [],
        [("nearest-neighbor", "nearest-projection")],
        [
            ("serial-", "parallel-"),
            ('      <data name="Force" mesh="Solid-Mesh"/>\n', BOTH_DATA),
        ],
    ],
    ids=["serial", "mapped by facets", "parallel"],
)
def test_two_runs_over_the_library_are_one_scene_with_both(tmp_path, replaced):
    """The data of preCICE agree to 1e-8 at the end of a window."""
    write_both(tmp_path, replaced)
    codes, said = run_both(tmp_path, ["fluid", "solid"])
    assert codes == [0, 0], said
    fluid, solid = (read_history(tmp_path / name / "history.csv") for name in ("fluid", "solid"))
    history, _ = both_sides()
    require_same(fluid, history, ("flap.f_x", "flap.f_y"))
    require_same(solid, history, ("tip.u_x", "tip.u_y"))


@needs_library
@pytest.mark.parametrize("strict", [True, False])
def test_no_run_over_the_library_ends_well_with_data_that_do_not_agree(tmp_path, strict):
    """Three iterations do not reach 1e-8."""
    loose = [] if strict else [(' strict="true"', "")]
    write_both(tmp_path, [('<max-iterations value="40"', '<max-iterations value="3"'), *loose])
    codes, said = run_both(tmp_path, ["fluid", "solid"])
    assert codes == [3, 3], said
    assert all("took all 3 iterations" in text for text in said)


def test_the_shipped_participants_are_the_sides_of_the_shipped_flap():
    both = load_scene("perpendicular_flap")
    fluid, solid = (load_scene(SHIPPED / f"{name}.toml") for name in ("fluid", "solid"))
    assert fluid.material[0] == both.material[0]
    assert solid.material[0].solid == both.material[1].solid
    assert fluid.time == solid.time == both.time
    text = CONFIGURATION.read_text()
    assert f'<max-time value="{both.time.end}"' in text
    assert f'<time-window-size value="{both.time.step}"' in text
