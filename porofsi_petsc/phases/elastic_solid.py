"""A solid beside a free fluid: the force of the fluid on their interface, its own on what holds
it.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from ..clock import at_end
from ..kernels import exchange
from .coupling_data import Flow, Rates
from .residual import Residual
from .setup import ElasticSolidSetup
from .solid import SolidPhase


class ElasticSolid(SolidPhase):
    """A solid without pores, or one that a free fluid flows through, of which it feels the drag.

    `force` (n_owned, d) [N] is that on what bounds it at the end of the accepted step, `_force0`
    the collocated one, if they are kept.
    """

    setup: ElasticSolidSetup

    def __init__(self, setup: ElasticSolidSetup) -> None:
        """Take the setup (collective)."""
        super().__init__(setup)
        if setup.immersed:
            self.noun = "skeleton"
        self.force, self._force0 = (np.zeros((self.mesh.n_owned, self.mesh.dim)) for _ in range(2))
        # from the level of _force0 to the accepted end of step [s]; None: no line through it
        self._force_age: float | None = None
        self.robin_coefficient = 0.0  # α of a Robin condition [Pa s/m]

    def _flow_terms(self, flow: Flow) -> dict[str, np.ndarray]:
        assert flow.force is not None  # of a free fluid
        force = {"interface": -flow.force}
        if self.setup.immersed:
            return {"drag": self._coupling_terms(flow)["drag"]} | force
        return force

    def boundary_force(self, residual: Residual) -> np.ndarray:
        """Return the force on what bounds the solid, (n_owned, d) [N]: minus the residual without
        given tractions.

        The force of a fluid is part of the residual; where the solid is held it is minus the
        reaction.
        """
        return -residual.without("traction")

    def take_velocity(self, gap: np.ndarray) -> None:
        """Move the nodes that are told their velocity so that a gap v_s - v on the collocation
        level, (n_local, d), closes.
        """
        n = self.mesh.n_owned
        setup = self.setup
        assert setup.driven is not None  # only such an interface tells a velocity
        shift = np.where(setup.driven[:, None] & ~setup.dirichlet.mask, -gap, 0.0)[:n]
        self.add(shift / self.scheme.c_v)

    # -- tangents ----------------------------------------------------------------------------------

    def _block_tangents(self, u, configuration, rates, surfaces, before):
        """Yield the tangents with the Robin condition of an interface."""
        for chunk, K in super()._block_tangents(u, configuration, rates, surfaces, before):
            if self.setup.robin is not None:
                self.setup.robin.add_to(K, self.robin_coefficient * rates.c_v, chunk, self.mesh.dim)
            yield chunk, K

    def drag_tangents(self) -> Iterator[tuple[slice, np.ndarray]]:
        """Yield (chunk, derivative (E, A, d, A, d + 1) of the residual by v_f and p) of an immersed
        solid.
        """
        configuration = self.mesh_state().configuration
        for region, chunk in self.domain.chunks(self._doubles_per_cell):
            drag = self.setup.materials[region].drag(configuration.J[chunk])
            geometry = configuration.geometry.part(chunk)
            yield chunk, exchange.solid_by_drag(self.domain.mass.N, geometry, drag)

    # -- end of a step -----------------------------------------------------------------------------

    def accept(self) -> None:
        """Make the trial state the accepted one; see `SolidPhase.accept`."""
        super().accept()
        if self.setup.reaction:
            force = self.boundary_force(self._residual)
            self.force = at_end(self.scheme, self._force_age, self._force0, force)
            self._force0 = force
            self._force_age = (1 - self.scheme.alpha_f) * self.scheme.dt

    def state(self) -> dict[str, np.ndarray]:
        """Return every array a restart needs, name -> (n_owned, d)."""
        if not self.setup.reaction:
            return super().state()
        return super().state() | {"force": self.force, "force_collocated": self._force0}

    def memory(self) -> dict[str, Any]:
        """Return the numbers a restart needs beside the arrays."""
        age = {"force_age": self._force_age} if self.setup.reaction else {}
        return super().memory() | age

    def load_state(
        self, arrays: dict[str, np.ndarray], memory: dict[str, Any], rates: Rates
    ) -> None:
        """Continue from `state` and `memory`; see `SolidPhase.load_state`."""
        if self.setup.reaction:
            self.force = arrays["force"]
            self._force0 = arrays["force_collocated"]
            self._force_age = memory["force_age"]
        super().load_state(arrays, memory, rates)
