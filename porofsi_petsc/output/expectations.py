"""Comparison of the history with the values a scene expects."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from ..config.sections import PERIODIC, Expect
from .period import Period

STATISTICS = {
    "max": np.max,
    "min": np.min,
    "abs_max": lambda values: np.max(np.abs(values)),
    "final": lambda values: values[-1],
}
# relative: a last time that misses the asked one by rounding is not a history that is too short
ROUNDING = 1e-9


def evaluate(
    expectations: Iterable[Expect],
    histories: Sequence[dict[str, np.ndarray]],
    complete: bool = True,
    period: Period | None = None,
) -> list[dict[str, Any]]:
    """Return one record per expectation, a dict.

    Its keys: quantity, at, since, statistic, value, reference, error, tolerance, passed, reason,
    source.

    expectations : objects with quantity (and minus, a column that is taken from it), at [s] (and
    since [s]) or statistic, value, tolerance, scale (None: |value|), source.
    histories : each a dict column -> (rows,), as read_history gives; the first that has the column
    counts.  The error is |computed - expected| / scale; a time that the history does not cover is
    skipped: passed None and a reason; so is a statistic
    of a run that did not complete.  period : the `output.period.Period` of the history, None where
    it has none, which skips too.
    """
    found = []
    for expectation in expectations:
        history = next(history for history in histories if expectation.quantity in history)
        found.append(_record(expectation, *_computed(expectation, history, complete, period)))
    return found


def _name(expectation):
    return (
        expectation.quantity
        if expectation.minus is None
        else f"{expectation.quantity} - {expectation.minus}"
    )


def failed(records: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the records that missed their value."""
    return [record for record in records if record["passed"] is False]


def _record(expectation, value, reason):
    error = (
        None
        if value is None
        else _relative(abs(value - expectation.value), expectation.scale or abs(expectation.value))
    )
    return {
        "quantity": _name(expectation),
        "at": expectation.at,
        "since": expectation.since,
        "statistic": expectation.statistic,
        "value": value,
        "reference": expectation.value,
        "error": error,
        "tolerance": expectation.tolerance,
        "passed": None if value is None else bool(error <= expectation.tolerance),
        "reason": reason,
        "source": expectation.source,
    }


def _relative(difference, scale):
    if scale == 0:
        return 0.0 if difference == 0 else float("inf")
    return float(difference / scale)


def _computed(expectation, history, complete, period):
    """Return the value and None, or None and the reason why there is none."""
    t = history["t"]
    values = history[expectation.quantity]
    if expectation.minus is not None:
        values = values - history[expectation.minus]
    if len(t) == 0:
        return None, "the history is empty"
    if expectation.at is None and not complete:
        return None, "the run did not reach its end"
    if expectation.statistic in PERIODIC:
        return _periodic(expectation, period)
    if expectation.at is None:
        return float(STATISTICS[expectation.statistic](values)), None
    times = [expectation.at] if expectation.since is None else [expectation.since, expectation.at]
    slack = ROUNDING * max(abs(t[0]), abs(t[-1]))
    if not t[0] - slack <= times[0] <= times[-1] <= t[-1] + slack:
        return None, f"the history covers {t[0]:g} s to {t[-1]:g} s"
    found = np.interp(times, t, values)
    return float(found[-1] - (found[0] if expectation.since is not None else 0.0)), None


def _periodic(expectation, period):
    if period is None:
        return None, "the history has no full period"
    value = getattr(period.columns[expectation.quantity], PERIODIC[expectation.statistic])
    return (None, "it is steady in the last period") if value is None else (float(value), None)
