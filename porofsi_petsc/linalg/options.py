"""Start of PETSc and its option database: command line > scene > PETSC_OPTIONS and rc files >
defaults of the package.
"""

import difflib
import itertools
import os
import re
import shlex
import signal
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from ..errors import InputError
from ..signals import ENDING, restored
from .scene_options import check_scene_options, is_name

if TYPE_CHECKING:  # MPI starts with its import, which PETSc is to do with the options
    from mpi4py import MPI

OLDEST = (3, 18)
# Read by PETSc only when it starts or ends, so they count as used.
START_AND_END = frozenset(
    "options_left options_view options_monitor objects_dump log_view log_trace malloc malloc_debug"
    " malloc_dump malloc_test malloc_view memory_view help version info on_error_abort skip_petscrc"
    " skip_petscrc_env".split()
)
# What PETSc is told unless the user says otherwise.
INITIAL = {
    # True by default since 3.21: dot products with several vectors then depend on where these lie
    # in memory, and no two runs are alike to the last digit.
    "vec_mdot_use_gemv": "false",
    # 3.25 ends with a list of what no solver has read, mostly our defaults; `check_options` judges
    # the user's.
    "options_left": "false",
}
# Suffixes worth suggesting for a misspelt option; only used to word an error.
COMMON = (
    "ksp_type ksp_rtol ksp_atol ksp_max_it ksp_monitor ksp_view ksp_converged_reason"
    " ksp_gmres_restart pc_type pc_factor_mat_solver_type pc_factor_levels pc_fieldsplit_type"
    " pc_fieldsplit_schur_fact_type pc_fieldsplit_schur_precondition pc_gamg_threshold"
    " pc_hypre_type sub_pc_type sub_ksp_type sub_pc_python_type"
).split()

RENAMED = {"mixture_": "monolithic_"}  # old prefix -> the one that it has now

_user: set[str] = set()
_defaults: dict[str, str] = {}  # full name -> prefix


def start(scene_options: str = "", command_line: Sequence[str] = (), trusted: bool = False) -> None:
    """Start PETSc once with the user's options; a later call replaces the options of the earlier
    one.

    scene_options : the scene's option string, split like a shell's; unless it is trusted, options
    of solvers alone (`check_scene_options`); command_line : the options of the command line, which
    win and may contain `-options_file FILE`. Raise InputError for words that are no options, a
    missing options file, a prefix of before, a PETSc that is absent, older than 3.18 or built with
    complex numbers.
    """
    of_scene = _split(scene_options)
    words = [*of_scene, *command_line]
    _check_words(words)
    _refuse_renamed(word.lstrip("-") for word in words if is_name(word))
    if not trusted:
        check_scene_options(of_scene)
    _check_files(words)
    _check_files(os.environ.get("PETSC_OPTIONS", "").split())
    if "petsc4py.PETSc" in sys.modules:
        _check_build()
        _forget()
        _insert(words)
    else:
        _initialise(words)
        _check_build()
    _user.update(_names(words))
    _refuse_renamed(_petsc().Options().getAll())
    _set_initial()


def set_defaults(prefix: str, defaults: Mapping[str, object]) -> None:
    """Insert `-<prefix><name> value` for every default that the user has not set; None is an option
    without a value.

    The defaults of an earlier call with the same prefix are removed first.
    """
    database = _petsc().Options()
    for full in [full for full, owner in _defaults.items() if owner == prefix]:
        database.delValue(full)
        del _defaults[full]
    given = database.getAll()  # hasName would count as a use
    for name, value in defaults.items():
        full = prefix + name
        if full not in given:
            _defaults[full] = prefix
            database.setValue(full, None if value is None else str(value))


def is_default(full: str) -> bool:
    """Return whether the value of an option, by its full name, is a default of the package."""
    return full in _defaults


def are_factored(*prefixes: str) -> bool:
    """Return whether no option of the user makes one of these solvers, direct by default, an
    iterative one.
    """
    given = _petsc().Options().getAll()
    kinds = [
        (given.get(prefix + "ksp_type", "preonly"), given.get(prefix + "pc_type", "lu"))
        for prefix in prefixes
    ]
    return all(ksp == "preonly" and pc in ("lu", "cholesky") for ksp, pc in kinds)


def unused_options(comm: "MPI.Comm", exempt_prefixes: Iterable[str] = ()) -> list[str]:
    """Return the options of the scene and the command line that PETSc has not asked for on any rank
    of comm (collective).

    exempt_prefixes : of solvers that a scene may lack; one that has been made answers for its
    options.
    """
    from .compat import option_used

    exempt = tuple(prefix for prefix in exempt_prefixes if prefix not in _defaults.values())
    names = sorted(
        name for name in _user if name not in START_AND_END and not name.startswith(exempt)
    )
    used = comm.allgather([option_used(name) for name in names])
    return [name for name, *flags in zip(names, *used, strict=True) if not any(flags)]


def check_options(comm: "MPI.Comm", exempt_prefixes: Iterable[str] = ()) -> None:
    """Raise InputError naming the first option that nobody used, with the nearest known name
    (collective).
    """
    unused = unused_options(comm, exempt_prefixes)
    if unused:
        more = (
            f" (and {len(unused) - 1} more: {', '.join('-' + name for name in unused[1:])})"
            if len(unused) > 1
            else ""
        )
        raise InputError(
            f"PETSc options: nothing used -{unused[0]}{more}; {_suggestion(unused[0])}"
        )


def has_package(name: str) -> bool:
    """Return whether PETSc was built with an external package such as mumps, hypre, ptscotch,
    superlu_dist or ml.
    """
    return bool(_petsc().Sys.hasExternalPackage(name))


