"""Stabilization parameters of the fluid, evaluated once a step."""

import numpy as np

from ..fem.geometry import element_size_tensor
from ..kernels import stabilization
from ..tensors import plus_identity, scaled_identity, weighted
from .coupling_data import MeshState, Rates
from .setup import FluidSetup


class StabilizationParameters:
    """τ, ν_L (E, Q) and c_v τ_u (E, Q, d, d) at the quadrature points, of the state at the start of
    a step.

    τ_u is kept as α at the points, (E, Q), or tensors where a drag has principal axes, and the
    compliance at grid scale, (E, d, d). They are kept over steps where nothing in them changes:
    neither convection nor a moving mesh, and the same step size.
    """

    def __init__(self, setup: FluidSetup) -> None:
        """Take a `phases.setup.FluidSetup`."""
        self._setup = setup
        self._made_for: Rates | None = None
        self.tau: np.ndarray
        self.nu_lsic: np.ndarray
        self._moved: np.ndarray
        self._compliance: np.ndarray

    def update(self, dt: float, rates: Rates, mesh_state: MeshState, v: np.ndarray) -> None:
        """Evaluate for a step of size dt from velocity v (n_local, d) on the accepted mesh."""
        setup = self._setup
        domain = self._setup.domain
        if not (setup.convection or setup.moving_mesh) and self._made_for == rates:
            return
        first = self._made_for is None
        self._made_for = rates
        shape = (domain.n_cells, len(domain.mass.weights))
        if first:
            self.tau = np.empty(shape)
            self.nu_lsic = np.zeros(shape)
            tensors = any(material.anisotropy for material in setup.materials.values())
            self._moved = np.empty((*shape, *(domain.dim,) * 2) if tensors else shape)
            self._compliance = np.empty((domain.n_cells, domain.dim, domain.dim))
        c = v - mesh_state.mesh_velocity
        positions = domain.mesh.X + mesh_state.displacement if setup.moving_mesh else domain.mesh.X
        for region, chunk in domain.chunks(shape[1] * domain.cells.shape[1] * domain.dim):
            configuration = mesh_state.configuration
            material = setup.material(region, chunk)
            self._momentum(
                chunk,
                material,
                configuration.J[chunk],
                configuration.geometry.G[chunk],
                domain.gather(c, chunk),
                dt,
            )
            if not material.is_free_fluid:
                vertices = positions[domain.cells[chunk, : domain.element.n_vertices]]
                self._set_undrained(chunk, material, configuration.J[chunk], rates, vertices)

    def undrained(self, chunk: slice | np.ndarray) -> np.ndarray:
        """Return c_v τ_u of some elements, (E, Q, d, d) [m³ s/kg]."""
        return stabilization.undrained_tau(self._compliance[chunk], self._moved[chunk])

    def _momentum(self, chunk, material, J, G, c, dt):
        setup = self._setup
        N = self._setup.domain.mass.N
        h = self._setup.domain.h[chunk]
        rho = material.fluid_density(J)
        transient = 2 * rho / dt if setup.inertia else 0.0
        viscosity = material.flow_fraction(J) * material.viscosity
        viscous = stabilization.viscous_scale(viscosity, h, material.flow_fraction_varies)
        convective = stabilization.convective_scale(N, G, rho, c) if setup.convection else 0.0
        self.tau[chunk] = stabilization.momentum_tau(
            transient, material.drag(J).largest, viscous, convective
        )
        if (
            setup.convection and setup.lsic and not material.flow_fraction_varies
        ):  # LSIC knows no w·∇n_f
            self.nu_lsic[chunk] = stabilization.lsic_viscosity(N, rho, c, h)

    def _set_undrained(self, chunk, material, J, rates, vertices):
        """Set c_v τ_u; where the fluid is free it has PSPG."""
        size = element_size_tensor(vertices, self._setup.domain.h[chunk])
        inertia = rates.c_a * (material.rho_s + (1 - material.n_s0) * material.rho_fR)
        n = material.fluid_fraction(J)
        chi = rates.dragged_fraction(material.drag(J), n * material.rho_fR)
        compliance = stabilization.grid_compliance(material.elastic.softest_modulus, size, inertia)
        self._compliance[chunk] = self._setup.undrained * rates.c_v * compliance
        moved = plus_identity(weighted(n, chi), 1 - n)
        if self._moved.ndim > moved.ndim:  # of an isotropic region beside others
            moved = scaled_identity(moved, self._setup.domain.dim)
        self._moved[chunk] = moved
