"""The public interface: a simulation step by step, scenes and loads of Python, results as
arrays.
"""

import sys

import numpy as np
import pytest
from mpi4py import MPI
from running import Job, complete, history, needs_mpirun, run_here

from porofsi_petsc import Simulation, load_scene, read_fields, read_history, run
from porofsi_petsc.errors import InputError, LimitError

pytestmark = pytest.mark.usefixtures("petsc")
COLUMN = (
    "expect=[]",
    "time.end=0.02",
    "time.growth=1.0",
    "time.step=2e-3",
    "output={ fields_every = 5, checkpoint_every = 5 }",
)
COMM = MPI.COMM_WORLD
# Of a state that is the same but for the order of sums over ranks: round-off grown by the condition
# of the systems.
RANKS = 1e-8


def column(*overrides, comm=MPI.COMM_SELF):
    return Simulation.from_scene("terzaghi", comm, overrides=(*COLUMN, *overrides))


def test_it_gives_what_a_run_writes(tmp_path):
    run_here(Job("terzaghi", str(tmp_path), COLUMN))
    written = read_history(tmp_path / "history.csv")
    last = read_fields(tmp_path)
    with column() as simulation:
        simulation.run()
        assert simulation.finished and simulation.steps == len(written["t"]) - 1
        assert {name: values.tolist() for name, values in simulation.history.items()} == {
            name: values.tolist() for name, values in written.items()
        }
        assert last["t"] == simulation.time
        for name in ("displacement", "pressure", "stress", "porosity"):
            own = simulation.fields.gathered(name)
            found = last[name].reshape(len(own), -1)[:, : own.shape[1]]
            np.testing.assert_array_equal(found, own)
        np.testing.assert_array_equal(last["points"][:, :2], simulation.fields.gathered("points"))


def test_fields_of_a_time_that_was_not_written_are_refused(tmp_path):
    run_here(Job("terzaghi", str(tmp_path), COLUMN))
    assert read_fields(tmp_path, 0.01)["t"] == pytest.approx(0.01, rel=1e-15)
    with pytest.raises(
        InputError,
        match="received the time 0.011 s, expected one that was written; the nearest is 0.01 s",
    ):
        read_fields(tmp_path, 0.011)
    with pytest.raises(InputError, match="no fields of a run"):
        read_fields(tmp_path / "fields")


def test_steps_one_by_one_are_those_of_a_run():
    with column() as one, column() as other:
        one.run()
        while not other.finished:
            other.step()
        np.testing.assert_array_equal(one.fields["pressure"], other.fields["pressure"])
        with pytest.raises(InputError, match="is time.end of the scene"):
            other.step()


def test_until_ends_there_and_nowhere_else():
    with column() as simulation:
        simulation.run(until=0.005)
        assert (simulation.time, simulation.steps) == (0.005, 3)  # 2, 4, 5 ms
        assert simulation.history["t"][-1] == 0.005
        simulation.step()
        assert simulation.time == pytest.approx(0.007, rel=1e-14)
        with pytest.raises(
            InputError, match="until: received 0.001 s, expected 0.007 s, where the simulation is"
        ):
            simulation.run(until=1e-3)
        with pytest.raises(InputError, match="to time.end = 0.02 s"):
            simulation.run(until=1.0)
        with pytest.raises(InputError, match="or a time from"):  # permeability is not to blame
            simulation.run(until=simulation.time * (1 + 1e-14))
        simulation.run(until=simulation.time)
        assert simulation.steps == 4


def test_every_callback_is_called_and_one_can_end_the_run():
    seen = []
    always = []
    with column() as simulation:
        simulation.callbacks.append(lambda s: always.append(s.time))
        simulation.run(callbacks=[lambda s: s.steps == 3, lambda s: seen.append(s.steps)])
        assert seen == [1, 2, 3] and not simulation.finished
        simulation.step()
        assert (len(always), seen[-1]) == (4, 3)  # those of a run are for that run alone


def test_a_checkpoint_continues(tmp_path):
    with column() as whole:
        whole.run(callbacks=[lambda s: s.steps == 5 and s.checkpoint(tmp_path) is None])
        wanted = whole.fields["pressure"]
    changes = {"overrides": COLUMN, "restart": tmp_path / "checkpoint.h5"}
    with Simulation.from_scene("terzaghi", MPI.COMM_SELF, **changes) as rest:
        assert (rest.steps, len(rest.history["t"])) == (5, 1)
        rest.run()
        np.testing.assert_array_equal(rest.fields["pressure"], wanted)


