"""A run that was killed goes on from its checkpoint as if nothing had happened; what may change at
a restart and what not.
"""

import json
import sys
from dataclasses import asdict, replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from mpi4py import MPI
from running import (
    HELPERS,
    SCENES,
    Job,
    complete,
    fields,
    header,
    history,
    largest_difference,
    needs_mpirun,
    run_here,
    run_on,
    state,
    summary,
)

from porofsi_petsc.errors import ConvergenceError, InputError
from porofsi_petsc.linalg.options import start
from porofsi_petsc.output.seal import seal

BLOCK = (
    "mesh.order=1",
    "mesh.x.cells=[4, 2, 4]",
    "mesh.y.cells=[4]",
    "time.end=0.02",
    "output.checkpoint_every=10",
    "output.fields_every=4",
)
COLUMN = (
    "mesh.y.cells=[9, 4]",
    "time.end=0.02",
    "time.step=1e-3",
    "time.growth=1.0",
    "output.checkpoint_every=10",
    "expect=[]",
)
SCENES_KILLED = {
    "lagged": ("pulse2d", BLOCK),
    "newton": ("pulse2d", (*BLOCK, 'coupling.tangent="newton"')),
    "growing steps": (
        "pulse2d",
        (*BLOCK, "time.growth=1.1", "time.step=3e-4", "time.max_step=2e-3"),
    ),
    "controlled steps": ("pulse2d", (*BLOCK, "time.error_tolerance=3e-3")),
    "consistent start": (
        "pulse2d",
        (*BLOCK, "time.consistent_start=true", 'coupling.accelerator="iqn_ils"'),
    ),
    "hard": ("pulse2d_low_permeability", (*BLOCK, "mesh.order=2", "model.porosity=variable")),
    "linear": ("column_harmonic", COLUMN),
    "three-dimensional": (
        str(SCENES / "block3d.toml"),
        ("time.end=0.02", "output.checkpoint_every=10"),
    ),
}
# Run a job and die by SIGKILL: after the records of a step, or inside the writing of the second
# checkpoint.
KILLED = """
import json, os, signal, sys
from pathlib import Path
from running import Job, run_here
import porofsi_petsc.output.checkpoint as checkpoint
from porofsi_petsc.linalg.options import start
start()
import porofsi_petsc.simulation.records as records
job, place, step = json.loads(Path(sys.argv[1]).read_text()), sys.argv[2], 13

def die(*_):
    os.kill(os.getpid(), signal.SIGKILL)

def after(action, number):
    calls = []
    def counted(*arguments):
        calls.append(1)
        return die() if len(calls) == number else action(*arguments)
    return counted

if place == "after a step":
    after_step = records.Records.after_step
    def counted(self, simulation):
        after_step(self, simulation)
        if simulation.steps == step:
            die()
    records.Records.after_step = counted
elif place == "before the rename":
    checkpoint._replace = after(checkpoint._replace, 2)
elif place == "between link and rename":
    replace = os.replace
    checkpoint.os = type("os", (), dict(vars(os), replace=after(replace, 3)))
elif place == "inside the file":
    import h5py
    import porofsi_petsc.output.hdf5 as hdf5
    create, written = h5py.File.create_dataset, []
    def counted(self, *arguments, **options):
        if "checkpoint.next" in self.filename:
            written.append(arguments[0])
        if written.count("fluid.p") == 2:
            die()
        return create(self, *arguments, **options)
    h5py.File.create_dataset = counted
run_here(Job(**job))
"""


def kill(job, folder, place="after a step", ranks=None):
    """Run a job in a process of its own that kills itself; the history must have rows past the
    checkpoint of step 10.
    """
    script = folder / "killed.py"
    todo = folder / "job.json"
    script.write_text(f"import sys\nsys.path.insert(0, {str(HELPERS)!r})\n{KILLED}")
    todo.write_text(json.dumps(asdict(job)))
    launcher = ["mpirun", "-n", str(ranks)] if ranks else []
    result = complete([*launcher, sys.executable, str(script), str(todo), place])
    killed = (137, 9) if ranks else (-9,)  # of mpirun: Open MPI's and MPICH's
    assert result.returncode in killed, result.stderr


