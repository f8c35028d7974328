"""Options of PETSc: precedence, misspellings, and the sentences that say what is wrong."""

import os
import subprocess
import sys

import numpy as np
import pytest
from mpi4py import MPI

from porofsi_petsc.errors import InputError
from porofsi_petsc.linalg import options

options.start()

from petsc4py import PETSc  # noqa: E402

COMM = MPI.COMM_WORLD


@pytest.fixture(autouse=True)
def clean_options():
    yield
    options.start()


def value(name):
    return PETSc.Options().getAll().get(name)


def in_new_process(code, environment="", cwd=None):
    """Return what a fresh Python prints; PETSc reads its environment and argument list only when it
    starts.
    """
    path = os.path.dirname(os.path.dirname(os.path.abspath(options.__file__)))
    env = os.environ | {
        "PETSC_OPTIONS": environment,
        "PYTHONPATH": os.path.dirname(path),
        "OMP_NUM_THREADS": "1",
    }
    done = subprocess.run(
        [sys.executable, "-c", code], env=env, cwd=cwd, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


@pytest.mark.parametrize("given", ["scene", "command line", "file"])
def test_a_prefix_of_before_is_refused_with_the_one_of_now(given, tmp_path):
    """The block of the monolithic schemes was called mixture_."""
    text = "-mixture_pc_type lu"
    (tmp_path / "old.opt").write_text(text)
    words = {"command line": text.split(), "file": ["-options_file", str(tmp_path / "old.opt")]}
    with pytest.raises(InputError, match="received -mixture_pc_type, .* -monolithic_pc_type"):
        options.start(text if given == "scene" else "", words.get(given, []))


def test_a_prefix_of_before_in_the_environment_is_refused_too():
    code = """
from porofsi_petsc.errors import InputError
from porofsi_petsc.linalg import options
try:
    options.start()
except InputError as error:
    print(error)
"""
    (line,) = in_new_process(code, "-mixture_pc_type lu")
    assert line.endswith("write -monolithic_pc_type")


def test_command_line_beats_scene_beats_default():
    options.start("-solid_ksp_rtol 1e-3 -solid_pc_type jacobi", ["-solid_ksp_rtol", "1e-5"])
    options.set_defaults("solid_", {"ksp_rtol": 1e-8, "pc_type": "gamg", "ksp_type": "cg"})
    assert [value("solid_" + name) for name in ("ksp_rtol", "pc_type", "ksp_type")] == [
        "1e-5",
        "jacobi",
        "cg",
    ]


PRECEDENCE = """
from porofsi_petsc.linalg import options
def show():
    database = PETSc.Options().getAll()
    names = "ksp_rtol", "ksp_atol", "ksp_max_it", "ksp_type", "ksp_divtol"
    print(*(database.get("solid_" + name, "-") for name in names))
    print(*options.unused_options(PETSc.COMM_WORLD.tompi4py()))
options.start("-solid_ksp_rtol 2 -solid_ksp_atol 2", ["-solid_ksp_atol", "3"])
from petsc4py import PETSc
options.set_defaults("solid_", {"ksp_max_it": 4, "ksp_type": "cg"})
show()
options.start("-solid_ksp_type gmres")
show()
"""


def test_environment_and_rc_file_are_respected_and_restored_by_a_second_start(tmp_path):
    (tmp_path / ".petscrc").write_text("-solid_ksp_divtol 1\n")
    lines = in_new_process(PRECEDENCE, "-solid_ksp_rtol 1 -solid_ksp_max_it 1", tmp_path)
    expected = ["2 3 1 cg 1", "solid_ksp_atol solid_ksp_rtol", "1 - 1 gmres 1", "solid_ksp_type"]
    assert lines == expected


def test_a_library_that_is_not_found_is_wrong_input(monkeypatch):
    def init(words):
        raise ImportError("libmpi.so.12: cannot open shared object file: No such file or directory")

    monkeypatch.setattr("petsc4py.init", init)
    monkeypatch.delitem(sys.modules, "petsc4py.PETSc")
    with pytest.raises(
        InputError,
        match=r"petsc4py cannot load PETSc \(libmpi.so.12: .*\); load .*LD_LIBRARY_PATH",
    ):
        options.start()


@pytest.mark.parametrize("words, said", [([], False), (["-options_left"], True)])
def test_what_no_solver_has_read_is_listed_at_the_end_only_on_demand(words, said):
    """Whatever the build of PETSc does by itself."""
    code = f"""
from porofsi_petsc.linalg import options
options.start("", {words})
options.set_defaults("solid_", {{"pc_gamg_reuse_interpolation": "false"}})
"""
    lines = in_new_process(code)
    assert any("solid_pc_gamg_reuse_interpolation" in line for line in lines) == said
    assert said or not lines


def test_initial_options_give_way_to_the_users_and_come_back():
    options.start("", ["-vec_mdot_use_gemv", "true"])
    assert value("vec_mdot_use_gemv") == "true"
    options.start()
    assert value("vec_mdot_use_gemv") == "false"


def test_a_dot_product_with_several_vectors_does_not_depend_on_where_they_lie():
    """PETSc's default since 3.21 gives them to BLAS at once where they lie one after the other,
    with other last digits.
    """
    rows = np.random.default_rng(0).normal(size=(5, 2000))

    def dots(arrays):
        x, *others = (PETSc.Vec().createWithArray(array, comm=PETSc.COMM_SELF) for array in arrays)
        try:
            return x.mDot(others)
        except NotImplementedError:
            pytest.skip("petsc4py without mDot")

    assert np.array_equal(dots(rows), dots([row.copy() for row in rows]))


def test_options_file_and_prefixes_count_as_the_users(tmp_path):
    file = tmp_path / "direct.txt"
    file.write_text("-solid_pc_type lu  # comment\n")
    options.start(
        "", f"-options_file {file} -prefix_push fluid_ -ksp_rtol 1e-4 -prefix_pop".split()
    )
    assert (value("solid_pc_type"), value("fluid_ksp_rtol")) == ("lu", "1e-4")
    assert options.unused_options(COMM) == ["fluid_ksp_rtol", "solid_pc_type"]
    assert PETSc.Options().getString("solid_pc_type") == "lu"
    assert options.unused_options(COMM) == ["fluid_ksp_rtol"]


def test_second_start_forgets_options_and_defaults_of_the_first():
    options.start("-solid_ksp_rtol 1e-3")
    options.set_defaults("solid_", {"pc_type": "gamg"})
    options.start("-fluid_ksp_rtol 1e-4")
    assert (value("solid_ksp_rtol"), value("solid_pc_type"), value("fluid_ksp_rtol")) == (
        None,
        None,
        "1e-4",
    )


def test_defaults_of_a_prefix_replace_the_earlier_ones():
    options.set_defaults("solid_", {"pc_type": "gamg", "pc_gamg_threshold": 0.01})
    options.set_defaults("solid_", {"pc_type": "lu"})
    assert (value("solid_pc_type"), value("solid_pc_gamg_threshold")) == ("lu", None)


@pytest.mark.parametrize(
    "text, hint",
    [
        ("-solid_ksp_rtoll 1e-3", "did you mean -solid_ksp_rtol?"),
        ("-soild_ksp_rtol 1e-3", "did you mean -solid_ksp_rtol?"),
        (
            "-solid_ksp_max_it 3",
            "it exists, but the solver made with -solid_ksp_type cg does not read it: remove it",
        ),
        ("-zebra 1", "the prefixes here are fluid_, solid_"),
    ],
)
def test_unused_option_is_an_error_with_a_suggestion(text, hint):
    options.start("", text.split())
    options.set_defaults("solid_", {"ksp_type": "cg"})
    options.set_defaults("fluid_", {"ksp_type": "fgmres"})
    with pytest.raises(InputError) as caught:
        options.check_options(COMM)
    assert text.split()[0] in str(caught.value) and hint in str(caught.value)


def test_an_option_that_only_replaces_a_default_is_not_yet_used():
    options.start("-solid_ksp_rtol 1e-3")
    options.set_defaults("solid_", {"ksp_rtol": 1e-8})
    assert options.unused_options(COMM) == ["solid_ksp_rtol"]


def test_prefixes_of_absent_phases_are_exempt():
    options.start("-fluid_ksp_rtol 1e-3 -log_view")
    options.check_options(COMM, exempt_prefixes=("fluid_",))


def test_a_solver_that_is_there_answers_for_its_options_whatever_is_exempt():
    options.start("-mesh_ksp_rtoll 1e-3")
    options.set_defaults("mesh_", {"ksp_type": "cg"})
    with pytest.raises(InputError, match="did you mean -mesh_ksp_rtol?"):
        options.check_options(COMM, exempt_prefixes=("mesh_",))


@pytest.mark.parametrize(
    "text, sentence",
    [
        ("ksp_rtol 1e-3", "'ksp_rtol' is neither an option nor the value of one"),
        ("-ksp_rtol 1e-3 2", "'2' is neither an option"),
        ("-options_file /nowhere/o.txt", "no file '/nowhere/o.txt'"),
        ("--options_file /nowhere/o.txt", "no file '/nowhere/o.txt'"),
        ("-ksp_view -options_file", "nothing .after -options_file"),
        ("-ksp_rtol '1e-3", "close the quotation"),
    ],
)
def test_words_that_are_no_options_are_refused(text, sentence):
    with pytest.raises(InputError, match=sentence):
        options.start(text, trusted=True)


def test_an_options_file_of_the_environment_is_looked_for(monkeypatch):
    monkeypatch.setenv("PETSC_OPTIONS", "-ksp_view -options_file /nowhere/o.txt")
    with pytest.raises(InputError, match="no file '/nowhere/o.txt'"):
        options.start()


def test_an_options_file_with_a_blank_in_its_path_is_refused(tmp_path):
    file = tmp_path / "a b.opt"
    file.write_text("-ksp_rtol 1e-3")
    with pytest.raises(InputError, match="path with a blank"):
        options.start("", ["-options_file", str(file)])


def test_an_options_file_of_bytes_is_refused(tmp_path):
    """PETSc takes it for one of its own and finds nothing in it."""
    file = tmp_path / "solver.opt"
    file.write_bytes(b"-ksp_rtol 1e-3\0\1\2")
    with pytest.raises(InputError, match="solver.opt is no text"):
        options.start("", ["-options_file", str(file)])


def test_a_file_that_holds_no_options_is_refused_by_name(tmp_path):
    """PETSc reads it as it starts: in a process of its own."""
    file = tmp_path / "no.opt"
    file.write_text("this is no option file")
    code = (
        f"from porofsi_petsc.linalg import options; options.start('', ['-options_file', '{file}'])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert "InputError: PETSc options: PETSc does not start with them" in done.stderr


def test_negative_numbers_are_values():
    options.start("", ["-shift", "-1e-3"])
    assert value("shift") == "-1e-3"


def test_unknown_package_is_absent():
    assert options.has_package("nosuch") is False
