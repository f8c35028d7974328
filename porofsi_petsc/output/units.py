"""Numbers for people: a unit that keeps them near one, few digits."""

import math

PREFIXES = ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"))


def scaled_unit(largest: float, unit: str) -> tuple[float, str]:
    """Return the factor from SI to a unit in which the largest magnitude lies between 1 and 1000,
    and its name.

    Lengths and velocities have no prefix above one, powers of lengths none at all.
    """
    if "²" in unit or "³" in unit:
        return 1.0, unit
    for size, prefix in PREFIXES:
        if largest >= size * (1 - 1e-12) and (size <= 1 or unit in ("Pa", "J")):
            return 1 / size, prefix + unit
    return 1.0, unit


def significant(value: float) -> float:
    """Return the positive value rounded to one significant digit."""
    power = 10.0 ** math.floor(math.log10(value))
    return round(value / power) * power


def plain(value: float) -> str:
    """Return a number of few digits as people write it: 0.02, 500, 5 x 10^7 (as mathtext)."""
    if 1e-3 <= value < 1e5:
        return f"{value:,g}"
    power = math.floor(math.log10(value))
    return f"${value / 10.0**power:g}\\times 10^{{{power}}}$"
