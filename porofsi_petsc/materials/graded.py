"""Laws whose moduli are fields: one value for each cell of the mesh."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .elastic import ElasticLaw

# of a state in which laws are compared, far from what one may refuse, and of round-off there
STRAIN = 0.02
AGREE = 1e-9
OfModuli = Callable[[float, float], ElasticLaw]  # λ, μ -> law


@dataclass(frozen=True)
class Graded(ElasticLaw):
    """Ψ = Σ_k c_k Ψ_k of laws with numbers and fields c_k: what a law becomes that is linear in λ
    and μ, or in both together where Poisson's ratio is a number.

    lam, mu (n, 1) [Pa] and the c_k (n, 1) of all cells, NaN where the law is not that of a cell;
    `at` some (E, 1) of them, for points (E, Q) or nodes (E, A); ratio : the largest λ/μ of all
    ranks
    """

    terms: tuple[tuple[np.ndarray, ElasticLaw], ...] = ()
    ratio: float = 0.0

    @property
    def _first(self):
        """Return the first of the laws, which tells what they all are."""
        return self.terms[0][1]

    @property
    def small_strain(self) -> bool:  # type: ignore[override]  # a constant of other laws
        """Return whether the stress is linear in H."""
        return self._first.small_strain

    @property
    def compacts(self) -> bool:  # type: ignore[override]  # a constant of other laws
        """Return whether there is a compaction point."""
        return self._first.compacts

    @property
    def largest_ratio(self) -> float:
        """Return the largest λ/μ [-]."""
        return self.ratio

    def at(self, cells: slice | np.ndarray) -> Graded:
        """Return the law of some cells."""
        terms = tuple((weight[cells], law) for weight, law in self.terms)
        return replace(self, lam=self.lam[cells], mu=self.mu[cells], terms=terms)  # type: ignore[index]

    def energy(self, H: np.ndarray) -> np.ndarray:
        """Return Ψ, (E, Q), of H (E, Q, d, d)."""
        return self._sum(lambda law: law.energy(H))

    def stress(self, H: np.ndarray) -> np.ndarray:
        """Return P, (E, Q, d, d), of H (E, Q, d, d)."""
        return self._sum(lambda law: law.stress(H))

    def tangent(self, H: np.ndarray) -> np.ndarray:
        """Return dP/dF, (E, Q, d, d, d, d), of H (E, Q, d, d)."""
        return self._sum(lambda law: law.tangent(H))

    def mixed_tangent(self, H: np.ndarray, before: np.ndarray) -> np.ndarray:
        """Do what `ElasticLaw.mixed_tangent` says."""
        return self._sum(lambda law: law.mixed_tangent(H, before))

    def _sum(self, of_law):
        total = 0.0
        for weight, law in self.terms:
            values = of_law(law)
            total = total + weight.reshape(len(weight), *(1,) * (values.ndim - 1)) * values
        return total


def graded(of_moduli: OfModuli, lam: Any, mu: Any, ratio: float, poisson: float | None) -> Graded:
    """Return the law of fields λ and μ, (n, 1) or one of them a number [Pa].

    of_moduli : the law of numbers; ratio : largest λ/μ of all ranks; poisson : Poisson's ratio
    where it is a number, with which the law need not be linear in λ and μ apart

    Raises ValueError where the law is no sum of fields times laws of numbers.
    """
    lam, mu = np.broadcast_arrays(np.asarray(lam, dtype=float), np.asarray(mu, dtype=float))
    parts: tuple[tuple[np.ndarray, ElasticLaw], ...]
    if poisson is None:
        parts = (lam, of_moduli(1.0, 0.0)), (mu, of_moduli(0.0, 1.0))
        _require_sum(of_moduli, (1.3, 0.7), tuple(law for _, law in parts))
    else:
        of_unit = 2 * poisson / (1 - 2 * poisson)  # λ of μ = 1
        parts = ((mu, of_moduli(of_unit, 1.0)),)
        _require_sum(lambda _, mu: of_moduli(mu * of_unit, mu), (0.0, 0.7), (parts[0][1],))
    first = parts[0][1]
    return Graded(lam, mu, first.n_s0, first.prony, parts, ratio)  # type: ignore[arg-type]


def _require_sum(of_moduli, moduli, laws):
    """Raise ValueError unless the law of some moduli is the sum of those times laws."""
    H = STRAIN * np.random.default_rng(3).standard_normal((4, 3, 3))
    wanted = of_moduli(*moduli).stress(H)
    found = sum(
        factor * law.stress(H) for factor, law in zip(moduli[-len(laws) :], laws, strict=True)
    )
    if not np.abs(found - wanted).max() <= AGREE * np.abs(wanted).max():
        kind = "λ and μ" if len(laws) > 1 else "its moduli together"
        raise ValueError(f"received a formula with a law that is not linear in {kind}")