def reason_of(error: Exception) -> str:
    """Return the last entry of PETSc's trace, the one that says what is wrong, as one line."""
    return " ".join(re.split(r"^\[\d+\] ", str(error), flags=re.MULTILINE)[-1].split())


def _petsc():
    from petsc4py import PETSc

    return PETSc


def _split(text):
    try:
        return shlex.split(text, comments=True)
    except ValueError as error:
        raise InputError(f"[petsc] options: {error} in {text!r}; close the quotation") from error


def _check_words(words):
    for previous, word in zip(["", *words], words, strict=False):
        if not is_name(word) and not is_name(previous):
            raise InputError(
                f"PETSc options: {word!r} is neither an option nor the value of one; write -NAME"
                " VALUE"
            )


def _refuse_renamed(names):
    """Raise InputError at an option with a prefix of before: nobody would use it."""
    for name in names:
        for old, new in RENAMED.items():
            if name.startswith(old):
                raise InputError(
                    f"PETSc options: received -{name}, whose prefix is {new} now; write"
                    f" -{new}{name.removeprefix(old)}"
                )


def _check_files(words):
    for name, word in itertools.zip_longest(words, words[1:]):
        if name.lstrip("-") == "options_file":
            if word is None or not os.path.isfile(word):
                received = "nothing" if word is None else f"no file {word!r}"
                raise InputError(
                    f"PETSc options: {received} (after -options_file); give the path of an existing"
                    " file"
                )
            with open(word, "rb") as file:
                if b"\0" in file.read(
                    4096
                ):  # PETSc would read it as one of its own and find nothing
                    raise InputError(
                        f"PETSc options: {word} is no text (after -options_file); give a file of"
                        " lines -NAME VALUE"
                    )
            if " " in word:
                raise InputError(
                    f"PETSc options: PETSc reads no path with a blank, {word!r} (after"
                    " -options_file); rename it"
                )


def _initialise(words):
    try:
        import petsc4py
    except ImportError as error:
        raise InputError(
            "this Python has no petsc4py; install PETSc with petsc4py, version 3.18 or newer"
        ) from error
    try:
        with restored(
            (signal.SIGPIPE, *ENDING)
        ):  # PETSc makes an end without results of a reader that has gone
            petsc4py.init([sys.argv[0] or "porofsi", *words])
    except ImportError as error:  # of a library that it is linked to
        text = (
            "load the modules it was built with, or name the folder of the library in"
            " LD_LIBRARY_PATH"
        )
        raise InputError(f"petsc4py cannot load PETSc ({error}); {text}") from error
    except RuntimeError as error:
        text = (
            "an options file has lines of -NAME VALUE and comments after #, and an -options_file in"
            " it an existing file"
        )
        raise InputError(
            f"PETSc options: PETSc does not start with them ({error}); {text}"
        ) from error


def _check_build():
    import numpy as np

    PETSc = _petsc()
    if np.issubdtype(PETSc.ScalarType, np.complexfloating):
        raise InputError(
            "this PETSc is built with complex numbers; use a build with real scalars (PETSC_ARCH)"
        )
    version = PETSc.Sys.getVersion()
    if version < OLDEST:
        raise InputError(
            f"this PETSc is version {'.'.join(map(str, version))}; use {OLDEST[0]}.{OLDEST[1]} or"
            " newer"
        )


def _forget():
    """Remove the options of the last start and all defaults; restore what the environment and rc
    files say.
    """
    from .compat import insert_environment_options

    database = _petsc().Options()
    for name in _user | set(_defaults):
        database.delValue(name)
    _user.clear()
    _defaults.clear()
    insert_environment_options()


def _set_initial():
    """Insert `INITIAL` where neither the user nor the environment has a value."""
    database = _petsc().Options()
    given = database.getAll()
    for name in INITIAL.keys() - given.keys():
        database.setValue(name, INITIAL[name])


def _insert(words):
    """Insert into the running database; a value with blanks cannot be told from two words here, so
    it is set by name.
    """
    database = _petsc().Options()
    plain = [word for word in words if " " not in word]
    database.insertString(" ".join(plain))
    for name, value in zip(words, words[1:], strict=False):
        if " " in value:
            database.setValue(name.lstrip("-"), value)


def _names(words):
    """Return the full names that the words, options files and prefixes in them set, by letting
    PETSc read them apart.
    """
    apart = _petsc().Options().create()
    apart.insertString(" ".join(word for word in words if " " not in word))
    names = set(apart.getAll())
    apart.destroy()
    return names


def _why_unused(name, prefix):
    """Say why an option that exists is not read: the solver is of a kind that has no use for it."""
    given = _petsc().Options().getAll()
    chosen = [
        f"-{prefix}{kind} {given[prefix + kind]}"
        for kind in ("ksp_type", "pc_type")
        if prefix + kind in given
    ]
    kind = f"the solver made with {' '.join(chosen)}" if chosen else "the solver"
    return f"it exists, but {kind} does not read it: remove it, or choose a solver that does"


def _suggestion(name):
    prefixes = sorted(set(_defaults.values()))
    for prefix in prefixes:
        if name.startswith(prefix):
            if name.removeprefix(prefix) in COMMON:
                return _why_unused(name, prefix)
            known = [full for full in _defaults if full.startswith(prefix)] + [
                prefix + suffix for suffix in COMMON
            ]
            near = difflib.get_close_matches(name, known, n=1, cutoff=0.7)
            return (
                f"did you mean -{near[0]}?"
                if near
                else f"no solver with the prefix {prefix} knows it: remove it or see -help"
            )
    first, _, rest = name.partition("_")
    near = difflib.get_close_matches(first + "_", prefixes, n=1, cutoff=0.5)
    if near:
        return f"did you mean -{near[0]}{rest}?"
    return f"the prefixes here are {', '.join(prefixes) or '(none)'}: correct or remove it"
