"""Sums over the modes of a layer that is drained at the top and closed at the base."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

SMALLEST_TIME = 1e-6  # of T: below it the sums are cut before they have converged
LARGEST_EXPONENT = 40.0  # terms below e^-40 change no digit


def modes(T: float) -> np.ndarray:
    """Return M = π (2n + 1)/2, (modes,), as many as count at the dimensionless time T = c_v
    t/H².
    """
    largest = np.sqrt(LARGEST_EXPONENT / max(T, SMALLEST_TIME))
    return np.pi / 2 * (2 * np.arange(int(largest / np.pi) + 2) + 1)


def on_distinct(function: Callable[[np.ndarray], np.ndarray], z: ArrayLike) -> np.ndarray:
    """Return function(distinct z) at z, any shape: the points of a mesh share few depths."""
    z = np.asarray(z, dtype=float)
    distinct, where = np.unique(z, return_inverse=True)
    return function(distinct)[where.reshape(-1)].reshape(z.shape)
