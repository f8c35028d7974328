"""Signals at random moments of a run: afterwards nothing hangs, and what is on disk is continued to
the very same history.

Half of the moments (40) on one rank, half on two: SIGINT, SIGTERM, SIGUSR1 or SIGKILL to one rank,
all of them, or mpirun, at a random time after Python's own start or after a random row of the
history.  Then every process must be gone within a minute, without a traceback, and a restart from
the checkpoint, or the run anew where there is none, must end with the history of a run that nobody
disturbed: to the last digit on one rank, to round-off on two (messages come in any order).  Prints
a line for each moment and ends with 1 when one of them failed.
"""

import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import command_line
import launching
import numpy as np

from porofsi_petsc.output.history import read_history

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1, signal.SIGKILL)
RECEIVERS = ("one rank", "all ranks", "mpirun")
STEPS = 40
SCENE = (
    *(
        "mesh.order=1",
        "mesh.x.cells=[4, 2, 4]",
        "mesh.y.cells=[4]",
        "time.step=1e-3",
        f"time.end={STEPS * 1e-3}",
    ),
    *("expect=[]", "output.checkpoint_every=3", "output.fields_every=4"),
)
# [s] until a process that has not ended hangs; a signal before the first step finds compiled
# routines
PATIENCE = 60.0
# of the largest value of a column, on several ranks: 1e-16 times the condition number of the
# factored blocks
ROUND_OFF = 1e-9


@dataclass(frozen=True)
class Moment:
    """When a signal comes to whom: after `rows` rows of the history (0: from the start) and `delay`
    [s] more.
    """

    ranks: int
    number: signal.Signals
    receiver: str
    rows: int
    delay: float

    def __str__(self):
        when = f"after {self.rows} rows" if self.rows else "at the start"
        return (
            f"{self.ranks} ranks, {self.number.name} to {self.receiver}, {when} and"
            f" {self.delay:.2f} s"
        )


def moments(count, seed, ranks=(1, 2)):
    """Return random moments, in turn on one and on several ranks."""
    chance = random.Random(seed)
    for i in range(count):
        early = chance.random() < 0.3
        yield Moment(
            ranks[i % len(ranks)],
            chance.choice(SIGNALS),
            chance.choice(RECEIVERS),
            0 if early else chance.randint(1, STEPS + 1),
            chance.uniform(0.0, 4.0 if early else 0.3),
        )


def command(folder, ranks, *more):
    """Return the words of a run in a folder."""
    launcher = ["mpirun", "-n", str(ranks)] if ranks > 1 else []
    changes = [word for change in SCENE for word in ("--set", change)]
    run = [
        sys.executable,
        "-m",
        "porofsi_petsc",
        "run",
        "pulse2d",
        "--output",
        str(folder),
        *changes,
    ]
    return [*launcher, *run, *more]


def start(words):
    """Start a process with the signals of a terminal, in a group of its own, so that mpirun starts
    afresh.
    """
    environment = launching.environment() | launching.GIVE_WAY
    streams = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen(
        words, **streams, env=environment, preexec_fn=_as_a_terminal, start_new_session=True
    )


def _as_a_terminal():
    for number in SIGNALS[:3]:
        signal.signal(number, signal.SIG_DFL)


def complete(words):
    """Run to the end and return the exit code and the errors."""
    with start(words) as process:
        _, error = process.communicate(timeout=5 * PATIENCE)
    return process.returncode, error


def try_moment(moment, folder, expected):
    """Disturb a run, continue it, and return what it ended with and a text of what is wrong, an
    empty one if nothing is.

    expected : history of the undisturbed run (dict column -> rows)
    """
    folder = Path(folder)
    with start(command(folder, moment.ranks)) as process:
        everyone = _strike(process, moment, folder)
        try:
            _, error = process.communicate(timeout=PATIENCE)
        except subprocess.TimeoutExpired:
            _kill(everyone)
            return None, "hangs"
    left = _wait_for_all(everyone)
    if left or "Traceback" in error or "Aborted!" in error:
        return process.returncode, f"processes {left} are left" if left else error
    return process.returncode, _continued(moment, folder, expected)


