"""Runs of scenes for the tests: in this process without figures, as a list of jobs under mpirun, or
by the command line.
"""

import importlib
import json
import shutil
import subprocess
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from unittest import mock

import h5py
import launching
import numpy as np
import pytest

from porofsi_petsc import load_scene
from porofsi_petsc.output.history import read_history

ROOT = Path(__file__).resolve().parents[2]
SCENES = ROOT / "tests" / "scenes"
HELPERS = Path(__file__).resolve().parent
needs_mpirun = pytest.mark.skipif(shutil.which("mpirun") is None, reason="no mpirun")


@dataclass(frozen=True)
class Job:
    """One run: scene (file or shipped name), its changes, where it writes, what it continues, PETSc
    options.
    """

    scene: str
    directory: str
    overrides: tuple = ()
    restart: str | None = None
    petsc_options: tuple = ()
    max_time: float | None = None
    force: bool = False


def run_here(job):
    """Run a job in this process (on all its ranks) and return its summary; without figures and the
    expectations of the scene.
    """
    from porofsi_petsc import run

    choices = {"restart": job.restart, "force": job.force, "quiet": True, "max_time": job.max_time}
    scene = load_scene(job.scene, ("expect=[]", *job.overrides))
    with mock.patch.object(
        importlib.import_module("porofsi_petsc.simulation.run"),
        "make_figures",
        lambda directory: [],
    ):
        return run(scene, job.directory, petsc_options=job.petsc_options, **choices)


def environment():
    """Return the environment of a run whose ranks, more than cores, give way to each other."""
    return launching.environment() | launching.GIVE_WAY


def complete(words, timeout=120):
    """Run a command to its end and return the completed process; end it, and with it all ranks,
    when it hangs [s].
    """
    with subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment()
    ) as process:
        try:
            out, err = process.communicate(timeout=timeout)
        except subprocess.TimeoutExpired:
            process.terminate()
            raise
    return subprocess.CompletedProcess(words, process.returncode, out, err)


def run_on(ranks, jobs, folder):
    """Run jobs one after the other in one parallel job."""
    todo = Path(folder) / f"jobs-{ranks}.json"
    todo.write_text(json.dumps([asdict(job) for job in jobs]))
    result = complete(
        ["mpirun", "-n", str(ranks), sys.executable, __file__, str(todo)], timeout=300
    )
    assert result.returncode == 0, result.stdout + result.stderr


def command(scene, directory, *arguments, ranks=None):
    """Return the command line of a run; arguments follow those of the output directory."""
    launcher = [] if ranks is None else ["mpirun", "-n", str(ranks)]
    return [
        *launcher,
        sys.executable,
        "-m",
        "porofsi_petsc",
        "run",
        str(scene),
        "--output",
        str(directory),
        *arguments,
    ]


def by_command_line(scene, directory, *arguments, ranks=None):
    """Run a scene by the command line and return the completed process."""
    return complete(command(scene, directory, *arguments, ranks=ranks))


def changes(overrides):
    """Return `--set KEY=VALUE` words."""
    return [word for text in overrides for word in ("--set", text)]


def history(directory):
    """Return dict column -> (rows,) of the history in a directory."""
    return read_history(Path(directory) / "history.csv")


def summary(directory):
    """Return the content of summary.json."""
    return json.loads((Path(directory) / "summary.json").read_text())


def state(checkpoint):
    """Return dict name -> array in the natural order of a checkpoint file."""
    with h5py.File(checkpoint, "r") as file:
        return {name: dataset[()] for name, dataset in file.items()}


def fields(checkpoint):
    """Return `state` without the vectors of the accelerator, which are differences of iterates and
    at last round-off.
    """
    return {
        name: array
        for name, array in state(checkpoint).items()
        if not name.startswith("accelerator.")
    }


def header(checkpoint):
    """Return the header of a checkpoint file."""
    with h5py.File(checkpoint, "r") as file:
        return json.loads(file.attrs["header"])


def largest_difference(a, b):
    """Return the largest |a - b| over the largest |b| (0 where both vanish)."""
    scale = np.abs(b).max(initial=0.0)
    return np.abs(a - b).max(initial=0.0) / scale if scale else np.abs(a).max(initial=0.0)


def main(path):
    """Run the jobs of a JSON file on all ranks."""
    for entry in json.loads(Path(path).read_text()):
        run_here(Job(**entry))


if __name__ == "__main__":
    main(sys.argv[1])