def continued(job, **changes):
    """Return the job that goes on from the checkpoint of a job."""
    return replace(job, restart=f"{job.directory}/checkpoint.h5", **changes)


def last_fields(directory):
    """Return name -> array of the last fields that a run wrote."""
    last = max(
        (path for path in (directory / "fields").glob("*.h5") if path.stem.isdigit()),
        key=lambda path: int(path.stem),
    )
    with h5py.File(last, "r") as file:
        arrays = {}
        file.visititems(
            lambda name, item: (
                arrays.update({name: item[()]}) if isinstance(item, h5py.Dataset) else None
            )
        )
    return last.name, arrays


@pytest.fixture(scope="module", params=SCENES_KILLED)
def uninterrupted(request, tmp_path_factory):
    """Return the job of a whole run of a scene, which has been done."""
    scene, overrides = SCENES_KILLED[request.param]
    job = Job(scene, str(tmp_path_factory.mktemp("whole") / "run"), overrides)
    run_here(job)
    return job


def assert_same(directory, expected, tolerance):
    """Every column of the history and every field of the state agree within a relative
    tolerance.
    """
    rows = history(directory)
    reference = history(expected)
    assert list(rows["t"]) == list(reference["t"])
    pairs = {
        name: (rows[name], reference[name]) for name in reference if name != "coupling_iterations"
    }
    computed = fields(directory / "checkpoint.h5")
    arrays = fields(expected / "checkpoint.h5")
    pairs |= {name: (computed[name], array) for name, array in arrays.items()}
    assert {
        name: d for name, (a, b) in pairs.items() if (d := largest_difference(a, b)) > tolerance
    } == {}


def assert_identical(directory, expected):
    """Every row of the history, every array of the state, every output field, to the last bit."""
    assert (directory / "history.csv").read_text() == (expected / "history.csv").read_text()
    computed = state(directory / "checkpoint.h5")
    reference = state(expected / "checkpoint.h5")
    assert computed.keys() == reference.keys()
    assert [name for name in reference if not np.array_equal(computed[name], reference[name])] == []
    if (expected / "fields").is_dir():
        (name, arrays), (last, others) = last_fields(directory), last_fields(expected)
        assert name == last and arrays.keys() == others.keys() and len(arrays) >= 6
        assert all(np.array_equal(arrays[key], others[key]) for key in arrays)


def test_a_killed_run_continues_identically(uninterrupted, tmp_path):
    job = replace(uninterrupted, directory=str(tmp_path / "run"))
    kill(job, tmp_path)
    assert header(tmp_path / "run/checkpoint.h5")["step"] == 10
    assert len(history(tmp_path / "run")["t"]) == 14
    run_here(continued(job))
    expected = tmp_path.__class__(uninterrupted.directory)
    before = summary(expected)
    after = summary(tmp_path / "run")
    assert_identical(tmp_path / "run", expected)
    for key in (
        "steps",
        "time_end",
        "coupling_iterations",
        "energy",
        "oscillation_indicator",
        "neglected",
    ):
        assert before[key] == after[key], key


@pytest.mark.parametrize(
    "place", ["before the rename", "between link and rename", "inside the file"]
)
def test_a_run_killed_while_it_writes_a_checkpoint_continues_identically(tmp_path, place):
    whole = Job("pulse2d", str(tmp_path / "whole"), BLOCK)
    run_here(whole)
    job = replace(whole, directory=str(tmp_path / "run"))
    kill(job, tmp_path, place)
    assert header(tmp_path / "run/checkpoint.h5")["step"] == 10
    run_here(continued(job))
    assert_identical(tmp_path / "run", tmp_path / "whole")


