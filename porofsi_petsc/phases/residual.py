"""A residual as the sum of named terms on the owned nodes of a rank."""

import numpy as np


class Residual:
    """Terms name -> (n_owned, k) of one field, internal minus external force; prescribed rows do not count."""

    def __init__(self, comm, terms, free):
        """Store the terms; free(array) returns a copy whose prescribed rows are zero."""
        self._comm, self.terms, self._free = comm, terms, free

    @property
    def total(self):
        """Return the sum of the terms on free rows, (n_owned, k)."""
        return self._free(self.unconstrained)

    @property
    def unconstrained(self):
        """Return the sum of the terms on all rows, (n_owned, k): on prescribed ones minus the force that holds them."""
        return sum(self.terms.values())

    def norms(self):
        """Return (norm of the total, largest norm of a term), Euclidean over all ranks (collective)."""
        vectors = [self.total, *map(self._free, self.terms.values())]
        squares = self._comm.allreduce(np.array([np.vdot(v, v) for v in vectors]))
        norms = np.sqrt(squares)
        return norms[0], norms[1:].max()

    def power(self, velocity):
        """Return name -> term · velocity over all rows and ranks, velocity (n_owned, k) (collective)."""
        local = np.array([np.vdot(term, velocity) for term in self.terms.values()])
        return dict(zip(self.terms, self._comm.allreduce(local).tolist(), strict=True))

    def reaction_power(self, velocity):
        """Return the power of what holds the prescribed rows: (sum of terms - its free part) · velocity (collective)."""
        held = self.unconstrained - self.total
        return self._comm.allreduce(float(np.vdot(held, velocity)))
