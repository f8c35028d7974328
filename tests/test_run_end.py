"""How a run ends: exit codes, what is on disk afterwards, signals, time limit, step cuts, limits,
options, assemblies.
"""

import importlib
import json
import os
import signal
import subprocess
import sys
import time

import pytest
from launching import ranks_of
from running import (
    SCENES,
    Job,
    by_command_line,
    changes,
    command,
    environment,
    header,
    history,
    needs_mpirun,
    run_here,
    summary,
)

from porofsi_petsc import load_scene, run
from porofsi_petsc.errors import ConvergenceError, ExpectationError, InputError, PorofsiError

BLOCK = (
    "expect=[]",
    "mesh.order=1",
    "mesh.x.cells=[4, 2, 4]",
    "mesh.y.cells=[4]",
    "time.end=0.01",
    "time.step=1e-3",
)
COLUMN = ("mesh.y.cells=[9, 4]", "time.end=0.01", "time.step=1e-3", "time.growth=1.0", "expect=[]")
BLOCK3D = str(SCENES / "block3d.toml")


def sentence(result):
    """Return the last line of the error output, which must be the only error."""
    lines = [line for line in result.stderr.splitlines() if line.startswith("error: ")]
    assert len(lines) == 1, result.stderr
    assert "Traceback" not in result.stderr
    return lines[0]


# -- signals and time limit ------------------------------------------------------------------------


@needs_mpirun
@pytest.mark.parametrize(
    "number, receiver",
    [(signal.SIGTERM, "a rank"), (signal.SIGUSR1, "mpirun"), (signal.SIGTERM, "mpirun")],
)
def test_a_signal_writes_a_checkpoint_and_ends_with_4(tmp_path, number, receiver):
    """Also the summary, before Open MPI's mpirun kills what it has sent SIGTERM: after a second,
    here after five.
    """
    out = tmp_path / "run"
    endless = (*BLOCK, "time.end=100")
    words = command("pulse2d", out, *changes(endless), ranks=2)
    patient = environment()
    if (number, receiver) == (signal.SIGTERM, "mpirun"):
        patient |= {"OMPI_MCA_odls_base_sigkill_timeout": "5"}
    with subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=patient
    ) as process:
        try:
            wait_for(lambda: (out / "history.csv").is_file() and len(history(out)["t"]) > 2)
            os.kill(process.pid if receiver == "mpirun" else ranks_of(process.pid)[-1], number)
            _, err = process.communicate(timeout=60)
        finally:
            process.terminate()
    stopped = header(out / "checkpoint.h5")
    assert stopped["step"] >= 2 and history(out)["t"][-1] == stopped["time"]
    own_code = (number, receiver) == (
        signal.SIGTERM,
        "mpirun",
    )  # Open MPI's mpirun has one for SIGTERM
    assert process.returncode == 4 or own_code, err
    assert err.count(f"stopped by signal {number.name}") == 1
    assert (
        summary(out)["exit_code"] == 4
        and summary(out)["steps"] == stopped["step"]
        and not list(out.glob("*.png"))
    )
    job = Job(
        "pulse2d",
        str(out),
        (*endless, f"time.end={stopped['time'] + 2e-3}"),
        restart=str(out / "checkpoint.h5"),
    )
    assert run_here(job)["steps"] == stopped["step"] + 2


def wait_for(condition, seconds=60.0):
    """Wait until a condition holds."""
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "waited too long"
        time.sleep(0.02)


def test_the_time_limit_ends_with_4_after_a_checkpoint(tmp_path):
    result = by_command_line(
        "pulse2d", tmp_path, *changes((*BLOCK, "time.end=100")), "--max-time", "0.3"
    )
    assert result.returncode == 4 and "the time limit --max-time" in sentence(result)
    assert header(tmp_path / "checkpoint.h5")["step"] == summary(tmp_path)["steps"] >= 1


# -- convergence -----------------------------------------------------------------------------------