def test_a_limit_leaves_the_step_that_passed_it():
    with column("model.moving_mesh=false", "limits.mesh_displacement=1e-12") as simulation:
        with pytest.raises(LimitError):
            simulation.step()
        assert simulation.steps == len(simulation.history["t"]) - 1 == 1


def test_a_closed_simulation_keeps_its_fields_and_makes_no_step():
    """PETSc would end the process with a segmentation fault."""
    with column() as simulation:
        simulation.step()
    simulation.close()
    assert simulation.fields["pressure"].max() > 1e3
    for advance in (simulation.step, simulation.run):
        with pytest.raises(InputError, match="the simulation is closed"):
            advance()


def test_a_callback_that_comes_within_a_run_stays():
    seen = []
    with column() as simulation:
        late = [lambda s: s.callbacks.append(lambda s: seen.append(s.steps))]
        simulation.run(until=0.002, callbacks=late)
        simulation.step()
    assert seen == [2]


def test_a_checkpoint_makes_its_folder(tmp_path):
    with column() as simulation:
        assert simulation.checkpoint(tmp_path / "a" / "b").is_file()


# -- scenes and loads of Python --------------------------------------------------------------------


def tables(load):
    """Return the tables of a column whose top has a traction."""
    return {
        "title": "a column from Python",
        "mesh": {
            "kind": "rectangle",
            "x": {"points": [0.0, 0.1], "cells": [1], "ratios": [1.0]},
            "y": {"points": [0.0, 1.0], "cells": [8], "ratios": [1.0]},
        },
        "time": {"end": 0.02, "step": 0.005, "scheme": "backward_euler"},
        "model": {"solid_inertia": False, "fluid_inertia": False},
        "limits": {"inertia": "report"},
        "material": [
            {
                "region": "all",
                "porosity": 0.4,
                "solid": {"law": "linear_elastic", "density": 2000.0, "lambda": 1e6, "mu": 1e6},
                "fluid": {"density": 1000.0, "specific_weight": 1e4},
                "permeability": {"law": "constant", "k": 1e-4},
            }
        ],
        "boundary": [
            {"on": ["left", "right"], "displacement": {"x": 0.0}},
            {"on": "bottom", "displacement": {"y": 0.0}},
            {"on": "top", "pressure": 0.0, "traction": {"y": load}},
        ],
        "probe": [{"name": "base", "at": [0.0, 0.0], "quantities": ["p"]}],
    }


def ramp(t, X):
    return -1e4 * min(t / 0.01, 1.0) * (1 + X[:, 0])


def test_a_function_of_python_is_a_load_like_its_formula():
    assert load_scene(tables("0")).name == "scene"
    found = []
    for load in (ramp, "-1e4*minimum(t/0.01, 1)*(1 + x)"):
        with Simulation.from_scene(tables(load), MPI.COMM_SELF) as simulation:
            simulation.run()
            found.append(simulation.history["base.p"])
    assert found[0][-1] > 1e3
    np.testing.assert_allclose(*found, rtol=1e-12)  # the same to the order of products


def test_a_run_with_a_function_restarts_by_its_name(tmp_path):
    checkpoint = {"output": {"checkpoint_every": 2}}
    run(load_scene(tables(ramp) | checkpoint, ("time.end=0.01",)), tmp_path, quiet=True)
    run(
        load_scene(tables(ramp) | checkpoint),
        tmp_path,
        quiet=True,
        restart=tmp_path / "checkpoint.h5",
    )
    assert history(tmp_path)["t"][-1] == 0.02
    with pytest.raises(InputError, match="restart with the same value"):
        run(
            tables(lambda t, X: 0.0) | checkpoint,
            tmp_path,
            quiet=True,
            restart=tmp_path / "checkpoint.h5",
        )
    with pytest.raises(
        InputError, match=r"the function 'test_simulation\.ramp' of Python, which no file can hold"
    ):
        load_scene(tmp_path / "scene.toml")


@pytest.mark.parametrize(
    "function, message",
    [
        (lambda t, X: np.zeros((len(X), 2)), r"of float64 of shape \(\d+, 2\) for \d+ points"),
        (lambda t, X: np.full(len(X), np.nan), "expected a finite number"),
    ],
)
def test_what_a_function_returns_is_checked(function, message):
    with pytest.raises(InputError, match=message):
        Simulation.from_scene(tables(function), MPI.COMM_SELF).run()


