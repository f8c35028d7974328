"""Accelerators of a fixed-point iteration x <- F(x): each sees vectors only and returns the next
iterate.

A vector is distributed, an array of any shape on every rank; `dot(a, b)` is the global inner
product, whose weights may change from step to step.  `restart` says that the map is another one,
`begin_step` that its fixed point is.
"""

import itertools
from collections.abc import Callable

import numpy as np
from scipy.linalg import cho_solve, solve_triangular

from .registry import Registry

Dot = Callable[[np.ndarray, np.ndarray], float]
Columns = list[list[tuple[np.ndarray, np.ndarray]]]  # of the steps, the newest last


class Plain:
    """x_{k+1} = F(x_k)."""

    FIRST = 1.0  # factor of the first iteration, where none is given
    GUARD = (0.0, np.inf)  # smallest and largest factor, where none are given

    def __init__(
        self,
        dot: Dot,
        relaxation: float | None = None,
        guard: tuple[float, float] | None = None,
        reuse_steps: int = 0,
    ) -> None:
        """Take the inner product, the factor of the first iteration, the smallest and the largest
        one, and the number of steps to reuse; each scheme looks at those it has a use for.
        """
        self._dot = dot
        self._first = self.FIRST if relaxation is None else relaxation
        self._guard = self.GUARD if guard is None else guard
        self._reused = reuse_steps
        self.restart()

    def restart(self) -> None:
        """Forget the history."""

    def begin_step(self) -> None:
        """Forget the history of the step before, except for what is reused."""
        self.restart()

    def columns(self) -> Columns:
        """Return the vectors that the next step reuses, for a checkpoint: pairs (Δr, ΔF), step by
        step, the newest last.
        """
        return []

    def load(self, steps: Columns) -> None:
        """Continue with `columns` of a checkpoint."""

    def next(self, x: np.ndarray, F: np.ndarray) -> np.ndarray:
        """Return the next iterate from x and F = F(x)."""
        return x + (F - x)


class Constant(Plain):
    """x_{k+1} = x_k + ω (F(x_k) - x_k)."""

    FIRST = 0.5

    def next(self, x: np.ndarray, F: np.ndarray) -> np.ndarray:
        """Return the next iterate from x and F = F(x)."""
        return x + self._first * (F - x)


class Aitken(Plain):
    """Aitken's vector extrapolation, ω_{k+1} = -ω_k r_k·(r_{k+1} - r_k)/|r_{k+1} - r_k|² (Küttler &
    Wall 2008).

    ω starts every step at its first value, so that a step does not depend on the ones before, and
    stays within the guard: one scalar cannot serve a whole spectrum, and a factor fitted to one
    error component magnifies the others.
    """

    GUARD = (0.05, 1.6)

    def restart(self) -> None:
        """Forget the history."""
        self._omega = self._first
        self._previous = None

    def next(self, x: np.ndarray, F: np.ndarray) -> np.ndarray:
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


class Anderson(Plain):
    """Anderson mixing (Walker & Ni 2011): F minus the combination of past differences that
    minimizes the residual.

    x_{k+1} = F_k - Σ_j γ_j ΔF_j, γ = argmin |r_k - Σ_j γ_j Δr_j|, over the last DEPTH differences;
    the least squares are solved through its Gram matrix with unit columns, singular values below
    CUTOFF dropped.
    """

    DEPTH = 12
    CUTOFF = 1e-12

    def restart(self) -> None:
        """Forget the history."""
        self._last: tuple[np.ndarray, np.ndarray] | None = None
        self._changes: list[tuple[np.ndarray, np.ndarray]] = []

    def next(self, x: np.ndarray, F: np.ndarray) -> np.ndarray:
        """Return the next iterate from x and F = F(x)."""
        residual = F - x
        if self._last is None:
            self._last = residual, F
            return x + self._first * residual
        change = residual - self._last[0]
        norm = np.sqrt(self._dot(change, change))
        if norm > 0:
            self._changes = [*self._changes, (change / norm, (F - self._last[1]) / norm)][
                -self.DEPTH :
            ]
        self._last = residual, F
        gram = np.array([[self._dot(a, b) for b, _ in self._changes] for a, _ in self._changes])
        right = np.array([self._dot(a, residual) for a, _ in self._changes])
        gamma = np.linalg.lstsq(gram, right, rcond=self.CUTOFF)[0] if len(right) else []
        return F - sum(
            (g * change for g, (_, change) in zip(gamma, self._changes, strict=True)),
            np.zeros_like(F),
        )


