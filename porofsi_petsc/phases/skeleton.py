"""The skeleton of a porous medium: pressure and drag of the fluid in its pores."""

from collections.abc import Iterator

import numpy as np

from ..conditions import Slope
from ..kernels import exchange, shape, storage
from ..tensors import plus_identity, weighted
from .coupling_data import Flow, Rates
from .setup import SkeletonSetup
from .solid import SolidPhase


class Skeleton(SolidPhase):
    """The solid of a saturated porous medium, which carries the mesh of its fluid."""

    setup: SkeletonSetup
    noun = "skeleton"

    def __init__(self, setup: SkeletonSetup) -> None:
        """Take the setup (collective)."""
        super().__init__(setup, setup.with_hessian)

    def _flow_terms(self, flow: Flow) -> dict[str, np.ndarray]:
        terms = self._coupling_terms(flow)
        domain = self.domain
        geometry = self.mesh_state().configuration.geometry
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
        as a force.  Plain split (the founding paper's block): ρ_s c_a and the derivative S c_v of
        the drag, or the scaled mass without it.
        """
        split = self.setup.split
        if split == "plain":
            return self._plain_weights(material, configuration, chunk, rates)
        J = configuration.J[chunk]
        dV = configuration.geometry.dV[chunk]
        drag = material.drag(J)
        inertia = material.rho_s * rates.c_a * self.domain.reference.dV[chunk]
        if split == "scaled":
            return self._scaled_mass(material, inertia, J, drag, dV, rates)
        if not (rates.c_a or rates.c_f):
            return None
        rho_f = material.fluid_fraction(J) * material.rho_fR
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
        configuration = self.mesh_state().configuration
        surfaces = self.surfaces.exchanges(self._surface_state, Slope(1.0, rates.c_v))
        for region, chunk in self.domain.chunks(self._doubles_per_cell):
            material = self.setup.material(region, chunk)
            J = configuration.J[chunk]
            n = material.fluid_fraction(J)
            geometry = configuration.geometry.part(chunk)
            N = self.domain.mass.N
            K = exchange.solid_by_flow(N, geometry, n, material.drag(J))
            if material.biot != 1.0:
                K[..., -1] += storage.grain_tangent(N, geometry, material.biot)
            surfaces.add_to(K, chunk, column=self.mesh.dim)
            yield chunk, K

    def shape_tangents(self, flow: Flow) -> Iterator[tuple[slice, np.ndarray]]:
        """Yield (chunk, derivative (E, A, d, A, d) of the residual by the moving mesh's geometry)
        of the trial state.
        """
        domain = self.domain
        configuration = self.mesh_state().configuration
        p = domain.gather(flow.pressure)
        w = domain.gather(flow.velocity - self.velocity)
        for region, chunk in domain.chunks(self._doubles_per_cell):
            material = self.setup.material(region, chunk)
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
