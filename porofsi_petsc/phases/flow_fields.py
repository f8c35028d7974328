"""Nodal fields of the flow; elements gather them chunk by chunk, so that no array of all elements
is made of them.
"""

from dataclasses import dataclass

import numpy as np

from ..fem.domain import Domain
from ..kernels.flow import FlowFields


@dataclass(frozen=True)
class NodalFlow:
    """`kernels.flow.FlowFields` of a domain, of nodes where those are of elements: (n_local, d), p
    and dp (n_local,).

    b is that of all its elements, (E, Q, d).
    """

    domain: Domain
    nodal: FlowFields

    def on(self, rows: slice | np.ndarray) -> FlowFields:
        """Return the `FlowFields` of some elements."""
        *fields, b = self.nodal
        return FlowFields(*[*(self.domain.gather(field, rows) for field in fields), b[rows]])