def test_a_function_that_changes_its_points_changes_nothing():
    """They are those of the mesh, if they are not a copy."""

    def start(t, X):
        X *= 0.5
        return 0 * X[:, 0]

    changed = tables(ramp) | {"initial": {"displacement": {"y": start}}}
    found = []
    for scene in (changed, tables(ramp)):
        with Simulation.from_scene(scene, MPI.COMM_SELF) as simulation:
            simulation.run()
            found.append(simulation.history["base.p"][-1])
    assert found[0] == found[1]


def test_numbers_and_arrays_of_numpy_are_numbers_and_lists():
    own = tables(np.int64(-10))
    own["mesh"]["y"]["cells"] = np.array([8])
    own["mesh"]["x"]["points"] = (0.0, np.float32(0.5))
    assert load_scene(own).mesh.y.cells == (8,)
    assert load_scene(own).boundary[2].traction.y.source == -10.0


@pytest.mark.parametrize(
    "value",
    ["-1e4", None, True, 1j, np.ma.masked_all(1)],
    ids=["text", "none", "bool", "complex", "mask"],
)
def test_a_function_returns_real_numbers(value):
    with pytest.raises(InputError, match=r"boundary.2.traction.y\]: .*(real numbers|finite)"):
        Simulation.from_scene(tables(lambda t, X: value), MPI.COMM_SELF).run()


def test_a_function_of_numpy_is_a_function():
    with pytest.raises(InputError, match="of Python, which no file can hold"):
        load_scene(tables({"function": "numpy.sin"}))
    assert "sin" in load_scene(tables(np.sin)).boundary[2].traction.y.source["function"]


def test_a_scene_of_python_is_validated_like_a_file():
    broken = tables(0.0) | {"timee": {}}
    with pytest.raises(InputError, match=r"scene .*unknown key 'timee'; did you mean 'time'"):
        load_scene(broken)


# -- communicators ---------------------------------------------------------------------------------


@pytest.mark.mpi
def test_two_halves_of_the_ranks_run_simulations_of_their_own():
    """Each half does another number of steps; the results are those of one rank."""
    half = COMM.Split(COMM.rank % 2)
    changes = (f"time.end={(0.02, 0.012)[COMM.rank % 2]}",)
    with Simulation.from_scene("terzaghi", half, overrides=(*COLUMN, *changes)) as simulation:
        simulation.run()
        own = simulation.history["base.p"]
    with Simulation.from_scene(
        "terzaghi", MPI.COMM_SELF, overrides=(*COLUMN, *changes)
    ) as simulation:
        simulation.run()
        np.testing.assert_allclose(own, simulation.history["base.p"], rtol=RANKS)
    half.Free()


@pytest.mark.mpi
def test_gathered_fields_do_not_depend_on_the_ranks():
    with column(comm=COMM) as simulation:
        simulation.run()
        found = {
            name: simulation.fields.gathered(name)
            for name in ("points", "pressure", "displacement")
        }
    with column() as alone:
        alone.run()
        expected = {name: alone.fields.gathered(name) for name in found}
    if COMM.rank == 0:
        np.testing.assert_array_equal(found["points"], expected["points"])
        for name in ("pressure", "displacement"):
            np.testing.assert_allclose(
                found[name], expected[name], rtol=0, atol=RANKS * np.abs(expected[name]).max()
            )
    else:
        assert all(array is None for array in found.values())


@pytest.mark.mpi
def test_a_callback_that_is_true_on_one_rank_ends_the_run_on_all():
    with column(comm=COMM) as simulation:
        simulation.run(callbacks=[lambda s: s.steps == 3 and COMM.rank == COMM.size - 1])
        assert simulation.steps == 3


ALONE = """
from mpi4py import MPI
from porofsi_petsc import Simulation
rank = MPI.COMM_WORLD.rank

def watch(simulation):
    if rank == 1 and simulation.steps == 2:
        raise {error}

with Simulation.from_scene("terzaghi", overrides=["time.end=0.02", "expect=[]"]) as simulation:
    simulation.run(callbacks=[watch])
"""


@needs_mpirun
@pytest.mark.parametrize(
    "error, code, said",
    [("ZeroDivisionError('one of us')", 1, "one of us"), ("SystemExit(7)", 7, "rank 1 of 2")],
)
def test_an_error_of_one_rank_ends_the_job_of_all(error, code, said, tmp_path):
    """The others wait for it in the next step, for ever."""
    script = tmp_path / "alone.py"
    script.write_text(ALONE.format(error=error))
    done = complete(["mpirun", "-n", "2", sys.executable, str(script)], timeout=100)
    assert done.returncode == code and said in done.stderr
