"""The drained end state of a laterally confined column under a load."""

from collections.abc import Callable

MARGIN = 1e-12  # of J: how far the search stays from J = 0 and from a compaction point


def confined_ratio(stress: Callable[[float], float], load: float, lowest: float = 0.0) -> float:
    """Return J with P(J) = -load under a pressure on the top [Pa].

    stress : the nominal stress P = dΨ/dJ of F = diag(1, 1, J), in tension positive [Pa]; lowest : J
    to which it falls with J. Raises ValueError when the law cannot carry the load.
    """
    from scipy.optimize import brentq  # slow to import, and few scenes have this reference

    return brentq(lambda J: stress(J) + load, lowest + MARGIN, 1.0, xtol=1e-15, rtol=1e-14)
