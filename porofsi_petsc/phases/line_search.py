"""The line search of Newton's iteration in a plastic flow, whose stress no longer grows."""

from collections.abc import Callable

# The part of the work of the residual that may be left, the least part of a step at once (both of
# Crisfield, Non-linear Finite Element Analysis of Solids and Structures, vol. 1, 1991, sec. 9.2),
# and how often a step is shortened.
LEFT = 0.8
SHORTEST = 0.1
SEARCHES = 5


def shorten(before: float, work: Callable[[], float], move: Callable[[float], None]) -> None:
    """Take back a part of a step δ that overshoots, until δ·R of the residual R is at most `LEFT`
    of its size before the step; one that falls short is left as it is.

    before : δ·R before the step, negative; work : returns that of the present state; move : changes
    the state by a part of δ.  δ·R is taken for linear in the part of the step.
    """
    part = 1.0
    for _ in range(SEARCHES):
        after = work()
        if after <= -LEFT * before:
            return
        shorter = part * max(SHORTEST, before / (before - after))
        move(shorter - part)
        part = shorter
