"""A solid: positional finite elements, its own KSP, its own state."""

from collections.abc import Iterator
from functools import cached_property
from math import inf
from typing import Any

import numpy as np

from ..clock import Scheme
from ..conditions import Slope, State
from ..errors import ConvergenceError
from ..fem.domain import Configuration
from ..kernels import solid as kernel
from ..kernels.assemble import add_mass
from ..linalg.low_rank import Coupled
from ..linalg.stopwatch import timed
from ..materials.elastic import ElasticLaw
from ..tensors import det_minus_one
from .block import LinearBlock
from .coupling_data import Flow, MeshState, Rates
from .fading import FadingForce
from .internal import InternalVariables
from .kept_force import KeptForce
from .line_search import shorten
from .loads import body_acceleration
from .residual import Residual
from .setup import SolidSetup
from .surface_terms import SurfaceTerms
from .tangent import TangentRule

# The residual of a body that turns stays at 0.7 to 2.5 times the round-off of what cancels
# (measured on a slender beam, the beam of the Hron-Turek channel and the ring, both last at 5e-10
# and 5e-11 of the largest force).
TURN = 4
# Least volume ratio of an accepted state from which on it is the deformation that inverts the next
# element, not the step.
STRAINED = 0.5
# λ/μ above which lagged tangents are of no use at large strain: 2ν/(1 - 2ν) at ν = 0.48.
NEARLY_INCOMPRESSIBLE = 24
# Size of the displacement gradient beyond which a plastic law for small strain has lost its way:
# the round-off of displacements without end would pass for equilibrium.
ASTRAY = 10


