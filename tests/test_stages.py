"""[[stage]]: loads, drains and materials that change in a run, its restart, and what is refused."""

from copy import deepcopy

import numpy as np
import pytest
from mpi4py import MPI

from porofsi_petsc import Simulation, load_scene
from porofsi_petsc.config import scene_to_toml
from porofsi_petsc.config.toml import tomllib
from porofsi_petsc.errors import InputError

pytestmark = pytest.mark.usefixtures("petsc")
# Both runs meet the tolerance of the coupling, 1e-6 of the largest forces; tangents differ.
SAME = 1e-5
T = 0.02  # end of the first stage [s], ten steps
TOP = {"on": ["top"], "pressure": 0.0}


def column(*stages, **sections):
    """Return the tables of Terzaghi's column under 1e4 Pa, with some stages."""
    tables = tomllib.loads(scene_to_toml(load_scene("terzaghi")))
    for name in ("expect", "reference", "line", "surface", "smoke"):
        tables.pop(name, None)
    tables["mesh"]["y"]["cells"] = [8]
    tables["output"] = {}
    tables["time"] |= {"end": T, "growth": 1.0}
    return tables | sections | ({"stage": list(stages)} if stages else {})


def stage(end=2 * T, name="second", **changes):
    return {"name": name, "time": {"end": end}} | changes


def loaded(load):
    return {**TOP, "traction": {"y": load}}


def solved(tables):
    with Simulation.from_scene(tables, MPI.COMM_SELF) as simulation:
        simulation.run()
        return simulation.history, simulation.steps


@pytest.mark.parametrize("load", [-2e4, 0.0])
def test_a_load_that_changes_is_that_of_a_formula(load):
    history, steps = solved(column(stage(boundary=[loaded(load)])))
    one = column()
    one["time"]["end"] = 2 * T
    one["boundary"][2]["traction"]["y"] = f"where(t > {T + 1e-6}, {load}, -1e4)"
    reference, _ = solved(one)
    assert steps == 20
    for name in ("top.u_y", "base.p"):
        scale = np.abs(reference[name]).max()
        np.testing.assert_allclose(history[name], reference[name], rtol=0, atol=SAME * scale)


def test_a_drain_that_is_closed_keeps_the_water():
    """But for half of what flowed before in the first step of the stage: 3/2 r_1 - r_0/2 = 0."""
    second = stage(boundary=[{"on": ["top"], "traction": {"y": -1e4}}])
    second["time"] = {"end": T + 1e-3, "step": 1e-4}
    history, _ = solved(column(second))
    t, settled = history["t"], history["top.u_y"]
    rate = (settled[10] - settled[9]) / (t[10] - t[9])
    assert abs(settled[-1] - settled[10]) <= 0.51 * abs(rate) * 1e-4


def elastic(modulus):
    """Return a bar of one material, held below and at its sides, under 1e4 Pa."""
    return {
        "region": ["body"],
        "solid": {"law": "linear_elastic", "lambda": 0.0, "mu": modulus / 2, "density": 2000.0},
    }


def test_a_softer_solid_is_compressed_more():
    """With λ = 0 the settlement is load times height over the modulus, in each stage."""
    tables = column(
        stage(material=[elastic(2.5e6)]),
        material=[elastic(1e7)],
        probe=[{"name": "top", "at": [0.05, 10.0], "quantities": ["u_y"]}],
    )
    for entry in tables["boundary"]:
        entry.pop("velocity", None)
        entry.pop("pressure", None)
    history, _ = solved(tables)
    exact = -1e4 * 10.0 / np.where(history["t"] > T, 2.5e6, 1e7)
    # of round-off and the tolerance of the coupling
    np.testing.assert_allclose(history["top.u_y"][1:], exact[1:], rtol=1e-6)


