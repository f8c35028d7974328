"""The fluid in the pores of a skeleton: drag, seepage, and what the skeleton answers to its
pressure.
"""

from collections.abc import Iterator
from functools import cached_property
from typing import Any

import numpy as np
from mpi4py import MPI

from ..clock import Scheme
from ..conditions import Slope
from ..kernels import exchange, shape, storage
from ..kernels import flow as kernel
from ..kernels.solid import displacement_gradient, volumetric_compliance
from ..linalg.constrained import BlockMatrix
from ..linalg.solver import LinearSolver
from ..tensors import trace
from .coupling_data import MeshState, Rates
from .fluid import BY_VELOCITY, FluidPhase
from .kept_force import KeptForce
from .nodal_drag import drag_weight, dragged_part, product
from .residual import Residual
from .setup import PoreFluidSetup
from .surface_terms import SurfaceTerms

# Of the round-off of what cancels in a body at rest under a uniform pressure, as TURN of the solid:
# with 1 too the iteration ends (measured on both orders in the plane and in space: after 15 to 30
# sweeps, with 4 after 14 to 29).
PRESSED = 4


class PoreFluid(FluidPhase):
    """The saturating fluid of a porous medium, on the mesh of its skeleton.

    With inertia in the corrected split it has an auxiliary field s beside v and p, see
    `kernels.flow.add_skeleton_answer`.
    """

    setup: PoreFluidSetup

    def __init__(self, setup: PoreFluidSetup) -> None:
        """Take the setup (collective)."""
        super().__init__(setup)
        self._compressible = any(m.is_compressible for m in setup.materials.values())
        self._rate = np.zeros(self.mesh.n_local)  # dp/dt of the accepted level [Pa/s]
        self.fluxes = SurfaceTerms(self.mesh.n_owned, 1, setup.fluxes)
        self._active = np.zeros(0, dtype=bool)  # where unilateral conditions act in the tangent
        self.kept = KeptForce(self.mesh.n_owned, self.mesh.dim + 1)

    @property
    def is_linear(self) -> bool:
        """Return whether the tangent depends on nothing but the rates."""
        unilateral = any(place.condition.unilateral for place in self.setup.fluxes)
        return super().is_linear and not unilateral

    def set_initial(
        self, velocity: np.ndarray, pressure: np.ndarray | float = 0.0, balanced: bool = False
    ) -> None:
        """Set the state at the start, zero at nodes without pores; see `FluidPhase.set_initial`."""
        wet = self.domain.holds
        velocity = np.where(wet[:, None], velocity, 0.0)
        super().set_initial(velocity, np.where(wet, pressure, 0.0), balanced)

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
        if self._compressible:
            terms["storage"] = self._stored_volume(terms["skeleton"])

    @property
    def _penalties(self) -> tuple[str, ...]:
        return ("flux",) if self.fluxes.is_unilateral else ()

    def _stored_volume(self, skeleton):
        """Return ∫ q S dp/dt, (n_owned, 1) [m³/s], and add what the grains take to the term of the
        skeleton.
        """
        domain = self.domain
        state = self._mesh_state
        end = self._end_of(self._p1)
        rate = self.scheme.velocity_level(self._rate, self._rate_at(end))
        stored = np.zeros((domain.n_owned, 1))
        N = domain.mass.N
        for region, chunk in domain.chunks(self._doubles_per_cell):
            material = self.setup.material(region, chunk)
            geometry = state.configuration.geometry.part(chunk)
            S = material.storage(state.configuration.J[chunk])
            of_elements = storage.stored_volume(N, geometry, S, domain.gather(rate, chunk))
            domain.add(stored, chunk, of_elements[..., None])
            v_s = domain.gather(state.velocity, chunk)
            grains = storage.grain_volume(N, geometry, material.biot, v_s)
            domain.add(skeleton, chunk, grains[..., None])
        return stored

    def _end_of(self, p):
        """Return the pressure at the end of a step whose collocated one is p."""
        return self.p + (p - self.p) / self.scheme.alpha_f

    def _rate_at(self, end):
        """Return dp/dt at the end of a step, where the pressure is `end`."""
        return self.scheme.rates(end, self.p, self._rate, self._rate)[0]

    def _end_pressure(self) -> np.ndarray:
        """Return the pressure at the end of the step; that of compressible constituents is a state
        of its own.
        """
        if not self._compressible:
            return super()._end_pressure()
        end = self._end_of(self._p1)
        self._prescribe_pressure(end, self._t_end)
        return end

    @property
    def borne_pressure(self) -> np.ndarray:
        """Return α p of the accepted state, (n_local,) [Pa]: σ = σ_E - α p I."""
        return self._alpha * self.p

    @cached_property
    def _alpha(self):
        """Return α, the mean over the elements at a node, (n_local,); 1 where there are none
        (collective).
        """
        domain = self.domain
        ones = np.ones((domain.n_cells, domain.cells.shape[1]))
        of_cells = np.ones((domain.n_cells, 1))
        for region, span in domain.region_slices.items():
            of_cells[span] = self.setup.material(region, span).biot
        total, count = (domain.scatter_add(values)[:, 0] for values in (of_cells * ones, ones))
        mean = np.divide(total, count, out=np.ones_like(total), where=count > 0)
        return self.mesh.halo.extend(mean[:, None])[:, 0]

    def stored_energy(self, mesh_state: MeshState) -> float:
        """Return ∫ S p²/2 of the accepted state [J] (collective)."""
        if not self._compressible:
            return 0.0
        domain = self.domain
        stored = np.zeros(domain.n_cells)
        for region, chunk in domain.chunks(self._doubles_per_cell):
            S = self.setup.material(region, chunk).storage(mesh_state.configuration.J[chunk])
            p = domain.gather(self.p, chunk) @ domain.mass.N.T
            dV = mesh_state.configuration.geometry.dV[chunk]
            stored[chunk] = 0.5 * (S * p**2 * dV).sum(axis=1)
        return domain.sum_owned(stored)

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

    def cancelling(self, mesh_state: MeshState, rates: Rates) -> dict[str, np.ndarray]:
        """Return field -> what cancels inside the forces of a uniform pressure on both phases,
        (n_owned, 1); its round-off remains.

        PRESSED V g |p| of an element of volume V, g = Σ_a |∇N_a|, in equal parts to its nodes.
        """
        domain = self.domain
        summed = np.zeros((self.mesh.n_owned, 1))
        for _, chunk in domain.chunks(self._doubles_per_cell):
            p = domain.gather(self._p1, chunk)
            force = PRESSED * self._surface[chunk] * np.abs(p).max(axis=1, initial=0.0)
            domain.add(summed, chunk, np.broadcast_to(force[:, None, None], (*p.shape, 1)))
        return {"fluid momentum": summed, "solid momentum": summed}

    @cached_property
    def _surface(self):
        """Return V g of the elements over the number of their nodes, (E,) [m^(d-1)]."""
        domain = self.domain
        values = np.empty(domain.n_cells)
        for _, chunk in domain.chunks(self._doubles_per_cell):
            geometry = domain.reference.part(chunk)
            g = np.linalg.norm(geometry.G, axis=-1).sum(axis=2).max(axis=1, initial=0.0)
            values[chunk] = geometry.dV.sum(axis=1) * g / domain.cells.shape[1]
        return values

    def force_per_rate(self, rates: Rates) -> float:
        """Return the least force on the fluid over the volume flux it goes with, 1/(n_f g/S +
        c_v/(E_c g)) [N s/m³], see `FreeFluid.force_per_rate` (collective).

        A force F of a node is a seepage n_f g F/S, or moves the skeleton by F/(E_c V g²): what is
        left of pressure and weight that cancel, in ground at rest, is the round-off of these.
        """
        seepage, motion = self._rates_per_force
        least = (1 / (seepage + rates.c_v * motion)).min(initial=np.inf)
        return self.mesh.comm.allreduce(least, MPI.MIN)

    @cached_property
    def _rates_per_force(self):
        """Return n_f g/S [m³/(N s)] and 1/(E_c g) [m³/N] of the elements in the reference, (E,)
        each.
        """
        domain = self.domain
        found = np.empty((2, domain.n_cells))
        for region, chunk in domain.chunks(self._doubles_per_cell):
            material = self.setup.material(region, chunk)
            g = np.linalg.norm(domain.reference.part(chunk).G, axis=-1).sum(axis=2)
            steepness = g.max(axis=1, initial=0.0)
            rest = np.ones((len(g), 1))
            S = material.drag(rest).smallest[:, 0]
            found[0, chunk] = material.fluid_fraction(rest)[:, 0] * steepness / S
            found[1, chunk] = 1 / (np.ravel(material.confined_modulus) * steepness)
        return found

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
            material = self.setup.material(region, chunk)
            self._add_skeleton_answer(K, elements, material, mesh_state, rates, chunk)

    def _balance_tangents(self, mesh_state, rates, fields, surfaces, components):
        """Yield the tangents of the balances, those of storage included."""
        d = self.mesh.dim
        found = super()._balance_tangents(mesh_state, rates, fields, surfaces, components)
        fluxes = self.fluxes.tangents(self._state_of(mesh_state, fields), BY_VELOCITY)
        for region, chunk, elements, K in found:
            if self._compressible:
                S = self.setup.material(region, chunk).storage(mesh_state.configuration.J[chunk])
                c_p = self.scheme.c_v
                stored = storage.storage_tangent(elements.N, elements.geometry, S, c_p)
                K[:, :, d, :, d] += stored
            fluxes.add_to(K, chunk, row=d, column=d)
            yield region, chunk, elements, K

    def has_switched(self) -> bool:
        """Return whether a unilateral condition acts elsewhere than in the tangent (collective)."""
        if not self.fluxes.is_unilateral:
            return False
        now = self.fluxes.active(self._surface_state)
        switched = not np.array_equal(now, self._active)
        return self.mesh.comm.allreduce(switched, MPI.LOR)

    def _prepare_solver(self, mesh_state, rates, fields):
        self._active = self.fluxes.active(self._state_of(mesh_state, fields))
        self._chi = self.dragged_part(mesh_state, rates)

    def _add_skeleton_answer(self, values, elements, material, mesh_state, rates, chunk):
        """Add the inertia-aware fixed-stress term; α - n_f + χ n_f, α = 1 of incompressible
        grains, is the part of the pressure gradient the skeleton feels.

        Of a χ with principal axes it takes the mean, since an approximation does here.
        """
        chi = rates.dragged_fraction(elements.drag, elements.rho)
        if chi.ndim > elements.n.ndim:
            chi = trace(chi) / self.mesh.dim
        alpha2_cv = (material.biot - elements.n + chi * elements.n) ** 2 * rates.c_v
        inertia = (
            material.rho_s * rates.c_a + rates.dragged_inertia(chi, elements.rho)
            if self.setup.has_auxiliary
            else 1.0
        )
        reference = self.domain.reference.part(chunk)
        H = displacement_gradient(
            reference.G, self.domain.displacement(mesh_state.displacement, chunk), reference.hoop
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
            alpha = self.setup.material(region, chunk).biot
            if alpha != 1.0:
                by_p = storage.grain_tangent(elements.N, elements.geometry, alpha)
                K[:, :, -1] -= rates.c_v * np.moveaxis(by_p, 3, 1)
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
                *self.setup.material(region, chunk).volume_derivatives(J)
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

    @property
    def collocated_pressure(self) -> np.ndarray:
        """Return p on the collocation level of the accepted step, (n_local,) [Pa]."""
        return self._p0

    def accept(self) -> None:
        """Make the trial state the accepted one (collective)."""
        if self.setup.reaction:
            balances = self._momentum.without("traction"), self._volume.without("flux")
            self.kept.accept(self.scheme, -np.column_stack(balances))
        rate = self._rate_at(self._end_pressure()) if self._compressible else self._rate
        super().accept()
        self._rate = rate

    def state(self) -> dict[str, np.ndarray]:
        """Return every array a restart needs, name -> (n_owned, ...)."""
        kept = self.kept.state() if self.setup.reaction else {}
        if self._compressible:
            kept["p_rate"] = self._rate[: self.mesh.n_owned]
        return kept | super().state()

    def memory(self) -> dict[str, Any]:
        """Return the numbers a restart needs beside the arrays."""
        return (self.kept.memory() if self.setup.reaction else {}) | super().memory()

    def load_state(self, arrays: dict[str, np.ndarray], memory: dict[str, Any], *args: Any) -> None:
        """Continue from `state` and `memory`; see `FluidPhase.load_state`."""
        if self.setup.reaction:
            self.kept.load(arrays, memory)
        if self._compressible:
            self._rate = self.mesh.halo.extend(arrays["p_rate"])
        super().load_state(arrays, memory, *args)
