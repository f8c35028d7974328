"""What the balances leave on nodes whose values are prescribed, kept from step to step."""

from typing import Any

import numpy as np

from ..clock import Scheme, at_end


class KeptForce:
    """A nodal field that the balances give on the collocation level of a step.

    end (n_owned, k) : at the end of the accepted step, on the line through the last two collocated
    values; collocated (n_owned, k) : the last of these; zero before the first step
    """

    def __init__(self, n_owned: int, k: int) -> None:
        """Start with none."""
        self.end, self.collocated = (np.zeros((n_owned, k)) for _ in range(2))
        # from the level of `collocated` to the accepted end of step [s]; None: no line through it
        self._age: float | None = None

    def accept(self, scheme: Scheme, found: np.ndarray) -> None:
        """Take the collocated values (n_owned, k) of an accepted step."""
        self.end = at_end(scheme, self._age, self.collocated, found)
        self.collocated = found
        self._age = (1 - scheme.alpha_f) * scheme.dt

    def state(self) -> dict[str, np.ndarray]:
        """Return the arrays a restart needs."""
        return {"force": self.end, "force_collocated": self.collocated}

    def memory(self) -> dict[str, Any]:
        """Return the number a restart needs."""
        return {"force_age": self._age}

    def load(self, arrays: dict[str, np.ndarray], memory: dict[str, Any]) -> None:
        """Continue from `state` and `memory`."""
        self.end = arrays["force"]
        self.collocated = arrays["force_collocated"]
        self._age = memory["force_age"]