def test_a_restart_within_a_stage_is_the_same_run(tmp_path):
    tables = column(stage(boundary=[loaded(-2e4)]), stage(3 * T, "third", boundary=[TOP]))
    with Simulation.from_scene(tables, MPI.COMM_SELF) as whole:
        whole.run(until=1.5 * T)
        path = whole.checkpoint(tmp_path)
        whole.run()
    with Simulation.from_scene(tables, MPI.COMM_SELF, restart=path) as rest:
        assert (rest.stage, rest.steps) == (1, 15)
        rest.run()
        assert rest.finished and rest.stage == 2
        for name in ("pressure", "displacement"):
            np.testing.assert_array_equal(rest.fields[name], whole.fields[name])


def test_a_restart_wants_the_ends_of_the_stages_that_are_over(tmp_path):
    tables = column(stage(boundary=[loaded(-2e4)]), stage(3 * T, "third", boundary=[TOP]))
    with Simulation.from_scene(tables, MPI.COMM_SELF) as whole:
        whole.run(until=2.5 * T)
        path = whole.checkpoint(tmp_path)
    later = column(stage(boundary=[loaded(-2e4)]), stage(4 * T, "third", boundary=[TOP]))
    with Simulation.from_scene(later, MPI.COMM_SELF, restart=path) as rest:
        rest.run()
        assert rest.time == 4 * T
    other = column(stage(2.2 * T, boundary=[loaded(-2e4)]), stage(4 * T, "third", boundary=[TOP]))
    with pytest.raises(InputError, match=r"\[stage.0.time.end\]"):
        Simulation.from_scene(other, MPI.COMM_SELF, restart=path)
    earlier = tables | {"time": tables["time"] | {"end": 0.9 * T}}
    with pytest.raises(InputError, match=r"\[time.end\]"):
        Simulation.from_scene(earlier, MPI.COMM_SELF, restart=path)


def settling(first, *stages):
    """Return the column in steps of 5 s, at first under its weight until that is consolidated."""
    tables = column(*stages)
    tables["time"] |= {"end": 1e6, "step": 1e5} if first else {"end": 50.0, "step": 5.0}
    tables["line"] = [{"name": "up", "from": [0.05, 0.0], "to": [0.05, 10.0], "points": 3}]
    tables["line"][0]["quantities"] = ["u_y"]
    if first:
        tables["body_force"] = {"solid": {"y": -10.0}, "fluid": {"y": -10.0}}
        tables["boundary"][2] = TOP
    return tables


LOADED = {"time": {"end": 1e6 + 50.0, "step": 5.0}, "boundary": [loaded(-1e4)]}


@pytest.mark.mpi
def test_a_reset_leaves_the_settlement_of_the_load_alone():
    """The column is linear; each run meets the tolerance of the coupling, 1e-6 of its forces, and
    the weight of the column is 17 times the load.
    """
    runs = [settling(False), settling(True, stage(**LOADED, reset_displacement=True))]
    found = []
    for tables in runs:
        with Simulation.from_scene(tables, MPI.COMM_WORLD) as simulation:
            simulation.run()
            u = simulation.fields.gathered("displacement")
            found.append((simulation.history, simulation.lines.values("up"), u))
    (alone, line, u), (history, line_after, u_after) = found
    settled = np.abs(alone["top.u_y"]).max()
    close = {"rtol": 0, "atol": 2e-5 * settled}
    after = history["t"] > 1e6
    assert history["top.u_y"][~after][-1] < -3 * settled  # under the weight
    np.testing.assert_allclose(history["top.u_y"][after], alone["top.u_y"][1:], **close)
    np.testing.assert_allclose(line_after["u_y"], line["u_y"], **close)
    if MPI.COMM_WORLD.rank == 0:
        np.testing.assert_allclose(u_after, u, **close)


