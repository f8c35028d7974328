"""Element routines compiled by Numba: one source for all elements, whose sizes the compiler knows,
kept on disk.
"""

import fcntl
import hashlib
import os
import pickle
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, wraps
from pathlib import Path
from typing import Any, TypeVar

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils, config
from numba.core.registry import CPUDispatcher
from numba.extending import intrinsic
from numba.np.arrayobj import make_array, populate_array

# LLVM may do to floating point what keeps the meaning of NaN and infinity, by which inadmissible
# states are found.  A division by zero gives infinity.  References to arrays are not counted: the
# counters cost up to seven times the arithmetic (measured), and a loop allocates nothing but
# `stack`. Loops over a few unknowns become straight code, which only LLVM's vectorizer of straight
# code puts into vector registers; Numba leaves it out by default (with it: a tangent of P2 in 0.77
# of the time, the other routines in 0.8 to 1).
config.SLP_VECTORIZE = 1
OPTIONS = {
    "fastmath": {"contract", "reassoc", "arcp", "nsz"},
    "error_model": "numpy",
    "_nrt": False,
}

F = TypeVar("F", bound=Callable)  # a compiled function has the signature of its source


def _source_hash() -> str:
    """Return a hash of the files with compiled routines of a point: Numba itself looks at the file
    of the outermost loop only.
    """
    package = Path(__file__).resolve().parent
    files = [
        package / "compiled.py",
        package / "tensors.py",
        *package.glob("kernels/*.py"),
        *package.glob("materials/*.py"),
    ]
    sources = [file.read_bytes() for file in sorted(files)]
    return hashlib.sha256(
        b"".join(source for source in sources if b"numba" in source or b"compiled import" in source)
    ).hexdigest()[:16]


def _cache_folder() -> Path:
    """Return where machine code is kept: below $NUMBA_CACHE_DIR, else below the user's cache
    folder.
    """
    cache_home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return Path(config.CACHE_DIR or cache_home / "porofsi_petsc") / _source_hash()


CACHE_FOLDER = _cache_folder()


class _Part(CPUDispatcher):
    """A compiled routine without an entry for Python."""

    def __call__(self, *arguments: Any) -> Any:
        name = self.py_func.__name__
        raise TypeError(f"{name} is a part of compiled loops and cannot be called from Python")


def inlined(function: F) -> F:
    """Compile a routine of a point or an element that becomes a part of every `specialized` one
    that calls it; Python cannot call it.

    Entries for Python into all such parts would double the time of compilation (measured).
    """
    part = numba.njit(
        function, **OPTIONS, forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True
    )
    part.__class__ = _Part
    return part


def expanded(function: F) -> F:
    """Compile a routine that is written out where it is called; unlike an `inlined` one it may
    return memory of `stack`.
    """
    return numba.njit(function, **OPTIONS, inline="always")


@intrinsic(prefer_literal=True)
def stack(typing: Any, shape: Any) -> tuple[Any, Callable]:
    """Return an array of a shape that the compiler knows, on the stack of the loop that calls it:
    it overlaps with no other one.

    The compiler may therefore keep its entries in registers.  They are not set.
    """
    sizes = [size.literal_value for size in shape]
    array_type = types.Array(types.float64, len(sizes), "C")

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array = make_array(array_type)(context, builder)
        memory = cgutils.alloca_once(builder, ir.ArrayType(ir.DoubleType(), int(np.prod(sizes))))
        strides = [8 * int(np.prod(sizes[k + 1 :])) for k in range(len(sizes))]
        populate_array(
            array,
            data=builder.bitcast(memory, ir.DoubleType().as_pointer()),
            shape=[context.get_constant(types.intp, size) for size in sizes],
            strides=[context.get_constant(types.intp, stride) for stride in strides],
            itemsize=context.get_constant(types.intp, 8),
            meminfo=None,
        )
        return array._getvalue()

    return array_type(shape), generate


def specialized(make: F) -> F:
    """Return a function (*sizes) -> compiled loop, from one (*sizes) -> loop over elements, made
    and kept for every set of sizes.

    Machine code is read from disk or compiled and written at the first call.  Every set has files
    of its own, which Numba replaces atomically; of the ranks on a machine one compiles while the
    others wait to read.  Damaged files are replaced.  Where nothing can be written, every process
    compiles for itself.
    """

    @cache
    @wraps(make)
    def of_sizes(*sizes: int) -> _Loop:
        loop = make(*sizes)
        loop.__qualname__ = "_".join([make.__name__, *map(str, sizes)])
        return _Loop(loop)

    return of_sizes  # type: ignore[return-value]  # `wraps` tells mypy nothing of the arguments


class _Loop:
    """A compiled loop whose first call is the only one of its kind on this machine at that time."""

    def __init__(self, loop: Callable) -> None:
        self.compiled = numba.njit(loop, **OPTIONS)
        self._ready = False

    def __call__(self, *arguments: Any) -> Any:
        if not self._ready:
            self._compile(tuple(map(self.compiled.typeof_pyval, arguments)))
        return self.compiled(*arguments)

    def _compile(self, signature: tuple) -> None:
        """Read or make the machine code for some types of arguments."""
        loop = self.compiled.py_func
        with _alone(CACHE_FOLDER / f"{loop.__qualname__}.lock"):
            for attempt in (_read_or_compile, _compile_anew) if _can_write() else ():
                with suppress(
                    OSError, EOFError, pickle.UnpicklingError
                ):  # a damaged file; a full disk, where nothing is kept
                    self.compiled = attempt(loop, signature)
                    break
        self._ready = True


def _read_or_compile(loop: Callable, signature: tuple) -> Callable:
    users = config.CACHE_DIR
    config.CACHE_DIR = str(CACHE_FOLDER)
    try:
        compiled = numba.njit(loop, **OPTIONS, cache=True)
        compiled.compile(signature)
    finally:
        config.CACHE_DIR = users
    return compiled


def _compile_anew(loop: Callable, signature: tuple) -> Callable:
    for file in CACHE_FOLDER.rglob(f"*.{loop.__qualname__}-*.nb?"):
        file.unlink(missing_ok=True)
    return _read_or_compile(loop, signature)


@cache
def _can_write() -> bool:
    """Return whether machine code can be kept; Numba would go on to a place where it may find that
    of another version.
    """
    try:
        CACHE_FOLDER.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(CACHE_FOLDER, os.W_OK)


def compilation_notice() -> str:
    """Return a sentence about the time that compilation will take, an empty one where there is
    machine code already.
    """
    text = "the element routines are compiled first, up to a minute"
    if not _can_write():
        return f"{text}; {CACHE_FOLDER} cannot be written to keep them, set NUMBA_CACHE_DIR"
    return "" if any(CACHE_FOLDER.rglob("*.nbi")) else f"{text}, and kept in {CACHE_FOLDER}"


@contextmanager
def _alone(lock: Path) -> Iterator[None]:
    """Hold a file's lock, which the system takes back from a process that dies; nothing where there
    can be no such file.
    """
    if not _can_write():
        yield
        return
    with open(lock, "a") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX)
        except OSError:  # a file system without locks: every process compiles, with the same result
            pass
        yield


def plain(array: np.ndarray) -> np.ndarray:
    """Return an array as the loops want it, so that each is compiled for one type: float64,
    contiguous, writeable.
    """
    flags = array.flags
    if array.dtype == np.float64 and flags.c_contiguous and flags.writeable:
        return array
    return np.require(array, np.float64, ["C", "W"])