@needs_mpirun
def test_a_killed_parallel_run_continues_on_any_number_of_ranks(tmp_path):
    tight = (
        "coupling.tolerance=1e-10",
    )  # so that what the linear solves leave is not what is compared
    whole = Job("pulse2d", str(tmp_path / "whole"), BLOCK + tight)
    run_on(2, [whole], tmp_path)
    job = replace(whole, directory=str(tmp_path / "run"))
    kill(job, tmp_path, ranks=2)
    for ranks in (1, 2, 3):
        copy = tmp_path / f"on {ranks}"
        copy.mkdir()
        for name in ("history.csv", "checkpoint.h5", "fields.xdmf"):
            (copy / name).write_bytes((tmp_path / "run" / name).read_bytes())
        (copy / "fields").mkdir()
        for path in (tmp_path / "run/fields").iterdir():
            (copy / "fields" / path.name).write_bytes(path.read_bytes())
        again = continued(replace(job, directory=str(copy)))
        run_here(again) if ranks == 1 else run_on(ranks, [again], tmp_path)
        # On the same ranks the state is read back to the last bit, but MUMPS on more than one rank
        # sums in the order in which messages arrive: two whole runs differ in the last digits too.
        # 1e-9: coupling tolerance 1e-10 over ten steps.
        assert_same(copy, tmp_path / "whole", 1e-9)


@pytest.fixture(scope="module")
def stopped(tmp_path_factory):
    """Return a job of ten steps with a checkpoint at its end, which has been done."""
    job = Job("pulse2d", str(tmp_path_factory.mktemp("stopped") / "run"), (*BLOCK, "time.end=0.01"))
    run_here(job)
    return job


def elsewhere(job, tmp_path, *overrides, **changes):
    """Return a job that continues another one in a directory of its own."""
    return continued(
        job, directory=str(tmp_path / "run"), overrides=(*job.overrides, *overrides), **changes
    )


def test_end_time_output_and_solver_options_may_change(stopped, tmp_path):
    whole = replace(
        stopped, directory=str(tmp_path / "whole"), overrides=(*stopped.overrides, "time.end=0.015")
    )
    run_here(whole)
    output = ("output.fields_every=3", "output.checkpoint_every=5", "output.history_every=5")
    iterative = ("-solid_ksp_type", "cg", "-solid_pc_type", "gamg", "-solid_ksp_rtol", "1e-12")
    other = elsewhere(
        stopped,
        tmp_path,
        "time.end=0.015",
        *output,
        "coupling.tolerance=1e-9",
        petsc_options=iterative,
    )
    changed = run_here(other)
    assert changed["linear_iterations"]["solid"]["max"] > 1 and changed["time_end"] == 0.015
    rows = history(tmp_path / "run")
    reference = history(tmp_path / "whole")
    assert list(rows["t"]) == [0.015]
    # the coupling tolerance of the whole run, 1e-6 of the largest force, over five steps
    assert abs(rows["C.u_y"][-1] / reference["C.u_y"][-1] - 1) < 1e-5


@pytest.mark.parametrize(
    "overrides, sentence",
    [
        (
            ["material.0.permeability.k=1e-3"],
            r"\[material\.0\.permeability\.k\]: the checkpoint was written with 0.01",
        ),
        (
            ["model.convection=false"],
            r"\[model\.convection\]: the checkpoint was written with true, the scene has false",
        ),
        (["mesh.y.cells=[5]"], "belongs to another mesh"),
        (["mesh.order=2"], "belongs to another mesh"),
        (
            ["time.end=0.009"],
            "the checkpoint is at t = 0.01 s, expected at most time.end = 0.009 s; raise time.end",
        ),
    ],
)
def test_another_scene_is_refused(stopped, tmp_path, overrides, sentence):
    with pytest.raises(InputError, match=sentence) as error:
        run_here(elsewhere(stopped, tmp_path, "time.end=0.02", *overrides))
    assert "\n" not in str(error.value)


