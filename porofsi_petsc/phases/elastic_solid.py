"""A solid beside a free fluid: the force of the fluid on their interface, its own on what holds
it.
"""

from collections.abc import Iterator

import numpy as np

from ..kernels import exchange, shape
from ..kernels.solid import body_residual
from .coupling_data import Flow
from .loads import body_acceleration
from .setup import ElasticSolidSetup
from .solid import SolidPhase


class ElasticSolid(SolidPhase):
    """A solid without pores, or one that a free fluid flows through, of which it feels the
    drag.
    """

    setup: ElasticSolidSetup

    def __init__(self, setup: ElasticSolidSetup) -> None:
        """Take the setup (collective)."""
        super().__init__(setup)
        if setup.immersed:
            self.noun = "skeleton"
        self.robin_coefficient = 0.0  # α of a Robin condition [Pa s/m]

    def _flow_terms(self, flow: Flow) -> dict[str, np.ndarray]:
        assert flow.force is not None  # of a free fluid
        force = {"interface": -flow.force}
        if self.setup.immersed:
            return {"drag": self._coupling_terms(flow)["drag"]} | force
        return force

    def _body_vector(self, t):
        """Return what `SolidPhase` does, and in pores the weight of the fluid that the grains
        displace, ∫ n_s ρ_fR b·w dV0, which bears them.
        """
        nodal = super()._body_vector(t)
        if not self.setup.fluid_force:
            return nodal
        domain = self.domain
        b = body_acceleration(domain, self.setup.fluid_force, t)
        for region, chunk in domain.chunks(self._doubles_per_cell):
            material = self.setup.material(region, chunk)
            if material.has_pores:
                dV = domain.reference.dV[chunk]
                displaced = -material.n_s0 * material.rho_fR
                domain.add(nodal, chunk, body_residual(domain.mass.N, dV, displaced, b[chunk]))
        return nodal

    def require_admissible(self) -> None:
        """Raise ConvergenceError where an element of an immersed solid in the trial state is
        inverted or its pores are closed (collective).
        """
        _ = self.configuration  # kept with the state

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
        configuration = self.configuration
        for region, chunk in self.domain.chunks(self._doubles_per_cell):
            drag = self.setup.material(region, chunk).drag(configuration.J[chunk])
            geometry = configuration.geometry.part(chunk)
            yield chunk, exchange.solid_by_drag(self.domain.mass.N, geometry, drag)

    def shape_tangents(self, flow: Flow) -> Iterator[tuple[slice, np.ndarray]]:
        """Yield (chunk, derivative (E, A, d, A, d) of the drag on an immersed solid by the moving
        mesh's geometry) of the trial state.
        """
        domain = self.domain
        configuration = self.configuration
        relative = flow.velocity - self.velocity
        for region, chunk in domain.chunks(self._doubles_per_cell):
            material = self.setup.material(region, chunk)
            if material.has_pores:
                J = configuration.J[chunk]
                _, _, slope = material.volume_derivatives(J)
                geometry = configuration.geometry.part(chunk)
                w = domain.gather(relative, chunk)
                K = shape.drag_by_geometry(domain.mass.N, geometry, material.drag(J), slope, w)
                yield chunk, K
