"""Mean, amplitude and frequency of periodic signals over the last full period of a leading one."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError

# of the amplitude: a crossing leads from this far below the level to as far above; ripple does not
# get there
HYSTERESIS = 0.3
# of the largest value: a smaller amplitude is a steady signal with round-off or the tolerance of a
# solver
STILL = 1e-6
AVERAGED = 4  # periods of the leading signal over which the frequencies are averaged
PASSES = 4  # of level and crossings, each from the last period of the pass before


@dataclass(frozen=True)
class Oscillation:
    """mean (max + min)/2 and amplitude (max - min)/2 in the last period, unit of the signal;
    frequency [Hz], None: steady.
    """

    mean: float
    amplitude: float
    frequency: float | None

    @property
    def largest(self) -> float:
        """Return the largest value in the period."""
        return self.mean + self.amplitude


@dataclass(frozen=True)
class Period:
    """The last full period of the leading signal: start and end [s], the oscillation of every
    column in it.

    change : |amplitude of the leading signal / that one period earlier - 1|, small in a periodic
    state; None: one period only.
    """

    start: float
    end: float
    change: float | None
    columns: dict


def period_analysis(t: ArrayLike, columns: Mapping[str, ArrayLike], of: str) -> Period | None:
    """Return the Period of the signals, or None when the leading one has no full period (short,
    steady or drifting).

    t : (n,) increasing times [s], of any spacing.  columns : dict name -> (n,).  of : name of the
    leading signal. A period runs from one upward crossing of the mean level of the leading signal
    to the next, both interpolated linearly; the extrema are those of parabolas through three
    samples: N samples per period leave an error of order (2π/N)⁴ of the amplitude. The frequency of
    a column is that of its own crossings, several per leading period for drag and u_x. Raises
    InputError for an unknown `of`, other lengths, values that are not finite and times that do not
    increase.
    """
    t, columns = _checked(t, columns, of)
    lead = columns[of]
    crossings = _leading_crossings(t, lead)
    if len(crossings) < 2:
        return None
    start, end = crossings[-2:]
    found = {name: _oscillation(t, y, crossings) for name, y in columns.items()}
    change = None
    if len(crossings) > 2:
        change = abs(found[of].amplitude / _mean_amplitude(t, lead, *crossings[-3:-1])[1] - 1)
    return Period(start, end, change, found)


def _checked(t, columns, of):
    t = np.asarray(t, dtype=float)
    columns = {name: np.asarray(y, dtype=float) for name, y in columns.items()}
    if of not in columns:
        raise InputError(
            f"period analysis: no column '{of}' to take the period of; choose from"
            f" {', '.join(columns)}"
        )
    for name, y in columns.items():
        if y.shape != t.shape:
            shapes = f"the shape {y.shape}, the times {t.shape}"
            raise InputError(
                f"period analysis: column '{name}' has {shapes}; give one value per time"
            )
    broken = [name for name, y in [("t", t), *columns.items()] if not np.isfinite(y).all()]
    if broken:
        raise InputError(
            f"period analysis: column '{broken[0]}' has values that are not finite; leave these"
            " rows out"
        )
    if (np.diff(t) <= 0).any():
        at = t[np.flatnonzero(np.diff(t) <= 0)[0]]
        raise InputError(
            f"period analysis: the times do not increase after t = {at:g} s; give each time once,"
            " in order"
        )
    return t, columns


def _leading_crossings(t, y):
    """Return the upward crossings of the mean level of the last period, (m,), or fewer than two.

    The level of the whole signal may belong to the start-up: the search begins in the shortest last
    part that holds a period.
    """
    for part in (0.25, 0.5, 1.0):
        late = t >= t[-1] - part * (t[-1] - t[0])
        level, amplitude = _middle(y[late])
        crossings = _upward(t[late], y[late], level, amplitude)
        if len(crossings) >= 2:
            break
    for _ in range(PASSES):
        if len(crossings) < 2:
            break
        crossings = _upward(t, y, *_mean_amplitude(t, y, *crossings[-2:]))
    return crossings


def _oscillation(t, y, crossings):
    """Return mean and amplitude of a signal in the last leading period and the frequency in the
    last AVERAGED ones.
    """
    mean, amplitude = _mean_amplitude(t, y, *crossings[-2:])
    period = crossings[-1] - crossings[-2]
    first = (
        crossings[max(len(crossings) - 1 - AVERAGED, 0)] - period / 2
    )  # half a period more: a crossing on the edge is in
    late = t >= first
    return Oscillation(
        mean, amplitude, _frequency(_upward(t[late], y[late], mean, amplitude), period)
    )


def _frequency(own, period):
    """Return the mean frequency of crossings over whole leading periods: the crossings within one
    need not be equidistant.
    """
    if len(own) < 2:
        return None
    per_period = max(round(period * (len(own) - 1) / (own[-1] - own[0])), 1)
    steps = (len(own) - 1) // per_period * per_period
    return float(steps / (own[-1] - own[-1 - steps])) if steps else None


def _upward(t, y, level, amplitude):
    """Return where y last crosses the level on each way from level - h to level + h, h = HYSTERESIS
    amplitude [s].
    """
    if amplitude <= STILL * np.abs(y).max():
        return np.empty(0)
    band = HYSTERESIS * amplitude
    state = np.where(y > level + band, 1, np.where(y < level - band, -1, 0))
    marks = np.flatnonzero(state)
    rises = marks[1:][(state[marks[1:]] == 1) & (state[marks[:-1]] == -1)]
    below = np.flatnonzero(y <= level)
    left = below[np.searchsorted(below, rises) - 1]
    return t[left] + (level - y[left]) / (y[left + 1] - y[left]) * (t[left + 1] - t[left])


def _mean_amplitude(t, y, start, end):
    """Return (max + min)/2 and (max - min)/2 of a signal between two times, its extrema by
    parabolas.
    """
    inside = np.flatnonzero((t >= start) & (t <= end))
    highest, lowest = (sign * _peak(t, sign * y, inside) for sign in (1, -1))
    return (highest + lowest) / 2, (highest - lowest) / 2


def _middle(y):
    return (y.max() + y.min()) / 2, (y.max() - y.min()) / 2


def _peak(t, y, inside):
    """Return the maximum of y at the samples, of the parabola through it and its two neighbours
    when it is a local one.
    """
    i = inside[np.argmax(y[inside])]
    if not 0 < i < len(t) - 1 or y[i] < max(y[i - 1], y[i + 1]):
        return float(y[i])
    left = (y[i] - y[i - 1]) / (t[i] - t[i - 1])
    right = (y[i + 1] - y[i]) / (t[i + 1] - t[i])
    curvature = (right - left) / (t[i + 1] - t[i - 1])
    slope = left + curvature * (t[i] - t[i - 1])
    return float(y[i] - slope**2 / (4 * curvature)) if curvature < 0 else float(y[i])
