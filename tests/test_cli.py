"""Command line: what reaches the simulation, exit codes, quick answers, and the end of a parallel
job when one rank fails.
"""

import shutil
import subprocess
import sys
import types
from pathlib import Path

import pytest
from click.testing import CliRunner
from launching import environment

import porofsi_petsc
from porofsi_petsc import errors, log
from porofsi_petsc.commands import cli
from porofsi_petsc.linalg import options

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture
def calls(monkeypatch):
    """Replace PETSc's start and the simulation; return the list of what they received."""
    received = []
    simulation = types.ModuleType("porofsi_petsc.simulation")
    simulation.run = lambda *arguments: received.append(("run", *arguments))
    simulation.check = lambda scene, figure: f"checked {scene.name}"
    monkeypatch.setitem(sys.modules, "porofsi_petsc.simulation", simulation)
    monkeypatch.setattr(options, "start", lambda *arguments: received.append(("start", *arguments)))
    return received


def invoke(*arguments):
    return CliRunner().invoke(cli, arguments)


def test_run_passes_everything_on(calls, tmp_path):
    result = invoke(
        *(
            "run",
            "pulse2d",
            "--output",
            str(tmp_path / "out"),
            "--set",
            "time.end=0.5",
            "--set",
            "petsc.options=-a 1",
        ),
        *(
            "--restart",
            "x.h5",
            "--force",
            "--quiet",
            "--max-time",
            "5",
            "--",
            "-fluid_ksp_monitor",
            "-b",
            "2",
        ),
    )
    assert result.exit_code == 0, result.output
    (_, *started), (_, scene, *rest) = calls
    assert started == ["-a 1", ["-fluid_ksp_monitor", "-b", "2"], False]
    assert scene.time.end == 0.5 and rest == [tmp_path / "out", Path("x.h5"), True, True, 5.0]


def test_run_has_a_default_directory_and_applies_smoke(calls):
    assert invoke("run", "pulse2d", "--smoke").exit_code == 0
    _, scene, *rest = calls[-1]
    assert scene.time.end == scene.smoke["time.end"] and rest == [
        Path("results/pulse2d"),
        None,
        False,
        False,
        None,
    ]


def test_the_same_from_python(calls):
    porofsi_petsc.run(porofsi_petsc.load_scene("pulse2d"), "results/x", petsc_options=["-c"])
    assert calls[0] == ("start", "", ["-c"], False) and calls[1][2] == Path("results/x")


def test_check_list_and_version(calls):
    assert invoke("check", "pulse2d").output == "checked pulse2d\n"
    assert "pulse2d" in invoke("list").output
    assert porofsi_petsc.__version__ in invoke("--version").output


@pytest.mark.parametrize(
    "error, code",
    [
        (errors.InputError, 2),
        (errors.ConvergenceError, 3),
        (errors.Stopped, 4),
        (errors.ExpectationError, 5),
        (errors.PorofsiError, 1),
        (ZeroDivisionError, 1),
    ],
)
def test_exit_codes(calls, error, code):
    def fail(*_):
        raise error("the reason")

    sys.modules["porofsi_petsc.simulation"].run = fail
    result = invoke("run", "pulse2d")
    assert result.exit_code == code
    if issubclass(error, errors.PorofsiError):
        assert result.stderr == "error: the reason\n"


@pytest.mark.parametrize(
    "arguments, sentence",
    [
        (["run"], "Missing argument"),
        (["run", "pulse2d", "--nonsense"], "No such option"),
        (["run", "pulse2d", "more"], "PETSc options follow after --"),
        (["run", "pulse2d", "--max-time", "0"], "received '0', expected a positive number"),
        (["run", "pulse2d", "--max-time", "nan"], "received 'nan', expected a positive number"),
        (["run", "pulse2d", "--set", "time.end"], "expected KEY=VALUE"),
        (["run", "nowhere.toml"], "no such file"),
        (
            ["check", "pulse2d", "--set", "time.end=no"],
            "[time.end]: received 'no', expected a number",
        ),
        (["walk"], "No such command"),
    ],
)
def test_wrong_use_ends_with_2(calls, arguments, sentence):
    result = invoke(*arguments)
    assert result.exit_code == 2 and sentence in result.stderr and not calls


def test_help_imports_nothing_heavy():
    code = "import sys; from porofsi_petsc.commands import cli; print(*sys.modules)"
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=environment(), check=True
    ).stdout.split()
    assert not {
        "petsc4py",
        "mpi4py",
        "numpy",
        "scipy",
        "matplotlib",
        "pydantic",
        "h5py",
        "meshio",
    } & set(loaded)


@pytest.mark.parametrize(
    "failure", [ImportError("No module named 'mpi4py'"), RuntimeError("cannot load MPI library")]
)
def test_an_mpi_that_cannot_be_loaded_is_wrong_input(monkeypatch, failure):
    class Finder:
        def find_spec(self, name, path=None, target=None):
            if name.startswith("mpi4py"):
                raise failure

    for name in [name for name in sys.modules if name.startswith("mpi4py")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(sys, "meta_path", [Finder(), *sys.meta_path])
    result = invoke("run", "pulse2d")
    assert result.exit_code == 2 and "Traceback" not in result.stderr
    assert (
        f"error: mpi4py cannot load MPI ({failure}); install it, load the modules" in result.stderr
    )


STUBBED = """
import sys, types
from mpi4py import MPI
from porofsi_petsc import errors, log
from porofsi_petsc.linalg import agreement, options
def run(*_):
    {action}
    MPI.COMM_WORLD.Barrier()
options.start = lambda *_: None
sys.modules["porofsi_petsc.simulation"] = types.SimpleNamespace(run=run)
from porofsi_petsc import __main__ as command_line
agreement.AGREEMENT_TIME = 0.5
sys.argv = ["porofsi", "run", "pulse2d"]
command_line.main()
"""
PARALLEL = [
    ("raise errors.ConvergenceError('all of us')", 3, "error: all of us", 1),
    (
        "if MPI.COMM_WORLD.rank == 1: raise ZeroDivisionError('one of us')",
        1,
        "ZeroDivisionError: one of us",
        1,
    ),
    ("if MPI.COMM_WORLD.rank == 1: raise errors.InputError('one of us')", 2, "error: one of us", 1),
]


@pytest.mark.skipif(shutil.which("mpirun") is None, reason="no mpirun")
@pytest.mark.parametrize("action, code, sentence, times", PARALLEL)
def test_a_parallel_job_ends_with_its_error(tmp_path, action, code, sentence, times):
    script = tmp_path / "job.py"
    script.write_text(STUBBED.format(action=action))
    command = ["mpirun", "-n", "2", sys.executable, str(script)]
    result = subprocess.run(command, capture_output=True, text=True, env=environment(), timeout=60)
    assert result.returncode == code
    assert result.stderr.count(sentence) == times


def test_only_rank_0_logs(tmp_path, capsys):
    log.start_log(tmp_path, rank=0)
    log.logger.info("first line")
    log.start_log(tmp_path, rank=1)
    log.logger.info("from another rank")
    log.start_log(tmp_path, rank=0, quiet=True)
    log.logger.info("second line")
    log.stop_log()
    assert capsys.readouterr().out == "first line\n"
    lines = (tmp_path / "run.log").read_text().splitlines()
    assert [line.split("INFO ")[1] for line in lines] == ["first line", "second line"]
