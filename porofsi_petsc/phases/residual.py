"""A residual as the sum of named terms on the owned nodes of a rank."""

import functools
from collections.abc import Callable, Collection, Sequence

import numpy as np
from mpi4py import MPI


def euclidean_norms(comm: MPI.Comm, vectors: Sequence[np.ndarray | float]) -> np.ndarray:
    """Return the norms over all ranks of distributed vectors of any shapes, (len(vectors),), in one
    reduction (collective).
    """
    squares = np.array([np.vdot(vector, vector) for vector in vectors])
    comm.Allreduce(MPI.IN_PLACE, squares)
    return np.sqrt(squares)


class Residual:
    """Terms name -> (n_owned, k) of one field, internal minus external force; prescribed rows do
    not count.
    """

    def __init__(
        self,
        comm: MPI.Comm,
        terms: dict[str, np.ndarray],
        free: Callable[[np.ndarray], np.ndarray],
        penalties: Collection[str] = (),
    ) -> None:
        """Store the terms; free(array) returns a copy whose prescribed rows are zero.

        penalties : terms that say nothing of the size of the others: an iterate that violates what
        they hold makes them as large as their factor
        """
        self._comm = comm
        self.terms = terms
        self._free = free
        self._penalties = frozenset(penalties)

    @property
    def total(self) -> np.ndarray:
        """Return the sum of the terms on free rows, (n_owned, k)."""
        return self._free(self.unconstrained)

    @property
    def unconstrained(self) -> np.ndarray:
        """Return the sum of the terms on all rows, (n_owned, k): on prescribed ones minus the force
        that holds them.
        """
        return functools.reduce(np.add, self.terms.values())

    def without(self, name: str) -> np.ndarray:
        """Return the sum of the terms but one on all rows, (n_owned, k)."""
        terms = (term for other, term in self.terms.items() if other != name)
        return functools.reduce(np.add, terms)

    def vectors(self) -> list[np.ndarray]:
        """Return the total and the terms on free rows but penalties, each (n_owned, k)."""
        return [self.total, *map(self._free, self._sizes)]

    def norms(self) -> tuple[float, float]:
        """Return (norm of the total, largest norm of a term), Euclidean over all ranks
        (collective).
        """
        total, *terms = euclidean_norms(self._comm, self.vectors())
        return total, max(terms)

    def largest_force(self) -> float:
        """Return the largest norm of a term but penalties over all rows and ranks, those of
        prescribed values included (collective).
        """
        return max(euclidean_norms(self._comm, self._sizes))

    @property
    def _sizes(self):
        """Return the terms that say how large forces are."""
        return [term for name, term in self.terms.items() if name not in self._penalties]

    def power(self, velocity: np.ndarray) -> dict[str, float]:
        """Return name -> term · velocity over all rows and ranks, velocity (n_owned, k)
        (collective).
        """
        local = np.array([np.vdot(term, velocity) for term in self.terms.values()])
        return dict(zip(self.terms, self._comm.allreduce(local).tolist(), strict=True))

    def reaction_power(self, velocity: np.ndarray) -> float:
        """Return the power of what holds the prescribed rows: (sum of terms - its free part) ·
        velocity (collective).
        """
        held = self.unconstrained - self.total
        return self._comm.allreduce(float(np.vdot(held, velocity)))
