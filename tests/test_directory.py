"""The result directory: one run at a time, --force removes the files of a run and nothing else, and
not before its first step.
"""

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from mpi4py import MPI
from running import Job, by_command_line, changes, environment, header, history, run_here, summary

from porofsi_petsc.errors import InputError, PorofsiError
from porofsi_petsc.output import directory
from porofsi_petsc.output.directory import Claim, written_files

COMM = MPI.COMM_SELF
OURS = (
    *(
        "history.csv",
        "summary.json",
        "scene.toml",
        "run.log",
        "profiles.csv",
        "line_a-1.csv",
        "line_up.png",
        "fields.xdmf",
        "fields.xdmf.next",
        "fields.vtkhdf",
        "fields.vtkhdf.journal.tmp",
        "checkpoint.h5",
        "paths.png",
    ),
    *(
        "checkpoint.previous.h5",
        "checkpoint.next.h5",
        "summary.json.tmp",
        "checkpoint.next.h5.tmp",
        "reference.png",
    ),
    *("fields/mesh.h5", "fields/000010.h5", "fields/1000000.h5", "fields/000020.h5.tmp"),
)
FOREIGN = (
    *(
        "notes.txt",
        "checkpoint_keep_me.h5",
        "checkpoint.h5.bak",
        "history.csv.old",
        "my_pressure.png",
        "scene.toml~",
    ),
    *(
        "fields/data.h5",
        "fields/12.h5",
        "fields/000010.h5.bak",
        "sub/history.csv",
        "fields/sub/000010.h5",
    ),
)


def fill(folder, names):
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(f"old {name}")


def content(folder):
    """Return relative path -> text of all files below a folder."""
    files = [path for path in Path(folder).rglob("*") if path.is_file()]
    return {path.relative_to(folder).as_posix(): path.read_text() for path in files}


def claim(folder, force=False, restart=None):
    return Claim(folder, force, restart, COMM)


# -- what may be written to ------------------------------------------------------------------------


def test_a_directory_with_files_needs_force_or_a_restart_of_its_own(tmp_path):
    fill(tmp_path, ("history.csv", "notes.txt", "other/checkpoint.h5"))
    with pytest.raises(InputError, match="already holds files.*--force .*--restart"):
        claim(tmp_path)
    with pytest.raises(InputError, match="already holds files"):
        claim(tmp_path, restart=tmp_path / "other" / "checkpoint.h5")
    with claim(tmp_path, restart=tmp_path / "checkpoint.h5") as own:
        own.put_aside()
        assert (tmp_path / "history.csv").exists()
    assert len(content(tmp_path)) == 3