def test_the_cap_ends_with_3_and_a_checkpoint_of_the_last_accepted_step(tmp_path):
    """The linear column meets its tolerance in more than two sweeps once the load has a size."""
    capped = (
        *BLOCK,
        "coupling.max_iterations=2",
        "coupling.tolerance=1e-3",
        "coupling.on_failure=stop",
        "boundary.3.traction.y=where(t < 0.0045, -10, -1e5)",
    )
    result = by_command_line("pulse2d", tmp_path, *changes(capped))
    assert result.returncode == 3, result.stderr
    text = sentence(result)
    assert (
        "coupling did not converge at t =" in text and "2 iterations" in text and "> 1e-03" in text
    )
    steps = summary(tmp_path)["steps"]
    assert header(tmp_path / "checkpoint.h5")["step"] == steps == len(history(tmp_path)["t"]) - 1
    assert summary(tmp_path)["exit_code"] == 3 and summary(tmp_path)["time_end"] == pytest.approx(
        1e-3 * steps, rel=1e-12
    )
    again = Job(
        "pulse2d",
        str(tmp_path),
        (*capped, "coupling.max_iterations=60"),
        restart=str(tmp_path / "checkpoint.h5"),
    )
    assert run_here(again)["time_end"] == 0.01


def test_a_failing_step_is_cut_and_the_run_goes_on(tmp_path):
    """A pressing load turns elements over within one step of 20 ms, not within its parts."""
    crush = (
        *BLOCK,
        "time.end=0.04",
        "time.step=0.02",
        "limits.mesh_displacement=report",
        "limits.porosity_change=report",
        'coupling.on_failure="cut_step"',
        "coupling.max_iterations=30",
        "coupling.max_cuts=8",
        "boundary.3.traction.y=-1e8*t/0.04",
    )
    with pytest.raises(ConvergenceError):
        run_here(Job("pulse2d", str(tmp_path / "stop"), (*crush, 'coupling.on_failure="stop"')))
    cut = run_here(Job("pulse2d", str(tmp_path / "cut"), crush))
    assert cut["step_cuts"] >= 1 and cut["steps"] > 2 and cut["time_end"] == 0.04
    assert {0.02, 0.04} <= set(history(tmp_path / "cut")["t"])


def test_a_step_that_fails_in_every_size_ends_the_run(tmp_path):
    never = (
        *BLOCK,
        "coupling.max_iterations=1",
        'coupling.on_failure="cut_step"',
        "coupling.max_cuts=2",
    )
    with pytest.raises(ConvergenceError, match="1 iterations"):
        run_here(Job("pulse2d", str(tmp_path / "run"), never))
    assert summary(tmp_path / "run")["step_cuts"] == 2


def test_a_linear_solver_that_does_not_converge_ends_with_3(tmp_path):
    iterative = [
        "--",
        "-fluid_ksp_type",
        "gmres",
        "-fluid_pc_type",
        "jacobi",
        "-fluid_ksp_max_it",
        "1",
    ]
    result = by_command_line("pulse2d", tmp_path, *changes(BLOCK), *iterative)
    assert result.returncode == 3
    text = sentence(result)
    assert (
        "linear solver fluid_ (gmres, jacobi) failed with DIVERGED" in text
        and "after 1 iterations" in text
    )
    assert summary(tmp_path)["steps"] == 0


def test_the_same_where_petsc_makes_an_error_of_it(tmp_path):
    options = (
        "-fluid_ksp_type gmres -fluid_pc_type jacobi -fluid_ksp_max_it 1"
        " -fluid_ksp_error_if_not_converged"
    )
    with pytest.raises(
        ConvergenceError,
        match=r"solver fluid_ \(gmres, jacobi\) failed with DIVERGED.* after 1 iterations",
    ):
        run_here(Job("pulse2d", str(tmp_path / "run"), BLOCK, petsc_options=tuple(options.split())))


