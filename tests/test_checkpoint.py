"""What a restart finds: damaged checkpoints, histories and fields, other tables, a full disk, a run
that is complete.
"""

import json
import os
import resource
import shutil
from contextlib import contextmanager, suppress
from pathlib import Path
from unittest import mock

import h5py
import numpy as np
import pytest
from fuzz import checkpoints as fuzzing
from mpi4py import MPI
from running import (
    SCENES,
    Job,
    by_command_line,
    changes,
    header,
    history,
    needs_mpirun,
    run_here,
    state,
    summary,
)

from porofsi_petsc.errors import ExpectationError, InputError, LimitError, PorofsiError
from porofsi_petsc.output import figures, hdf5
from porofsi_petsc.output import seal as sealing
from porofsi_petsc.output.checkpoint import open_checkpoint
from porofsi_petsc.output.figures import make_figures
from porofsi_petsc.output.hdf5 import write_slabs
from porofsi_petsc.output.info import describe
from porofsi_petsc.output.seal import is_sealed, seal
from porofsi_petsc.simulation.header import HEADER, mistake

SELF = MPI.COMM_SELF
WORLD = MPI.COMM_WORLD


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Return the job of a run of five steps with checkpoints of the third and the last, which has
    been done.
    """
    folder = tmp_path_factory.mktemp("whole")
    (folder / "scene.toml").write_text(fuzzing.SCENE)
    job = Job(str(folder / "scene.toml"), str(folder / "run"))
    run_here(job)
    return job


@pytest.fixture
def half(whole, tmp_path):
    """Return the job that goes on from the third step in a directory of its own."""
    run = tmp_path / "run"
    shutil.copytree(whole.directory, run)
    (run / "checkpoint.previous.h5").replace(run / "checkpoint.h5")
    return Job(whole.scene, str(run), restart=str(run / "checkpoint.h5"))


def assert_complete(job, whole):
    """The run of a job is the whole one, to the last bit."""
    directory = Path(job.directory)
    expected = Path(whole.directory)
    assert (directory / "history.csv").read_text() == (expected / "history.csv").read_text()
    found = state(directory / "checkpoint.h5")
    arrays = state(expected / "checkpoint.h5")
    assert found.keys() == arrays.keys()
    assert [name for name in arrays if not np.array_equal(arrays[name], found[name])] == []


def files(directory):
    """Return name -> content of all files in a directory."""
    return {
        str(path.relative_to(directory)): path.read_bytes()
        for path in Path(directory).rglob("*")
        if path.is_file()
    }


def refused(job, match):
    """The job is refused in one sentence and no file changes; return the sentence."""
    before = files(job.directory)
    with pytest.raises(InputError, match=match) as error:
        run_here(job)
    assert "\n" not in str(error.value)
    after = files(job.directory)
    assert {name: after.get(name) for name in before if name != "run.log"} == {
        n: c for n, c in before.items() if n != "run.log"
    }
    return str(error.value)


# -- damage ----------------------------------------------------------------------------------------


def test_damaged_checkpoints_are_refused_or_do_not_matter(tmp_path):
    """Two of each kind; scripts/run fuzz checkpoints does many."""
    found = fuzzing.fuzz(2 * len(fuzzing.DAMAGES), 0, tmp_path)
    assert fuzzing.wrong(found) == []
    assert sum(outcome == "refused" for *_, outcome in found) > 30


@pytest.mark.parametrize("ranks", [1, pytest.param(2, marks=needs_mpirun)])
def test_one_bit_is_noticed_and_the_sound_checkpoint_offered(whole, tmp_path, ranks):
    run = tmp_path / "run"
    shutil.copytree(whole.directory, run)
    content = bytearray((run / "checkpoint.h5").read_bytes())
    content[-40] ^= 1  # the last digits of a number of the last array
    (run / "checkpoint.h5").write_bytes(content)
    result = by_command_line(
        whole.scene,
        run,
        "--restart",
        str(run / "checkpoint.h5"),
        ranks=None if ranks == 1 else ranks,
    )
    assert result.returncode == 2 and "Traceback" not in result.stderr
    found = "truncated or damaged, its checksum is not that of its content"
    other = run / "checkpoint.previous.h5"
    assert f"error: {run / 'checkpoint.h5'}: {found}; {other} is sound, give that" in result.stderr
    job = Job(whole.scene, str(run), restart=str(other))
    run_here(job)
    assert_complete(job, whole)


def edited(change):
    """Return the damage that changes header and file by change(header, file) and makes the checksum
    fit again.
    """

    def damage(path):
        with h5py.File(path, "r+") as file:
            entries = json.loads(file.attrs["header"])
            change(entries, file)
            file.attrs["header"] = json.dumps(entries)
        seal(path, SELF)

    return damage


def replaced(name, value):
    def change(entries, file):
        del file[name]
        if value is not None:
            file[name] = value

    return edited(change)


INVALID = {
    "no TOML": (
        edited(lambda h, f: h.update(scene="title = ")),
        "damaged, its entry scene is no TOML: ",
    ),
    "no scene": (edited(lambda h, f: h.update(scene='title = "x"')), r"\[model"),
    "scene a number": (
        edited(lambda h, f: h.update(scene=3)),
        "damaged, its entry scene is 3, expected text; ",
    ),
    "step": (
        edited(lambda h, f: h.update(step=5.5)),
        "damaged, its entry step is 5.5, expected a whole number",
    ),
    "iterations": (
        edited(lambda h, f: h.update(iterations="33")),
        "damaged, its entry iterations is '33', expected a list",
    ),
    "an iteration": (
        edited(lambda h, f: h["iterations"].append("x")),
        r"its entry iterations.3 is 'x', expected a whole number",
    ),
    "nan": (
        edited(lambda h, f: h["clock"].update(t=float("nan"))),
        "its entry clock.t is nan, expected a number of at least 0",
    ),
    "two times": (
        edited(lambda h, f: h["clock"].update(t=0.9e-3)),
        "its entry time is 0.00331.*, but clock.t is 0.0009",
    ),
    "two steps": (
        edited(lambda h, f: h["clock"].update(step=4)),
        "its entry step is 3, but clock.step is 4",
    ),
    "no clock": (edited(lambda h, f: h.pop("clock")), "its entry clock is missing"),
    "no rates": (edited(lambda h, f: h["coupling"]["solid"].update(rates=[1.0])), "damaged, "),
    "no mesh": (edited(lambda h, f: h.pop("mesh_hash")), "damaged, its header cannot be read"),
    "other regions": (
        edited(lambda h, f: h.update(regions=["soil"])),
        "belongs to another mesh.* with the regions body",
    ),
    "shape": (
        replaced("solid.u", np.zeros((12, 3))),
        r"its array solid.u has rows of shape \(3,\) of float64, expected .*\(2,\)",
    ),
    "type": (
        replaced("solid.u", np.zeros((12, 2), "f4")),
        "its array solid.u has rows of shape .* of float32, expected",
    ),
    "tangent": (
        replaced("fluid.tangent_p", np.zeros((12, 2))),
        "its array fluid.tangent_p has rows of shape",
    ),
    "rows": (
        replaced("solid.u", np.zeros((11, 2))),
        "damaged, expected 12 rows of numbers in every array",
    ),
    "scalar": (replaced("fluid.p", 3.0), "damaged, expected 12 rows of numbers in every array"),
    "text": (
        replaced("fluid.p", np.full(12, b"x")),
        "damaged, expected 12 rows of numbers in every array",
    ),
    "missing": (replaced("fluid.p", None), "damaged, its array fluid.p is missing"),
    "not finite": (
        replaced("fluid.p", np.full(12, np.inf)),
        "damaged, it holds numbers that are not finite",
    ),
}


@pytest.mark.parametrize("case", INVALID)
def test_what_no_run_has_written_is_one_sentence_even_with_its_checksum(half, case):
    damage, sentence = INVALID[case]
    damage(Path(half.restart))
    assert refused(half, sentence).startswith(half.restart)


def unknown(kind, value, place=()):
    """Yield the entries of a header that `HEADER` does not have."""
    if isinstance(kind, dict) and isinstance(value, dict):
        kinds = {key.rstrip("?"): part for key, part in kind.items()}
        for key, entry in value.items():
            if key in kinds or "*" in kinds:
                yield from unknown(kinds.get(key, kinds.get("*")), entry, (*place, key))
            else:
                yield (*place, key)
    elif isinstance(kind, list) and isinstance(value, list):
        for entry in value:
            yield from unknown(kind[0], entry, place)


OF_THE_FILE = ("format_version", "mesh_hash", "ranks", "nodes", "cells", "regions", "scene_name")
SHORT = ("expect=[]", "time.step=1e-3", "time.end=2e-3", "output.checkpoint_every=1")
EVERY_PART = {
    "step control": (
        "pulse2d",
        (*SHORT, "mesh.order=1", "mesh.y.cells=[4]", "time.error_tolerance=1e-2"),
    ),
    "reference": ("column_harmonic", (*SHORT, "mesh.y.cells=[4, 4]", "time.growth=1.0")),
    "interface": (str(SCENES / "flap.toml"), SHORT),
}


@pytest.mark.parametrize("part", EVERY_PART)
def test_every_entry_of_a_header_has_its_kind(tmp_path, part):
    """What a part writes and `simulation.header` does not know would be taken back unseen."""
    scene, overrides = EVERY_PART[part]
    run_here(Job(scene, str(tmp_path / "run"), overrides))
    entries = header(tmp_path / "run" / "checkpoint.h5")
    assert {entry for entry in unknown(HEADER, entries) if entry[0] not in OF_THE_FILE} == set()
    assert mistake(entries) == ""


def as_before(path):
    """Make the checkpoint one of the version before: no checksum, no tables, no regions."""
    with h5py.File(path, "r+") as file:
        entries = json.loads(file.attrs["header"])
        del entries["tables"], entries["regions"]
        file.attrs["header"] = json.dumps(entries | {"format_version": 1})
    path.write_bytes(path.read_bytes()[sealing.FRONT :])


def test_a_checkpoint_of_the_version_before_goes_on_and_the_log_says_what_it_lacks(half, whole):
    as_before(Path(half.restart))
    run_here(half)
    assert_complete(half, whole)
    assert (
        "has no checksum: an earlier version wrote it"
        in (Path(half.directory) / "run.log").read_text()
    )


def test_without_a_checksum_the_types_of_numbers_are_looked_at(half):
    """A flipped bit in the exponent bias of an array lets all its numbers be 1e-1230."""
    path = Path(half.restart)
    as_before(path)
    content = path.read_bytes()
    exponent = bytes([52, 11, 0, 52]) + (1023).to_bytes(
        4, "little"
    )  # of an IEEE double in an HDF5 file
    at = content.rindex(exponent) + 5
    path.write_bytes(content[:at] + bytes([content[at] ^ 16]) + content[at + 1 :])
    refused(half, "damaged, expected 12 rows of numbers in every array")


# -- the checksum ----------------------------------------------------------------------------------


@pytest.mark.mpi
@pytest.mark.parametrize("size", [0, 511, 512, 513, 5000])
def test_a_checksum_is_that_of_one_rank_and_sees_every_byte(shared_path, size, monkeypatch):
    """Blocks of 700 bytes, so that ranks share them; one byte is changed in the front, in each
    block and at the end.
    """
    monkeypatch.setattr(sealing, "BLOCK", 700)
    path = shared_path / "file"
    if WORLD.rank == 0:
        path.write_bytes(np.random.default_rng(1).bytes(size))
    WORLD.barrier()
    assert not is_sealed(path, WORLD)
    seal(path, WORLD)
    assert is_sealed(path, WORLD) and is_sealed(path, SELF)
    content = path.read_bytes()
    assert len(content) == max(size, 512)
    WORLD.barrier()
    for at in {0, 100, 511, *range(512, len(content), 700), len(content) - 1}:
        if WORLD.rank == 0:
            path.write_bytes(content[:at] + bytes([content[at] ^ 1]) + content[at + 1 :])
        WORLD.barrier()
        assert not is_sealed(path, WORLD)
        WORLD.barrier()
    with pytest.raises(InputError, match="could not be read .No such file"):
        is_sealed(shared_path / "none", WORLD)


# -- tables ----------------------------------------------------------------------------------------

LOAD = "t,f,g\n0,0,1\n1e-2,-1e4,1\n"
TABLE = ('boundary.2.traction.y={ table = "load.csv", column = "f" }',)


@pytest.fixture
def loaded(half, tmp_path):
    """Return the job that goes on with a load from a table, in a folder of its own."""
    folder = tmp_path / "case"
    folder.mkdir()
    shutil.copy(half.scene, folder)
    (folder / "load.csv").write_text(LOAD)
    job = Job(str(folder / "scene.toml"), str(folder / "run"), TABLE)
    run_here(job)
    run = folder / "run"
    (run / "checkpoint.previous.h5").replace(run / "checkpoint.h5")
    return Job(job.scene, job.directory, TABLE, restart=str(run / "checkpoint.h5"))


def test_another_table_is_refused(loaded):
    path = Path(loaded.scene).with_name("load.csv")
    path.write_text(LOAD.replace("-1e4", "-1e2"))
    sentence = (
        r"checkpoint.h5 \[boundary.2.traction.y.table\]: the table has other numbers than when the"
        r" checkpoint was written"
    )
    refused(loaded, sentence)
    path.unlink()
    with pytest.raises(InputError, match="cannot be read"):
        run_here(loaded)


def test_a_folder_that_moved_is_no_obstacle(loaded, tmp_path):
    """Nor are another name of the file, another column or another way to write the numbers."""
    moved = tmp_path / "moved"
    Path(loaded.scene).parent.rename(moved)
    (moved / "load.csv").rename(moved / "other.csv")
    (moved / "other.csv").write_text("# again\nt,h\n0.0,0.0\n0.01,-10000\n")
    table = ('boundary.2.traction.y={ table = "other.csv", column = "h" }',)
    rows = (moved / "run/history.csv").read_text()
    run_here(
        Job(
            str(moved / "scene.toml"),
            str(moved / "run"),
            table,
            restart=str(moved / "run/checkpoint.h5"),
        )
    )
    assert (
        moved / "run/history.csv"
    ).read_text() == rows  # of the run before, the rows of which were cut


def test_without_checksum_a_table_goes_by_its_name(loaded, tmp_path):
    as_before(Path(loaded.restart))
    other = ('boundary.2.traction.y={ table = "other.csv", column = "f" }',)
    shutil.copy(Path(loaded.scene).with_name("load.csv"), Path(loaded.scene).with_name("other.csv"))
    with pytest.raises(
        InputError,
        match=r"table\]: the checkpoint was written with 'load.csv', the scene has 'other.csv'",
    ):
        run_here(Job(loaded.scene, loaded.directory, other, restart=loaded.restart))
    run_here(loaded)


# -- a run that is complete ------------------------------------------------------------------------


def expecting(value):
    return (
        f'expect=[{{ quantity = "top.u_y", statistic = "final", value = {value}, tolerance ='
        " 1e-9 }]"
    )


def at_end(job, **other):
    return Job(job.scene, job.directory, **{"restart": f"{job.directory}/checkpoint.h5"} | other)


def test_a_run_killed_before_its_figures_can_be_completed(whole, tmp_path):
    run = tmp_path / "run"
    shutil.copytree(whole.directory, run)
    (run / "summary.json").unlink()
    (run / "histories.png").unlink(missing_ok=True)
    value = history(run)["top.u_y"][-1]
    words = ["--restart", str(run / "checkpoint.h5"), *changes([expecting(value)])]
    result = by_command_line(whole.scene, run, *words)
    assert result.returncode == 0, result.stderr
    assert "that is the end of the run: no step is left" in (run / "run.log").read_text()
    assert (run / "histories.png").is_file() and (run / "pressure.png").is_file()
    done = summary(run)
    expected = summary(whole.directory)
    for key in (
        "steps",
        "time_end",
        "coupling_iterations",
        "energy",
        "oscillation_indicator",
        "neglected",
    ):
        assert done[key] == expected[key], key
    assert done["expectations"][0]["passed"] is True
    assert_complete(Job(whole.scene, str(run)), whole)
    with pytest.raises(ExpectationError, match="1 of 1 expectations failed"):
        run_here(
            Job(whole.scene, str(run), (expecting(2 * value),), restart=str(run / "checkpoint.h5"))
        )
    assert summary(run)["exit_code"] == 5


def test_a_restart_of_a_complete_run_changes_nothing(whole, tmp_path):
    run = tmp_path / "run"
    shutil.copytree(whole.directory, run)
    before = files(run)
    run_here(Job(whole.scene, str(run), restart=str(run / "checkpoint.h5")))
    assert {k: v for k, v in files(run).items() if k != "run.log"} == {
        k: v for k, v in before.items() if k != "run.log"
    }


@needs_mpirun
@pytest.mark.parametrize("ranks", [1, 2])
def test_a_complete_run_in_another_directory_has_its_end_there(whole, tmp_path, ranks):
    restart = ["--restart", f"{whole.directory}/checkpoint.h5", "--quiet"]
    result = by_command_line(whole.scene, tmp_path / "run", *restart, ranks=ranks)
    assert result.returncode == 0, result.stderr
    last = history(whole.directory)
    rows = history(tmp_path / "run")
    assert {name: list(values) for name, values in rows.items()} == {
        name: [values[-1]] for name, values in last.items()
    }
    assert [path.name for path in (tmp_path / "run/fields").glob("0*.h5")] == ["000005.h5"]


def test_a_limit_passed_in_the_last_step_is_passed_after_a_restart_too(whole, tmp_path):
    limit = ("material.0.solid.law=linear_elastic", "limits.strain=1e-9", "time.end=1e-3")
    job = Job(whole.scene, str(tmp_path / "run"), limit)
    with pytest.raises(LimitError):
        run_here(job)
    with pytest.raises(LimitError):
        run_here(at_end(job, overrides=limit))
    assert summary(job.directory)["exit_code"] == 2
    assert run_here(at_end(job, overrides=(*limit, "limits.strain=report")))["exit_code"] == 0


# -- what lies beside the checkpoint ---------------------------------------------------------------


def spoil_history(row):
    def spoil(directory):
        path = directory / "history.csv"
        lines = path.read_bytes().split(b"\n")
        lines[2] = row
        path.write_bytes(b"\n".join(lines))

    return spoil


def in_fields(name, write):
    return lambda directory: write(directory / "fields" / name)


def foreign(path):
    with h5py.File(path, "w") as file:
        file["x"] = np.zeros(3)


def truncated(path):
    path.write_bytes(path.read_bytes()[:-100])


def of_another_step(path):
    with h5py.File(path, "r+") as file:
        file.attrs["step"] = 4


BESIDE = {
    "binary history": (
        spoil_history(b"\x00\xff\xfe,1,2,3"),
        r"history.csv: line 3 is .*, expected 4 numbers, the time first",
    ),
    "text in history": (
        spoil_history(b"0.1,a,2,3"),
        "history.csv: line 3 is '0.1,a,2,3', expected 4 numbers",
    ),
    "short row": (
        spoil_history(b"0.1,2,3"),
        "history.csv: line 3 is '0.1,2,3', expected 4 numbers",
    ),
    "nan time": (
        spoil_history(b"nan,1,2,3"),
        "history.csv: line 3 is 'nan,1,2,3', expected 4 numbers",
    ),
    "foreign fields": (
        in_fields("000001.h5", foreign),
        "000001.h5: an HDF5 file, but not the fields of the step in its name",
    ),
    "text for fields": (
        in_fields("000001.h5", lambda path: path.write_text("x")),
        "000001.h5: could not be read, expected a",
    ),
    "truncated fields": (
        in_fields("000003.h5", truncated),
        "000003.h5: could not be read, expected a complete HDF5 file",
    ),
    "fields of another step": (
        in_fields("000003.h5", of_another_step),
        "000003.h5: an HDF5 file, but not the fields",
    ),
}


@pytest.mark.parametrize("case", BESIDE)
def test_damage_beside_the_checkpoint_is_one_sentence_and_nothing_is_lost(half, case):
    spoil, sentence = BESIDE[case]
    spoil(Path(half.directory))
    refused(half, sentence)


@pytest.mark.parametrize(
    "name",
    [
        "scene.toml",
        "history.csv",
        "checkpoint.h5",
        "summary.json",
        "fields/mesh.h5",
        "fields/000005.h5",
    ],
)
@pytest.mark.parametrize("damage", ["noise", "nothing", "half"])
def test_results_that_are_damaged_are_described_and_drawn_or_refused(whole, tmp_path, name, damage):
    run = tmp_path / "run"
    shutil.copytree(whole.directory, run)
    content = (run / name).read_bytes()
    noise = np.random.default_rng(0).bytes(len(content))
    (run / name).write_bytes(
        {"noise": noise, "nothing": b"", "half": content[: len(content) // 2]}[damage]
    )
    with mock.patch.object(figures, "save_figure", lambda path, draw, *arguments: path):
        for look in (describe, make_figures):
            with suppress(InputError):
                look(run)
    with suppress(InputError):
        describe(run / name)


def test_files_of_others_in_the_folder_of_the_fields_are_left_alone(half, whole):
    names = ("data.h5", "2024_results.h5", "1.h5", "000001.h5.bak")
    for name in names:
        (Path(half.directory) / "fields" / name).write_text(name)
    run_here(half)
    assert_complete(half, whole)
    assert all((Path(half.directory) / "fields" / name).read_text() == name for name in names)


# -- a full disk -----------------------------------------------------------------------------------


@contextmanager
def no_file_larger_than(size):
    """Let the system refuse to write beyond a size [bytes], as a full disk does."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.mpi
