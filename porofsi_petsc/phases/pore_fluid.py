"""The fluid in the pores of a skeleton: drag, seepage, and what the skeleton answers to its
pressure.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from ..clock import Scheme
from ..conditions import Slope
from ..kernels import exchange, shape
from ..kernels import flow as kernel
from ..kernels.solid import displacement_gradient, volumetric_compliance
from ..linalg.constrained import BlockMatrix
from ..linalg.solver import LinearSolver
from ..tensors import trace
from .coupling_data import MeshState, Rates
from .fluid import FluidPhase
from .kept_force import KeptForce
from .nodal_drag import drag_weight, dragged_part, product
from .residual import Residual
from .setup import PoreFluidSetup
from .surface_terms import SurfaceTerms


class PoreFluid(FluidPhase):
    """The saturating fluid of a porous medium, on the mesh of its skeleton.

    With inertia in the corrected split it has an auxiliary field s beside v and p, see
    `kernels.flow.add_skeleton_answer`.
    """

    setup: PoreFluidSetup

    def __init__(self, setup: PoreFluidSetup) -> None:
        """Take the setup (collective)."""
        super().__init__(setup)
        self.fluxes = SurfaceTerms(self.mesh.n_owned, 1, setup.fluxes)
        self.kept = KeptForce(self.mesh.n_owned, self.mesh.dim + 1)

    def _new_solver(self, matrix: BlockMatrix) -> LinearSolver:
        return self.setup.linear_solver(matrix, operators=False)

    def begin_step(self, scheme: Scheme, rates: Rates, t: float, mesh_state: MeshState) -> None:
        """Start a step; see `FluidPhase.begin_step`."""
        super().begin_step(scheme, rates, t, mesh_state)
        self.fluxes.begin_step(scheme, self._accepted_state(mesh_state, t))
        self._drag_weight = drag_weight(self.domain, self.setup.materials, mesh_state.configuration)

    def _prescribe_pressure(self, p: np.ndarray, t: float) -> None:
        self.setup.pressure.apply(p[:, None], t)

    def _add_volume_terms(self, terms: dict[str, np.ndarray]) -> None:
        terms["flux"] = self.fluxes.residual(self._surface_state)

    def unbalanced(self, momentum: Residual) -> np.ndarray | float:
        """Return what the momentum residual adds to the skeleton's, (n_owned, d) [N]; nothing in
        the plain split.

        Their sum is the balance of the mixture, in which the drag cancels.
        """
        return momentum.total if self.setup.split == "corrected" else 0.0

    def drag_scale(self, mesh_state: MeshState, rates: Rates) -> np.ndarray:
        """Return the nodal forces S max(|v_f|, c_v |u|), (n_owned, d) [N], whose round-off v_f -
        v_s has.

        v_s is a difference of displacements, whose digits it loses where a deformed skeleton hardly
        moves any more.
        """
        n = self.mesh.n_owned
        v_f = self._level(self.v, self._v1)[:n]
        u = mesh_state.displacement[:n]
        return product(self._drag_weight, np.maximum(np.abs(v_f), rates.c_v * np.abs(u)))

    def force_per_rate(self, rates: Rates) -> float:
        """Return infinity: the drag and the skeleton resist, whatever force there is; see
        `FreeFluid.force_per_rate`.
        """
        return np.inf

    def drag_along(self, change: np.ndarray) -> None:
        """Add what the drag does to v_f when v_s changes, (n_local, d) [m/s], while the pressure is
        as it was: χ times the change.

        An exact solution of the block does not see it.  A lagged tangent or an iterative solver
        leaves a part of the right side, which therefore must not hold S Δv_s, up to 1e8 times any
        other force.
        """
        free = ~self.setup.mask[:, : self.mesh.dim]
        carried = product(self._chi, change) / self.scheme.alpha_f
        self._v1 += np.where(free, carried, 0.0)
        self._update_rates()

    def dragged_part(self, mesh_state: MeshState, rates: Rates) -> np.ndarray:
        """Return χ of the nodes; see `nodal_drag.dragged_part` (collective)."""
        free = ~self.setup.mask[:, : self.mesh.dim]
        configuration = mesh_state.configuration
        return dragged_part(self.domain, self.setup.materials, configuration, rates, free)

    # -- tangents ----------------------------------------------------------------------------------

    def _complete(self, K, elements, region, chunk, mesh_state, rates):
        """Add what the skeleton answers, in the corrected split."""
        if self.setup.split == "corrected":
            material = self.setup.materials[region]
            self._add_skeleton_answer(K, elements, material, mesh_state, rates, chunk)

    def _prepare_solver(self, mesh_state, rates, fields):
        self._chi = self.dragged_part(mesh_state, rates)

    def _add_skeleton_answer(self, values, elements, material, mesh_state, rates, chunk):
        """Add the inertia-aware fixed-stress term; α = n_s + χ n_f is the part of the pressure
        gradient the skeleton feels.

        Of a χ with principal axes it takes the mean, since an approximation does here.
        """
        chi = rates.dragged_fraction(elements.drag, elements.rho)
        if chi.ndim > elements.n.ndim:
            chi = trace(chi) / self.mesh.dim
        alpha2_cv = (1 - elements.n + chi * elements.n) ** 2 * rates.c_v
        inertia = (
            material.rho_s * rates.c_a + rates.dragged_inertia(chi, elements.rho)
            if self.setup.has_auxiliary
            else 1.0
        )
        reference = self.domain.reference.part(chunk)
        H = displacement_gradient(
            reference.G, self.domain.gather(mesh_state.displacement, chunk), reference.hoop
        )
        compliance = volumetric_compliance(material.elastic, H)
        kernel.add_skeleton_answer(values, elements, alpha2_cv * compliance, alpha2_cv / inertia)
        if self.setup.has_auxiliary:
            rows, terms = self.setup.free_surface
            here = (rows >= chunk.start) & (rows < chunk.stop)
            kernel.add_free_surface(
                values, alpha2_cv / inertia, rows[here] - chunk.start, terms[here]
            )

    def exchange_tangents(
        self, rates: Rates, mesh_state: MeshState
    ) -> Iterator[tuple[slice, np.ndarray]]:
        """Yield (chunk, derivative (E, A, d + 1, A, d) of the residuals by the skeleton's
        positions) of the trial state.
        """
        fields = self._trial_fields(mesh_state)
        moving = mesh_state.moving_mesh
        state = self._state_of(mesh_state, fields)
        surfaces = self.fluxes.exchanges(state, Slope(float(moving), rates.c_v))
        for region, chunk in self.domain.chunks(self._doubles_per_cell):
            elements = self._elements(region, chunk, mesh_state.configuration)
            K = exchange.flow_by_skeleton(elements, fields.on(chunk), rates.c_v, moving)
            surfaces.add_to(K, chunk, row=self.mesh.dim)
            yield chunk, K

    def shape_tangents(self, mesh_state: MeshState) -> Iterator[tuple[slice, np.ndarray]]:
        """Yield (chunk, derivative (E, A, d + 1, A, d) of the residuals by the moving mesh's
        geometry) of the trial state.
        """
        domain = self.domain
        fields = self._trial_fields(mesh_state)
        for region, chunk in domain.chunks(self._doubles_per_cell):
            elements = self._elements(region, chunk, mesh_state.configuration)
            J = mesh_state.configuration.J[chunk]
            derivatives = shape.VolumeDerivatives(
                *self.setup.materials[region].volume_derivatives(J)
            )
            yield chunk, shape.flow_by_geometry(elements, fields.on(chunk), derivatives)

    # -- end of a step -----------------------------------------------------------------------------

    @property
    def force(self) -> np.ndarray:
        """Return the force on what holds the velocity at the end of the accepted step, (n_owned, d)
        [N], if it is kept: minus the residual of the momentum.
        """
        return self.kept.end[:, : self.mesh.dim]

    @property
    def outflow(self) -> np.ndarray:
        """Return the volume rates ∮ N_a n_f w·n dA out of the boundary at the end of the accepted
        step, (n_owned, 1) [m³/s], if they are kept: minus the volume balance without given fluxes.
        """
        return self.kept.end[:, self.mesh.dim :]

    @property
    def collocated_outflow(self) -> np.ndarray:
        """Return the same on the collocation level of the accepted step, where the volume balance
        holds.
        """
        return self.kept.collocated[:, self.mesh.dim :]

    def accept(self) -> None:
        """Make the trial state the accepted one (collective)."""
        if self.setup.reaction:
            balances = self._momentum.without("traction"), self._volume.without("flux")
            self.kept.accept(self.scheme, -np.column_stack(balances))
        super().accept()

    def state(self) -> dict[str, np.ndarray]:
        """Return every array a restart needs, name -> (n_owned, ...)."""
        return (self.kept.state() if self.setup.reaction else {}) | super().state()

    def memory(self) -> dict[str, Any]:
        """Return the numbers a restart needs beside the arrays."""
        return (self.kept.memory() if self.setup.reaction else {}) | super().memory()

    def load_state(self, arrays: dict[str, np.ndarray], memory: dict[str, Any], *args: Any) -> None:
        """Continue from `state` and `memory`; see `FluidPhase.load_state`."""
        if self.setup.reaction:
            self.kept.load(arrays, memory)
        super().load_state(arrays, memory, *args)
