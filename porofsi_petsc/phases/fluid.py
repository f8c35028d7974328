"""A fluid: stabilized equal-order velocity and pressure in ALE description, its own KSP, its own
state.
"""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from mpi4py import MPI

from ..clock import Scheme, at_end
from ..conditions import Slope, State
from ..kernels import flow as kernel
from ..kernels.flow_loops import MOMENTUM_TERMS, VOLUME_TERMS
from ..linalg.constrained import BlockMatrix
from ..linalg.low_rank import Coupled, padded
from ..linalg.solver import LinearSolver
from ..linalg.stopwatch import timed
from .block import LinearBlock
from .coupling_data import Flow, MeshState, Rates
from .flow_fields import NodalFlow
from .loads import body_acceleration
from .parameters import StabilizationParameters
from .residual import Residual
from .setup import FluidSetup
from .surface_terms import SurfaceTerms
from .tangent import TangentRule

# change of the volume ratio after which a lagged tangent is renewed within a step
VOLUME_CHANGE = 0.02
BY_VELOCITY = Slope(0.0, 1.0)


class FluidPhase:
    """Solve momentum and volume balance for the phase velocity v_f and the pressure p on the mesh
    that moves with a solid; `PoreFluid` and `FreeFluid` have their own terms.

    Arrays with ghosts: `v`, `a` (n_local, d), `p` (n_local,) at the end of the accepted step;
    `_v1`, `_a1` of the trial step. The pressure has no rate: its unknown `_p1` is the value on the
    collocation level, where the balances hold, and p is what a line through it and the collocated
    value before, `_p0`, takes at the end of the step.  An unknown p at the end of the step would
    carry every error on as (-ρ∞)^n: after a jump of the load it rings, for ρ∞ = 1 for ever.
    """

    prefix = "fluid_"

    def __init__(self, setup: FluidSetup) -> None:
        """Take domain, materials, boundary data, options of the model and of the solver
        (collective).
        """
        self.setup = setup
        self.domain = setup.domain
        self.mesh = setup.domain.mesh
        self.stopwatch = setup.stopwatch
        self.v, self.a = (np.zeros((self.mesh.n_local, self.mesh.dim)) for _ in range(2))
        self.p, self._p0 = np.zeros(self.mesh.n_local), np.zeros(self.mesh.n_local)
        # time from the level of _p0 to the accepted end of step [s]; None: no line through _p0
        self._p0_age: float | None = None
        self._t_alpha = 0.0  # of the collocation level of the trial step [s]
        self._rule = TangentRule(self.is_linear)
        self._parameters = StabilizationParameters(setup)
        self.surfaces = SurfaceTerms(self.mesh.n_owned, self.mesh.dim, setup.surfaces)
        self.block = LinearBlock(setup, self.prefix, setup.solver_mask, self._new_solver)
        self.reset()

    @property
    def is_linear(self) -> bool:
        """Return whether the tangent depends on nothing but the rates."""
        return not (self.setup.convection or self.setup.moving_mesh)

    @property
    def components(self) -> int:
        """Return the unknowns per node in the matrix."""
        return self.setup.mask.shape[1]

    def _new_solver(self, matrix: BlockMatrix) -> LinearSolver:
        raise NotImplementedError

    def set_initial(
        self, velocity: np.ndarray, pressure: np.ndarray | float = 0.0, balanced: bool = False
    ) -> None:
        """Set velocity (n_local, d) and pressure (n_local,) at the start; what is prescribed comes
        with the first step.

        balanced : whether the pressure is that of the loads at 0+; only then it starts the line on
        which p is at the end of a step, else the first one has its collocated value
        """
        self.v[:] = velocity
        self.p[:] = pressure
        self.p[:] = self._p0[:] = self._levelled(self.p)
        self._p0_age = 0.0 if balanced else None
        self.reset()

    # -- one step ----------------------------------------------------------------------------------

    def begin_step(self, scheme: Scheme, rates: Rates, t: float, mesh_state: MeshState) -> None:
        """Start a step from the accepted level at time t and the accepted mesh: predictor,
        essential values, parameters.
        """
        self.scheme = scheme
        self._t_alpha = t + scheme.alpha_f * scheme.dt
        self._t_end = t + scheme.dt
        self._begin(t, mesh_state)
        self._v1 = scheme.predict(self.v, self.a, self.a) if self.setup.inertia else self.v.copy()
        self._p1 = self.p.copy()
        self.setup.velocity.apply(self._v1, t + scheme.dt)
        self._prescribe_pressure(self._p1, self._t_alpha)
        self._update_rates()
        self._mesh_before = mesh_state.displacement
        self.surfaces.begin_step(scheme, self._accepted_state(mesh_state, t))
        b = self.setup.body_force
        self._b = body_acceleration(self.domain, b, self._t_alpha) if b else self._no_body
        self._rates = rates
        self._parameters.update(self.scheme.dt, rates, mesh_state, self.v)

    def _begin(self, t: float, mesh_state: MeshState) -> None:
        """Start what the model has of its own."""

    def _prescribe_pressure(self, p: np.ndarray, t: float) -> None:
        """Set prescribed pressures in a field (n_local,)."""

    def _levelled(self, p: np.ndarray) -> np.ndarray:
        """Return a pressure (n_local,) with its level, where the balances leave it open
        (collective).
        """
        return p

    def _accepted_state(self, mesh_state, t):
        """Return what conditions on surfaces see of the accepted state."""
        return State(t, mesh_state.displacement, self.v, self.v - mesh_state.mesh_velocity, self.p)

    def _update_rates(self):
        if self.setup.inertia:
            self._a1, _ = self.scheme.rates(self._v1, self.v, self.a, self.a)

    def _level(self, old, new):
        return old + self.scheme.alpha_f * (new - old)

    def flow(self) -> Flow:
        """Return what the solid needs of the trial state on the collocation level."""
        return Flow(self._level(self.v, self._v1), self._p1)

    @property
    def unknowns(self) -> np.ndarray:
        """Return the trial velocity (end of step) and pressure (collocation level) on the owned
        nodes, (n_owned, d + 1).
        """
        n = self.mesh.n_owned
        return np.column_stack([self._v1[:n], self._p1[:n]])

    @unknowns.setter
    def unknowns(self, owned: np.ndarray) -> None:
        n = self.mesh.n_owned
        d = self.mesh.dim
        both = np.empty((self.mesh.n_local, d + 1))
        both[:n] = owned
        self.mesh.halo.update(both)
        self._v1 = np.ascontiguousarray(both[:, :d])
        self._p1 = np.ascontiguousarray(both[:, d])
        self._update_rates()

    def follow(self, mesh_state: MeshState) -> None:
        """Give the nodes of no-slip walls the velocity of the solid."""
        wall = self.setup.no_slip
        if self.setup.has_no_slip:
            self._v1[wall] = mesh_state.end_velocity[wall]
            self._update_rates()

    def drag_scale(self, mesh_state: MeshState, rates: Rates) -> np.ndarray | float:
        """Return nodal forces, (n_owned, d) [N], whose round-off the drag has; 0 without any."""
        return 0.0

    def cancelling(self, mesh_state: MeshState, rates: Rates) -> dict[str, np.ndarray]:
        """Return field -> what cancels inside its terms, (n_owned,), whose round-off remains."""
        return {}

    @timed("residual")
    def residual(self, mesh_state: MeshState) -> tuple[Residual, Residual]:
        """Return the `Residual`s of momentum [N] and of the volume balance [m³/s] of the trial
        state on a mesh.
        """
        domain = self.domain
        fields = self._residual_fields(mesh_state)
        nodal = np.zeros((domain.n_owned, kernel.term_columns(domain.dim)))
        for region, chunk in domain.chunks(self._doubles_per_cell):
            elements = self._elements(region, chunk, mesh_state.configuration)
            terms = self._element_terms(chunk)
            kernel.flow_residual(elements, fields.on(chunk), terms)
            domain.add(nodal, chunk, terms)
        momentum, volume = kernel.split_terms(np.asfortranarray(nodal), domain.dim)
        momentum_terms = dict(zip(MOMENTUM_TERMS, momentum, strict=True))
        volume_terms = dict(zip(VOLUME_TERMS, volume[..., None], strict=True))
        self._mesh_state = mesh_state
        self._surface_state = self._state_of(mesh_state, fields)
        momentum_terms["traction"] = self.surfaces.residual(self._surface_state)
        self._add_volume_terms(volume_terms)
        comm = self.mesh.comm
        self._momentum = Residual(comm, momentum_terms, self.setup.velocity_free)
        free = self.setup.pressure_free
        self._volume = Residual(comm, volume_terms, free, self._penalties)
        return self._momentum, self._volume

    def _residual_fields(self, mesh_state):
        return self._trial_fields(mesh_state)

    def _state_of(self, mesh_state, fields):
        """Return what conditions on surfaces see at the time of collocation."""
        v, c, p = (getattr(fields.nodal, name) for name in ("v", "c", "p"))
        return State(self._t_alpha, mesh_state.displacement, v, c, p, v_s=mesh_state.velocity)

    def _add_volume_terms(self, terms: dict[str, np.ndarray]) -> None:
        """Add what the volume balance has beside the terms of the elements (collective)."""

    @property
    def _penalties(self) -> tuple[str, ...]:
        """Return the terms of the volume balance that are penalties."""
        return ()

    def _element_terms(self, chunk):
        """Return room for the terms of the residual of some elements, (E, A,
        `kernel.term_columns`).
        """
        return np.empty(
            (
                chunk.stop - chunk.start,
                self.domain.cells.shape[1],
                kernel.term_columns(self.domain.dim),
            )
        )

    @property
    def _doubles_per_cell(self):
        return (self.domain.cells.shape[1] * self.components) ** 2

    def _acceleration(self):
        if not self.setup.inertia:
            return np.zeros_like(self.v)
        return self.a + self.scheme.alpha_m * (self._a1 - self.a)

    def _trial_fields(self, mesh_state):
        return self._fields(
            mesh_state, self._level(self.v, self._v1), self._acceleration(), self._p1, self._b
        )

    def _fields(self, mesh_state, v, a, p, b):
        c = v - mesh_state.mesh_velocity
        dp = p - self._p0
        return NodalFlow(self.domain, kernel.FlowFields(v, a, c, mesh_state.velocity, p, dp, b))

    @property
    def _no_body(self):
        return np.broadcast_to(
            0.0, (self.domain.n_cells, len(self.domain.mass.weights), self.mesh.dim)
        )

    # -- coefficients ------------------------------------------------------------------------------

    def _elements(self, region, chunk, configuration):
        material = self.setup.material(region, chunk)
        setup = self.setup
        J = configuration.J[chunk]
        stabilization = self._parameters
        second = None
        grad_n = None
        if material.viscosity and configuration.second is not None:
            second = configuration.second.part(chunk)
            grad_n = material.flow_fraction_gradient(J, second)
        return kernel.FlowElements(
            N=self.domain.mass.N,
            geometry=configuration.geometry.part(chunk),
            n=material.flow_fraction(J),
            rho=material.fluid_density(J),
            drag=material.drag(J) if material.resists else None,
            mu=material.viscosity,
            tau=setup.pspg * stabilization.tau[chunk],
            tau_supg=setup.supg * stabilization.tau[chunk],
            nu_lsic=stabilization.nu_lsic[chunk],
            tau_u=None if material.is_free_fluid else stabilization.undrained(chunk),
            second=second,
            grad_n=grad_n,
            convection=setup.convection,
            order=self.domain.element.order,
            free=material.is_free_fluid,
        )

    # -- tangent -----------------------------------------------------------------------------------

    def prepare_tangent(self, rates: Rates, iterations: int, mesh_state: MeshState) -> None:
        """Renew the lagged tangent where its rule asks for it; called after `begin_step`, with the
        accepted mesh.
        """
        if self._rule.due(rates, iterations):
            point = {
                "v": self.v,
                "a": self.a,
                "p": self.p,
                "skeleton_u": mesh_state.displacement,
                "skeleton_v": mesh_state.velocity,
            }
            self._rule.store(rates, point)
            self._assemble(
                mesh_state, rates, self._fields(mesh_state, self.v, self.a, self.p, self._no_body)
            )

    def renew_tangent(self, rates: Rates, mesh_state: MeshState) -> None:
        """Assemble the tangent at the trial state (full Newton)."""
        self._rule.forget()
        self._assemble(mesh_state, rates, self._trial_fields(mesh_state))

    def volume_has_changed(self, mesh_state: MeshState) -> bool:
        """Return whether a volume ratio differs by more than VOLUME_CHANGE from the one in the
        tangent (collective).
        """
        if not self.domain.n_nodes:
            return False
        change = np.abs(mesh_state.configuration.J / self._tangent_J - 1).max(initial=0.0)
        return self.mesh.comm.allreduce(float(change), MPI.MAX) > VOLUME_CHANGE

    def has_switched(self) -> bool:
        """Return whether a unilateral condition acts elsewhere than in the tangent (collective)."""
        return False

    def expire_tangent(self) -> None:
        """Ask for a new tangent at the start of the next step."""
        self._rule.forget()

    def correct(
        self, residuals: tuple[Residual, Residual], on_interface: np.ndarray | None = None
    ) -> None:
        """Solve H δ = -residual and add δ to the trial state: one Newton step of the block.

        on_interface : (n_owned, d) [N] residual of an interface whose velocity is unknown, by a
        Robin condition
        """
        momentum, volume = residuals
        self.add(self.solve(-np.column_stack([momentum.total, volume.total])))

    def solve(self, rhs: np.ndarray) -> np.ndarray:
        """Return δ with H δ = rhs, both (n_owned, d + 1): [N] and [m³/s] to [m/s] and [Pa] on the
        collocation level.
        """
        d = self.mesh.dim
        padded = np.zeros((self.mesh.n_owned, self.components))
        padded[:, : d + 1] = rhs
        return self.block.solve(padded)[:, : d + 1]

    def add(self, increment: np.ndarray) -> None:
        """Add an increment on the collocation level, (n_owned, d + 1), to the trial state."""
        d = self.mesh.dim
        self.unknowns = self.unknowns + np.column_stack(
            [increment[:, :d] / self.scheme.alpha_f, increment[:, d]]
        )
        self._p1 = self._levelled(self._p1)

    @timed("assembly")
    def _assemble(self, mesh_state, rates, fields):
        if not self.domain.n_nodes:
            return
        surfaces = self.surfaces.tangents(self._state_of(mesh_state, fields), BY_VELOCITY)
        self.block.assemble(
            self._block_tangents(mesh_state, rates, fields, surfaces),
            padded(surfaces.coupled, slice(self.mesh.dim), self.components),
        )
        self._tangent_J = mesh_state.configuration.J
        self._prepare_solver(mesh_state, rates, fields)
        self.block.refactor()

    def _block_tangents(self, mesh_state, rates, fields, surfaces):
        """Yield (chunk, tangent (E, A, m, A, m)) of the block at given fields."""
        tangents = self._balance_tangents(mesh_state, rates, fields, surfaces, self.components)
        for region, chunk, elements, K in tangents:
            self._complete(K, elements, region, chunk, mesh_state, rates)
            yield chunk, K

    def _complete(self, K, elements, region, chunk, mesh_state, rates):
        """Add to the tangents of the balances what the block of the model has beside them."""

    def _prepare_solver(self, mesh_state, rates, fields):
        """Make what else the tangent brings with it (collective)."""

    def _balance_tangents(self, mesh_state, rates, fields, surfaces, components):
        """Yield (region, chunk, elements, tangent (E, A, m, A, m)) of the balances, surfaces
        included, for m unknowns per node.
        """
        for region, chunk in self.domain.chunks(self._doubles_per_cell):
            elements = self._elements(region, chunk, mesh_state.configuration)
            K = kernel.flow_tangent(elements, fields.on(chunk), rates.c_f, components)
            surfaces.add_to(K, chunk)
            yield region, chunk, elements, K

    def trial_tangents(
        self, rates: Rates, mesh_state: MeshState
    ) -> Iterator[tuple[slice, np.ndarray]]:
        """Yield (chunk, tangent (E, A, d + 1, A, d + 1)) of the trial state on a fixed mesh, of the
        plain split, without what couples whole surfaces.
        """
        fields = self._trial_fields(mesh_state)
        surfaces = self.surfaces.tangents(self._state_of(mesh_state, fields), BY_VELOCITY)
        m = self.mesh.dim + 1
        for _, chunk, _, K in self._balance_tangents(mesh_state, rates, fields, surfaces, m):
            yield chunk, K

    def coupled(self, mesh_state: MeshState) -> tuple[Coupled, ...]:
        """Return what couples the velocities of whole surfaces in the tangent of the trial state
        (collective).
        """
        fields = self._trial_fields(mesh_state)
        return self.surfaces.tangents(self._state_of(mesh_state, fields), BY_VELOCITY).coupled

    # -- end of a step -----------------------------------------------------------------------------

    def accept(self) -> None:
        """Make the trial state the accepted one (collective)."""
        end = self._end_pressure()
        self.surfaces.accept(self._end_state(end))
        self.v, self.a, self.p = self._v1.copy(), self._a1.copy(), end
        self._p0 = self._p1.copy()
        self._p0_age = (1 - self.scheme.alpha_f) * self.scheme.dt

    def _end_state(self, p):
        """Return what conditions on surfaces see at the end of the trial step."""
        mesh = self._mesh_state
        u = self._mesh_before + (mesh.displacement - self._mesh_before) / self.scheme.alpha_f
        c = self._v1 - mesh.end_velocity if mesh.moving_mesh else self._v1
        return State(self._t_end, u, self._v1, c, p)

    def _end_pressure(self):
        end = self._at_end(self._p0, self._p1)
        self._prescribe_pressure(end, self._t_end)
        return end

    def _at_end(self, before, now):
        """Return a value at the end of the trial step, on the line through the last two collocated
        ones.
        """
        return at_end(self.scheme, self._p0_age, before, now)

    def reset(self) -> None:
        """Forget the trial state."""
        self._v1, self._a1, self._p1 = self.v.copy(), self.a.copy(), self.p.copy()

    def state(self) -> dict[str, np.ndarray]:
        """Return every array a restart needs, name -> (n_owned, ...)."""
        n = self.mesh.n_owned
        fields = {"v": self.v[:n], "a": self.a[:n], "p": self.p[:n], "p_collocated": self._p0[:n]}
        return fields | self._rule.state(n)

    def memory(self) -> dict[str, Any]:
        """Return the numbers a restart needs beside the arrays."""
        return self._rule.memory() | {
            "pressure_age": self._p0_age,
            "surfaces": self.surfaces.memory(),
        }

    def load_state(
        self,
        arrays: dict[str, np.ndarray],
        memory: dict[str, Any],
        scheme: Scheme,
        rates: Rates,
        mesh_state_at: Callable[[np.ndarray, np.ndarray], MeshState],
    ) -> None:
        """Continue from `state` and `memory`; a tangent that fits the rates of the next step is
        made again where it was.

        scheme : of the next step; mesh_state_at(u, v) : the mesh at a displacement and a velocity
        """
        self.v, self.a, self.p, self._p0 = (
            self.mesh.halo.extend(arrays[name]) for name in ("v", "a", "p", "p_collocated")
        )
        self._p0_age = memory["pressure_age"]
        self.surfaces.load(memory.get("surfaces", {}))
        self.reset()
        point = self._rule.load(arrays, memory, self.mesh)
        if point is None or self._rule.rates != rates:
            self._rule.forget()
            return
        self.scheme = scheme
        zero = np.zeros_like(self.v)
        mesh_state = mesh_state_at(point.get("skeleton_u", zero), point.get("skeleton_v", zero))
        v, a, p = (point.get(name, getattr(self, name)) for name in ("v", "a", "p"))
        self._parameters.update(scheme.dt, rates, mesh_state, v)
        self._assemble(mesh_state, rates, self._fields(mesh_state, v, a, p, self._no_body))

    # -- measures ----------------------------------------------------------------------------------

    @property
    def borne_pressure(self) -> np.ndarray:
        """Return the part of the accepted pressure in the total stress, (n_local,) [Pa]."""
        return self.p

    def stored_energy(self, mesh_state: MeshState) -> float:
        """Return the energy of what the pressure compresses in the accepted state [J]."""
        return 0.0

    def kinetic_energy(self, mesh_state: MeshState) -> float:
        """Return ∫ ρ_f |v_f|²/2 of the accepted state [J] (collective)."""
        if not self.setup.inertia:
            return 0.0
        domain = self.domain
        kinetic = np.zeros(domain.n_cells)
        for region, chunk in domain.chunks(self._doubles_per_cell):
            material = self.setup.material(region, chunk)
            J = mesh_state.configuration.J[chunk]
            rho = material.fluid_density(J)
            speed2 = ((domain.mass.N @ domain.gather(self.v, chunk)) ** 2).sum(axis=-1)
            kinetic[chunk] = 0.5 * (rho * speed2 * mesh_state.configuration.geometry.dV[chunk]).sum(
                axis=1
            )
        return domain.sum_owned(kinetic)
