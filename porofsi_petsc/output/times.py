"""Simulated times at which something is written, whatever the steps are."""

from collections.abc import Sequence

import numpy as np

from .results import SAME_TIME


class Times:
    """The multiples of an interval [s], None for none, and some times [s]."""

    def __init__(self, interval: float | None, times: Sequence[float]) -> None:
        """Take them."""
        self._interval = interval
        self._times = np.sort(times)

    def lie_between(self, before: float, now: float) -> bool:
        """Return whether one of the times is later than the end of a step [s] and not later than
        the end of the next one, but for the last digits.
        """
        return self._passed(now) > self._passed(before)

    def _passed(self, t):
        t = t * (1 + SAME_TIME)
        multiples = 0 if self._interval is None else t // self._interval
        return multiples + np.searchsorted(self._times, t, side="right")
