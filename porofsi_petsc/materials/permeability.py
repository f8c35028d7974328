"""Permeability laws: factor k/k0 as a function of the volume ratio J, the initial solid fraction n_s0 and an exponent.

The factor multiplies the Darcy coefficient k_f [m/s] or the intrinsic permeability K [m^2] alike.  J > n_s0 is the caller's
duty (the pores are still open).
"""

import numpy as np


def constant(J, n_s0, exponent):
    """Return 1."""
    return np.ones_like(J)


def markert(J, n_s0, exponent):
    """Return [(J - n_s0)/(1 - n_s0)]^kappa (Markert 2007)."""
    return ((J - n_s0) / (1 - n_s0)) ** exponent


def ehlers_eipper(J, n_s0, exponent):
    """Return [(1 - n_s0/J)/(1 - n_s0)]^kappa (Ehlers & Eipper 1999)."""
    return ((1 - n_s0 / J) / (1 - n_s0)) ** exponent


def kozeny_carman(J, n_s0, exponent):
    """Return n_f^3/(1 - n_f)^2 over its initial value, with n_f = 1 - n_s0/J."""
    n_f, n_f0 = 1 - n_s0 / J, 1 - n_s0
    return (n_f / n_f0) ** 3 * (n_s0 / (1 - n_f)) ** 2


def xie_leo(J, n_s0, exponent):
    """Return J^2, the law of the exact large-strain consolidation of Xie & Leo (2004)."""
    return J**2
