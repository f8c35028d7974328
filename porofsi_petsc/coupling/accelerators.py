"""Accelerators of a fixed-point iteration x <- F(x): each sees vectors only and returns the next iterate.

A vector is distributed, (n,) on every rank; `dot(a, b)` is the global inner product.
"""

import numpy as np


class Plain:
    """x_{k+1} = F(x_k)."""

    def __init__(self, dot, relaxation=None, guard=None):
        """Take the inner product; nothing is relaxed or guarded."""
        self._factor = 1.0

    def restart(self):
        """Forget the history: a new step, or another map."""

    def next(self, x, F):
        """Return the next iterate from x and F = F(x)."""
        return x + self._factor * (F - x)


class Constant(Plain):
    """x_{k+1} = x_k + ω (F(x_k) - x_k)."""

    def __init__(self, dot, relaxation=None, guard=None):
        """Take the inner product and ω (default 0.5); a constant needs no guard."""
        self._factor = 0.5 if relaxation is None else relaxation


class Aitken:
    """Aitken's vector extrapolation, ω_{k+1} = -ω_k r_k·(r_{k+1} - r_k)/|r_{k+1} - r_k|² (Küttler & Wall 2008).

    ω starts every step at its first value, so that a step does not depend on the ones before, and stays within the guard: one
    scalar cannot serve a whole spectrum, and a factor fitted to one error component magnifies the others.
    """

    def __init__(self, dot, relaxation=None, guard=(0.05, 1.6)):
        """Take the inner product, the first ω (default 1) and the guard (smallest, largest ω)."""
        self._dot, self._first, self._guard = dot, 1.0 if relaxation is None else relaxation, guard
        self.restart()

    def restart(self):
        """Forget the history."""
        self._omega, self._previous = self._first, None

    def next(self, x, F):
        """Return the next iterate from x and F = F(x)."""
        residual = F - x
        if self._previous is not None:
            change = residual - self._previous
            norm2 = self._dot(change, change)
            if norm2 > 0:
                omega = -self._omega * self._dot(self._previous, change) / norm2
                self._omega = float(np.clip(omega, *self._guard))
        self._previous = residual
        return x + self._omega * residual


class Anderson:
    """Anderson mixing (Walker & Ni 2011): F minus the combination of past differences that minimizes the residual.

    x_{k+1} = F_k - Σ_j γ_j ΔF_j, γ = argmin |r_k - Σ_j γ_j Δr_j|, over the last DEPTH differences; the least squares are solved
    through its Gram matrix with unit columns, singular values below CUTOFF dropped.
    """

    DEPTH, CUTOFF = 12, 1e-12

    def __init__(self, dot, relaxation=None, guard=None):
        """Take the inner product and the factor of the first iteration (default 1); the least squares need no guard."""
        self._dot, self._first = dot, 1.0 if relaxation is None else relaxation
        self.restart()

    def restart(self):
        """Forget the history."""
        self._last, self._changes = None, []

    def next(self, x, F):
        """Return the next iterate from x and F = F(x)."""
        residual = F - x
        if self._last is None:
            self._last = residual, F
            return x + self._first * residual
        change = residual - self._last[0]
        norm = np.sqrt(self._dot(change, change))
        if norm > 0:
            self._changes = [*self._changes, (change / norm, (F - self._last[1]) / norm)][-self.DEPTH :]
        self._last = residual, F
        gram = np.array([[self._dot(a, b) for b, _ in self._changes] for a, _ in self._changes])
        right = np.array([self._dot(a, residual) for a, _ in self._changes])
        gamma = np.linalg.lstsq(gram, right, rcond=self.CUTOFF)[0] if len(right) else []
        return F - sum((g * change for g, (_, change) in zip(gamma, self._changes, strict=True)), np.zeros_like(F))


ACCELERATORS = {"none": Plain, "constant": Constant, "aitken": Aitken, "anderson": Anderson}
