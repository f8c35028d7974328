"""What [petsc] options of a scene may say: options of solvers; no code, no files, which only the
command line names.
"""

from pathlib import Path

import pytest
from click.testing import CliRunner

from porofsi_petsc import load_scene
from porofsi_petsc.commands import cli
from porofsi_petsc.config import list_scenes
from porofsi_petsc.errors import InputError
from porofsi_petsc.linalg import options
from porofsi_petsc.linalg.scene_options import check_scene_options


@pytest.fixture(autouse=True)
def clean_options():
    yield
    options.start()


REFUSED = (
    "-dll_append /tmp/evil.so",
    "-dll_prepend /tmp/evil.so",
    "--DLL_APPEND /tmp/evil.so",
    "-fluid_pc_type python -fluid_pc_python_type /tmp/evil.py:PC",
    "-fluid_pc_python_type evil.PC",
    "-fluid_pc_python_type porofsi_petsc.linalg/../../evil.py:PC",
    "-fluid_PC_Python_Type evil.PC",
    "-fluid_ksp_python_type porofsi_petsc.linalg.pyamg_pc.PyAMG",
    "-solid_sub_pc_python_type evil.PC",
    "-fluid_mat_python_type evil.Mat",
    "-log_view :/tmp/file",
    "-log_view ascii:/tmp/file",
    "-log_trace /tmp/file",
    "-log_all /tmp/file",
    "-history /tmp/file",
    "-history",
    "-info /tmp/file",
    "-fluid_ksp_view ascii:/tmp/file",
    "-fluid_ksp_view :file",
    "-fluid_ksp_view_mat binary",
    "-fluid_ksp_view_rhs hdf5:file",
    "-fluid_ksp_monitor :file",
    "-fluid_ksp_monitor file",
    "-fluid_ksp_monitor draw",
    "-fluid_ksp_converged_reason :file",
    "-fluid_mat_view socket",
    "-fluid_mat_view saws",
    "-solid_mat_mumps_ooc_tmpdir somewhere",
    "-options_file other.opt",
    "-options_file_yaml other.yaml",
    "-options_monitor",
    "-prefix_push fluid_ -pc_type lu -prefix_pop",
    "-ksp_view",
    "-saws_port 80",
    "-start_in_debugger",
    "-on_error_attach_debugger",
    "-help",
    "-malloc_dump",
    "-fluid_pc_type ../lu",
    "-fluid_pc_type 'lu dll_append'",
    "-fluid_a.b 1",
)
ALLOWED = (
    "",
    "-fluid_ksp_type gmres -fluid_ksp_rtol 1e-6 -fluid_ksp_atol -1.5E+3 -fluid_ksp_max_it 10",
    "-solid_pc_type gamg -solid_pc_gamg_threshold 0.01,-1 -solid_pc_gamg_reuse_interpolation false",
    (
        "-mesh_ksp_converged_reason -mesh_ksp_monitor -mesh_ksp_view ::ascii_info_detail"
        " -monolithic_ksp_view ascii"
    ),
    "-monolithic_pc_type python -solid_sub_pc_python_type porofsi_petsc.linalg.pyamg_pc.PyAMG",
    "-log_view -options_left",
    "-fluid_pc_fieldsplit_schur_fact_type upper # a comment",
)


@pytest.mark.parametrize("text", REFUSED)
def test_code_and_files_are_refused_before_petsc_sees_them(text):
    options.start()  # forgets the defaults of solvers that were made in this process before
    from petsc4py import PETSc

    before = PETSc.Options().getAll()
    with pytest.raises(
        InputError, match=r"\[petsc\] options: received .*after --.*--allow-scene-options"
    ):
        options.start(text)
    assert PETSc.Options().getAll() == before


@pytest.mark.parametrize("text", ALLOWED)
def test_options_of_solvers_are_accepted(text):
    options.start(text)


def test_the_recipes_and_the_shipped_scenes_are_accepted():
    for file in (Path(__file__).resolve().parent.parent / "configs" / "petsc").glob("*.opt"):
        lines = [line.partition("#")[0] for line in file.read_text().splitlines()]
        check_scene_options(" ".join(lines).split())
    for name, _, _ in list_scenes():
        options.start(load_scene(name).petsc.options)


def test_the_command_line_may_say_all_and_may_trust_a_scene(tmp_path):
    (tmp_path / "own.opt").write_text("-solid_ksp_rtol 1e-3\n")
    words = ["-options_file", str(tmp_path / "own.opt")]
    options.start("", words)
    options.start(" ".join(words), trusted=True)
    from petsc4py import PETSc

    assert PETSc.Options().getAll()["solid_ksp_rtol"] == "1e-3"


@pytest.mark.parametrize("command", ["check", "run"])
def test_check_and_run_refuse_and_can_be_told_to_trust(tmp_path, command, monkeypatch):
    target = tmp_path / "own.opt"
    target.write_text("# nothing\n")
    words = [
        command,
        "terzaghi",
        "--set",
        f"petsc.options=-options_file {target}",
        "--set",
        "time.end=no",
    ]
    refused = CliRunner().invoke(cli, words[:-2])
    assert refused.exit_code == 2 and "received -options_file" in refused.stderr
    received = []
    monkeypatch.setattr(options, "start", lambda *arguments: received.append(arguments) or _stop())
    assert CliRunner().invoke(cli, [*words[:-2], "--allow-scene-options"]).exit_code == 2
    assert received == [(f"-options_file {target}", [], True)]


def _stop():
    raise InputError("far enough")
