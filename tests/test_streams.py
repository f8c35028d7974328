"""Standard output and error that are closed, full or read no further: a run goes on, a command that
prints says so.
"""

import io
import subprocess
import sys

import pytest
from running import changes, environment, summary

from porofsi_petsc.output.progress import Progress

MESH = ("mesh.order=1", "mesh.x.cells=[4, 2, 4]", "mesh.y.cells=[4]")
TINY = ("expect=[]", "figures={}", "time.end=2e-3", "time.step=1e-3", *MESH)
PROGRAM = f"{sys.executable} -m porofsi_petsc"


def shell(text):
    """Run a line of the shell, in which the program is the last command or its exit code is
    printed.
    """
    return subprocess.run(
        ["bash", "-c", text], capture_output=True, text=True, env=environment(), timeout=120
    )


def a_run(folder, *more):
    return " ".join(
        [
            PROGRAM,
            "run pulse2d --output",
            str(folder),
            *(f"'{word}'" for word in changes(TINY)),
            *more,
        ]
    )


@pytest.mark.parametrize("streams", [">&-", "<&- >&- 2>&-", ">/dev/full", ">/dev/full 2>/dev/full"])
def test_a_run_needs_no_standard_output(tmp_path, streams):
    done = shell(f"{a_run(tmp_path / 'run')} {streams}")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert summary(tmp_path / "run")["steps"] == 2


@pytest.mark.parametrize(
    "options",
    ["-fluid_ksp_converged_reason", "-fluid_ksp_type gmres -fluid_ksp_monitor", "-log_view"],
)
def test_a_reader_that_goes_does_not_end_the_run(tmp_path, options):
    """PETSc prints too here: after a solve, in it, at the end.  (Under mpirun, that of Open MPI
    ends the job as by SIGTERM.)
    """
    done = shell(f"{a_run(tmp_path / 'run', '--', options)} | head -1; echo ${{PIPESTATUS[0]}}")
    assert (done.stdout.splitlines()[1:], done.stderr) == (["0"], "")
    assert summary(tmp_path / "run")["steps"] == 2


@pytest.mark.parametrize("command", ["list", "check terzaghi"])
def test_a_command_that_cannot_print_says_so(command):
    done = shell(f"{PROGRAM} {command} >/dev/full")
    assert (done.returncode, done.stderr) == (
        1,
        "error: standard output: could not be written (No space left on device)\n",
    )
    done = shell(f"{PROGRAM} {command} | true; echo ${{PIPESTATUS[0]}}")
    assert (done.stdout, done.stderr) == ("1\n", "")


@pytest.mark.parametrize("streams", ["2>&-", "2>/dev/full"])
def test_the_exit_code_needs_no_standard_error(streams):
    assert shell(f"{PROGRAM} check nowhere.toml {streams}").returncode == 2


def test_progress_goes_on_when_its_stream_fails():
    class Full(io.StringIO):
        def write(self, text):
            raise OSError(28, "No space left on device")

    display = Progress(1.0, stream=Full())
    display.update(1, 0.5, 2)
    display.close()
