"""The force of a porous medium on a surface, and the flow of its fluid through one: the residuals
of its balances on the nodes, split where other boundaries have a part in them.
"""

from collections.abc import Sequence

import numpy as np

from ..kernels.surface import flux_load, traction_load
from .setup import SkeletonSetup
from .surface_force import SolidForce, SurfaceForce


class MixtureForce(SolidForce):
    """The force of skeleton and pore fluid together, whose traction is (σ_E - α p I) n with the
    viscous stress of the fluid.
    """

    def __init__(
        self, setup: SkeletonSetup, surfaces: Sequence[np.ndarray], no_slip: np.ndarray
    ) -> None:
        """Take the setup, the facets of the surfaces, each (F, Af) nodes, and the walls of the
        fluid without slip, (n_local,) bool.
        """
        self._no_slip = no_slip
        super().__init__(setup, surfaces)

    def _prescribed(self):
        held = super()._prescribed()
        held[self._rows, self._local] |= self._no_slip[self._facets].all(axis=1)[:, None]
        return held

    def _loads_of_stress(self, nodes, material, state, rows):
        effective = super()._loads_of_stress(nodes, material, state, rows)
        if not material.has_pores:
            return effective
        moved = self._domain.mesh.X + (state.u if self._setup.moving_mesh else 0.0)
        v = self._domain.gather(state.v, rows)
        p = self._domain.gather(state.p, rows)
        viscosity = np.expand_dims(1 - material.n_s0, -1) * material.viscosity
        return effective + traction_load(*self._trace(nodes, moved, rows), v, p, viscosity)


class SeepageFlow(SurfaceForce):
    """The volume of pore fluid that flows out through surfaces relative to the skeleton, ∮ n_f w·n
    dA.
    """

    @property
    def _components(self):
        return 1

    @property
    def _essential(self):
        return self._setup.pressure

    def _positions(self, state):
        return self._domain.mesh.X + (state.u if self._setup.moving_mesh else 0.0)

    def _loads_of_stress(self, nodes, material, state, rows):
        N, _, normal = self._trace(nodes, self._positions(state), rows)
        w = self._domain.gather(state.c, rows)
        return -flux_load(N, normal, np.expand_dims(1 - material.n_s0, -1) * w)
