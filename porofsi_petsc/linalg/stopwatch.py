"""Wall time by stage, which is one of -log_view too."""

import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import wraps
from typing import TypeVar

from petsc4py import PETSc

F = TypeVar("F", bound=Callable)


def stage(name: str) -> AbstractContextManager:
    """Return a context whose work PETSc logs as a stage of this name; of a stage inside a stage the
    inner one counts.
    """
    return PETSc.Log.Stage(name)


class Stopwatch:
    """Sum of the wall time of named stages [s]."""

    def __init__(self) -> None:
        """Start at zero."""
        self.seconds: dict[str, float] = defaultdict(float)
        self._began = time.perf_counter()

    @contextmanager
    def measure(self, name: str) -> Iterator[None]:
        """Add the time spent inside to the stage of this name."""
        start = time.perf_counter()
        try:
            with stage(name):
                yield
        finally:
            self.seconds[name] += time.perf_counter() - start

    @property
    def total(self) -> float:
        """Return the time since the stopwatch was made [s]."""
        return time.perf_counter() - self._began


def timed(name: str) -> Callable[[F], F]:
    """Return a decorator that counts the time of a method into a stage of the `stopwatch` of its
    object.
    """

    def decorate(method):
        @wraps(method)
        def measured(self, *arguments):
            with self.stopwatch.measure(name):
                return method(self, *arguments)

        return measured

    return decorate