@pytest.mark.parametrize(
    "options, sentence",
    [
        (
            "-solid_mat_type nosuch",
            (
                r"'solid_': received .*Unknown Mat type given: nosuch; remove the option"
                r" -solid_mat_type"
            ),
        ),
        (
            "-fluid_ksp_rtol 1e-3",
            (
                "nothing used -fluid_ksp_rtol; it exists, but .*-fluid_ksp_type preonly .* does not"
                " read it"
            ),
        ),
        (
            "-fluid_ksp_type gmres -fluid_ksp_rtol abc",
            "a solver -fluid_… cannot be made: Input string abc has no numeric value",
        ),
        (
            "-fluid_ksp_converged_reason :/nowhere/x",
            "Cannot open .*/nowhere/x.*; correct the file of an option -fluid_",
        ),
    ],
)
def test_an_option_that_petsc_cannot_follow_is_named(tmp_path, options, sentence):
    with pytest.raises(InputError, match=sentence):
        run_here(
            Job(
                "pulse2d",
                str(tmp_path / "run"),
                (*BLOCK, "time.end=2e-3"),
                petsc_options=tuple(options.split()),
            )
        )


@needs_mpirun
def test_an_inverted_element_on_one_rank_ends_all_with_3(tmp_path):
    given = (
        "time.step=0.01",
        "boundary.3.traction.y=-1e9",
        "limits.mesh_displacement=report",
        "coupling.on_failure=stop",
    )
    crush = (*BLOCK, *given)
    result = by_command_line("pulse2d", tmp_path, *changes(crush), ranks=2)
    assert result.returncode == 3, result.stderr
    assert result.stderr.count("error: ") == 1
    assert header(tmp_path / "checkpoint.h5")["step"] == summary(tmp_path)["steps"]


# -- expectations, limits, options -----------------------------------------------------------------


def expecting(value, tolerance):
    return (
        f'expect=[{{ quantity = "C.u_y", statistic = "min", value = {value}, tolerance ='
        f" {tolerance} }}]"
    )


def test_a_failing_expectation_ends_with_5_after_everything_is_written(tmp_path):
    with pytest.raises(
        ExpectationError, match=r"1 of 1 expectations failed, the first: C.u_y computed -"
    ):
        run_here(Job("pulse2d", str(tmp_path / "run"), (*BLOCK, expecting(-1.0, 1e-3))))
    record = summary(tmp_path / "run")["expectations"][0]
    assert summary(tmp_path / "run")["exit_code"] == 5 and record["passed"] is False
    assert record["value"] == history(tmp_path / "run")["C.u_y"].min()
    passed = run_here(
        Job("pulse2d", str(tmp_path / "met"), (*BLOCK, expecting(record["value"], 1e-9)))
    )
    assert passed["exit_code"] == 0 and passed["expectations"][0]["passed"] is True


@pytest.mark.parametrize(
    "overrides, limit, name",
    [
        (("material.0.solid.law=linear_elastic", "limits.strain=1e-5"), "strain", "strain"),
        (
            ("model.moving_mesh=false", "limits.mesh_displacement=1e-6"),
            "mesh_displacement",
            "mesh_displacement",
        ),
        (("model.convection=false", "limits.reynolds=1e-9"), "reynolds", "reynolds"),
        (("model.fluid_inertia=false", "limits.inertia=1e-6"), "inertia", "fluid_inertia"),
        (("model.solid_inertia=false", "limits.inertia=1e-6"), "inertia", "solid_inertia"),
        (("limits.porosity_change=1e-6",), "porosity_change", "porosity_change"),
        (("material.0.fluid.viscosity=1.0", "limits.viscosity=1e-6"), "viscosity", "viscosity"),
    ],
)
def test_a_limit_that_is_passed_stops_the_run_and_report_does_not(tmp_path, overrides, limit, name):
    with pytest.raises(
        PorofsiError,
        match=rf"\[limits\] {limit}: at t = .* the term left out reached.* set limits.{limit} to",
    ) as error:
        run_here(Job("pulse2d", str(tmp_path / "run"), BLOCK + overrides))
    assert error.value.exit_code == 2
    assert summary(tmp_path / "run")["exit_code"] == 2
    assert (
        summary(tmp_path / "run")["neglected"][name]["value"]
        > summary(tmp_path / "run")["neglected"][name]["bound"]
    )
    reported = run_here(
        Job("pulse2d", str(tmp_path / "reported"), (*BLOCK, *overrides, f"limits.{limit}=report"))
    )
    assert reported["time_end"] == 0.01 and reported["neglected"][name]["bound"] is None


