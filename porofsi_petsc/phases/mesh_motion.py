"""The motion of a free fluid's mesh: an elastic extension of the solid's displacement, from the
reference configuration.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
from mpi4py import MPI

from ..clock import Scheme
from ..errors import ConvergenceError
from ..fem.domain import Configuration, Domain
from ..fem.geometry import Geometry, Rule, geometry, shape_quality
from ..kernels import solid as kernel
from ..linalg.stopwatch import timed
from ..materials.distortion import Distortion
from ..materials.strain import green_strain
from ..mesh.topology import is_collapsed
from ..tensors import det_minus_one, trace
from .block import LinearBlock
from .coupling_data import MeshState
from .setup import MeshSetup

# Of the increments of a nonlinear law, whose lagged tangent contracts them linearly: far below any
# coupling tolerance.
TOLERANCE = 1e-11
CAP = 40
# The part of its volume that an element keeps in an increment, and the parts of an increment that
# are tried for it.
KEPT = 0.2
PARTS = 0.5 ** np.arange(8)
# Mean ratio of the map of an element from the reference at which a mesh still holds a flow: where a
# cylinder winds it up the velocity is wrong by 1 to 3 % there, by 30 % and more later on.
FLATTEST = 0.03
# Falls of the smallest volume ratio that are remembered, and the ratio below which the mesh itself
# is what inverts.
NOTED = 0.6
SQUEEZED = 0.5
SLOW = 0.1  # contraction of its increments above which a lagged tangent is renewed within a step


class MeshMotion:
    """Solve Div P(∇u) = 0 for the displacement u of the mesh, u = u_s on the interface, prescribed
    on all other boundaries.

    P is taken at the vertices of the elements too, where one that is not affine is inverted first.

    Always from the reference configuration, so that the mesh is a function of the interface and a
    period ends where it began. The velocity of the mesh is that of the solid's time scheme: on the
    interface it is v_s to the last digit. Arrays (n_local, d), ghosts included: `u`, `v`, `a` of
    the accepted level, `_u1`, `_v1`, `_a1` of the trial level. `smallest_ratio`, `worst_shape`:
    least volume ratio J and `shape_quality` of an element, in the reference configuration and on
    all accepted levels; `trail`: times [s] and least J of the levels on which it fell.
    """

    prefix = "mesh_"

    def __init__(self, setup: MeshSetup, fluid_domain: Domain, with_hessian: bool) -> None:
        """Take a `phases.setup.MeshSetup` and the domain of the fluid, which may go on into a
        porous solid.

        with_hessian : whether the fluid wants second derivatives
        """
        self.setup = setup
        self._fluid_domain = fluid_domain
        self._with_hessian = with_hessian
        self.domain = setup.domain
        self.mesh = setup.domain.mesh
        self.stopwatch = setup.stopwatch
        shape = (self.mesh.n_local, self.mesh.dim)
        self.u = np.zeros(shape)
        self.v = np.zeros(shape)
        self.a = np.zeros(shape)
        self._u1, self._v1, self._a1 = self.u.copy(), self.v.copy(), self.a.copy()
        self._reference = Configuration.at(fluid_domain, self.mesh.X, with_hessian)
        self._configuration: Configuration | None = None
        self._accepted: Configuration | None = None
        self.block = LinearBlock(setup, self.prefix, setup.mask, setup.new_solver)
        self._stale = True
        self._t_end = 0.0
        self.trail: list[list[float]] = []
        self.smallest_ratio = self.worst_shape = 1.0
        self._watch(self._reference, self.mesh.X)
        self._points = _closed_points(self.domain)
        volume = self.domain.reference.section.sum(axis=1)
        mean = self.domain.sum_owned(volume) / max(
            self.mesh.comm.allreduce(int(self.domain.owned.sum())), 1
        )
        self._stiffness = (mean / volume) ** setup.stiffening

    @property
    def moves(self) -> bool:
        """Return whether the mesh moves at all."""
        return self.setup.moving_mesh

    @property
    def squeezed(self) -> bool:
        """Return whether an element has lost so much of its volume that it is the mesh which
        inverts, not the step.
        """
        return bool(self.trail) and self.trail[-1][1] < SQUEEZED

    def set_initial(self, displacement: np.ndarray, velocity: np.ndarray) -> None:
        """Set the mesh to displacement and velocity of the solid, both (n_local, d), extended; what
        is prescribed is at rest.
        """
        if self.moves:
            self.u = self.extended(displacement, self.u, 0.0)
            self.v = self._extended_rate(velocity)
        self.reset()

    def begin_step(self, scheme: Scheme, t: float) -> None:
        """Start a step from the accepted level at time t."""
        self.scheme = scheme
        self._t_end = t + scheme.dt
        self._stale = self._stale or not self.setup.law.small_strain

    def follow(self, displacement: np.ndarray) -> None:
        """Take the solid's displacement at the end of the step, (n_local, d), and extend it."""
        if self.moves:
            self._u1 = self.extended(displacement, self._u1, self._t_end)
            self._v1, self._a1 = self.scheme.rates(self._u1, self.u, self.v, self.a)
            self._configuration = None

    # -- what the fluid sees -----------------------------------------------------------------------

    def mesh_state(self) -> MeshState:
        """Return the trial state on the collocation level; raises ConvergenceError when an element
        is inverted.
        """
        level = self.u + self.scheme.alpha_f * (self._u1 - self.u)
        if self._configuration is None:
            self._configuration = self._configuration_at(level)
        return MeshState(
            self._configuration,
            self.scheme.velocity_level(self.v, self._v1),
            self._v1,
            level,
            self.moves,
        )

    def accepted_mesh_state(self) -> MeshState:
        """Return the accepted state."""
        if self._accepted is None:
            self._accepted = self._configuration_at(self.u)
        return MeshState(self._accepted, self.v, self.v, self.u, self.moves)

    def mesh_state_at(self, u: np.ndarray, v: np.ndarray) -> MeshState:
        """Return the state of a displacement and a velocity, both (n_local, d)."""
        return MeshState(self._configuration_at(u), v, v, u, self.moves)

    def _configuration_at(self, u):
        if not self.moves:
            return self._reference
        return Configuration.at(
            self._fluid_domain, self.mesh.X + u, self._with_hessian, self._inverted
        )

    # -- extension ---------------------------------------------------------------------------------

    @timed("mesh")
    def extended(self, solid: np.ndarray, start: np.ndarray, t: float) -> np.ndarray:
        """Return the displacement with that of the solid (n_local, d) on its nodes and what is
        prescribed at time t elsewhere.
        """
        setup = self.setup
        goal = start.copy()
        setup.dirichlet.apply(goal, t)
        goal[setup.carried] = setup.transfer.to_fluid(solid)[setup.carried]
        return self._solved(goal, start)

    def _solved(self, goal, start):
        """Return the equilibrium with the boundary of the goal, from the displacement `start` on;
        both (n_local, d).

        Boundary and inside move together, as far as no element is inverted: the boundary comes to
        its goal in one increment or in several.
        """
        setup = self.setup
        u = start
        last = np.inf
        free = ~setup.mask[: self.mesh.n_owned]
        for _ in range(CAP):
            if self._stale:
                self._assemble(u)
            gap = np.where(setup.mask, goal - u, 0.0)
            inside = self.block.solve(np.where(free, -self._forces(u, gap), 0.0))
            increment = gap + self.mesh.halo.extend(inside)
            if setup.law.small_strain:
                return np.where(setup.mask, goal, u + increment)
            part = self._admissible_part(u, increment)
            u = np.where(setup.mask & (part == 1), goal, u + part * increment)
            size = self.relative(increment[: self.mesh.n_owned], u)
            if size <= TOLERANCE:
                return u
            self._stale = part < 1 or size > SLOW * last
            last = size
        raise self._failure(
            f"the motion of the mesh of the fluid did not converge in {CAP} iterations at t ="
            f" {self._t_end:g} s"
        )

    def _admissible_part(self, u, increment):
        """Return the largest of the `PARTS` of an increment after which every element has more than
        `KEPT` of its volume at u (collective).
        """
        least = KEPT * self._volume_ratio(u)
        for part in PARTS:
            admissible = self._volume_ratio(u + part * increment) > least
            if self.mesh.comm.allreduce(bool(admissible.all()), MPI.LAND):
                break
        self.domain.require(admissible, self._inverted)
        return part

    def _volume_ratio(self, u):
        """Return J where the law is asked, (E, Q)."""
        return 1 + det_minus_one(self._gradient(u))

    def _gradient(self, u):
        """Return H where the law is asked, (E, Q, d, d)."""
        points = self._points
        return kernel.displacement_gradient(points.G, self.domain.gather(u), points.hoop)

    def _require_shapes(self, u):
        """Raise ConvergenceError where an element is inverted, or has lost its shape: the mean
        ratio d J^(2/d)/I1 of its map from the reference is below `FLATTEST` (collective).
        """
        H = self._gradient(u)
        J = 1 + det_minus_one(H)
        self.domain.require(J > 0, self._inverted)
        d = H.shape[-1]
        mean_ratio = d * J ** (2 / d) / (d + 2 * trace(green_strain(H)))
        self.domain.require(mean_ratio > FLATTEST, self._flattened)

    def _extended_rate(self, solid):
        """Return the velocity of the mesh for that of the solid (n_local, d), K v = 0 inside with
        the tangent of `u`.
        """
        setup = self.setup
        v = np.where(setup.carried[:, None], setup.transfer.to_fluid(solid), 0.0)
        if self._stale or not self.setup.law.small_strain:
            self._assemble(self.u)
        forces = self._forces(self.u, v) - self._forces(self.u, 0 * v)
        free = ~setup.mask[: self.mesh.n_owned]
        return v + self.mesh.halo.extend(self.block.solve(np.where(free, -forces, 0.0)))

    def _inverted(self, place):
        return self._failure(
            f"an element of the mesh of the fluid is inverted at t = {self._t_end:g} s, element at"
            f" {place}"
        )

    def _flattened(self, place):
        return ConvergenceError(
            f"an element of the mesh of the fluid has lost its shape at t = {self._t_end:g} s, the"
            f" mean ratio of its distortion is below {FLATTEST:g}, element at {place}",
            f"a smaller step does not help: {self._keys()}",
        )

    def _failure(self, what):
        """Return the error of a mesh that does not follow: how its quality fell, and what helps."""
        if self.squeezed:
            fell = ", ".join(f"{ratio:.2g} at {t:g} s" for t, ratio in self.trail)
            what = f"{what}; its smallest volume ratio fell to {fell}"
            return ConvergenceError(
                what, f"a smaller step hardly helps where the mesh is squeezed: {self._keys()}"
            )
        return ConvergenceError(what, f"if a smaller step stops at the same time, {self._keys()}")

    def _keys(self):
        """Return which keys take a motion farther."""
        farthest = isinstance(self.setup.law, Distortion)
        law = "" if farthest else 'mesh_motion.law = "distortion", '
        return (
            f"try {law}another mesh_motion.stiffening than {self.setup.stiffening:g} (1 to 2), or"
            " another mesh there"
        )

    def relative(self, increment: np.ndarray, u: np.ndarray) -> float:
        """Return |increment|/|u|, 0 at rest; both (n_owned, d) or longer (collective)."""
        owned = u[: len(increment)]
        squares = self.mesh.comm.allreduce(
            np.array([np.vdot(increment, increment), np.vdot(owned, owned)])
        )
        return float(np.sqrt(squares[0] / squares[1])) if squares[1] else 0.0

    def _forces(self, u, change):
        """Return the nodal forces of the law at u and what a change of u adds to first order,
        (n_owned, d).
        """
        domain = self.domain
        law = self.setup.law
        moves = change.any()
        forces = np.zeros((self.mesh.n_owned, self.mesh.dim))
        for chunk, G, dV, hoop in self._stiffened():
            nodal = domain.gather(u, chunk)
            moved = domain.gather(change, chunk)
            vectors = kernel.stress_residual(
                G, dV, law, nodal + moved if law.small_strain else nodal, hoop
            )
            if moves and not law.small_strain:
                K = kernel.stress_tangent(G, dV, law, nodal, hoop=hoop)
                vectors += np.einsum("eaibj,ebj->eai", K, moved)
            domain.add(forces, chunk, vectors)
        return forces

    def tangents(self) -> Iterator[tuple[slice, np.ndarray]]:
        """Return an iterator over (chunk, tangent (E, A, d, A, d)) of the law in the trial
        state.
        """
        return self._tangents(self._u1)

    def _tangents(self, u):
        for chunk, G, dV, hoop in self._stiffened():
            nodal = self.domain.gather(u, chunk)
            yield chunk, kernel.stress_tangent(G, dV, self.setup.law, nodal, hoop=hoop)

    def _assemble(self, u):
        self.block.assemble(self._tangents(u))
        self._stale = False
        self.block.refactor()

    def _stiffened(self):
        """Yield (chunk, G, dV times the stiffening, hoop)."""
        for _, chunk in self.domain.chunks((self.domain.cells.shape[1] * self.mesh.dim) ** 2):
            part = self._points.part(chunk)
            yield chunk, part.G, part.dV * self._stiffness[chunk, None], part.hoop

    # -- end of a step -----------------------------------------------------------------------------

    @property
    def end_displacement(self) -> np.ndarray:
        """Return u at the end of the trial step, (n_local, d) [m]."""
        return self._u1

    def accept(self) -> None:
        """Make the trial state the accepted one; raises ConvergenceError, changing nothing, when an
        element is inverted.
        """
        if self.moves:
            accepted = self._configuration_at(self._u1)
            self._require_shapes(self._u1)
            self._accepted = accepted
            self._watch(accepted, self.mesh.X + self._u1)
        self.u, self.v, self.a = self._u1.copy(), self._v1.copy(), self._a1.copy()

    def _watch(self, configuration, positions):
        """Take the worst elements of a configuration with nodal positions (n_local, d) into account
        (collective).
        """
        domain = self._fluid_domain
        worst = 1.0
        for _, chunk in domain.chunks(domain.cells.shape[1] * domain.dim):
            vertices = positions[domain.cells[chunk, : domain.element.n_vertices]]
            worst = min(worst, float(shape_quality(domain.element.cell, vertices).min()))
        ratios, shapes = zip(
            *self.mesh.comm.allgather((float(configuration.J.min(initial=1.0)), worst)), strict=True
        )
        self.smallest_ratio = min(self.smallest_ratio, *ratios)
        self.worst_shape = min(self.worst_shape, *shapes)
        if min(ratios) < NOTED * (self.trail[-1][1] if self.trail else 1.0):
            self.trail = [*self.trail, [self._t_end, min(ratios)]]

    def reset(self) -> None:
        """Forget the trial state."""
        self._u1, self._v1, self._a1 = self.u.copy(), self.v.copy(), self.a.copy()
        self._configuration = self._accepted = None

    def state(self) -> dict[str, np.ndarray]:
        """Return every array a restart needs, name -> (n_owned, d)."""
        n = self.mesh.n_owned
        return {"u": self.u[:n], "v": self.v[:n], "a": self.a[:n]}

    def memory(self) -> dict[str, Any]:
        """Return the numbers a restart needs beside the arrays."""
        return {
            "smallest_ratio": self.smallest_ratio,
            "worst_shape": self.worst_shape,
            "trail": self.trail,
        }

    def load_state(self, arrays: dict[str, np.ndarray], memory: dict[str, Any]) -> None:
        """Continue from `state` and `memory`."""
        self.smallest_ratio = memory["smallest_ratio"]
        self.worst_shape = memory["worst_shape"]
        self.trail = memory.get("trail", [])
        self.u, self.v, self.a = (self.mesh.halo.extend(arrays[name]) for name in ("u", "v", "a"))
        self.reset()


def _closed_points(domain: Domain) -> Geometry:
    """Return the reference geometry of a rule that has the vertices among its points; that of the
    mass rule on affine elements, and where some are collapsed (collective).
    """
    element = domain.element
    collapsed = is_collapsed(domain.cells, element).any()
    if element.is_affine or domain.mesh.comm.allreduce(bool(collapsed), MPI.LOR):
        return domain.reference
    rule = Rule.at(element, *element.cell.closed_quadrature())
    return geometry(rule, domain.mesh.X[domain.cells])
