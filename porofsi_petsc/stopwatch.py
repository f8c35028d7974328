"""Wall time by stage."""

import time
from collections import defaultdict
from contextlib import contextmanager
from functools import wraps


class Stopwatch:
    """Sum of the wall time of named stages [s]."""

    def __init__(self):
        """Start at zero."""
        self.seconds = defaultdict(float)
        self._began = time.perf_counter()

    @contextmanager
    def measure(self, stage):
        """Add the time spent inside to the stage."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[stage] += time.perf_counter() - start

    @property
    def total(self):
        """Return the time since the stopwatch was made [s]."""
        return time.perf_counter() - self._began


def timed(stage):
    """Return a decorator that counts the time of a method into a stage of the `stopwatch` of its object."""

    def decorate(method):
        @wraps(method)
        def measured(self, *arguments):
            with self.stopwatch.measure(stage):
                return method(self, *arguments)

        return measured

    return decorate