def test_a_key_that_the_checkpoint_does_not_know_has_its_default(stopped, tmp_path):
    """One of an older version, which had fewer keys; another value than the default is still
    another scene.
    """
    job = elsewhere(stopped, tmp_path, "time.end=0.015")
    older = tmp_path / "older.h5"
    older.write_bytes(Path(job.restart).read_bytes())
    with h5py.File(older, "r+") as file:
        entries = json.loads(file.attrs["header"])
        assert "backflow = 0.0" in entries["scene"]
        entries["scene"] = (
            entries["scene"].replace("backflow = 0.0\n", "").replace("convection = true\n", "")
        )
        file.attrs["header"] = json.dumps(entries)
    seal(older, MPI.COMM_SELF)
    with pytest.raises(
        InputError, match=r"model\.convection.*written with false, the scene has true"
    ):
        run_here(replace(job, restart=str(older)))
    assert (
        run_here(
            replace(
                job,
                restart=str(older),
                overrides=(*job.overrides, "model.convection=false"),
                force=True,
            )
        )["exit_code"]
        == 0
    )


@pytest.mark.parametrize("kept", [100, 5000, -1])
def test_a_truncated_checkpoint_is_refused(stopped, tmp_path, kept):
    whole = open(continued(stopped).restart, "rb").read()
    torn = tmp_path / "torn.h5"
    torn.write_bytes(whole[:kept])
    with pytest.raises(InputError, match="truncated or damaged|not an HDF5 file"):
        run_here(replace(elsewhere(stopped, tmp_path, "time.end=0.02"), restart=str(torn)))


def test_an_unused_option_is_refused_after_a_restart_too(stopped, tmp_path):
    with pytest.raises(InputError, match="nothing used -solid_nonsense"):
        run_here(
            elsewhere(stopped, tmp_path, "time.end=0.02", petsc_options=("-solid_nonsense", "1"))
        )
    start()


def test_a_checkpoint_inside_a_cut_step_continues_identically(tmp_path, monkeypatch):
    """A step of 1 ms fails once; the run stops after the first half of it and goes on as if it had
    not.
    """
    from porofsi_petsc.coupling.porous import PorousCoupling

    step = PorousCoupling.step

    def failing(self, schemes, rates, t, number):
        if number == 3 and schemes[0].dt == 1e-3:
            raise ConvergenceError("made to fail")
        step(self, schemes, rates, t, number)

    monkeypatch.setattr(PorousCoupling, "step", failing)
    cut = (*BLOCK, "time.end=0.004", 'coupling.on_failure="cut_step"', "output.checkpoint_every=1")
    whole = Job("pulse2d", str(tmp_path / "whole"), cut)
    run_here(whole)
    assert list(history(tmp_path / "whole")["t"]) == pytest.approx(
        [0, 1e-3, 2e-3, 2.5e-3, 3e-3, 4e-3], rel=1e-12
    )  # round-off
    assert summary(tmp_path / "whole")["step_cuts"] == 1
    job = replace(whole, directory=str(tmp_path / "run"))
    monkeypatch.setattr("porofsi_petsc.simulation.records.Records.after_step", stop_after(3))
    with pytest.raises(KeyboardInterrupt):
        run_here(job)
    monkeypatch.setattr("porofsi_petsc.simulation.records.Records.after_step", stop_after(None))
    run_here(continued(job))
    assert_identical(tmp_path / "run", tmp_path / "whole")


def stop_after(number):
    """Return Records.after_step that interrupts the run after a step."""
    from porofsi_petsc.simulation import records

    original = getattr(records.Records.after_step, "original", records.Records.after_step)

    def after_step(self, simulation):
        original(self, simulation)
        if simulation.steps == number:
            raise KeyboardInterrupt

    after_step.original = original
    return after_step