class QuasiNewton(Plain):
    """IQN-ILS: Newton's step with the inverse Jacobian of a least-squares model (Degroote, Bathe &
    Vierendeels 2009).

    x_{k+1} = F_k + Σ_j c_j ΔF_j, c = argmin |r_k + Σ_j c_j Δr_j|, over the differences of this and
    the last `reuse_steps` steps. Without reuse these are Anderson's iterates.  What differs:
    columns survive a step, as long as the map does; and a column of which the newer ones leave less
    than FILTER is dropped for good (the QR2 filter of Haelterman et al. 2016), where Anderson drops
    the oldest and cuts small singular values.  The triangular factor is that of the Gram matrix by
    Cholesky: what the filter keeps is independent enough for it, and a new column costs one inner
    product with each other instead of a new QR. Without any column, in the first step, x is
    relaxed.
    """

    # The newer columns know the map better, and what is left of a nearly dependent older one is
    # mostly its curvature and the tolerance of the sub-solves; 1e-2 as in the source.
    FILTER = 1e-2
    COLUMNS = 40  # at most; more cost more inner products than the sweeps they save

    def restart(self) -> None:
        """Forget the history."""
        self.load([])

    def begin_step(self) -> None:
        """Keep the columns of the last `reuse_steps` steps."""
        self.load(self.columns())

    def columns(self) -> Columns:
        """Return the columns (Δr, ΔF) of the last `reuse_steps` steps, step by step, for a
        checkpoint.
        """
        kept = [step for step in self._steps if step]
        return kept[max(0, len(kept) - self._reused) :]

    def load(self, steps: Columns) -> None:
        """Start a step with the `columns` of the steps before."""
        self._steps = [*steps, []]
        self._last: tuple[np.ndarray, np.ndarray] | None = None
        self._gram: np.ndarray | None = None

    def next(self, x: np.ndarray, F: np.ndarray) -> np.ndarray:
        """Return the next iterate from x and F = F(x)."""
        residual = F - x
        if self._gram is None:  # the weights of the inner product are those of this step
            changes = [change for step in self._steps for change, _ in step]
            lower = np.array(
                [
                    [self._dot(a, b) if j <= i else 0.0 for j, b in enumerate(changes)]
                    for i, a in enumerate(changes)
                ]
            )
            lower = lower.reshape(2 * (len(changes),))
            self._gram = lower + np.tril(lower, -1).T
        if self._last is not None:
            self._append(residual - self._last[0], F - self._last[1])
        self._last = residual, F
        factor = self._filter()
        pairs = [pair for step in reversed(self._steps) for pair in reversed(step)]
        if not pairs:
            return x + self._first * residual
        right = [-self._dot(change, residual) for change, _ in pairs]
        weights = cho_solve((factor, True), right)
        return F + sum(weight * image for weight, (_, image) in zip(weights, pairs, strict=True))

    def _append(self, change, image):
        """Add a column of this step and its inner products with all."""
        self._steps[-1].append((change, image))
        products = [self._dot(change, other) for step in self._steps for other, _ in step]
        self._gram = np.pad(self._gram, ((0, 1), (0, 1)))
        self._gram[-1, :] = self._gram[:, -1] = products

    def _filter(self):
        """Drop the columns that depend on newer ones; return the Cholesky factor of the others,
        newest first, (n, n).
        """
        kept = []
        factor = np.zeros((len(self._gram),) * 2)
        for j in reversed(range(len(self._gram))):
            n = len(kept)
            row = (
                solve_triangular(factor[:n, :n], self._gram[kept, j], lower=True)
                if n
                else np.zeros(0)
            )
            rest = self._gram[j, j] - row @ row
            if n < self.COLUMNS and rest > self.FILTER**2 * self._gram[j, j]:
                factor[n, :n] = row
                factor[n, n] = np.sqrt(rest)
                kept.append(j)
        self._keep(sorted(kept))
        return factor[: len(kept), : len(kept)]

    def _keep(self, kept):
        """Drop all columns but the numbered ones, counted from the oldest."""
        self._gram = self._gram[np.ix_(kept, kept)]
        number = itertools.count()
        self._steps = [[pair for pair in step if next(number) in kept] for step in self._steps]


def check_accelerator(accelerator: type) -> None:
    """Raise ValueError where an accelerator does not end at the fixed point of a contraction."""

    def dot(a, b):
        return float(np.vdot(a, b))

    body = accelerator(dot)
    body.begin_step()
    x = np.zeros(2)
    for _ in range(ENOUGH):
        F = MATRIX @ x + 1.0
        x = body.next(x, F)
    body.load(body.columns())
    exact = np.linalg.solve(np.eye(2) - MATRIX, np.ones(2))
    if not np.allclose(x, exact, rtol=1e-6):
        raise ValueError(f"it ends at {x} instead of the fixed point {exact}")


# A contraction with the factors 0.5 and -0.3, and iterations after which each one is at its end.
MATRIX = np.array([[0.1, 0.4], [0.4, 0.1]])
ENOUGH = 60
ACCELERATORS = Registry(
    "accelerator",
    "porofsi_petsc.accelerators",
    {
        "iqn_ils": QuasiNewton,
        "aitken": Aitken,
        "anderson": Anderson,
        "constant": Constant,
        "none": Plain,
        "auto": QuasiNewton,  # the fewest sweeps in every scene measured, docs/solvers.md
    },
    check=check_accelerator,
)
