"""A force that balances a body at the start of a stage and fades over it."""

import numpy as np


class FadingForce:
    """F(t) = F_0 (t_1 - t)/(t_1 - t_0) on the owned nodes, F_0 (n_owned, d) [N].

    span : t_0 and t_1 [s]
    """

    def __init__(self, span: tuple[float, float], n_owned: int, dim: int) -> None:
        """Start with no force."""
        self._begins, self._ends = span
        self.at_start = np.zeros((n_owned, dim))

    def at(self, t: float) -> np.ndarray:
        """Return the force at a time, (n_owned, d) [N]."""
        return self.at_start * ((self._ends - t) / (self._ends - self._begins))
