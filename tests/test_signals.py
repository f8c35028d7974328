"""A signal ends every command with one sentence, on one rank or several, before, in and after the
time loop; nothing is lost.
"""

import importlib
import os
import signal
import subprocess
import sys
import threading
import time

import pytest
from fuzz import signals as fuzzing
from fuzz.signals import Moment
from launching import ranks_of
from running import (
    Job,
    changes,
    command,
    environment,
    header,
    history,
    needs_mpirun,
    run_here,
    summary,
)

from porofsi_petsc import load_scene, run, signals
from porofsi_petsc.errors import Stopped
from porofsi_petsc.signals import Interrupted, answered_by, interrupt, note, noted, restored

BLOCK = (
    "expect=[]",
    "mesh.order=1",
    "mesh.x.cells=[4, 2, 4]",
    "mesh.y.cells=[4]",
    "time.end=0.01",
    "time.step=1e-3",
)


@pytest.fixture(autouse=True)
def nothing_noted():
    yield
    signals.forget()


# -- handlers --------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", signals.ENDING)
def test_a_note_waits_and_an_interruption_does_not(number):
    before = signal.getsignal(number)
    with answered_by(note):
        signal.raise_signal(number)
        assert noted() == number
    signals.forget()
    with (
        pytest.raises(Interrupted, match=f"stopped by signal {signal.Signals(number).name}"),
        answered_by(interrupt),
    ):
        signal.raise_signal(number)
    assert noted() == number and signal.getsignal(number) == before


@pytest.mark.parametrize("handler", [note, interrupt])
def test_only_a_second_sigint_ends_what_the_first_signal_has_begun_to_end(handler):
    """Of Ctrl-C under mpirun a rank may see SIGINT and SIGTERM."""
    with answered_by(note):
        signal.raise_signal(signal.SIGINT)
        with answered_by(handler):
            signal.raise_signal(signal.SIGTERM)
            assert noted() == signal.SIGINT
            with pytest.raises(Interrupted):
                signal.raise_signal(signal.SIGINT)


