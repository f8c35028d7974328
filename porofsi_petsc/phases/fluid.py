"""The interstitial fluid: stabilized equal-order velocity and pressure in ALE description, its own
KSP, its own state.
"""

from functools import cached_property

import numpy as np
from mpi4py import MPI

from ..clock import at_end
from ..kernels import exchange, shape
from ..kernels import flow as kernel
from ..kernels.solid import displacement_gradient, volumetric_compliance
from ..linalg.dense_block import DenselyCoupled
from ..linalg.stopwatch import timed
from .flow_fields import NodalFlow
from .loads import body_acceleration
from .parameters import StabilizationParameters
from .pressure_operators import PressureOperators
from .residual import Residual
from .tangent import TangentRule
from .transfer import Flow

# change of the volume ratio after which a lagged tangent is renewed within a step
VOLUME_CHANGE = 0.02


class FluidPhase:
    """Solve momentum and volume balance for the phase velocity v_f and the pressure p on the mesh
    that the skeleton carries.

    `force` is that on the boundary of a free fluid at the end of the accepted step, `_force0` the
    collocated one.

    Arrays with ghosts: `v`, `a` (n_local, d), `p` (n_local,) at the end of the accepted step;
    `_v1`, `_a1` of the trial step. The pressure has no rate: its unknown `_p1` is the value on the
    collocation level, where the balances hold, and p is what a line through it and the collocated
    value before, `_p0`, takes at the end of the step.  An unknown p at the end of the step would
    carry every error on as (-ρ∞)^n: after a jump of the load it rings, for ρ∞ = 1 for ever.
    """

    prefix = "fluid_"

    def __init__(self, setup):
        """Take a `phases.setup.FluidSetup`: domain, materials, boundary data, options of the model
        and of the solver.
        """
        self._setup = setup
        self.domain = setup.domain
        self.mesh = setup.domain.mesh
        self.stopwatch = setup.stopwatch
        self.v, self.a = (np.zeros((self.mesh.n_local, self.mesh.dim)) for _ in range(2))
        self.p, self._p0 = np.zeros(self.mesh.n_local), np.zeros(self.mesh.n_local)
        self.force, self._force0 = (np.zeros((self.mesh.n_owned, self.mesh.dim)) for _ in range(2))
        # time from the level of _p0 to the accepted end of step [s]; None: no line through _p0
        self._p0_age = None
        self._rule = TangentRule(self.is_linear)
        self._matrix = self._solver = self._pressure = self._carrying = None
        self._parameters = StabilizationParameters(setup)
        self.robin_coefficient = 0.0  # α of a Robin condition [Pa s/m]
        self.assemblies = 0
        self.reset()

    @property
    def setup(self):
        """Return the `phases.setup.FluidSetup`."""
        return self._setup

    @property
    def is_linear(self):
        """Return whether the tangent depends on nothing but the rates."""
        return not (self._setup.convection or self._setup.moving_mesh)

    @property
    def components(self):
        """Return the unknowns per node in the matrix: v, p and, with inertia in the corrected
        split, the auxiliary field s.
        """
        return self.mesh.dim + 1 + self._setup.has_auxiliary

    def set_initial(self, velocity, pressure=0.0, balanced=False):
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

    def begin_step(self, scheme, rates, t, skeleton):
        """Start a step from the accepted level at time t and the accepted skeleton: predictor,
        essential values, parameters.
        """
        self.scheme = scheme
        t_alpha = t + scheme.alpha_f * scheme.dt
        self._t_end = t + scheme.dt
        for part in self._setup.closed:
            part.begin_step(t, self._t_end)
            if not self._setup.moving_mesh:
                part.require_balanced_data(self._t_end)
        self._v1 = scheme.predict(self.v, self.a, self.a) if self._setup.inertia else self.v.copy()
        self._p1 = self.p.copy()
        self._setup.velocity.apply(self._v1, t + scheme.dt)
        self._setup.pressure.apply(self._p1[:, None], t_alpha)
        self._update_rates()
        self._traction = np.zeros((self.mesh.n_owned, self.mesh.dim))
        self._flux = np.zeros((self.mesh.n_owned, 1))
        for load in self._setup.loads:
            load.add_to(self._traction, t_alpha)
        for load in self._setup.fluxes:
            load.add_to(self._flux, t_alpha)
        b = self._setup.body_force
        self._b = body_acceleration(self.domain, b, t_alpha) if b else self._no_body
        self._rates = rates
        self._parameters.update(self.scheme.dt, rates, skeleton, self.v)
        if self._setup.porous:
            self._weigh_drag(skeleton)

    def _update_rates(self):
        if self._setup.inertia:
            self._a1, _ = self.scheme.rates(self._v1, self.v, self.a, self.a)

    def _level(self, old, new):
        return old + self.scheme.alpha_f * (new - old)

    def flow(self):
        """Return what the solid needs of the trial state on the collocation level."""
        return Flow(self._level(self.v, self._v1), self._p1)

    @property
    def unknowns(self):
        """Return the trial velocity (end of step) and pressure (collocation level) on the owned
        nodes, (n_owned, d + 1).
        """
        n = self.mesh.n_owned
        return np.column_stack([self._v1[:n], self._p1[:n]])

    @unknowns.setter
    def unknowns(self, owned):
        n = self.mesh.n_owned
        d = self.mesh.dim
        both = np.empty((self.mesh.n_local, d + 1))
        both[:n] = owned
        self.mesh.halo.update(both)
        self._v1 = np.ascontiguousarray(both[:, :d])
        self._p1 = np.ascontiguousarray(both[:, d])
        self._update_rates()

    def follow(self, skeleton):
        """Give the nodes of no-slip walls the skeleton's velocity."""
        wall = self._setup.no_slip
        if self._setup.has_no_slip:
            self._v1[wall] = skeleton.end_velocity[wall]
            self._update_rates()

    def unbalanced(self, momentum):
        """Return what the momentum residual adds to the skeleton's, (n_owned, d) [N]; nothing in
        the plain split.

        Their sum is the balance of the mixture, in which the drag cancels.
        """
        return momentum.total if self._setup.split == "corrected" else 0.0

    def drag_scale(self, skeleton, rates):
        """Return the nodal forces S max(|v_f|, c_v |u|), (n_owned, d) [N], whose round-off v_f -
        v_s has; 0 in a free fluid.

        v_s is a difference of displacements, whose digits it loses where a deformed skeleton hardly
        moves any more.
        """
        if not self._setup.porous:
            return 0.0
        n = self.mesh.n_owned
        v_f = self._level(self.v, self._v1)[:n]
        u = skeleton.displacement[:n]
        return self._drag_weight[:, None] * np.maximum(np.abs(v_f), rates.c_v * np.abs(u))

    def cancelling(self, skeleton, rates):
        """Return field -> what cancels inside the terms of a free fluid, (n_owned,); a uniform flow
        has nothing else.

        Per element of volume V, with g = Σ_a |∇N_a| and c = v_f - v_m: V g |v_f| in ∫ q div v and V
        |v_f| (ρ c_f + ρ |c| g + μ g²) in the momentum, each in equal parts to its nodes.
        """
        if self._setup.porous:
            return {}
        domain = self.domain
        v = self._level(self.v, self._v1)
        nodal = np.zeros((self.mesh.n_owned, 2))
        speed, relative = (
            np.linalg.norm(field, axis=-1) for field in (v, v - skeleton.mesh_velocity)
        )
        for region, chunk in domain.chunks(self._doubles_per_cell):
            material = self._setup.materials[region]
            geometry = skeleton.configuration.geometry.part(chunk)
            g = np.linalg.norm(geometry.G, axis=-1).sum(axis=2).max(axis=1, initial=0.0)
            flux = (
                geometry.dV.sum(axis=1)
                * domain.gather(speed, chunk).max(axis=1)
                / domain.cells.shape[1]
            )
            convective = (
                domain.gather(relative, chunk).max(axis=1) * g if self._setup.convection else 0.0
            )
            force = flux * (material.rho_fR * (rates.c_f + convective) + material.viscosity * g**2)
            both = np.column_stack([force, flux * g])[:, None]
            domain.add(nodal, chunk, np.broadcast_to(both, (len(both), domain.cells.shape[1], 2)))
        return dict(zip(("fluid momentum", "volume"), nodal.T, strict=True))

    def force_per_rate(self, rates):
        """Return the least force of a free fluid over the volume flux it goes with, (ρ c_f + μ
        g²)/g [N s/m³] (collective).

        What is left of forces that cancel, as in a fluid at rest under its weight, is a velocity by
        their round-off; g = Σ_a |∇N_a|.  Infinite in a porous medium, where the drag and the
        skeleton resist, too.
        """
        if self._setup.porous:
            return np.inf
        least = np.inf
        for region, span in self.domain.region_slices.items():
            material = self._setup.materials[region]
            g = self._steepness[span]
            least = min(
                least,
                ((material.rho_fR * rates.c_f + material.viscosity * g**2) / g).min(initial=np.inf),
            )
        return self.mesh.comm.allreduce(least, MPI.MIN)

    @cached_property
    def _steepness(self):
        """Return Σ_a |∇N_a| of the elements in the reference configuration, (E,) [1/m]."""
        return np.linalg.norm(self.domain.reference.G, axis=-1).sum(axis=2).max(axis=1, initial=0.0)

    def _weigh_drag(self, skeleton):
        """Set ∫ S dV of the elements of a node, each in equal parts to its nodes, (n_owned,) [N
        s/m].
        """
        domain = self.domain
        drag = np.empty(self.domain.n_cells)
        for region, span in domain.region_slices.items():
            configuration = skeleton.configuration
            drag[span] = (
                self._setup.materials[region].drag(configuration.J[span])
                * configuration.geometry.dV[span]
            ).sum(axis=1)
        self._drag_weight = self._nodal_sum(drag / domain.cells.shape[1])

    def _nodal_sum(self, values):
        """Return the sum of element values (E,) over the elements of a node, (n_owned,)."""
        return self.domain.scatter_add(np.broadcast_to(values[:, None], self.domain.cells.shape))[
            :, 0
        ]

    def drag_along(self, change):
        """Add χ times a change of v_s, (n_local, d) [m/s], to v_f: what the drag does to it while
        the pressure is as it was.

        An exact solution of the block does not see it.  A lagged tangent or an iterative solver
        leaves a part of the right side, which therefore must not hold S Δv_s, up to 1e8 times any
        other force.
        """
        free = ~self._setup.mask[:, : self.mesh.dim]
        self._v1 += np.where(free, self._chi[:, None] * change / self.scheme.alpha_f, 0.0)
        self._update_rates()

    @timed("residual")
    def residual(self, skeleton):
        """Return the `Residual`s of momentum [N] and of the volume balance [m³/s] of the trial
        state on the skeleton.
        """
        domain = self.domain
        fields = self._trial_fields(skeleton)
        if not (
            self._setup.inertia or self._setup.porous
        ):  # nothing else remembers the step before
            self._parameters.update(self.scheme.dt, self._rates, skeleton, fields.nodal.v)
        nodal = np.zeros((domain.n_owned, kernel.term_columns(domain.dim)))
        for region, chunk in domain.chunks(self._doubles_per_cell):
            elements = self._elements(region, chunk, skeleton.configuration)
            terms = self._element_terms(chunk)
            kernel.flow_residual(elements, fields.on(chunk), terms)
            domain.add(nodal, chunk, terms)
        momentum, volume = kernel.split_terms(np.asfortranarray(nodal), domain.dim)
        momentum_terms = dict(zip(kernel.MOMENTUM_TERMS, momentum, strict=True))
        volume_terms = dict(zip(kernel.VOLUME_TERMS, volume[..., None], strict=True))
        momentum_terms["traction"] = -self._traction
        volume_terms["flux"] = self._flux
        for boundary in self._setup.open_boundaries:
            boundary.add_to(
                momentum_terms["traction"], skeleton.displacement, fields.nodal.v, fields.nodal.c
            )
        if self._setup.closed:
            volume_terms["source"] = self._balancing_source(volume_terms)
        comm = self.mesh.comm
        self._momentum = Residual(comm, momentum_terms, self._setup.velocity_free)
        return self._momentum, Residual(comm, volume_terms, self._setup.pressure.free)

    def _balancing_source(self, terms):
        """Return the source in closed parts that takes the net flux of their data, (n_owned, 1)
        [m³/s] (collective).
        """
        source = np.zeros((self.mesh.n_owned, 1))
        for part in self._setup.closed:
            source[:, 0] -= part.net(list(terms.values())) * part.weight
        return source

    def _levelled(self, p):
        """Return a pressure (n_local,) with zero mean in closed parts (collective)."""
        for part in self._setup.closed:
            p = np.where(part.nodes, p - part.mean(p), p)
        return p

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

    def boundary_force(self, momentum):
        """Return the force of a free fluid on what bounds it, (n_owned, d) [N]: minus the residual
        without given tractions.

        Inside it is zero up to the solver's tolerance; on boundary nodes no stress is recovered
        (Gresho, Lee & Sani 1987).
        """
        return -sum(term for name, term in momentum.terms.items() if name != "traction")

    @timed("residual")
    def interface_force(self, skeleton):
        """Return `boundary_force` of the trial state on the interface, (n_owned, d) [N], from the
        elements that touch it.
        """
        domain = self.domain
        force = np.zeros((domain.n_local, domain.dim))
        for region, rows in self._beside_interface.items():
            elements = self._elements(region, rows, skeleton.configuration)
            momentum, _ = kernel.flow_residual(elements, self._trial_fields(skeleton).on(rows))
            np.subtract.at(force, domain.cells[rows], momentum.sum(axis=0))
        return np.where(self._setup.no_slip[:, None], force, 0.0)[: domain.n_owned]

    @cached_property
    def _beside_interface(self):
        """Return region -> rows of the elements that touch the interface."""
        touching = np.flatnonzero(self._setup.no_slip[self.domain.cells].any(axis=1))
        slices = self.domain.region_slices.items()
        return {
            region: touching[(touching >= span.start) & (touching < span.stop)]
            for region, span in slices
        }

    @property
    def _doubles_per_cell(self):
        return (self.domain.cells.shape[1] * self.components) ** 2

    def _acceleration(self):
        if not self._setup.inertia:
            return np.zeros_like(self.v)
        return self.a + self.scheme.alpha_m * (self._a1 - self.a)

    def _trial_fields(self, skeleton):
        return self._fields(
            skeleton, self._level(self.v, self._v1), self._acceleration(), self._p1, self._b
        )

    def _fields(self, skeleton, v, a, p, b):
        c = v - skeleton.mesh_velocity
        dp = p - self._p0
        return NodalFlow(self.domain, kernel.FlowFields(v, a, c, skeleton.velocity, p, dp, b))

    @property
    def _no_body(self):
        return np.broadcast_to(
            0.0, (self.domain.n_cells, len(self.domain.mass.weights), self.mesh.dim)
        )

    # -- coefficients ------------------------------------------------------------------------------

    def _elements(self, region, chunk, configuration):
        material = self._setup.materials[region]
        setup = self._setup
        J = configuration.J[chunk]
        n = material.fluid_fraction(J)
        stabilization = self._parameters
        second = None
        grad_n = None
        if material.viscosity and configuration.second is not None:
            second = configuration.second.part(chunk)
            grad_n = material.fluid_fraction_gradient(J, second)
        return kernel.FlowElements(
            N=self.domain.mass.N,
            geometry=configuration.geometry.part(chunk),
            n=n,
            rho=n * material.rho_fR,
            S=material.drag(J) if material.drag0 else None,
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

    def prepare_tangent(self, rates, iterations, skeleton):
        """Renew the lagged tangent where its rule asks for it; called after `begin_step`, with the
        accepted skeleton.
        """
        if self._rule.due(rates, iterations):
            point = {
                "v": self.v,
                "a": self.a,
                "p": self.p,
                "skeleton_u": skeleton.displacement,
                "skeleton_v": skeleton.velocity,
            }
            self._rule.store(rates, point)
            self._assemble(
                skeleton, rates, self._fields(skeleton, self.v, self.a, self.p, self._no_body)
            )

    def renew_tangent(self, rates, skeleton):
        """Assemble the tangent at the trial state (full Newton)."""
        self._rule.forget()
        self._assemble(skeleton, rates, self._trial_fields(skeleton))

    def volume_has_changed(self, skeleton):
        """Return whether a volume ratio differs by more than VOLUME_CHANGE from the one in the
        tangent (collective).
        """
        if not self.domain.n_nodes:
            return False
        change = np.abs(skeleton.configuration.J / self._tangent_J - 1).max(initial=0.0)
        return self.mesh.comm.allreduce(float(change), MPI.MAX) > VOLUME_CHANGE

    def expire_tangent(self):
        """Ask for a new tangent at the start of the next step."""
        self._rule.forget()

    def correct(self, residuals, on_interface=None):
        """Solve H δ = -residual and add δ to the trial state: one Newton step of the block.

        on_interface : (n_owned, d) [N] residual of an interface whose velocity is unknown, by a
        Robin condition
        """
        momentum, volume = residuals
        force = momentum.total
        if self._setup.robin is not None:
            force = force + np.where(self._setup.released[: len(force)], on_interface, 0.0)
        self.add(self.solve(-np.column_stack([force, volume.total])))

    @property
    def interface_unknowns(self):
        """Return owned nodes and components, (N, 2), of the velocities of an interface that the
        solver finds.
        """
        return np.argwhere(self._setup.released[: self.mesh.n_owned])

    def carry(self, stiffness):
        """Add a dense matrix of the interface's unknowns, rank by rank as in `interface_unknowns`,
        to the tangent (collective).

        stiffness : (N, N) force per velocity [N s/m], the same on every rank; to be given again
        after every assembly
        """
        if self._carrying is None:
            node, component = self.interface_unknowns.T
            numbers = self.domain.numbering[node] * self.components + component
            self._carrying = DenselyCoupled(
                self._matrix.mat, np.concatenate(self.mesh.comm.allgather(numbers))
            )
        self._carrying.assemble(stiffness)
        self._solver.use(self._carrying.mat)

    def solve(self, rhs):
        """Return δ with H δ = rhs, both (n_owned, d + 1): [N] and [m³/s] to [m/s] and [Pa] on the
        collocation level.
        """
        n = self.mesh.n_owned
        d = self.mesh.dim
        padded = np.zeros((n, self.components))
        padded[:, : d + 1] = rhs
        increment = self._setup.solve(self._solver, padded)
        return np.where(self._setup.solver_mask[:n], 0.0, increment)[
            :, : d + 1
        ]  # see `SolidPhase.solve`

    def add(self, increment):
        """Add an increment on the collocation level, (n_owned, d + 1), to the trial state."""
        d = self.mesh.dim
        self.unknowns = self.unknowns + np.column_stack(
            [increment[:, :d] / self.scheme.alpha_f, increment[:, d]]
        )
        self._p1 = self._levelled(self._p1)

    @timed("assembly")
    def _assemble(self, skeleton, rates, fields):
        if not self.domain.n_nodes:
            return
        if self._matrix is None:
            self._matrix = self._setup.new_matrix(
                self.prefix, self.components, self._setup.solver_mask
            )
        self._matrix.clear()
        for chunk, K in self._element_tangents(
            skeleton, rates, fields, self._setup.split, self.components
        ):
            if self._setup.robin is not None:
                self._setup.robin.add_to(K, self.robin_coefficient, chunk, self.mesh.dim)
            self._matrix.add(chunk, K)
        self._matrix.finish()
        self._tangent_J = skeleton.configuration.J
        if self._setup.porous:
            self._chi = self.dragged_fraction(skeleton, rates)
        self.assemblies += 1
        if self._solver is None:
            self._make_solver()
        if self._pressure is not None:
            self._assemble_pressure(skeleton, rates, fields)
        self._solver.refactor()

    def _make_solver(self):
        """Make the KSP, and what preconditions the pressure of a free fluid where the KSP has a
        place for it.
        """
        pressure = PressureOperators(self._setup) if self._setup.has_pressure_operators else None
        self._solver = self._setup.new_solver(
            self._matrix, self.components, pressure and pressure.preconditioner
        )
        self._pressure = pressure if self._solver.preconditioned_by_object else None

    def _assemble_pressure(self, skeleton, rates, fields):
        """Make the operators that precondition the pressure at the state of the tangent."""
        speed = np.linalg.norm(fields.nodal.c[self.domain.holds], axis=-1).max(initial=0.0)
        speed = self.mesh.comm.allreduce(float(speed), MPI.MAX)
        diagonal = self._matrix.mat.getDiagonal().getArray()[self.mesh.dim :: self.components]

        def chunks():
            for region, chunk in self.domain.chunks(self._doubles_per_cell):
                yield chunk, self._elements(region, chunk, skeleton.configuration), fields.on(chunk)

        self._pressure.assemble(chunks, rates.c_f, speed, self.robin_coefficient, diagonal)

    def _element_tangents(self, skeleton, rates, fields, split, components):
        """Yield (chunk, tangent (E, A, m, A, m)) of a split at given fields, for m unknowns per
        node.
        """
        for region, chunk in self.domain.chunks(self._doubles_per_cell):
            elements = self._elements(region, chunk, skeleton.configuration)
            part = fields.on(chunk)
            K = kernel.flow_tangent(elements, part, rates.c_f, components)
            if split == "corrected":
                self._add_skeleton_answer(
                    K, elements, self._setup.materials[region], skeleton, rates, chunk
                )
            for boundary in self._setup.open_boundaries:
                boundary.add_tangent(
                    K, chunk, skeleton.displacement, fields.nodal.v, fields.nodal.c
                )
            yield chunk, K

    def trial_tangents(self, rates, skeleton):
        """Yield (chunk, tangent (E, A, d + 1, A, d + 1)) of the trial state on a fixed mesh, of the
        plain split.
        """
        return self._element_tangents(
            skeleton, rates, self._trial_fields(skeleton), "plain", self.mesh.dim + 1
        )

    def exchange_tangents(self, rates, skeleton):
        """Yield (chunk, derivative (E, A, d + 1, A, d) of the residuals by the skeleton's
        positions) of the trial state.
        """
        fields = self._trial_fields(skeleton)
        moving = skeleton.moving_mesh
        for region, chunk in self.domain.chunks(self._doubles_per_cell):
            elements = self._elements(region, chunk, skeleton.configuration)
            yield chunk, exchange.flow_by_skeleton(elements, fields.on(chunk), rates.c_v, moving)

    def drag_tangents(self, rates, skeleton):
        """Yield (chunk, derivative (E, A, d + 1, A, d) of a free fluid's residuals by the skeleton
        it flows through).
        """
        fields = self._trial_fields(skeleton)
        for region, chunk in self.domain.chunks(self._doubles_per_cell):
            if self._setup.materials[region].drag0:
                elements = self._elements(region, chunk, skeleton.configuration)
                yield chunk, exchange.flow_by_drag(elements, fields.on(chunk), rates.c_v)

    def mesh_tangents(self, rates, skeleton):
        """Yield (chunk, derivative (E, A, d + 1, A, d) of a free fluid's residuals by its mesh) of
        the trial state.
        """
        fields = self._trial_fields(skeleton)
        for region, chunk in self.domain.chunks(self._doubles_per_cell):
            elements = self._elements(region, chunk, skeleton.configuration)
            part = fields.on(chunk)
            yield (
                chunk,
                shape.flow_by_geometry(elements, part, None)
                + exchange.flow_by_mesh_velocity(elements, part, rates.c_v),
            )

    def shape_tangents(self, skeleton):
        """Yield (chunk, derivative (E, A, d + 1, A, d) of the residuals by the moving mesh's
        geometry) of the trial state.
        """
        domain = self.domain
        fields = self._trial_fields(skeleton)
        for region, chunk in domain.chunks(self._doubles_per_cell):
            elements = self._elements(region, chunk, skeleton.configuration)
            J = skeleton.configuration.J[chunk]
            derivatives = shape.VolumeDerivatives(
                *self._setup.materials[region].volume_derivatives(J)
            )
            yield chunk, shape.flow_by_geometry(elements, fields.on(chunk), derivatives)

    def dragged_fraction(self, skeleton, rates):
        """Return χ, the part of the fluid that the drag carries along, (n_local,): the mean of a
        node's elements (collective).
        """
        domain = self.domain
        chi = np.empty(domain.n_cells)
        for region, span in domain.region_slices.items():
            material = self._setup.materials[region]
            J = skeleton.configuration.J[span]
            rho = material.fluid_fraction(J) * material.rho_fR
            chi[span] = rates.dragged_fraction(material.drag(J), rho).mean(axis=1)
        return self.mesh.halo.extend(self._nodal_sum(chi) / self._nodal_sum(np.ones_like(chi)))

    def _add_skeleton_answer(self, values, elements, material, skeleton, rates, chunk):
        """Add the inertia-aware fixed-stress term; α = n_s + χ n_f is the part of the pressure
        gradient the skeleton feels.
        """
        chi = rates.dragged_fraction(elements.S, elements.rho)
        alpha2_cv = (1 - elements.n + chi * elements.n) ** 2 * rates.c_v
        inertia = (
            rates.moving_inertia(elements.S, material.rho_s, elements.rho)
            if self._setup.has_auxiliary
            else 1.0
        )
        H = displacement_gradient(
            self.domain.reference.G[chunk], self.domain.gather(skeleton.displacement, chunk)
        )
        compliance = volumetric_compliance(material.elastic, H)
        kernel.add_skeleton_answer(values, elements, alpha2_cv * compliance, alpha2_cv / inertia)
        if self._setup.has_auxiliary:
            rows, terms = self._setup.free_surface
            here = (rows >= chunk.start) & (rows < chunk.stop)
            kernel.add_free_surface(
                values, alpha2_cv / inertia, rows[here] - chunk.start, terms[here]
            )

    @property
    def solver(self):
        """Return the `LinearSolver`, None before the first tangent."""
        return self._solver

    # -- end of a step -----------------------------------------------------------------------------

    def accept(self):
        """Make the trial state the accepted one."""
        if not self._setup.porous:
            force = self.boundary_force(self._momentum)
            self.force = self._at_end(self._force0, force)
            self._force0 = force
        self.v, self.a, self.p = self._v1.copy(), self._a1.copy(), self._end_pressure()
        self._p0 = self._p1.copy()
        self._p0_age = (1 - self.scheme.alpha_f) * self.scheme.dt

    def _end_pressure(self):
        end = self._at_end(self._p0, self._p1)
        self._setup.pressure.apply(end[:, None], self._t_end)
        return end

    def _at_end(self, before, now):
        """Return a value at the end of the trial step, on the line through the last two collocated
        ones.
        """
        return at_end(self.scheme, self._p0_age, before, now)

    def reset(self):
        """Forget the trial state."""
        self._v1, self._a1, self._p1 = self.v.copy(), self.a.copy(), self.p.copy()

    def state(self):
        """Return every array a restart needs, name -> (n_owned, ...)."""
        n = self.mesh.n_owned
        forces = (
            {} if self._setup.porous else {"force": self.force, "force_collocated": self._force0}
        )
        fields = {"v": self.v[:n], "a": self.a[:n], "p": self.p[:n], "p_collocated": self._p0[:n]}
        return fields | forces | self._rule.state(n)

    def memory(self):
        """Return the numbers a restart needs beside the arrays."""
        return self._rule.memory() | {"pressure_age": self._p0_age}

    def load_state(self, arrays, memory, scheme, rates, skeleton_at):
        """Continue from `state` and `memory`; a tangent that fits the rates of the next step is
        made again where it was.

        scheme : of the next step; skeleton_at(u, v) : `SolidPhase.skeleton_at`.
        """
        self.v, self.a, self.p, self._p0 = (
            self.mesh.halo.extend(arrays[name]) for name in ("v", "a", "p", "p_collocated")
        )
        self._p0_age = memory["pressure_age"]
        if not self._setup.porous:
            self.force = arrays["force"]
            self._force0 = arrays["force_collocated"]
        self.reset()
        point = self._rule.load(arrays, memory, self.mesh)
        if point is None or self._rule.rates != rates:
            self._rule.forget()
            return
        self.scheme = scheme
        zero = np.zeros_like(self.v)
        skeleton = skeleton_at(point.get("skeleton_u", zero), point.get("skeleton_v", zero))
        v, a, p = (point.get(name, getattr(self, name)) for name in ("v", "a", "p"))
        self._parameters.update(scheme.dt, rates, skeleton, v)
        self._assemble(skeleton, rates, self._fields(skeleton, v, a, p, self._no_body))

    # -- measures ----------------------------------------------------------------------------------

    def kinetic_energy(self, skeleton):
        """Return ∫ ρ_f |v_f|²/2 of the accepted state [J] (collective)."""
        if not self._setup.inertia:
            return 0.0
        domain = self.domain
        kinetic = np.zeros(domain.n_cells)
        for region, chunk in domain.chunks(self._doubles_per_cell):
            material = self._setup.materials[region]
            J = skeleton.configuration.J[chunk]
            rho = material.fluid_fraction(J) * material.rho_fR
            speed2 = ((domain.mass.N @ domain.gather(self.v, chunk)) ** 2).sum(axis=-1)
            kinetic[chunk] = 0.5 * (rho * speed2 * skeleton.configuration.geometry.dV[chunk]).sum(
                axis=1
            )
        return domain.sum_owned(kinetic)
