"""Steps of a size that keeps the local error in time at a tolerance, on request
(`time.error_tolerance`).
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from mpi4py import MPI

from ..config.sections import Time

GROW, SHRINK, SAFETY = 2.0, 0.2, 0.8  # of one step to the next
# A new size costs new tangents and factors: what would gain less than this keeps the old one.
WORTH = 1.3
SMALLEST = 1e-4  # default of min_step, in first steps


class StepTooLarge(Exception):
    """The local error of a step is above the tolerance; `size` is what to try next [s]."""

    def __init__(self, size: float) -> None:
        super().__init__(f"try {size:g} s")
        self.size = size


class StepControl:
    """Local error of displacement and pressure by Milne's device, and the step size that follows
    from it.

    The divided difference D of the present and the last k + 1 values is y^(k+1)/(k+1)!; a scheme of
    order k makes the error C Δt^(k+1) D in a step, C = 1 for backward Euler (k = 1), 1/2 for the
    trapezoidal rule (k = 2), in place of generalized-α. It is measured in the Euclidean norm of the
    nodal values over the largest norm in the run.  The first k + 1 steps are taken as they are.
    """

    def __init__(self, section: Time, comm: MPI.Comm) -> None:
        """Take the [time] section of a scene."""
        self._comm = comm
        self._tolerance = section.error_tolerance
        self._largest_step = section.max_step or np.inf
        self._smallest_step = section.min_step or SMALLEST * section.step
        self._order, self._constant = (1, 1.0) if section.scheme == "backward_euler" else (2, 0.5)
        self._values: dict[str, list[tuple[float, np.ndarray]]] = {"u": [], "p": []}
        self._largest = {"u": 0.0, "p": 0.0}
        self.rejections = 0

    def next_size(
        self, dt: float, trial: Mapping[str, tuple[float, np.ndarray]], resolution: float = 0.0
    ) -> float:
        """Return the size of the next step after a trial step of size dt (collective); raise
        StepTooLarge to repeat it.

        trial : name -> (time [s], values (n_owned, ...)); it is remembered when it is accepted.
        resolution : size [s] below which no step is tried, whatever the error
        """
        largest = {
            name: max(self._norm(value), self._largest[name]) for name, (_, value) in trial.items()
        }
        error = max(self._error(name, dt, *trial[name], largest[name]) for name in trial)
        factor = np.clip(
            SAFETY * (self._tolerance / max(error, 1e-300)) ** (1 / (self._order + 1)), SHRINK, GROW
        )
        size = max(dt * factor, self._smallest_step, resolution)
        if error > self._tolerance and size < dt:
            self.rejections += 1
            raise StepTooLarge(size)
        self._largest = largest
        for name, (time, value) in trial.items():
            self._values[name] = [*self._values[name], (time, np.array(value))][
                -(self._order + 1) :
            ]
        return dt if factor < WORTH or error == 0 else min(size, self._largest_step)

    def _error(self, name, dt, time, value, largest):
        """Return the local error of one field over its largest norm; 0 before there are enough
        values.
        """
        points = [*self._values[name], (time, value)]
        if len(points) < self._order + 2 or largest == 0:
            return 0.0
        return (
            self._constant
            * dt ** (self._order + 1)
            * self._norm(_divided_difference(points))
            / largest
        )

    def _norm(self, value):
        return float(np.sqrt(self._comm.allreduce(np.vdot(value, value))))

    def state(self) -> dict[str, np.ndarray]:
        """Return the arrays a restart needs, name -> (n_owned, ...)."""
        return {
            f"step_control.{name}.{i}": v
            for name, kept in self._values.items()
            for i, (_, v) in enumerate(kept)
        }

    def memory(self) -> dict[str, Any]:
        """Return the numbers a restart needs beside the arrays."""
        times = {name: [time for time, _ in kept] for name, kept in self._values.items()}
        return {"times": times, "largest": self._largest, "rejections": self.rejections}

    def load(self, arrays: dict[str, np.ndarray], memory: dict[str, Any]) -> None:
        """Continue from `state` and `memory`."""
        self._largest = memory["largest"]
        self.rejections = memory["rejections"]
        for name, times in memory["times"].items():
            self._values[name] = [
                (time, arrays[f"step_control.{name}.{i}"]) for i, time in enumerate(times)
            ]


def _divided_difference(points):
    """Return the divided difference of all (time, value)."""
    times = [time for time, _ in points]
    values = [value for _, value in points]
    for k in range(1, len(points)):
        values = [
            (b - a) / (times[i + k] - times[i])
            for i, (a, b) in enumerate(zip(values[:-1], values[1:], strict=True))
        ]
    return values[0]