def test_an_option_that_nobody_used_is_refused_after_the_first_step(tmp_path):
    result = by_command_line("pulse2d", tmp_path, *changes(BLOCK), "--", "-fluid_ksp_rtoll", "1e-3")
    assert result.returncode == 2
    assert (
        sentence(result)
        == "error: PETSc options: nothing used -fluid_ksp_rtoll; did you mean -fluid_ksp_rtol?"
    )
    assert json.loads((tmp_path / "summary.json").read_text())["exit_code"] == 2


def test_options_of_solvers_that_the_scene_lacks_are_exempt(tmp_path):
    mesh = ("-mesh_ksp_type", "cg", "-mesh_pc_type", "gamg")
    assert (
        run_here(Job("pulse2d", str(tmp_path / "run"), BLOCK, petsc_options=mesh))["exit_code"] == 0
    )
    with pytest.raises(InputError, match="nothing used -meshes_ksp_type"):
        run_here(
            Job("pulse2d", str(tmp_path / "other"), BLOCK, petsc_options=("-meshes_ksp_type", "cg"))
        )


# -- what is linear is assembled once --------------------------------------------------------------


def assert_matrices(done, times):
    for counts in (done["assemblies"], done["factorizations"]):
        assert (counts["fluid"], counts["solid"]) == (times, times)


@pytest.mark.parametrize("end, times", [("0.01", 1), ("0.0095", 2)])
def test_a_linear_scene_assembles_and_factors_each_block_once_per_step_size(tmp_path, end, times):
    done = run_here(Job("column_harmonic", str(tmp_path / "run"), (*COLUMN, f"time.end={end}")))
    assert done["steps"] == 10
    assert_matrices(done, times)


def test_a_linear_scene_in_three_dimensions_assembles_once(tmp_path):
    linear = (
        "model.moving_mesh=false",
        "model.convection=false",
        "material.0.solid.law=linear_elastic",
        "limits.strain=report",
    )
    done = run_here(
        Job(
            BLOCK3D,
            str(tmp_path / "run"),
            (*linear, "limits.mesh_displacement=report", "limits.reynolds=report"),
        )
    )
    assert_matrices(done, 1)


def test_the_command_line_needs_python_only(tmp_path):
    """A whole run from another directory writes every file that the summary lists."""
    words = [*command("pulse2d", tmp_path / "run", *changes((*BLOCK, "time.end=0.002"))), "--quiet"]
    assert words[0] == sys.executable
    result = subprocess.run(
        words, capture_output=True, text=True, env=environment(), cwd=tmp_path, timeout=60
    )
    assert result.returncode == 0 and result.stdout == "", result.stderr
    done = summary(tmp_path / "run")
    assert {
        "history.csv",
        "scene.toml",
        "run.log",
        "fields.xdmf",
        "pressure.png",
        "histories.png",
    } <= set(done["files"])
    assert all((tmp_path / "run" / name).is_file() for name in done["files"])


def test_no_rank_reads_the_fields_of_a_large_mesh_for_its_figures(tmp_path, monkeypatch):
    monkeypatch.setattr(
        importlib.import_module("porofsi_petsc.simulation.run"), "FIGURE_ELEMENTS", 10
    )
    run(load_scene("pulse2d", (*BLOCK, "time.end=2e-3")), tmp_path / "run", quiet=True)
    figures = {path.name for path in (tmp_path / "run").glob("*.png")}
    assert (
        (tmp_path / "run" / "fields.xdmf").is_file()
        and "histories.png" in figures
        and "pressure.png" not in figures
    )
