"""A matrix and what couples many of its unknowns by few numbers, as the flow through an outlet
does: Woodbury's formula.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np
from mpi4py import MPI


class Coupled(NamedTuple):
    """A term b C aᵀ of a matrix: b on its owned rows and a on its columns, (n_owned, m), and C.

    column : a, None where it is b
    """

    vector: np.ndarray
    factor: float
    column: np.ndarray | None = None

    def where(self, free: np.ndarray) -> "Coupled":
        """Return the term with zeros where free (n_owned, m) is false."""
        column = None if self.column is None else np.where(free, self.column, 0.0)
        return Coupled(np.where(free, self.vector, 0.0), self.factor, column)


def padded(terms: Iterable[Coupled], columns: slice, m: int) -> list[Coupled]:
    """Return terms on some of m unknowns of a node as terms on all of them."""
    found = []
    for term in terms:
        vector = np.zeros((len(term.vector), m))
        vector[:, columns] = term.vector
        found.append(Coupled(vector, term.factor))
    return found


class LowRankUpdate:
    """Solutions with A + Σ b C aᵀ from those with A.

    x = y - Z (C⁻¹ + aᵀZ)⁻¹ aᵀ y,  A y = r,  A Z = b: one more solution with A for each term, which
    is kept as long as A is.
    """

    def __init__(
        self,
        comm: MPI.Comm,
        terms: Sequence[Coupled],
        solve: Callable[[np.ndarray], np.ndarray],
    ) -> None:
        """Take the terms, whose factors are not zero, and solve(r) -> y, both (n_owned, m)
        (collective).
        """
        self._comm = comm
        columns = [term.vector if term.column is None else term.column for term in terms]
        self._columns = np.array(columns)
        self._answers = np.array([solve(term.vector) for term in terms])
        self._small = np.diag([1 / term.factor for term in terms]) + self._inner(self._answers)

    def _inner(self, vectors):
        """Return aᵀ x for all a, (r, ...), of vectors x (..., n_owned, m) (collective)."""
        return self._comm.allreduce(np.tensordot(self._columns, vectors, ((1, 2), (-2, -1))))

    def correct(self, y: np.ndarray) -> np.ndarray:
        """Return x for the solution y (n_owned, m) with A (collective)."""
        factors = np.linalg.solve(self._small, self._inner(y))
        return y - np.tensordot(factors, self._answers, 1)
