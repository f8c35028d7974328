"""Steady steps: where the iteration fails from the state before, along the load, from a part of it
to the whole.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..clock import Scheme
from ..errors import ConvergenceError
from ..log import logger
from ..phases.coupling_data import Rates
from .auto import AnyMedium

if TYPE_CHECKING:
    from .loop import Clock

FIRST, SMALLEST = 0.5, 1 / 64  # parts of the load: the first one tried, and below which none is
ADVICE = (
    "try a finer mesh, smaller steps of the data or more coupling.max_iterations, or time.scheme ="
    ' "generalized_alpha"'
)


@dataclass(frozen=True)
class Scaled:
    """An expression of (t, x) on the way of a `LoadFactor`; `source` is its text, by which equal
    ones are known.
    """

    factor: LoadFactor
    expression: Callable

    @property
    def source(self) -> object:
        """Return the text of the expression."""
        return getattr(self.expression, "source", self.expression)

    def __call__(self, t: float, X: np.ndarray) -> np.ndarray:
        """Return the values at points X (n, d), (n,)."""
        part = self.factor.value
        since = self.factor.since
        if part == 1 or since is None:
            return part * self.expression(t, X)
        return (1 - part) * self.expression(since, X) + part * self.expression(t, X)


class LoadFactor:
    """The part λ of the way to all boundary data and body forces of a scene: 1, but within a step
    that is continued.

    since : time [s] of the state that the way sets out from; None: from none of the data
    """

    def __init__(self) -> None:
        """Start with the whole load."""
        self.value = 1.0
        self.since = None

    def of(self, expression: Callable) -> Scaled:
        """Return the expression `Scaled` by this factor."""
        return Scaled(self, expression)


class Continuation:
    """Solve steady steps of a medium whose data have a `LoadFactor`.

    Newton's iteration converges from near by: from rest, or from the data of the step before, it
    may not reach the next state, from that under a part of the way, with the data as the parameter
    of the path, it does as long as there is one.  A part that fails is halved, one that succeeds is
    doubled.
    """

    def __init__(
        self,
        coupling: AnyMedium,
        clock: Clock,
        solve: Callable[[tuple[Scheme, Scheme], Rates], None],
    ) -> None:
        """Take the medium, the `Clock` that counts the parts, and what solves the next step at
        once: (schemes, rates).
        """
        self._coupling = coupling
        self._clock = clock
        self._solve = solve
        self._factor = coupling.load_factor

    def solve(self, schemes: tuple[Scheme, Scheme], rates: Rates) -> None:
        """Solve the next step; raise ConvergenceError, changing nothing, where no path leads to it
        (collective).
        """
        try:
            self._solve(schemes, rates)
            return
        except ConvergenceError as error:
            failure = error
        coupling = self._coupling
        accepted = coupling.state(), coupling.memory()
        text = "step %d does not converge from the state before: now along the load, part by part"
        logger.info(text, self._clock.step + 1)
        try:
            self._count(self._along(schemes, rates))
        except ConvergenceError:
            coupling.load_state(*accepted, schemes, rates)
            reached = f"nor does load continuation, beyond {self._reached:.3g} of the load"
            raise ConvergenceError(f"{failure.what}; {reached}", ADVICE) from None
        finally:
            self._factor.value = 1.0

    def _along(self, schemes, rates):
        """Follow the path to the whole load and return the number of its parts."""
        self._reached = 0.0
        part = FIRST
        parts = 0
        iterations = 0
        coupling = self._coupling
        clock = self._clock
        self._factor.since = clock.t if clock.step else None
        while self._reached < 1:
            self._factor.value = min(self._reached + part, 1.0)
            try:
                coupling.reset()
                self._solve(schemes, rates)
            except ConvergenceError:
                part /= 2
                if part < SMALLEST:
                    raise
                continue
            parts = parts + 1
            iterations = iterations + coupling.iterations
            self._reached = self._factor.value
            part = 2 * part
            logger.info("%.3g of the load, %d iterations", self._reached, coupling.iterations)
            if self._reached < 1:
                coupling.accept()
        coupling.iterations = iterations
        return parts

    def _count(self, parts):
        if not self._clock.load_parts:
            text = (
                "step %d does not converge from the state before: load continuation in %d parts"
                " (said once, see summary.json)"
            )
            logger.info(text, self._clock.step + 1, parts)
        self._clock.load_parts += parts