class SolidPhase:
    """Solve ρ_s a = Div P + force of the fluid + ρ_s b for the positions y = X + u; `Skeleton` and
    `ElasticSolid` say what the fluid's force is.

    The positions are stored as displacements u = y - X, so that round-off is relative to the
    motion.  Arrays (n_local, d), ghosts included: `u`, `v`, `a` of the accepted level n; `_u1`,
    `_v1`, `_a1` of the trial level n + 1.
    """

    prefix = "solid_"
    noun = "solid"  # in messages

    def __init__(self, setup: SolidSetup, with_hessian: bool = False) -> None:
        """Take domain, materials, boundary data, options of the model and of the solver
        (collective).

        with_hessian : whether the fluid wants second derivatives on this mesh
        """
        self.setup = setup
        self.domain = setup.domain
        self.mesh = setup.domain.mesh
        self.stopwatch = setup.stopwatch
        shape = (self.mesh.n_local, self.mesh.dim)
        self.u = np.zeros(shape)
        self.v = np.zeros(shape)
        self.a = np.zeros(shape)
        self._u1, self._v1, self._a1 = self.u.copy(), self.v.copy(), self.a.copy()
        self.internal = InternalVariables(self.domain, self._laws, setup.initial_stress)
        self._rule = TangentRule(self.is_linear)
        self._configuration: Configuration | None = None
        self._accepted_configuration: Configuration | None = None
        self._own: dict[str, np.ndarray] | None = None
        self._before = self.u  # displacement of the iterate before, (n_local, d)
        self._with_hessian = with_hessian
        self._reference = Configuration.reference(self.domain, with_hessian)
        self._elastic = False  # whether no law is plastic until the trial state changes
        self._t_end = self._t_alpha = 0.0  # of the trial step and its collocation level [s]
        self.surfaces = SurfaceTerms(self.mesh.n_owned, self.mesh.dim, setup.surfaces)
        self.kept = KeptForce(self.mesh.n_owned, self.mesh.dim)
        span = setup.fading
        self.fading = FadingForce(span, self.mesh.n_owned, self.mesh.dim) if span else None
        constraints = setup.dirichlet.constraints
        self.block = LinearBlock(setup, self.prefix, setup.mask, setup.new_solver, constraints)

    @property
    def is_linear(self) -> bool:
        """Return whether the tangent depends on nothing but the rates."""
        return (
            all(law.small_strain for law in self._laws.values())
            and not self.is_plastic
            and not self.setup.moving_mesh
            and not self.setup.has_followers
        )

    @property
    def is_plastic(self) -> bool:
        """Return whether a law is plastic: none of its tangents is of use for a next iteration."""
        return any(law.plastic for law in self._laws.values())

    @property
    def is_stiff_in_volume(self) -> bool:
        """Return whether the change of volume of a nearly incompressible material at large strain
        limits Newton's iteration.

        A displacement that keeps the volume to first order changes it in the second, and the stress
        with it by λ; of a tangent that is old nothing is left then.
        """
        return any(
            law.largest_ratio > NEARLY_INCOMPRESSIBLE
            for law in self._laws.values()
            if not law.small_strain
        )

    @property
    def _laws(self) -> dict[str, ElasticLaw]:
        """Return region -> elastic law."""
        return self.setup.laws

    def set_initial(self, displacement: np.ndarray, velocity: np.ndarray) -> None:
        """Set displacement and velocity at the start, both (n_local, d); what is prescribed comes
        with the first step.

        A boundary that is not where its condition wants it moves there in that step, and the volume
        balance sees it.
        """
        self.u[:] = displacement
        self.v[:] = velocity
        if self.internal:  # at rest where it is
            self.internal.accept(self.u, inf, self._doubles_per_cell)
        self._accepted_configuration = None
        self.reset()

    # -- one step ----------------------------------------------------------------------------------

    def begin_step(self, scheme: Scheme, t: float) -> None:
        """Start a step from the accepted level at time t: predictor, essential values and loads of
        the new level.
        """
        self.scheme = scheme
        self._t_end = t + scheme.dt
        self._before = self.u
        self._t_alpha = t + scheme.alpha_f * scheme.dt
        self._u1 = scheme.predict(self.u, self.v, self.a)
        self.setup.dirichlet.apply(self._u1, t + scheme.dt)
        self._update_rates()
        self.surfaces.begin_step(scheme, State(t, self.u, self.v))
        self._body = self._body_vector(self._t_alpha)

    @property
    def _surface_state(self):
        """Return what conditions on surfaces see of the trial state."""
        return State(self._t_alpha, self._u_alpha, self.velocity)

    def _update_rates(self):
        self._v1, self._a1 = self.scheme.rates(self._u1, self.u, self.v, self.a)
        self._configuration = self._own = None
        self._elastic = False

    @property
    def _u_alpha(self):
        return self.u + self.scheme.alpha_f * (self._u1 - self.u)

    @property
    def end_displacement(self) -> np.ndarray:
        """Return u at the end of the trial step, (n_local, d) [m]."""
        return self._u1

    @property
    def velocity(self) -> np.ndarray:
        """Return the velocity on the collocation level, (n_local, d) [m/s]."""
        return self.scheme.velocity_level(self.v, self._v1)

    @property
    def configuration(self) -> Configuration:
        """Return the configuration of the trial state; raises ConvergenceError when an element is
        inverted.
        """
        if self._configuration is None:
            self._configuration = self._configuration_at(self._u_alpha)
        return self._configuration

    @property
    def accepted_configuration(self) -> Configuration:
        """Return the configuration of the accepted state."""
        if self._accepted_configuration is None:
            self._accepted_configuration = self._configuration_at(self.u)
        return self._accepted_configuration

    def mesh_state(self) -> MeshState:
        """Return what the fluid needs of the trial state; raises ConvergenceError when an element
        is inverted.
        """
        return self._carrier(self.configuration, self.velocity, self._v1, self._u_alpha)

    def mesh_state_at(self, u: np.ndarray, v: np.ndarray) -> MeshState:
        """Return the same for a displacement and a velocity, both (n_local, d)."""
        return self._carrier(self._configuration_at(u), v, v, u)

    def accepted_mesh_state(self) -> MeshState:
        """Return the same for the accepted state."""
        return self._carrier(self.accepted_configuration, self.v, self.v, self.u)

    def _carrier(self, configuration, velocity, end_velocity, displacement):
        moving = self.setup.moving_mesh
        return MeshState(configuration.of_fluid, velocity, end_velocity, displacement, moving)

    def _configuration_at(self, u):
        if not self.setup.moving_mesh:
            return self._reference
        configuration = Configuration.at(
            self.domain, self.mesh.X + u, self._with_hessian, self._inverted
        )
        admissible = np.ones(configuration.J.shape, dtype=bool)
        for region, span in self.domain.region_slices.items():
            admissible[span] = self.setup.material(region, span).open_pores(configuration.J[span])
        self.domain.require(admissible, self._compacted)
        return configuration

    def _inverted(self, place):
        return self._overloaded("an element of the {} is inverted", place)

    def _compacted(self, place):
        return self._overloaded("the pores of the {} are closed, J <= n_s0", place)

    def _collapsed(self, place):
        return ConvergenceError(
            f"the plastic flow of the {self.noun} has no end at t = {self._t_end:g} s, element at"
            f" {place}",
            "if smaller steps end at the same load, this is the collapse load: load it less, or"
            " prescribe displacements",
        )

    def _overloaded(self, what, place):
        """Return the error of an element that is deformed too far; what : with a place for the name
        of the phase (collective).
        """
        found = what.format(self.noun) + f" at t = {self._t_end:g} s, element at {place}"
        before = self.domain.least_volume_ratio(self.u)
        trail = f"the least volume ratio of an element was {before:.2g} at the end of the last step"
        modulus = "compare the loads with the moduli in material.solid, or refine the mesh there"
        if before < STRAINED:
            return ConvergenceError(f"{found}; {trail}", f"a smaller step hardly helps: {modulus}")
        return ConvergenceError(
            f"{found}; {trail}", f"if a smaller step stops at the same time, {modulus}"
        )

    @property
    def unknowns(self) -> np.ndarray:
        """Return the trial displacement on the owned nodes, (n_owned, d) [m]."""
        return self._u1[: self.mesh.n_owned]

    @unknowns.setter
    def unknowns(self, owned: np.ndarray) -> None:
        self._u1[: self.mesh.n_owned] = owned
        self.mesh.halo.update(self._u1)
        self._update_rates()

    @timed("residual")
    def residual(self, flow: Flow) -> Residual:
        """Return the `Residual` of the trial state under the force of the flow [N]."""
        terms = self._own_terms() | self._flow_terms(flow)
        state = self._surface_state._replace(p=flow.pressure)
        terms |= {"body": self._body, "traction": self.surfaces.residual(state)}
        self._residual = Residual(self.mesh.comm, terms, self.setup.dirichlet.free)
        return self._residual

    def elastic_residual(self, flow: Flow) -> Residual:
        """Return the residual of a trial state that is reached without plastic flow, from which the
        first iteration of a step sets out; tangents are the elastic ones until that state changes.

        A boundary that is moved strains the elements there alone, far beyond the yield stress, and
        with what is left of their stress and stiffness Newton's method leads anywhere.
        """
        self._own = None
        self._elastic = True
        return self.residual(flow)

    @property
    def force(self) -> np.ndarray:
        """Return the force on what bounds the solid at the end of the accepted step, (n_owned, d)
        [N], if it is kept: minus the residual without given tractions.

        The force of a fluid is part of the residual; where the solid is held it is minus the
        reaction.
        """
        return self.kept.end

    def _flow_terms(self, flow: Flow) -> dict[str, np.ndarray]:
        """Return what the fluid does to the solid, name -> (n_owned, d) [N]."""
        raise NotImplementedError

    def _coupling_terms(self, flow):
        """Return the pressure and the drag of a fluid in the pores, name -> (n_owned, d) [N]."""
        domain = self.domain
        configuration = self.configuration
        relative = flow.velocity - self.velocity
        terms = {name: np.zeros(self.unknowns.shape) for name in ("pressure", "drag")}
        for region, chunk in domain.chunks(self._doubles_per_cell):
            material = self.setup.material(region, chunk)
            if not material.has_pores:
                continue
            current = configuration.geometry.part(chunk)
            p = domain.gather(flow.pressure, chunk)
            w = domain.gather(relative, chunk)
            vectors = kernel.coupling_residual(
                domain.mass.N, current, material, configuration.J[chunk], p, w
            )
            for nodal, of_elements in zip(terms.values(), vectors, strict=True):
                domain.add(nodal, chunk, of_elements)
        return terms

    def _own_terms(self):
        """Return the terms that depend on the skeleton alone; kept until its trial state
        changes.
        """
        if self._own is None:
            domain = self.domain
            setup = self.setup
            u = self._u_alpha
            terms = {
                name: np.zeros(self.unknowns.shape)
                for name in ("stress", "inertia")[: 1 + setup.inertia]
            }
            acceleration = (
                self.scheme.acceleration_level(self.a, self._a1) if setup.inertia else None
            )
            for region, chunk in domain.chunks(self._doubles_per_cell):
                material = setup.material(region, chunk)
                stiffness = domain.reference_stiffness.part(chunk)
                nodal = domain.displacement(u, chunk)
                law = self._collocated_law(material.elastic, chunk)
                stress = kernel.stress_residual(
                    stiffness.G, stiffness.dV, law, nodal, stiffness.hoop
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

    def _collocated_law(self, law, chunk):
        """Return the law of some elements on the collocation level."""
        if law.plastic and self._elastic:
            law = law.unyielding
        duration = self.scheme.alpha_f * self.scheme.duration if self.internal else 0.0
        return self.internal.law(law, chunk, duration)

    @property
    def _doubles_per_cell(self):
        return (self.domain.cells.shape[1] * self.mesh.dim) ** 2

    def _body_vector(self, t):
        """Return -∫ ρ_s b·w dV0, minus the concentrated loads and minus what fades, (n_owned, d);
        zero without.
        """
        nodal = np.zeros((self.mesh.n_owned, self.mesh.dim))
        for load in self.setup.loads:
            load.add_to(nodal, t)
        nodal *= -1
        if self.fading:
            nodal -= self.fading.at(t)
        if not self.setup.body_force:
            return nodal
        domain = self.domain
        b = body_acceleration(domain, self.setup.body_force, t)
        for region, chunk in domain.chunks(self._doubles_per_cell):
            rho_s = self.setup.material(region, chunk).rho_s
            domain.add(
                nodal,
                chunk,
                kernel.body_residual(domain.mass.N, domain.reference.dV[chunk], rho_s, b[chunk]),
            )
        return nodal

    def cancelling(self) -> dict[str, np.ndarray]:
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
            modulus = self.setup.material(region, chunk).elastic.oedometer_modulus
            g = np.linalg.norm(stiffness.G, axis=-1).sum(axis=2).max(axis=1, initial=0.0)
            values[chunk] = stiffness.dV.sum(axis=1) * np.ravel(modulus) * g**2
        return values

    def require_orientation(self) -> None:
        """Raise ConvergenceError where at the end of the trial step an element is inverted under a
        law for large strain, or a plastic flow has no end.
        """
        domain = self.domain
        oriented = np.ones((self.domain.n_cells, 1), dtype=bool)
        bounded = oriented.copy()
        for region, chunk in domain.chunks(self._doubles_per_cell):
            law = self._laws[region]
            if law.plastic or not law.small_strain:
                stiffness = domain.reference_stiffness.part(chunk)
                H = kernel.displacement_gradient(
                    stiffness.G, domain.displacement(self._u1, chunk), stiffness.hoop
                )
                if law.plastic:
                    bounded[chunk, 0] = np.abs(H).max(axis=(1, 2, 3), initial=0.0) < ASTRAY
                else:
                    oriented[chunk, 0] = (det_minus_one(H) > -1).all(axis=1)
        domain.require(oriented, self._inverted)
        domain.require(bounded, self._collapsed)

    def require_stable(self) -> None:
        """Raise ConvergenceError where the last tangent is known to be indefinite and nothing else
        decides the stability (collective).
        """
        solver = self.block.solver
        if self.setup.is_static and solver and solver.is_indefinite():
            raise ConvergenceError(
                "the equilibrium of the solid is unstable, its tangent is indefinite:"
                " it buckles before the load is reached",
                "support it, load it less, or follow its motion with model.solid_inertia = true",
            )

    # -- tangent -----------------------------------------------------------------------------------

    def prepare_tangent(self, rates: Rates, iterations: int) -> None:
        """Renew the lagged tangent where its rule asks for it; called at the start of a step with
        the last step's iterations.
        """
        if self._rule.due(rates, iterations):
            point = {"u": self.u} | ({"v": self.v} if self.surfaces.places else {})
            self._rule.store(rates, point)
            self._assemble(self.u, self.v, self.accepted_configuration, rates)

    def renew_tangent(self, rates: Rates) -> None:
        """Assemble the tangent at the trial state (full Newton)."""
        self._rule.forget()
        configuration = self.configuration
        self._assemble(self._u_alpha, self.velocity, configuration, rates, self._linear_from)

    def expire_tangent(self) -> None:
        """Ask for a new tangent at the start of the next step."""
        self._rule.forget()

    def correct(self, residual: np.ndarray) -> None:
        """Solve H δ = -residual, (n_owned, d) [N], and add δ to the trial state: one Newton step of
        the block; of a plastic flow the part of it that a line search leaves.
        """
        searched = self.is_plastic and not self._elastic
        own = self._own_force if searched else 0.0
        increment = self._flowing_step(-residual) if searched else self.solve(-residual)
        self.add(increment)
        if searched:
            shorten(
                self._work(increment, residual),
                lambda: self._work(increment, residual - own + self._own_force),
                lambda part: self.add(part * increment),
            )

    def _flowing_step(self, rhs):
        """Return H⁻¹ rhs of a plastic flow; where H is singular, say what that means."""
        try:
            return self.solve(rhs)
        except ConvergenceError as error:
            raise ConvergenceError(
                f"the {self.noun} flows as a whole, its tangent has no inverse ({error.what})",
                "take smaller steps (time.step): the first one is at most a tenth of what the body"
                " can bear; beyond its collapse load no step helps",
            ) from error

    @property
    def _own_force(self):
        """Return the sum of the terms of the solid alone in the trial state, (n_owned, d) [N]."""
        return sum(self._own_terms().values())

    def _work(self, increment, residual):
        """Return δ·R [J] (collective)."""
        free = self.setup.dirichlet.free(residual)
        return self.mesh.comm.allreduce(float(np.vdot(increment, free)))

    def solve(self, rhs: np.ndarray) -> np.ndarray:
        """Return δ with H δ = rhs, both (n_owned, d): [N] to [m] on the collocation level."""
        return self.block.solve(rhs)

    def add(self, increment: np.ndarray) -> None:
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
    def _assemble(self, u, v, configuration, rates, before=None):
        if not self.domain.n_nodes:
            return
        surfaces = self.surfaces.tangents(State(self._t_alpha, u, v), Slope(1.0, rates.c_v))
        self.block.assemble(
            self._block_tangents(u, configuration, rates, surfaces, before), surfaces.coupled
        )
        self.block.refactor()

    def _block_tangents(self, u, configuration, rates, surfaces, before):
        """Yield (chunk, tangent (E, A, d, A, d)) of the block at u (n_local, d)."""
        weights = self._inertia_weights
        return self._tangents(u, configuration, rates, surfaces, weights, before)

    def _tangents(self, u, configuration, rates, surfaces, weights, before=None):
        """Yield (chunk, tangent (E, A, d, A, d)) at u (n_local, d); weights : function that returns
        the mass times dV; before : see `kernels.solid.stress_tangent`.
        """
        domain = self.domain
        for region, chunk in domain.chunks(self._doubles_per_cell):
            material = self.setup.material(region, chunk)
            stiffness = domain.reference_stiffness.part(chunk)
            fields = [
                None if field is None else domain.displacement(field, chunk)
                for field in (u, before)
            ]
            law = self._collocated_law(material.elastic, chunk)
            K = kernel.stress_tangent(stiffness.G, stiffness.dV, law, *fields, stiffness.hoop)
            mass = weights(material, configuration, chunk, rates)
            if mass is not None:
                add_mass(K, domain.mass.N, mass, self.mesh.dim)
            surfaces.add_to(K, chunk)
            yield chunk, K

    def trial_tangents(self, rates: Rates) -> Iterator[tuple[slice, np.ndarray]]:
        """Yield (chunk, tangent (E, A, d, A, d)) of the trial state on a fixed mesh, without the
        corrected split's terms and what couples whole surfaces.
        """
        surfaces = self.surfaces.tangents(self._surface_state, Slope(1.0, rates.c_v))
        configuration = self.configuration
        weights = self._plain_weights
        return self._tangents(
            self._u_alpha, configuration, rates, surfaces, weights, self._linear_from
        )

    def coupled(self, rates: Rates) -> tuple[Coupled, ...]:
        """Return what couples the displacements of whole surfaces in the tangent of the trial state
        (collective).
        """
        return self.surfaces.tangents(self._surface_state, Slope(1.0, rates.c_v)).coupled

    def _inertia_weights(self, material, configuration, chunk, rates):
        """Return the mass of the block's tangent times dV, (E, Q), or tensors (E, Q, d, d) of a
        drag with principal axes; None without any.
        """
        return self._plain_weights(material, configuration, chunk, rates)

    def _plain_weights(self, material, configuration, chunk, rates):
        """Return ρ_s c_a and the derivative S c_v of the drag, times dV."""
        drag = material.drag(configuration.J[chunk])
        inertia = material.rho_s * rates.c_a * self.domain.reference.dV[chunk]
        return drag.times(rates.c_v).times(configuration.geometry.dV[chunk]).plus(inertia)

    # -- end of a step -----------------------------------------------------------------------------

    def accept(self) -> None:
        """Make the trial state the accepted one; raise ConvergenceError, changing nothing, when its
        end is not admissible (collective).
        """
        configuration = self._configuration_at(self._u1)
        self.surfaces.accept(State(self._t_end, self._u1, self._v1))
        self._accepted_configuration = configuration
        if self.internal:
            self.internal.accept(self._u1, self.scheme.duration, self._doubles_per_cell)
            if not self.is_linear:  # its tangent is that of variables that are gone
                self._rule.forget()
        self.u, self.v, self.a = self._u1.copy(), self._v1.copy(), self._a1.copy()
        if self.setup.reaction:
            self.kept.accept(self.scheme, -self._residual.without("traction"))

    def reset(self) -> None:
        """Forget the trial state."""
        self._u1, self._v1, self._a1 = self.u.copy(), self.v.copy(), self.a.copy()
        self._configuration = self._own = None

    def state(self) -> dict[str, np.ndarray]:
        """Return every array a restart needs, name -> (n_owned, d), and that of the internal
        variables.
        """
        n = self.mesh.n_owned
        fields = {"u": self.u[:n], "v": self.v[:n], "a": self.a[:n]}
        kept = self.kept.state() if self.setup.reaction else {}
        if self.fading:
            kept["fading"] = self.fading.at_start
        return fields | kept | self._rule.state(n) | self.internal.state()

    def memory(self) -> dict[str, Any]:
        """Return the numbers a restart needs beside the arrays."""
        kept = self.kept.memory() if self.setup.reaction else {}
        return self._rule.memory() | {"surfaces": self.surfaces.memory()} | kept

    def load_state(
        self, arrays: dict[str, np.ndarray], memory: dict[str, Any], rates: Rates
    ) -> None:
        """Continue from `state` and `memory`; a tangent that fits the rates of the next step is
        made again where it was.
        """
        self.u, self.v, self.a = (self.mesh.halo.extend(arrays[name]) for name in ("u", "v", "a"))
        self.internal.load(arrays)
        self.surfaces.load(memory.get("surfaces", {}))
        if self.setup.reaction:
            self.kept.load(arrays, memory)
        if self.fading:
            self.fading.at_start = arrays["fading"]
        self._accepted_configuration = None
        self.reset()
        point = self._rule.load(arrays, memory, self.mesh)
        if point is None or self._rule.rates != rates or self.internal:
            self._rule.forget()
        else:
            u = point.get("u", self.u)
            self._assemble(u, point.get("v", self.v), self._configuration_at(u), rates)

    # -- measures ----------------------------------------------------------------------------------

    def energies(self) -> tuple[float, float]:
        """Return kinetic and elastic energy of the accepted state [J] (collective)."""
        domain = self.domain
        kinetic = np.zeros(domain.n_cells)
        elastic = np.zeros(domain.n_cells)
        for region, chunk in domain.chunks(self._doubles_per_cell):
            material = self.setup.material(region, chunk)
            stiffness = domain.reference_stiffness.part(chunk)
            nodal = domain.displacement(self.u, chunk)
            law = self._laws[region].at(domain.cell_numbers[chunk])
            elastic[chunk] = kernel.stored_energy(
                stiffness.G,
                stiffness.dV,
                self.internal.law(law, chunk, 0.0),
                nodal,
                stiffness.hoop,
            )
            speed2 = ((domain.mass.N @ domain.gather(self.v, chunk)) ** 2).sum(axis=-1)
            mass = speed2 * domain.reference.dV[chunk]
            kinetic[chunk] = 0.5 * np.ravel(material.rho_s) * mass.sum(axis=1)
        return domain.sum_owned(kinetic) if self.setup.inertia else 0.0, domain.sum_owned(elastic)
