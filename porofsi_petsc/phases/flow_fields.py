"""Nodal fields of the flow; elements gather them chunk by chunk, so that no array of all elements is made of them."""

from dataclasses import dataclass

import numpy as np

from ..fem.domain import Domain
from ..kernels.flow import FlowFields


@dataclass(frozen=True)
class NodalFlow:
    """v, a, c = v - v_m, v_s (n_local, d); p, dp = p - p_n (n_local,) of a domain; b (E, Q, d) at the points of its elements.

    Units and level: `kernels.flow.FlowFields`.
    """

    domain: Domain
    v: np.ndarray
    a: np.ndarray
    c: np.ndarray
    v_s: np.ndarray
    p: np.ndarray
    dp: np.ndarray
    b: np.ndarray

    def on(self, rows):
        """Return the `FlowFields` of some elements."""
        nodal = (self.v, self.a, self.c, self.v_s, self.p, self.dp)
        return FlowFields(*(self.domain.gather(field, rows) for field in nodal), self.b[rows])
