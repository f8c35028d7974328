"""The skeleton of a porous medium: pressure and drag of the fluid in its pores, and the solids
without pores beside it.
"""

from collections.abc import Iterator

import numpy as np

from ..conditions import Slope
from ..kernels import exchange, shape, storage
from ..tensors import plus_identity, weighted
from .coupling_data import Flow, Rates
from .setup import SkeletonSetup
from .solid import SolidPhase


class Skeleton(SolidPhase):
    """The solid of a saturated porous medium, which carries the mesh of its fluid; elements without
    pores have neither pressure nor drag.
    """

    setup: SkeletonSetup
    noun = "skeleton"

    def __init__(self, setup: SkeletonSetup) -> None:
        """Take the setup (collective)."""
        self._wet = None if setup.fluid is setup.domain else setup.domain.rows_of(setup.fluid)
        super().__init__(setup, setup.with_hessian)
        self._reference = self._with_wet(self._reference)

    def _configuration_at(self, u):
        found = super()._configuration_at(u)
        return found if found is self._reference else self._with_wet(found)

    def _with_wet(self, configuration):
        """Return a configuration that knows which of its elements carry the fluid."""
        return configuration if self._wet is None else configuration.with_fluid_in(self._wet)

    def _flow_terms(self, flow: Flow) -> dict[str, np.ndarray]:
        terms = self._coupling_terms(flow)
        domain = self.domain
        geometry = self.configuration.geometry
        for region, chunk in domain.chunks(self._doubles_per_cell):
            alpha = self.setup.material(region, chunk).biot
            if alpha != 1.0:
                p = domain.gather(flow.pressure, chunk)
                force = storage.grain_force(domain.mass.N, geometry.part(chunk), alpha, p)
                domain.add(terms["pressure"], chunk, force)
        return terms

    # -- tangents ----------------------------------------------------------------------------------

    def _inertia_weights(self, material, configuration, chunk, rates):
        """Return the mass of the tangent times dV, (E, Q), or tensors (E, Q, d, d) of a drag with
        principal axes; None without any.

        Corrected split: ρ_χ c_a, the inertia with the fluid that is dragged along, the drag itself
        as a force.  Plain split (the block of Meirelles et al.): ρ_s c_a and the derivative S c_v
        of the drag, or the scaled mass without it.
        """
        split = self.setup.split
        if split == "plain":
            return self._plain_weights(material, configuration, chunk, rates)
        inertia = material.rho_s * rates.c_a * self.domain.reference.dV[chunk]
        if not material.has_pores:
            return inertia if rates.c_a else None
        J = configuration.J[chunk]
        dV = configuration.geometry.dV[chunk]
        drag = material.drag(J)
        if split == "scaled":
            return self._scaled_mass(material, inertia, J, drag, dV, rates)
        if not (rates.c_a or rates.c_f):
            return None
        rho_f = material.fluid_density(J)
        dragged = rates.dragged_inertia(rates.dragged_fraction(drag, rho_f), rho_f)
        return plus_identity(weighted(dV, dragged), inertia)

    def _scaled_mass(self, material, inertia, J, drag, dV, rates):
        """Return the tangent's inertia times the factor of the papers' mass scaling, (E, Q), or
        tensors.

        "optimal" is 1 + n_s ρ_fR/(n_f ρ_sR) + γ Δt (γ_fR/k_f)/(n_s ρ_sR), with the weights of the
        time schemes c_f c_v/c_a and c_v/c_a instead of 1 and γ Δt: ρ_s c_a + (n_s²/n_f) ρ_fR c_f
        c_v + (S/n_f²) c_v, the exact answer to a compression wave.
        """
        if self.setup.mass_scaling != "optimal":
            return self.setup.mass_scaling * inertia
        n = material.fluid_fraction(J)
        added = (1 - n) ** 2 / n * material.rho_fR * rates.c_f
        return plus_identity(weighted(rates.c_v * dV, drag.times(1 / n**2).plus(added)), inertia)

    def exchange_tangents(self, rates: Rates) -> Iterator[tuple[slice, np.ndarray]]:
        """Yield (chunk, derivative (E, A, d, A, d + 1) of the residual by v_f and p) of the trial
        state.
        """
        configuration = self.configuration
        surfaces = self.surfaces.exchanges(self._surface_state, Slope(1.0, rates.c_v))
        d = self.mesh.dim
        for region, chunk in self.domain.chunks(self._doubles_per_cell):
            material = self.setup.material(region, chunk)
            if material.has_pores:
                K = self._pore_exchange(material, configuration, chunk)
            else:
                K = np.zeros(
                    (*self.domain.cells[chunk].shape, d, self.domain.cells.shape[1], d + 1)
                )
            surfaces.add_to(K, chunk, column=d)
            yield chunk, K

    def _pore_exchange(self, material, configuration, chunk):
        """Return the derivative of pressure and drag by v_f and p, (E, A, d, A, d + 1)."""
        J = configuration.J[chunk]
        geometry = configuration.geometry.part(chunk)
        N = self.domain.mass.N
        K = exchange.solid_by_flow(N, geometry, material.fluid_fraction(J), material.drag(J))
        if material.biot != 1.0:
            K[..., -1] += storage.grain_tangent(N, geometry, material.biot)
        return K

    def shape_tangents(self, flow: Flow) -> Iterator[tuple[slice, np.ndarray]]:
        """Yield (chunk, derivative (E, A, d, A, d) of the residual by the moving mesh's geometry)
        of the trial state.
        """
        domain = self.domain
        configuration = self.configuration
        p = domain.gather(flow.pressure)
        w = domain.gather(flow.velocity - self.velocity)
        for region, chunk in domain.chunks(self._doubles_per_cell):
            material = self.setup.material(region, chunk)
            if not material.has_pores:
                continue
            J = configuration.J[chunk]
            n = material.fluid_fraction(J)
            drag = material.drag(J)
            derivatives = shape.VolumeDerivatives(*material.volume_derivatives(J))
            geometry = configuration.geometry.part(chunk)
            yield (
                chunk,
                shape.solid_by_geometry(
                    domain.mass.N, geometry, n, drag, derivatives, p[chunk], w[chunk]
                ),
            )