def _strike(process, moment, folder):
    """Send the signal when its moment has come, unless the run has ended; return the ids of all its
    processes.
    """
    history = folder / "history.csv"
    while moment.rows and process.poll() is None:
        if history.is_file() and len(history.read_bytes().splitlines()) > moment.rows:
            break
        time.sleep(0.005)
    ranks = _started(process, moment.ranks)
    time.sleep(moment.delay)
    receivers = {"one rank": ranks[-1:], "all ranks": ranks, "mpirun": []}[moment.receiver] or [
        process.pid
    ]
    for receiver in receivers:
        if process.poll() is None:
            _send(receiver, moment.number)
    return [process.pid, *ranks]


def _started(process, count):
    """Return the ids of the ranks under mpirun once all have handlers: a Python that starts prints
    its own traceback.
    """
    while process.poll() is None:
        ranks = launching.ranks_of(process.pid) if count > 1 else [process.pid]
        if len(ranks) == count and all(map(_has_handlers, ranks)):
            return ranks if count > 1 else []
        time.sleep(0.005)
    return []


def _has_handlers(pid):
    """Return whether a process catches SIGUSR1."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return False
    caught = next((int(line.split()[1], 16) for line in lines if line.startswith("SigCgt")), 0)
    return bool(caught >> (signal.SIGUSR1 - 1) & 1)


def _send(pid, number):
    try:
        os.kill(pid, number)
    except ProcessLookupError:
        pass


def _kill(everyone):
    for pid in everyone:
        _send(pid, signal.SIGKILL)


def _wait_for_all(everyone):
    """Return those who are there after all patience; ranks outlive a killed mpirun by moments."""
    deadline = time.monotonic() + PATIENCE
    while left := [pid for pid in everyone if Path(f"/proc/{pid}").exists()]:
        if time.monotonic() > deadline:
            _kill(left)
            return left
        time.sleep(0.05)
    return []


def _continued(moment, folder, expected):
    """Bring the run to its end and return how its history differs."""
    if (
        not (folder / "summary.json").is_file()
        or '"exit_code": 0' not in (folder / "summary.json").read_text()
    ):
        checkpoint = folder / "checkpoint.h5"
        more = ("--restart", str(checkpoint)) if checkpoint.is_file() else ("--force",)
        code, error = complete(command(folder, moment.ranks, *more))
        if code:
            return f"{more[0]} ends with {code}: {error}"
    found = read_history(folder / "history.csv")
    if found.keys() != expected.keys() or len(found["t"]) != len(expected["t"]):
        return f"{len(found['t'])} rows instead of {len(expected['t'])}"
    largest = max(
        np.abs(found[name] - expected[name]).max() / (np.abs(expected[name]).max() or 1.0)
        for name in expected
    )
    return (
        ""
        if largest <= (ROUND_OFF if moment.ranks > 1 else 0.0)
        else f"another history, by {largest:.1e}"
    )


def undisturbed(folder, ranks):
    """Return the history of a run that nobody disturbs."""
    code, error = complete(command(folder, ranks))
    if code:
        raise SystemExit(error)
    return read_history(Path(folder) / "history.csv")


def main():
    parser = command_line.parser("fuzz signals", __doc__)
    parser.add_argument("--moments", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--folder", type=Path)
    choice = parser.parse_args()
    folder = choice.folder or Path(tempfile.mkdtemp(prefix="porofsi-signals-"))
    expected = {ranks: undisturbed(folder / f"undisturbed-{ranks}", ranks) for ranks in (1, 2)}
    failures = 0
    for i, moment in enumerate(moments(choice.moments, choice.seed)):
        code, wrong = try_moment(moment, folder / str(i), expected[moment.ranks])
        failures += bool(wrong)
        print(
            f"{i + 1}: {moment}: exit code {code}, {wrong or 'continued to the same history'}",
            flush=True,
        )
    print(f"{failures} of {choice.moments} failed; results in {folder}")
    sys.exit(bool(failures))


if __name__ == "__main__":
    main()
