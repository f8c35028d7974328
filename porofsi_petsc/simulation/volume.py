"""The volume that an incompressible fluid makes by what its solution leaves of div v = 0, beside
what flows through its boundary.
"""

from typing import Any, Literal

import numpy as np

from ..errors import LimitError
from ..fem.geometry import Rule, facet_measure
from .auto import AnyMedium

# Part of the volume of the fluid that one at rest does not make by round-off, whatever its
# pressure.
ROUND_OFF = 1e-6


class VolumeBalance:
    """Sums over the steps of a run: volume that came from nowhere, and that flowed through.

        made = |Σ Δt ∫ div v dV|        passed = Σ Δt ½ ∮ |v·n| dA

    The residuals of the volume balance are summed over all nodes, where stabilization drops out.
    What is left is the tolerance of the coupling, or what its measure of round-off lets pass: under
    pressures so large that the round-off of their gradient is a flow like the one that is sought.
    """

    def __init__(self, coupling: AnyMedium, bound: float | Literal["report"]) -> None:
        """Take the coupling of a free fluid and `limits.volume` (collective)."""
        self._coupling = coupling
        self._bound = bound
        domain = coupling.fluid.domain
        self._rule = Rule.of(domain.element.facet, 2 * domain.element.order)
        tagged = [
            facets.nodes[facets.owned & (domain.row_of_cell[facets.cells] >= 0)]
            for facets in domain.mesh.facets.values()
        ]
        none = np.zeros((0, domain.element.facet.nodes), dtype=int)
        self._facets = np.concatenate([none, *tagged])
        self._volume = domain.sum_owned(domain.reference.dV.sum(axis=1))
        self._made = self._passed = 0.0

    def add_step(self, dt: float) -> None:
        """Add the accepted step of size dt (collective)."""
        coupling = self._coupling
        fluid = coupling.fluid
        x = fluid.mesh.X + coupling.accepted_mesh_state().displacement
        normal = facet_measure(self._rule, x[self._facets])
        through = (normal * (self._rule.N @ fluid.v[self._facets])).sum(axis=(1, 2))
        made = coupling.residuals[1][1].unconstrained.sum()
        sums = fluid.mesh.comm.allreduce(np.array([made, np.abs(through).sum() / 2]))
        self._made += dt * float(sums[0])
        self._passed += dt * float(sums[1])

    @property
    def error(self) -> float:
        """Return the volume made over the volume passed [-], 0 where it is round-off."""
        made = abs(self._made)
        return made / self._passed if made > ROUND_OFF * self._volume and self._passed else 0.0

    def require(self, t: float) -> None:
        """Raise LimitError where the error has passed its bound."""
        if self._bound == "report" or self.error <= self._bound:
            return
        found = f"at t = {t:g} s the fluid has made {self.error:.3g} > {self._bound:g} of the"
        raise LimitError(
            f"[limits] volume: {found} volume that flowed through it, {abs(self._made):.3g} of"
            f" {self._passed:.3g} (m³, in 2-D m²): its pressures are so large that their round-off"
            " is a flow, or the tolerance is; lower what makes them, a resistance or a load, or"
            ' coupling.tolerance, or set limits.volume to a larger bound or to "report"'
        )

    def state(self) -> dict[str, Any]:
        """Return the numbers a restart needs."""
        return {"made": self._made, "passed": self._passed}

    def load(self, state: dict[str, Any]) -> None:
        """Continue from `state`."""
        self._made = state["made"]
        self._passed = state["passed"]
