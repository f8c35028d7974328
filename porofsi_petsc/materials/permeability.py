"""Permeability laws: the factor k/k0 as a function of the volume ratio J and the initial solid
fraction n_s0.

The factor multiplies the Darcy coefficient k_f [m/s] or the intrinsic permeability K [m^2] alike.
J > n_s0 is the caller's duty (the pores are still open).  J may be complex: the derivative of the
drag is taken by a complex step.
"""

from dataclasses import dataclass

import numpy as np

from ..registry import Registry, parameter
from .contract import check_permeability


@dataclass(frozen=True)
class PermeabilityLaw:
    """What every law has.  A new one: a subclass with `factor`, its parameters, and a line of the
    registry.
    """

    closes = False  # true: the law has a meaning for J > n_s0 only, while pores are open

    def factor(self, J: np.ndarray, n_s0: float) -> np.ndarray:
        """Return k/k0, the shape of J."""
        raise NotImplementedError


@dataclass(frozen=True)
class Constant(PermeabilityLaw):
    """k/k0 = 1."""

    def factor(self, J: np.ndarray, n_s0: float) -> np.ndarray:
        """Return 1."""
        return np.ones_like(J)


@dataclass(frozen=True)
class Markert(PermeabilityLaw):
    """k/k0 = [(J - n_s0)/(1 - n_s0)]^κ (Markert 2007)."""

    closes = True
    exponent: float = parameter("-", "κ", above=0.0, at_most=100.0, example=3.0)

    def factor(self, J: np.ndarray, n_s0: float) -> np.ndarray:
        """Return [(J - n_s0)/(1 - n_s0)]^κ."""
        return ((J - n_s0) / (1 - n_s0)) ** self.exponent


@dataclass(frozen=True)
class EhlersEipper(PermeabilityLaw):
    """k/k0 = [(1 - n_s0/J)/(1 - n_s0)]^κ (Ehlers & Eipper 1999)."""

    closes = True
    exponent: float = parameter("-", "κ", above=0.0, at_most=100.0, example=2.0)

    def factor(self, J: np.ndarray, n_s0: float) -> np.ndarray:
        """Return (n_f/n_f0)^κ with n_f = 1 - n_s0/J."""
        return ((1 - n_s0 / J) / (1 - n_s0)) ** self.exponent


@dataclass(frozen=True)
class KozenyCarman(PermeabilityLaw):
    """k/k0 = n_f³/(1 - n_f)² over its initial value, n_f = 1 - n_s0/J."""

    closes = True

    def factor(self, J: np.ndarray, n_s0: float) -> np.ndarray:
        """Return (n_f/n_f0)³ (n_s0/(1 - n_f))²."""
        n_f = 1 - n_s0 / J
        n_f0 = 1 - n_s0
        return (n_f / n_f0) ** 3 * (n_s0 / (1 - n_f)) ** 2


@dataclass(frozen=True)
class HolmesMow(PermeabilityLaw):
    """k/k0 = [(J - n_s0)/(1 - n_s0)]^κ exp(M (J² - 1)/2), of cartilage (Holmes & Mow 1990)."""

    closes = True
    exponent: float = parameter("-", "κ", above=0.0, at_most=100.0, example=2.0)
    slope: float = parameter("-", "M", at_least=0.0, at_most=100.0, example=4.6)

    def factor(self, J: np.ndarray, n_s0: float) -> np.ndarray:
        """Return [(J - n_s0)/(1 - n_s0)]^κ exp(M (J² - 1)/2)."""
        return ((J - n_s0) / (1 - n_s0)) ** self.exponent * np.exp(self.slope * (J**2 - 1) / 2)


@dataclass(frozen=True)
class Exponential(PermeabilityLaw):
    """k/k0 = exp(M (J - 1)), of cartilage, e = J - 1 the dilatation (Lai & Mow 1980)."""

    slope: float = parameter("-", "M", at_least=0.0, at_most=100.0, example=4.3)

    def factor(self, J: np.ndarray, n_s0: float) -> np.ndarray:
        """Return exp(M (J - 1))."""
        return np.exp(self.slope * (J - 1))


@dataclass(frozen=True)
class XieLeo(PermeabilityLaw):
    """k/k0 = J², of the exact large-strain consolidation of Xie & Leo (2004)."""

    def factor(self, J: np.ndarray, n_s0: float) -> np.ndarray:
        """Return J²."""
        return J**2


PERMEABILITY = Registry(
    "permeability law",
    "porofsi_petsc.permeability",
    {
        "constant": Constant,
        "markert": Markert,
        "ehlers_eipper": EhlersEipper,
        "kozeny_carman": KozenyCarman,
        "holmes_mow": HolmesMow,
        "exponential": Exponential,
        "xie_leo": XieLeo,
    },
    taken=("k", "intrinsic", "anisotropy", "angle", "axes"),
    check=check_permeability,
)
