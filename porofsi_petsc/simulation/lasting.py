"""How large a size is that lasts: single steps say little after a jump of the load."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .loop import Clock

# A jump of the load, or of its rate, makes velocities jump, the faster, the shorter the step, and
# the scheme forgets it by about rho_inf per step: Mandel's slab in steps of 1e-4 s, rho_inf = 0.5,
# has 5e3 at the jump, 0.77 to 0.55 of that in each step after it, and 0.1 after 22.  Steps in which
# the size falls like that are passed over.
FADING = 0.8
STEPS = 5  # of the others; Terzaghi's column in steps of 1e-4 s has four before it fades
FEWEST = 3  # in a run that is shorter and in which nothing fades
# Of the run.  What follows a jump decays like the inverse of the time since it, too, if steps are
# short enough to show it: Terzaghi's column in steps of 1e-5 s is below 0.1 after 1e-3 s, of a
# consolidation that takes 50 s.
SHARE = 0.01


class Lasting:
    """The least of a size over the last steps in which it did not fade.

    They are at least STEPS and SHARE of the run.  A size that stays above a bound for so long is
    told; one that is above it for a moment is not.
    """

    def __init__(self, end: float) -> None:
        """Take the end of the run [s]."""
        self._end = end
        self._last = 0.0
        self._counted = 0
        # [time [s], number of counted steps before it, least size since then], sizes increasing
        self._trail: list[list[float]] = []

    def add(self, size: float, dt: float, clock: Clock) -> float:
        """Return the size that lasts up to now, by the `Clock` after a step of size dt."""
        fades = size < FADING * self._last
        self._last = size
        if fades:
            return 0.0
        start = [clock.t - dt, self._counted]
        self._counted += 1
        while self._trail and self._trail[-1][2] >= size:
            *start, _ = self._trail.pop()
        self._trail.append([*start, size])
        old = [
            i
            for i, (t, count, _) in enumerate(self._trail)
            if self._is_long(clock.t - t, self._counted - count)
        ]
        if old:
            del self._trail[: old[-1]]  # what began earlier can only be smaller
        short = clock.finished and FEWEST <= self._counted == clock.step
        return self._trail[0][2] if old or short else 0.0

    def _is_long(self, time: float, steps: float) -> bool:
        return steps >= STEPS and time >= SHARE * self._end

    def state(self) -> dict[str, Any]:
        """Return what a restart needs."""
        return {"last": self._last, "counted": self._counted, "trail": self._trail}

    def load(self, state: dict[str, Any]) -> None:
        """Continue from `state`."""
        self._last = state["last"]
        self._counted = state["counted"]
        self._trail = [list(entry) for entry in state["trail"]]
