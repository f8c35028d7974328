"""The skeleton: positional finite elements, its own KSP, its own state."""

from functools import cached_property

import numpy as np

from ..clock import at_end
from ..errors import ConvergenceError
from ..fem.domain import Configuration
from ..kernels import exchange, shape
from ..kernels import solid as kernel
from ..kernels.assemble import add_isotropic, mass_matrix
from ..linalg.stopwatch import timed
from ..tensors import det_minus_one
from .loads import body_acceleration
from .residual import Residual
from .tangent import TangentRule
from .transfer import Skeleton

# The residual of a body that turns stays at 0.7 to 2.5 times the round-off of what cancels
# (measured on a slender beam, the beam of the Hron-Turek channel and the ring, both last at 5e-10
# and 5e-11 of the largest force).
TURN = 4
# Least volume ratio of an accepted state from which on it is the deformation that inverts the next
# element, not the step.
STRAINED = 0.5
# λ/μ above which lagged tangents are of no use at large strain: 2ν/(1 - 2ν) at ν = 0.48.
NEARLY_INCOMPRESSIBLE = 24


class SolidPhase:
    """Solve ρ_s a = Div P + pressure + drag + ρ_s b for the positions y = X + u.

    The positions are stored as displacements u = y - X, so that round-off is relative to the
    motion.  Arrays (n_local, d), ghosts included: `u`, `v`, `a` of the accepted level n; `_u1`,
    `_v1`, `_a1` of the trial level n + 1. `force` (n_owned, d) is that on what bounds it at the end
    of the accepted step, `_force0` the collocated one, if they are kept.
    """

    prefix = "solid_"

    def __init__(self, setup):
        """Take a `phases.setup.SolidSetup`: domain, materials, boundary data, options of the model
        and of the solver.
        """
        self._setup = setup
        self.domain = setup.domain
        self.mesh = setup.domain.mesh
        self.stopwatch = setup.stopwatch
        shape = (self.mesh.n_local, self.mesh.dim)
        self.u = np.zeros(shape)
        self.v = np.zeros(shape)
        self.a = np.zeros(shape)
        self._u1, self._v1, self._a1 = self.u.copy(), self.v.copy(), self.a.copy()
        self.force, self._force0 = (np.zeros((self.mesh.n_owned, self.mesh.dim)) for _ in range(2))
        # from the level of _force0 to the accepted end of step [s]; None: no line through it
        self._force_age = None
        self._rule = TangentRule(self.is_linear)
        self._matrix = self._solver = self._configuration = self._own = (
            self._accepted_configuration
        ) = None
        self._before = self.u  # displacement of the iterate before, (n_local, d)
        self._reference = Configuration.reference(self.domain, setup.with_hessian)
        self.assemblies, self.robin_coefficient = 0, 0.0  # α of a Robin condition [Pa s/m]
        self._t_end = 0.0  # of the trial step [s]

    @property
    def setup(self):
        """Return the `phases.setup.SolidSetup`."""
        return self._setup

    @property
    def is_linear(self):
        """Return whether the tangent depends on nothing but the rates."""
        return (
            all(m.elastic.small_strain for m in self._setup.materials.values())
            and not self._setup.moving_mesh
        )

    @property
    def is_stiff_in_volume(self):
        """Return whether the change of volume of a nearly incompressible material at large strain
        limits Newton's iteration.

        A displacement that keeps the volume to first order changes it in the second, and the stress
        with it by λ; of a tangent that is old nothing is left then.
        """
        laws = [material.elastic for material in self._setup.materials.values()]
        return any(law.lam > NEARLY_INCOMPRESSIBLE * law.mu for law in laws if not law.small_strain)

    def set_initial(self, displacement, velocity):
        """Set displacement and velocity at the start, both (n_local, d); what is prescribed comes
        with the first step.

        A boundary that is not where its condition wants it moves there in that step, and the volume
        balance sees it.
        """
        self.u[:] = displacement
        self.v[:] = velocity
        self._accepted_configuration = None
        self.reset()

    # -- one step ----------------------------------------------------------------------------------

    def begin_step(self, scheme, t):
        """Start a step from the accepted level at time t: predictor, essential values and loads of
        the new level.
        """
        self.scheme = scheme
        self._t_end = t + scheme.dt
        self._before = self.u
        t_alpha = t + scheme.alpha_f * scheme.dt
        self._u1 = scheme.predict(self.u, self.v, self.a)
        self._setup.dirichlet.apply(self._u1, t + scheme.dt)
        self._update_rates()
        self._traction = np.zeros((self.mesh.n_owned, self.mesh.dim))
        for load in self._setup.loads:
            load.add_to(self._traction, t_alpha)
        self._body = self._body_vector(t_alpha)

    def _update_rates(self):
        self._v1, self._a1 = self.scheme.rates(self._u1, self.u, self.v, self.a)
        self._configuration = self._own = None

    @property
    def _u_alpha(self):
        return self.u + self.scheme.alpha_f * (self._u1 - self.u)

    @property
    def end_displacement(self):
        """Return u at the end of the trial step, (n_local, d) [m]."""
        return self._u1

    @property
    def velocity(self):
        """Return the velocity on the collocation level, (n_local, d) [m/s]."""
        return self.scheme.velocity_level(self.v, self._v1)

    def skeleton(self):
        """Return what the fluid needs of the trial state; raises ConvergenceError when an element
        is inverted.
        """
        if self._configuration is None:
            self._configuration = self._configuration_at(self._u_alpha)
        return Skeleton(
            self._configuration, self.velocity, self._v1, self._u_alpha, self._setup.moving_mesh
        )

    def skeleton_at(self, u, v):
        """Return the same for a displacement and a velocity, both (n_local, d)."""
        return Skeleton(self._configuration_at(u), v, v, u, self._setup.moving_mesh)

    def accepted_skeleton(self):
        """Return the same for the accepted state."""
        if self._accepted_configuration is None:
            self._accepted_configuration = self._configuration_at(self.u)
        return Skeleton(
            self._accepted_configuration, self.v, self.v, self.u, self._setup.moving_mesh
        )

    def _configuration_at(self, u):
        if not self._setup.moving_mesh:
            return self._reference
        configuration = Configuration.at(
            self.domain, self.mesh.X + u, self._setup.with_hessian, self._inverted
        )
        admissible = np.ones(configuration.J.shape, dtype=bool)
        for region, span in self.domain.region_slices.items():
            admissible[span] = self._setup.materials[region].open_pores(configuration.J[span])
        self.domain.require(admissible, self._compacted)
        return configuration

    def _inverted(self, place):
        return self._overloaded("an element of the {} is inverted", place)

    def _compacted(self, place):
        return self._overloaded("the pores of the {} are closed, J <= n_s0", place)

    def _overloaded(self, what, place):
        """Return the error of an element that is deformed too far; what : with a place for the name
        of the phase (collective).
        """
        found = (
            what.format("skeleton" if self._setup.porous else "solid")
            + f" at t = {self._t_end:g} s, element at {place}"
        )
        before = self.domain.least_volume_ratio(self.u)
        trail = f"the least volume ratio of an element was {before:.2g} at the end of the last step"
        modulus = "compare the loads with the moduli in material.solid, or refine the mesh there"
        if before < STRAINED:
            return ConvergenceError(f"{found}; {trail}", f"a smaller step hardly helps: {modulus}")
        return ConvergenceError(
            f"{found}; {trail}", f"if a smaller step stops at the same time, {modulus}"
        )

    @property
    def unknowns(self):
        """Return the trial displacement on the owned nodes, (n_owned, d) [m]."""
        return self._u1[: self.mesh.n_owned]

    @unknowns.setter
    def unknowns(self, owned):
        self._u1[: self.mesh.n_owned] = owned
        self.mesh.halo.update(self._u1)
        self._update_rates()

    @timed("residual")
    def residual(self, flow):
        """Return the `Residual` of the trial state under the flow's pressure and drag [N]."""
        terms = (
            self._own_terms()
            | self._flow_terms(flow)
            | {
                "body": self._body,
                "traction": -self._traction,
            }
        )
        self._residual = Residual(self.mesh.comm, terms, self._setup.dirichlet.free)
        return self._residual

    def boundary_force(self, residual):
        """Return the force on what bounds the solid, (n_owned, d) [N]: minus the residual without
        given tractions.

        The force of a fluid is part of the residual; where the solid is held it is minus the
        reaction.
        """
        return -sum(term for name, term in residual.terms.items() if name != "traction")

    def _own_terms(self):
        """Return the terms that depend on the skeleton alone; kept until its trial state
        changes.
        """
        if self._own is None:
            domain = self.domain
            setup = self._setup
            u = self._u_alpha
            terms = {
                name: np.zeros(self.unknowns.shape)
                for name in ("stress", "inertia")[: 1 + setup.inertia]
            }
            acceleration = (
                self.scheme.acceleration_level(self.a, self._a1) if setup.inertia else None
            )
            for region, chunk in domain.chunks(self._doubles_per_cell):
                material = setup.materials[region]
                stiffness = domain.reference_stiffness.part(chunk)
                stress = kernel.stress_residual(
                    stiffness.G, stiffness.dV, material.elastic, domain.gather(u, chunk)
                )
                domain.add(terms["stress"], chunk, stress)
                if setup.inertia:
                    N = domain.mass.N
                    dV = domain.reference.dV[chunk]
                    a = domain.gather(acceleration, chunk)
                    domain.add(
                        terms["inertia"], chunk, kernel.inertia_residual(N, dV, material.rho_s, a)
                    )
            self._own = terms
        return self._own

    def _flow_terms(self, flow):
        """Return pressure and drag, or the force of a free fluid."""
        if not self._setup.porous:
            return {"interface": -flow.force}
        domain = self.domain
        configuration = self.skeleton().configuration
        relative = flow.velocity - self.velocity
        terms = {name: np.zeros(self.unknowns.shape) for name in ("pressure", "drag")}
        for region, chunk in domain.chunks(self._doubles_per_cell):
            material = self._setup.materials[region]
            current = configuration.geometry.part(chunk)
            p = domain.gather(flow.pressure, chunk)
            w = domain.gather(relative, chunk)
            vectors = kernel.coupling_residual(
                domain.mass.N, current, material, configuration.J[chunk], p, w
            )
            for nodal, of_elements in zip(terms.values(), vectors, strict=True):
                domain.add(nodal, chunk, of_elements)
        if self._setup.immersed:
            return {"drag": terms["drag"], "interface": -flow.force}
        return terms

    @property
    def _doubles_per_cell(self):
        return (self.domain.cells.shape[1] * self.mesh.dim) ** 2

    def _body_vector(self, t):
        """Return -∫ ρ_s b·w dV0, (n_owned, d); zero without body force."""
        if not self._setup.body_force:
            return np.zeros((self.mesh.n_owned, self.mesh.dim))
        domain = self.domain
        b = body_acceleration(domain, self._setup.body_force, t)
        nodal = np.zeros((self.mesh.n_owned, self.mesh.dim))
        for region, chunk in domain.chunks(self._doubles_per_cell):
            rho_s = self._setup.materials[region].rho_s
            domain.add(
                nodal,
                chunk,
                kernel.body_residual(domain.mass.N, domain.reference.dV[chunk], rho_s, b[chunk]),
            )
        return nodal

    def cancelling(self):
        """Return field -> what cancels inside the stress of a body that turns, (n_owned, 1); its
        round-off remains.

        TURN V E_c g² max |u - ū| of an element of volume V and mean displacement ū, g = Σ_a |∇N_a|,
        in equal parts to its nodes.
        """
        domain = self.domain
        u = self._u_alpha
        summed = np.zeros((self.mesh.n_owned, 1))
        for _, chunk in domain.chunks(self._doubles_per_cell):
            nodal = domain.gather(u, chunk)
            stretch = np.linalg.norm(nodal - nodal.mean(axis=1, keepdims=True), axis=-1).max(
                axis=1, initial=0.0
            )
            force = TURN * self._turning_stiffness[chunk] * stretch / nodal.shape[1]
            domain.add(summed, chunk, np.broadcast_to(force[:, None], nodal.shape[:2]))
        return {"solid momentum": summed}

    @cached_property
    def _turning_stiffness(self):
        """Return V E_c g² of the elements, (E,) [N/m]."""
        domain = self.domain
        values = np.empty(self.domain.n_cells)
        for region, chunk in domain.chunks(self._doubles_per_cell):
            stiffness = domain.reference_stiffness.part(chunk)
            modulus = self._setup.materials[region].elastic.oedometer_modulus
            g = np.linalg.norm(stiffness.G, axis=-1).sum(axis=2).max(axis=1, initial=0.0)
            values[chunk] = stiffness.dV.sum(axis=1) * modulus * g**2
        return values

    def require_orientation(self):
        """Raise ConvergenceError where an element is inverted at the end of the trial step under a
        law for large strain.
        """
        domain = self.domain
        oriented = np.ones((self.domain.n_cells, 1), dtype=bool)
        for region, chunk in domain.chunks(self._doubles_per_cell):
            if not self._setup.materials[region].elastic.small_strain:
                H = kernel.displacement_gradient(
                    domain.reference_stiffness.G[chunk], self._u1[domain.cells[chunk]]
                )
                oriented[chunk, 0] = (det_minus_one(H) > -1).all(axis=1)
        domain.require(oriented, self._inverted)

    def require_stable(self):
        """Raise ConvergenceError where the last tangent of a solid at rest is known to be
        indefinite (collective).

        In a porous solid and with inertia other terms than this tangent's decide.
        """
        if self._setup.is_static and self.solver and self.solver.is_indefinite():
            raise ConvergenceError(
                "the equilibrium of the solid is unstable, its tangent is indefinite:"
                " it buckles before the load is reached",
                "support it, load it less, or follow its motion with model.solid_inertia = true",
            )

    # -- tangent -----------------------------------------------------------------------------------

    def prepare_tangent(self, rates, iterations):
        """Renew the lagged tangent where its rule asks for it; called at the start of a step with
        the last step's iterations.
        """
        if self._rule.due(rates, iterations):
            self._rule.store(rates, {"u": self.u})
            self._assemble(self.u, self.accepted_skeleton().configuration, rates)

    def renew_tangent(self, rates):
        """Assemble the tangent at the trial state (full Newton)."""
        self._rule.forget()
        self._assemble(self._u_alpha, self.skeleton().configuration, rates, self._linear_from)

    def expire_tangent(self):
        """Ask for a new tangent at the start of the next step."""
        self._rule.forget()

    def correct(self, residual):
        """Solve H δ = -residual, (n_owned, d) [N], and add δ to the trial state: one Newton step of
        the block.
        """
        self.add(self.solve(-residual))

    def solve(self, rhs):
        """Return δ with H δ = rhs, both (n_owned, d): [N] to [m] on the collocation level."""
        increment = self._setup.solve(self._solver, rhs)
        return np.where(
            self._setup.mask[: len(increment)], 0.0, increment
        )  # multigrid moves prescribed nodes within its tolerance

    def take_velocity(self, gap):
        """Move the nodes that are told their velocity so that a gap v_s - v on the collocation
        level, (n_local, d), closes.
        """
        n = self.mesh.n_owned
        setup = self._setup
        shift = np.where(setup.driven[:, None] & ~setup.dirichlet.mask, -gap, 0.0)[:n]
        self.add(shift / self.scheme.c_v)

    def add(self, increment):
        """Add an increment on the collocation level, (n_owned, d), to the trial state."""
        self._before = self._u_alpha
        self.unknowns = self.unknowns + increment / self.scheme.alpha_f

    @property
    def _linear_from(self):
        """Return from where the stress in the geometric stiffness is linear, None where it is that
        of the law.
        """
        return self._before if self.is_stiff_in_volume else None

    @timed("assembly")
    def _assemble(self, u, configuration, rates, before=None):
        if not self.domain.n_nodes:
            return
        if self._matrix is None:
            self._matrix = self._setup.new_matrix(self.prefix, self.mesh.dim, self._setup.mask)
        self._matrix.clear()
        for chunk, K in self._element_tangents(u, configuration, rates, self._setup.split, before):
            if self._setup.robin is not None:
                self._setup.robin.add_to(
                    K, self.robin_coefficient * rates.c_v, chunk, self.mesh.dim
                )
            self._matrix.add(chunk, K)
        self._matrix.finish()
        self.assemblies += 1
        if self._solver is None:
            self._solver = self._setup.new_solver(self._matrix)
        self._solver.refactor()

    def _element_tangents(self, u, configuration, rates, split, before=None):
        """Yield (chunk, tangent (E, A, d, A, d)) of a split at u (n_local, d); before : see
        `kernels.solid.stress_tangent`.
        """
        domain = self.domain
        for region, chunk in domain.chunks(self._doubles_per_cell):
            material = self._setup.materials[region]
            stiffness = domain.reference_stiffness.part(chunk)
            fields = [
                None if field is None else domain.gather(field, chunk) for field in (u, before)
            ]
            K = kernel.stress_tangent(stiffness.G, stiffness.dV, material.elastic, *fields)
            weights = self._inertia_weights(material, configuration, chunk, rates, split)
            if weights is not None:
                add_isotropic(K, mass_matrix(domain.mass.N, weights), self.mesh.dim)
            yield chunk, K

    def trial_tangents(self, rates):
        """Yield (chunk, tangent (E, A, d, A, d)) of the trial state on a fixed mesh, without the
        corrected split's terms.
        """
        return self._element_tangents(
            self._u_alpha, self.skeleton().configuration, rates, "plain", self._linear_from
        )

    def drag_tangents(self):
        """Yield (chunk, derivative (E, A, d, A, d + 1) of the residual by v_f and p) of an immersed
        solid.
        """
        configuration = self.skeleton().configuration
        for region, chunk in self.domain.chunks(self._doubles_per_cell):
            S = self._setup.materials[region].drag(configuration.J[chunk])
            yield (
                chunk,
                exchange.solid_by_drag(self.domain.mass.N, configuration.geometry.part(chunk), S),
            )

    def exchange_tangents(self):
        """Yield (chunk, derivative (E, A, d, A, d + 1) of the residual by v_f and p) of the trial
        state.
        """
        configuration = self.skeleton().configuration
        for region, chunk in self.domain.chunks(self._doubles_per_cell):
            material = self._setup.materials[region]
            J = configuration.J[chunk]
            n = material.fluid_fraction(J)
            S = material.drag(J)
            yield (
                chunk,
                exchange.solid_by_flow(
                    self.domain.mass.N, configuration.geometry.part(chunk), n, S
                ),
            )

    def shape_tangents(self, flow):
        """Yield (chunk, derivative (E, A, d, A, d) of the residual by the moving mesh's geometry)
        of the trial state.
        """
        domain = self.domain
        configuration = self.skeleton().configuration
        p = domain.gather(flow.pressure)
        w = domain.gather(flow.velocity - self.velocity)
        for region, chunk in domain.chunks(self._doubles_per_cell):
            material = self._setup.materials[region]
            J = configuration.J[chunk]
            n = material.fluid_fraction(J)
            S = material.drag(J)
            derivatives = shape.VolumeDerivatives(*material.volume_derivatives(J))
            geometry = configuration.geometry.part(chunk)
            yield (
                chunk,
                shape.solid_by_geometry(
                    domain.mass.N, geometry, n, S, derivatives, p[chunk], w[chunk]
                ),
            )

    def _inertia_weights(self, material, configuration, chunk, rates, split):
        """Return the mass of the tangent times dV, (E, Q), None without any.

        Corrected split: ρ_χ c_a, the inertia with the fluid that is dragged along, the drag itself
        as a force.  Plain split (the founding paper's block): ρ_s c_a and the derivative S c_v of
        the drag, or the scaled mass without it.
        """
        dV0 = self.domain.reference.dV[chunk]
        J = configuration.J[chunk]
        dV = configuration.geometry.dV[chunk]
        S = material.drag(J)
        inertia = material.rho_s * rates.c_a * dV0
        if split == "scaled":
            return self._scaled_mass(material, inertia, J, S, dV, rates)
        if split == "plain":
            return inertia + S * rates.c_v * dV
        if not (rates.c_a or rates.c_f):
            return None
        rho_f = material.fluid_fraction(J) * material.rho_fR
        return inertia + rates.moving_inertia(S, 0.0, rho_f) * dV

    def _scaled_mass(self, material, inertia, J, S, dV, rates):
        """Return the tangent's inertia times the factor of the papers' mass scaling, (E, Q).

        "optimal" is 1 + n_s ρ_fR/(n_f ρ_sR) + γ Δt (γ_fR/k_f)/(n_s ρ_sR), with the weights of the
        time schemes c_f c_v/c_a and c_v/c_a instead of 1 and γ Δt: ρ_s c_a + (n_s²/n_f) ρ_fR c_f
        c_v + (S/n_f²) c_v, the exact answer to a compression wave.
        """
        if self._setup.mass_scaling != "optimal":
            return self._setup.mass_scaling * inertia
        n = material.fluid_fraction(J)
        return (
            inertia + ((1 - n) ** 2 / n * material.rho_fR * rates.c_f + S / n**2) * rates.c_v * dV
        )

    @property
    def solver(self):
        """Return the `LinearSolver`, None before the first tangent."""
        return self._solver

    # -- end of a step -----------------------------------------------------------------------------

    def accept(self):
        """Make the trial state the accepted one; raise ConvergenceError, changing nothing, when its
        end is not admissible.
        """
        configuration = self._configuration_at(self._u1)
        self._accepted_configuration = configuration
        self.u, self.v, self.a = self._u1.copy(), self._v1.copy(), self._a1.copy()
        if self._setup.reaction:
            force = self.boundary_force(self._residual)
            self.force = at_end(self.scheme, self._force_age, self._force0, force)
            self._force0 = force
            self._force_age = (1 - self.scheme.alpha_f) * self.scheme.dt

    def reset(self):
        """Forget the trial state."""
        self._u1, self._v1, self._a1 = self.u.copy(), self.v.copy(), self.a.copy()
        self._configuration = self._own = None

    def state(self):
        """Return every array a restart needs, name -> (n_owned, d)."""
        n = self.mesh.n_owned
        forces = (
            {"force": self.force, "force_collocated": self._force0} if self._setup.reaction else {}
        )
        return {"u": self.u[:n], "v": self.v[:n], "a": self.a[:n]} | forces | self._rule.state(n)

    def memory(self):
        """Return the numbers a restart needs beside the arrays."""
        return self._rule.memory() | (
            {"force_age": self._force_age} if self._setup.reaction else {}
        )

    def load_state(self, arrays, memory, rates):
        """Continue from `state` and `memory`; a tangent that fits the rates of the next step is
        made again where it was.
        """
        self.u, self.v, self.a = (self.mesh.halo.extend(arrays[name]) for name in ("u", "v", "a"))
        if self._setup.reaction:
            self.force = arrays["force"]
            self._force0 = arrays["force_collocated"]
            self._force_age = memory["force_age"]
        self._accepted_configuration = None
        self.reset()
        point = self._rule.load(arrays, memory, self.mesh)
        if point is None or self._rule.rates != rates:
            self._rule.forget()
        else:
            u = point.get("u", self.u)
            self._assemble(u, self._configuration_at(u), rates)

    # -- measures ----------------------------------------------------------------------------------

    def energies(self):
        """Return kinetic and elastic energy of the accepted state [J] (collective)."""
        domain = self.domain
        kinetic = np.zeros(domain.n_cells)
        elastic = np.zeros(domain.n_cells)
        for region, chunk in domain.chunks(self._doubles_per_cell):
            material = self._setup.materials[region]
            stiffness = domain.reference_stiffness.part(chunk)
            elastic[chunk] = kernel.stored_energy(
                stiffness.G, stiffness.dV, material.elastic, domain.gather(self.u, chunk)
            )
            speed2 = ((domain.mass.N @ domain.gather(self.v, chunk)) ** 2).sum(axis=-1)
            kinetic[chunk] = (
                0.5 * material.rho_s * (speed2 * domain.reference.dV[chunk]).sum(axis=1)
            )
        return domain.sum_owned(kinetic) if self._setup.inertia else 0.0, domain.sum_owned(elastic)