@pytest.mark.parametrize(
    "size", [0, 1, 96, 511, 512, 600, 2048, 4096, 8000, 10000, 20000, 40000, 60000, 70000]
)
def test_a_disk_that_is_full_is_one_sentence(shared_path, size):
    """At any place in a file of more than 70 kB; HDF5 by itself ends the process after a write that
    failed.
    """
    slabs = {
        f"array {i}": np.random.default_rng(i).random((4400 // 8 // WORLD.size, 2))
        for i in range(8)
    }
    write_slabs(shared_path / "a.h5", WORLD, slabs, {"header": "x" * 9000}, 512)
    before = (shared_path / "a.h5").read_bytes()
    WORLD.barrier()
    with (
        no_file_larger_than(size),
        pytest.raises(PorofsiError, match=r"a.h5.tmp: could not be written \(File too large\)"),
    ):
        write_slabs(shared_path / "a.h5", WORLD, slabs, {"header": "y" * 9000}, 512)
    WORLD.barrier()
    assert [path.name for path in shared_path.iterdir()] == ["a.h5"]
    assert (shared_path / "a.h5").read_bytes() == before


def test_a_run_on_a_full_disk_keeps_its_checkpoint(half, whole):
    """The second checkpoint does not fit; from the first the run goes on."""
    size = os.path.getsize(half.restart)
    with (
        no_file_larger_than(size - 100),
        pytest.raises(PorofsiError, match="could not be written .File too large") as error,
    ):
        run_here(half)
    assert error.value.exit_code == 1
    assert open_checkpoint(half.restart, SELF)["step"] == header(half.restart)["step"] == 3
    run_here(half)
    assert_complete(half, whole)


def test_room_is_looked_for_before_ranks_write_together(tmp_path):
    """HDF5 for MPI writes by itself: it can only be kept from starting."""
    hdf5.require_room(tmp_path / "a.h5", 1000)
    with pytest.raises(OSError, match="No space left"):
        hdf5.require_room(tmp_path / "a.h5", 1 << 62)