def test_a_directory_that_cannot_hold_results_is_refused(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    for place, sentence in (
        (tmp_path / "file", "is a file"),
        (tmp_path / "file" / "below", "could not be created"),
    ):
        with pytest.raises(InputError, match=sentence):
            claim(place)
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(InputError, match="not writable"):
        claim(tmp_path)


def test_folders_made_for_a_run_that_is_refused_are_removed(tmp_path):
    with pytest.raises(InputError, match="the scene"), claim(tmp_path / "a" / "b"):
        raise InputError("the scene")
    assert not any(tmp_path.iterdir())


# -- what --force removes --------------------------------------------------------------------------


def test_force_removes_the_files_of_a_run_and_nothing_else_once_a_step_is_done(tmp_path):
    fill(tmp_path, OURS + FOREIGN)
    with claim(tmp_path, force=True) as claimed:
        claimed.put_aside()
        assert not any((tmp_path / name).exists() for name in OURS)
        fill(tmp_path, ("history.csv", "fields/000000.h5"))
        claimed.accept()
    assert content(tmp_path) == {
        name: f"old {name}" for name in (*FOREIGN, "history.csv", "fields/000000.h5")
    }


def test_links_are_not_followed(tmp_path):
    """A linked folder of fields is refused; a linked file gives way itself, not what it points
    to.
    """
    fill(tmp_path / "elsewhere", ("000010.h5", "data.h5", "precious.csv"))
    here = tmp_path / "here"
    here.mkdir()
    (here / "history.csv").symlink_to(tmp_path / "elsewhere" / "precious.csv")
    with claim(here, force=True) as claimed:
        claimed.put_aside()
        (here / "history.csv").write_text("new")
        claimed.accept()
    (here / "fields").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(InputError, match="fields: received a link, to .*elsewhere"):
        claim(here, force=True)
    assert written_files(here) == [here / "history.csv"]
    assert len(content(tmp_path / "elsewhere")) == 3 and (here / "history.csv").read_text() == "new"


def test_earlier_results_come_back_when_no_step_is_done(tmp_path):
    fill(tmp_path, OURS + FOREIGN)
    with pytest.raises(InputError, match="an option"), claim(tmp_path, force=True) as claimed:
        claimed.put_aside()
        fill(tmp_path, ("history.csv", "fields/000000.h5", "fields/mesh.h5"))
        (tmp_path / "history.csv").write_text("new")
        raise InputError("an option")
    assert content(tmp_path) == {name: f"old {name}" for name in OURS + FOREIGN}


class Killed(BaseException):
    """A kill -9 between two calls of the system."""


def killed_after(count, action, monkeypatch):
    """Do an action and stop it at its call number `count` that renames or removes; return whether
    it came so far.
    """
    done = 0

    def counted(call):
        def counting(*arguments, **choices):
            nonlocal done
            done += 1
            if done > count:
                raise Killed
            return call(*arguments, **choices)

        return counting

    with monkeypatch.context() as patch:
        for place, name in (
            (os, "rename"),
            (os, "replace"),
            (Path, "unlink"),
            (Path, "rmdir"),
            (Path, "mkdir"),
        ):
            patch.setattr(place, name, counted(getattr(place, name)))
        try:
            action()
        except Killed:
            return True
    return False


def replace_results(folder, accept):
    """Go through the life of a run with --force and leave the directory to the next one without the
    end of the claim.
    """
    claimed = claim(folder, force=True)
    claimed.put_aside()
    for name in ("history.csv", "fields/000000.h5"):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text("new")
    if accept:
        claimed.accept()


@pytest.mark.parametrize("accept", [False, True])
def test_a_kill_at_any_moment_loses_nothing(tmp_path, monkeypatch, accept):
    """Old results before the first step, or new ones after it: the next run finds one of them
    complete, and foreign files.
    """
    old = {
        name: f"old {name}"
        for name in ("history.csv", "summary.json", "fields/000010.h5", "notes.txt")
    }
    new = {"history.csv": "new", "fields/000000.h5": "new", "notes.txt": "old notes.txt"}
    found = []
    for count in range(100):
        folder = tmp_path / str(count)
        fill(folder, old)
        goes_on = killed_after(
            count, lambda folder=folder: replace_results(folder, accept), monkeypatch
        )
        while killed_after(
            2, lambda folder=folder: directory.recover(folder), monkeypatch
        ):  # the recovery is killed too
            pass
        left = {name: text for name, text in content(folder).items() if name != ".lock"}
        assert left in (old, new), count
        found.append(left == new)
        if not goes_on:
            break
    assert count > 8 and found == sorted(found) and found[-1] is accept


TINY = (
    "expect=[]",
    "mesh.order=1",
    "mesh.x.cells=[4, 2, 4]",
    "mesh.y.cells=[4]",
    "time.step=1e-3",
    "figures={}",
)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A directory with the results of three steps."""
    folder = tmp_path_factory.mktemp("finished")
    run_here(Job("pulse2d", str(folder), (*TINY, "time.end=3e-3")))
    return folder


@pytest.mark.parametrize(
    "change, options, sentence",
    [
        ("time.end=4e-3", ("-fluid_ksp_typ", "gmres"), "nothing used -fluid_ksp_typ"),
        ("time.end=4e-3", ("-fluid_ksp_type", "nosuch"), "cannot be made"),
        ("time.end=4e-3", ("-fluid_pc_type", "shell"), "cannot work"),
        ("coupling.max_iterations=1", (), "did not converge"),
    ],
)
def test_a_forced_run_that_is_refused_leaves_the_earlier_results(
    finished, change, options, sentence, capsys
):
    before = {path.name: path.read_bytes() for path in written_files(finished)}
    with pytest.raises(PorofsiError, match=sentence):
        run_here(Job("pulse2d", str(finished), (*TINY, change), force=True, petsc_options=options))
    assert {path.name: path.read_bytes() for path in written_files(finished)} == before
    assert not list(finished.glob("porofsi.*")) and not (finished / ".lock").exists()
    if "nothing used" in sentence or "converge" in sentence:
        assert "the results that were in" in capsys.readouterr().out


def test_a_forced_run_replaces_the_earlier_results(finished, tmp_path):
    shutil.copytree(finished, tmp_path, dirs_exist_ok=True)
    assert (
        run_here(Job("pulse2d", str(tmp_path), (*TINY, "time.end=1e-3"), force=True))["steps"] == 1
    )
    assert len(history(tmp_path)["t"]) == 2 and not list(tmp_path.glob("porofsi.*"))
    assert {path.name for path in (tmp_path / "fields").iterdir()} <= {
        "mesh.h5",
        "000000.h5",
        "000001.h5",
    }


# -- one run at a time -----------------------------------------------------------------------------

HOLD = """
import sys, time
from mpi4py import MPI
from porofsi_petsc.output.directory import Claim
with Claim(sys.argv[1], True, None, MPI.COMM_WORLD):
    print("held", flush=True)
    time.sleep(60)
"""


@pytest.fixture
def holder(tmp_path):
    """A process that holds tmp_path; killed at the end."""
    words = [sys.executable, "-c", HOLD, str(tmp_path)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True, env=environment()) as process:
        assert process.stdout.readline() == "held\n"
        yield process
        process.kill()


def test_a_second_run_is_refused_and_a_killed_one_is_not_in_the_way(tmp_path, holder):
    for choice in ({}, {"force": True}, {"restart": tmp_path / "checkpoint.h5"}):
        with pytest.raises(
            InputError, match=rf"a run is writing there \(process {holder.pid} on .*--output"
        ):
            claim(tmp_path, **choice)
    holder.send_signal(signal.SIGKILL)
    holder.wait()
    with claim(tmp_path):
        assert f"process {os.getpid()} " in (tmp_path / ".lock").read_text()
    assert not any(tmp_path.iterdir())


def refused_lock(folder):
    """Refuse a folder for its .lock in every way to take it."""
    for choice in ({}, {"force": True}, {"restart": folder / "checkpoint.h5"}):
        with pytest.raises(
            InputError, match=r"\.lock: received a link or a file that no run has written"
        ):
            claim(folder, **choice)


@pytest.mark.parametrize(
    "text", ["precious", "process 1 on machine\nand more\n", "\n", "\0", "p" * 5000]
)
def test_a_lock_file_of_the_users_own_is_left_alone(tmp_path, text):
    (tmp_path / ".lock").write_text(text)
    refused_lock(tmp_path)
    assert content(tmp_path) == {".lock": text}


@pytest.mark.parametrize("text", [None, "", "precious", "process 1 on machine\n"])
def test_a_linked_lock_is_not_followed(tmp_path, text):
    """To any file, also to none and to one like a lock."""
    precious = tmp_path / "precious.txt"
    folder = tmp_path / "here"
    folder.mkdir()
    (folder / ".lock").symlink_to(precious)
    if text is not None:
        precious.write_text(text)
    refused_lock(folder)
    assert (folder / ".lock").is_symlink() and precious.exists() == (text is not None)
    assert text is None or precious.read_text() == text


@pytest.mark.parametrize("make", [os.mkdir, os.mkfifo])
def test_a_lock_that_is_no_file_is_refused(tmp_path, make):
    make(tmp_path / ".lock")
    refused_lock(tmp_path)
    assert (tmp_path / ".lock").exists()


def test_a_file_system_without_locks_refuses_nobody(tmp_path, monkeypatch):
    def no_locks(*_):
        raise OSError(38, "Function not implemented")

    monkeypatch.setattr("porofsi_petsc.output.lock.fcntl.flock", no_locks)
    with claim(tmp_path), claim(tmp_path):
        pass
    assert not any(tmp_path.iterdir())


def test_the_lock_is_that_of_the_file_under_its_name(tmp_path, monkeypatch):
    """The one opened may be removed by its holder before it is locked: then the new one counts."""
    from porofsi_petsc.output import lock

    real = lock.fcntl.flock
    removed = []

    def late(file, how):
        if not removed:
            removed.append((tmp_path / lock.NAME).unlink())
        real(file, how)

    monkeypatch.setattr(lock.fcntl, "flock", late)
    held = lock.Lock(tmp_path)
    assert removed and (tmp_path / lock.NAME).exists()
    with pytest.raises(InputError, match="a run is writing there"):
        lock.Lock(tmp_path)
    held.release()


def test_two_runs_do_not_mix_their_results(tmp_path):
    """The second one, with --force, ends with 2 while the first goes on undisturbed."""
    words = [
        sys.executable,
        "-m",
        "porofsi_petsc",
        "run",
        "pulse2d",
        "--output",
        str(tmp_path),
        *changes((*TINY, "time.end=10")),
    ]
    with subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment()
    ) as first:
        deadline = time.monotonic() + 60
        while not (tmp_path / "history.csv").exists() or len(history(tmp_path)["t"]) < 3:
            assert time.monotonic() < deadline and first.poll() is None
            time.sleep(0.02)
        second = by_command_line("pulse2d", tmp_path, *changes((*TINY, "time.end=2e-3")), "--force")
        first.send_signal(signal.SIGTERM)
        _, error = first.communicate(timeout=60)
    assert (
        second.returncode == 2
        and f"process {first.pid} on" in second.stderr
        and "Traceback" not in second.stderr
    )
    assert first.returncode == 4, error
    assert (
        header(tmp_path / "checkpoint.h5")["step"]
        == summary(tmp_path)["steps"]
        == len(history(tmp_path)["t"]) - 1
    )
