"""Which steps of time can be taken: not lost in the digits of the time, and few enough to reach the
end.
"""

from math import log, log1p

# smallest step over the time that is reached: t + dt - t is dt to three digits at least
RESOLUTION = 1e-12
MOST_STEPS = 1e9  # weeks, even where a step takes a millisecond only


def number_of_steps(end: float, step: float, growth: float, max_step: float | None) -> float:
    """Return about how many steps lead to the end: a geometric row of sizes, and equal ones from
    max_step [s] on.
    """
    if growth == 1:
        return end / step
    rate = log1p(growth - 1)
    to_end = log1p((growth - 1) * end / step) / rate
    if max_step is None:
        return to_end
    growing = log(max_step / step) / rate
    if to_end <= growing:
        return to_end
    return growing + (end - (max_step - step) / (growth - 1)) / max_step
