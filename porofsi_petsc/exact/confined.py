"""Laterally confined compression of every skeleton law: P(J) in closed form, and the drained end state under a load.

The nominal stress P = dΨ/dJ of F = diag(1, 1, J), in tension positive [Pa]; λ and μ [Pa], n_s0 [-] the initial solid fraction.
"""

import numpy as np

UNIAXIAL = {
    "linear_elastic": lambda J, lam, mu, n_s0: (lam + 2 * mu) * (J - 1),
    "saint_venant_kirchhoff": lambda J, lam, mu, n_s0: (lam + 2 * mu) * J * (J**2 - 1) / 2,
    "neo_hookean": lambda J, lam, mu, n_s0: mu * (J - 1 / J) + lam * np.log(J) / J,
    "neo_hookean_j2": lambda J, lam, mu, n_s0: mu * (J - 1 / J) + lam * (J - 1),
    "xie_leo": lambda J, lam, mu, n_s0: (lam + 2 * mu) * np.log(J),
    "ehlers_eipper": lambda J, lam, mu, n_s0: mu * (J - 1 / J) + lam * (1 - n_s0) ** 2 * (1 / (1 - n_s0) - 1 / (J - n_s0)),
}
LOWEST = {"saint_venant_kirchhoff": 1 / np.sqrt(3)}  # the stress has its extremum there and the law softens beyond
MARGIN = 1e-12  # of J: how far the search stays from J = 0 and from the compaction point


def confined_ratio(law, load, lam, mu, n_s0):
    """Return J with P(J) = -load, the drained end state under a pressure on the top [Pa].

    Raises ValueError when the law cannot carry the load.
    """
    stress = UNIAXIAL[law]
    lowest = LOWEST.get(law, n_s0 if law == "ehlers_eipper" else 0.0) + MARGIN
    from scipy.optimize import brentq  # slow to import, and few scenes have this reference

    return brentq(lambda J: stress(J, lam, mu, n_s0) + load, lowest, 1.0, xtol=1e-15, rtol=1e-14)