def test_an_import_is_finished_before_the_interruption(tmp_path, monkeypatch):
    """Python forgets a module whose import is interrupted, and with it that MPI, say, has
    started.
    """
    (tmp_path / "slow_to_import.py").write_text(
        "import signal, time\nsignal.raise_signal(signal.SIGTERM)\ntime.sleep(0.1)\ndone = True\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(Interrupted, match="SIGTERM"), answered_by(interrupt):
        import slow_to_import

        deadline = time.monotonic() + 5.0
        while time.monotonic() < deadline:
            pass
    assert sys.modules["slow_to_import"].done and slow_to_import.done


def test_an_ignored_signal_stays_ignored():
    """As nohup and a shell's jobs in the background want it."""
    with restored([signal.SIGHUP]):
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        with answered_by(interrupt):
            signal.raise_signal(signal.SIGHUP)
    assert not noted()


def test_a_thread_may_run_a_scene():
    """Python lets the main thread alone set handlers."""
    failures = []

    def work():
        try:
            with answered_by(note):
                pass
        except ValueError as failure:
            failures.append(failure)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert not failures


def test_petsc_leaves_the_handlers_alone():
    """It would make an error of SIGHUP under nohup and of SIGPIPE."""
    code = """
import signal
signal.signal(signal.SIGHUP, signal.SIG_IGN)
from porofsi_petsc.linalg import options
options.start()
signal.raise_signal(signal.SIGHUP), signal.raise_signal(signal.SIGPIPE)
print("alive")
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=environment(), timeout=60
    )
    assert done.stdout == "alive\n", done.stderr


# -- a run in this process -------------------------------------------------------------------------


def test_a_signal_while_figures_are_drawn_leaves_them_out_and_stops_the_next_run(
    tmp_path, monkeypatch, capsys
):
    drawn = []

    def draw(directory):
        assert summary(directory)["exit_code"] == 0  # it is there before the figures
        drawn.append("begun")
        signal.raise_signal(signal.SIGTERM)
        drawn.append("ended")

    monkeypatch.setattr(
        importlib.import_module("porofsi_petsc.simulation.run"), "make_figures", draw
    )
    scene = load_scene("pulse2d", (*BLOCK, "time.end=2e-3"))
    assert run(scene, tmp_path / "first")["exit_code"] == 0
    assert (
        f"the figures are left out; porofsi plot {tmp_path / 'first'} draws them"
        in capsys.readouterr().out
    )
    with pytest.raises(Stopped, match=r"SIGTERM at t = 0.001 s \(step 1\)"):
        run(scene, tmp_path / "next", quiet=True)
    assert drawn == ["begun"] and summary(tmp_path / "next")["exit_code"] == 4


# -- the command line ------------------------------------------------------------------------------

WAITING = """
import sys, time, types
def wait(*_):
    from mpi4py import MPI
    print("ready", flush=True)
    if MPI.COMM_WORLD.rank == {sleeper}:
        time.sleep(100)
    MPI.COMM_WORLD.Barrier()
from porofsi_petsc.linalg import options
options.start = wait
sys.argv = ["porofsi", *{words}]
from porofsi_petsc import __main__ as command_line
command_line.TIME_OF_RANK_0 = 1.0
command_line.main()
"""


def start(words):
    """Start a command with the signals of a terminal, whatever this process ignores."""

    def terminal():
        for number in signals.ENDING:
            signal.signal(number, signal.SIG_DFL)

    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.Popen(words, **pipes, text=True, env=environment(), preexec_fn=terminal)


def ended(process, seconds=60):
    """Return exit code, output and errors of a process that must end by itself."""
    try:
        out, err = process.communicate(timeout=seconds)
    except subprocess.TimeoutExpired:
        process.kill()
        raise
    assert "Traceback" not in err and "Aborted!" not in err, err
    return process.returncode, out, err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGUSR1])
@pytest.mark.parametrize("words", [["run", "pulse2d"], ["check", "pulse2d"]])
def test_a_signal_during_the_set_up_ends_with_4_and_a_sentence(words, number):
    process = start([sys.executable, "-c", WAITING.format(sleeper=0, words=words)])
    assert process.stdout.readline() == "ready\n"
    process.send_signal(number)
    code, _, err = ended(process)
    assert (code, err) == (4, f"error: stopped by signal {number.name}\n")


@needs_mpirun
@pytest.mark.parametrize("sleeper", [0, 1])
@pytest.mark.parametrize("receivers", [(0,), (1,), (0, 1)])
def test_no_rank_hangs_when_one_or_all_are_interrupted_during_the_set_up(sleeper, receivers):
    """One rank waits for the other in a collective call, where Python sees no signal."""
    process = start(
        [
            "mpirun",
            "-n",
            "2",
            sys.executable,
            "-c",
            WAITING.format(sleeper=sleeper, words=["run", "pulse2d"]),
        ]
    )
    process.stdout.read(2 * len("ready\n"))
    ranks = ranks_of(process.pid)
    for receiver in receivers:
        os.kill(ranks[receiver], signal.SIGINT)
    if receivers == (
        1 - sleeper,
    ):  # inside MPI, until the other comes: the next signal is that of somebody who has waited
        time.sleep(0.5)
        os.kill(ranks[sleeper], signal.SIGINT)
    code, _, err = ended(process)
    assert code == 4 and err.count("error: stopped by signal SIGINT") == 1


def wait_for_steps(process, folder, count):
    deadline = time.monotonic() + 60
    while not (folder / "history.csv").is_file() or len(history(folder)["t"]) <= count:
        assert time.monotonic() < deadline and process.poll() is None
        time.sleep(0.02)


@pytest.mark.parametrize(
    "ranks, receivers",
    [
        (None, ()),
        pytest.param(2, (0,), marks=needs_mpirun),
        pytest.param(2, (0, 1), marks=needs_mpirun),
    ],
)
def test_ctrl_c_writes_a_checkpoint_and_a_restart_goes_on(tmp_path, ranks, receivers):
    out = tmp_path / "run"
    endless = (*BLOCK, "time.end=100")
    process = start(command("pulse2d", out, *changes(endless), ranks=ranks))
    wait_for_steps(process, out, 2)
    family = ranks_of(process.pid) if ranks else []
    for pid in [family[i] for i in receivers] or [process.pid]:
        os.kill(pid, signal.SIGINT)
    code, _, err = ended(process)
    stopped = header(out / "checkpoint.h5")
    assert (
        code == summary(out)["exit_code"] == 4
        and err.count("error: stopped by signal SIGINT at t = ") == 1
    )
    assert (
        stopped["step"] >= 2
        and history(out)["t"][-1] == stopped["time"]
        and not list(out.glob("*.png"))
    )
    more = (*endless, f"time.end={stopped['time'] + 2e-3}")
    assert (
        run_here(Job("pulse2d", str(out), more, restart=str(out / "checkpoint.h5")))["steps"]
        == stopped["step"] + 2
    )


def test_a_second_ctrl_c_ends_at_once(tmp_path):
    process = start(command("pulse2d", tmp_path / "run", *changes((*BLOCK, "time.end=100"))))
    wait_for_steps(process, tmp_path / "run", 2)
    for _ in range(2):
        process.send_signal(signal.SIGINT)
        time.sleep(0.01)
    code, _, err = ended(process, 10)
    assert code == 4 and err.count("error: stopped by signal SIGINT") == 1


@pytest.mark.parametrize(
    "words",
    [["verify", "terzaghi", "--output"], ["study", "coupling", "--output"]],
)
def test_long_commands_end_with_a_sentence(tmp_path, words):
    process = start([sys.executable, "-m", "porofsi_petsc", *words, str(tmp_path / "out")])
    deadline = time.monotonic() + 60
    while not list(tmp_path.rglob("*.csv")):
        assert time.monotonic() < deadline and process.poll() is None
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    code, _, err = ended(process)
    assert code == 4 and err.startswith("error: stopped by signal SIGINT") and err.count("\n") == 1


# -- a sample of scripts/run fuzz signals ----------------------------------------------------------


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """Histories of runs that nobody disturbs, by the number of ranks."""
    return {
        ranks: fuzzing.undisturbed(tmp_path_factory.mktemp(f"on{ranks}"), ranks) for ranks in (1, 2)
    }


@needs_mpirun
@pytest.mark.parametrize(
    "moment",
    [
        Moment(1, signal.SIGKILL, "all ranks", rows=20, delay=0.01),
        Moment(2, signal.SIGKILL, "one rank", rows=8, delay=0.02),
        Moment(2, signal.SIGINT, "all ranks", rows=13, delay=0.0),
    ],
    ids=str,
)
def test_what_a_signal_leaves_is_continued_to_the_same_history(tmp_path, undisturbed, moment):
    code, wrong = fuzzing.try_moment(moment, tmp_path / "run", undisturbed[moment.ranks])
    assert not wrong and code != 0