def test_a_restart_after_a_reset_is_the_same_run(tmp_path):
    """In the stage of the reset, and in one after it."""
    third = stage(1e6 + 75.0, "third", boundary=[TOP])
    tables = settling(True, stage(**LOADED, reset_displacement=True), third)
    with Simulation.from_scene(tables, MPI.COMM_SELF) as whole:
        paths = []
        for until in (1e6 + 25.0, 1e6 + 60.0):
            whole.run(until=until)
            paths.append(whole.checkpoint(tmp_path / f"{len(paths)}"))
        whole.run()
    assert abs(whole.history["top.u_y"][-1]) < 2e-3  # of 17 mm in all
    for path in paths:
        with Simulation.from_scene(tables, MPI.COMM_SELF, restart=path) as rest:
            np.testing.assert_equal(
                rest.last_row[1],
                dict(zip(whole.history["t"], whole.history["top.u_y"], strict=True))[rest.time],
            )
            rest.run()
            np.testing.assert_array_equal(rest.fields["displacement"], whole.fields["displacement"])
    tables["stage"][0].pop("reset_displacement")
    with pytest.raises(InputError, match=r"\[stage.0.reset_displacement\]"):
        Simulation.from_scene(tables, MPI.COMM_SELF, restart=paths[0])


def test_a_stage_may_be_added_to_a_run_at_its_end(tmp_path):
    with Simulation.from_scene(column(), MPI.COMM_SELF) as first:
        first.run()
        path = first.checkpoint(tmp_path)
    longer = column(stage(boundary=[loaded(-2e4)]))
    whole, _ = solved(longer)
    with Simulation.from_scene(longer, MPI.COMM_SELF, restart=path) as rest:
        assert not rest.finished
        rest.run()
        assert rest.history["base.p"][-1] == whole["base.p"][-1]


def test_a_past_stage_may_not_change(tmp_path):
    tables = column(stage(boundary=[loaded(-2e4)]), stage(3 * T, "third", boundary=[TOP]))
    with Simulation.from_scene(tables, MPI.COMM_SELF) as simulation:
        simulation.run(until=2.5 * T)
        path = simulation.checkpoint(tmp_path)
    other = deepcopy(tables)
    other["stage"][0]["boundary"][0]["traction"]["y"] = -3e4
    with pytest.raises(InputError, match=r"\[stage.0.boundary.0.traction.y\]"):
        Simulation.from_scene(other, MPI.COMM_SELF, restart=path)


def test_a_scene_with_stages_loads_again():
    scene = load_scene("terzaghi_stages")
    assert load_scene(tomllib.loads(scene_to_toml(scene))) == scene
    assert [part.time.end for part in scene.stages] == [5.0, 10.0, 30.0]
    assert [part.time.begins for part in scene.stages] == [0.0, 5.0, 10.0]
    smoke = load_scene("terzaghi_stages", smoke=True)
    assert smoke.end == 0.03


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"time": {"end": T / 2}}, r"\[stage.0.time.end\]: received 0.01 s, expected a time after"),
        ({"time": {}}, r"\[stage.0.time.end\]: received nothing"),
        ({"boundary": TOP}, r"\[stage.0.boundary\]: received one table, .* write .*\[\[…\]\]"),
        ({"time": {"end": 1.0, "stp": 1.0}}, r"\[stage.0.time.stp\]: unknown key 'stp'"),
        ({"time": {"end": 1.0, "scheme": "steady"}}, r"\[stage.0.time.scheme\]: received 'steady'"),
        ({"boundary": [{**TOP, "flux": 0.0}]}, r"\[stage.0.boundary.0"),
        ({"boundary": [{"on": ["top"], "presure": 0.0}]}, r"\[stage.0.boundary.0.presure\]"),
        ({"boundary": [{"on": ["lid"], "pressure": 0.0}]}, r"lid.*\(in the stage 'second'\)"),
    ],
)
def test_what_is_no_stage_is_refused(changes, text):
    with pytest.raises(InputError, match=text):
        Simulation.from_scene(column(stage() | changes), MPI.COMM_SELF)
