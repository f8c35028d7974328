"""Manufactured flows of a free fluid: velocity from a stream function, body force and traction by
sympy, on a moving mesh.

The Navier-Stokes equations are written out once more, in the space-fixed frame: on a mesh that
moves they are only evaluated where its points are.  A scene gets boundary and initial values as
formulas of the reference position, as a user writes them.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import sympy as sp
from manufactured import functions, square, steps_to_end, t, x, y
from running import SCENES

from porofsi_petsc import load_scene
from porofsi_petsc.fem.geometry import Rule, geometry
from porofsi_petsc.linalg.options import start
from porofsi_petsc.phases.loads import BodyForce
from porofsi_petsc.simulation.simulation import Simulation

SCENE = str(SCENES / "free_fluid.toml")
RHO, MU = 2.0, 0.1  # of the scene [kg/m³], [Pa s]
NORMALS = {"left": (-1, 0), "bottom": (0, -1), "right": (1, 0), "top": (0, 1)}


@dataclass(frozen=True)
class Flow:
    """Stream function ψ [m²/s] and pressure p [Pa] of place and time; displacement of the mesh,
    (2,) [m], of X and time.

    The motion starts from rest; only its values on the boundary are used, the rest is for the law
    of the mesh.
    open : the sides with a given traction, the others have a given velocity
    """

    psi: object
    p: object
    motion: tuple = (sp.S.Zero, sp.S.Zero)
    open: tuple = ("top",)

    @cached_property
    def v(self):
        """Return v_f, (2,)."""
        return sp.Matrix([self.psi.diff(y), -self.psi.diff(x)])

    @cached_property
    def body_force(self):
        """Return the functions of b = ∂v/∂t + v·∇v + (∇p - μ Δv)/ρ [m/s²]."""
        laplacian = self.v.applyfunc(lambda f: f.diff(x, 2) + f.diff(y, 2))
        pressure = sp.Matrix([self.p.diff(x), self.p.diff(y)])
        return functions(
            self.v.diff(t) + self.v.jacobian([x, y]) * self.v + (pressure - MU * laplacian) / RHO
        )

    @cached_property
    def exact(self):
        """Return dict name -> functions of the fields at a place."""
        return {"v": functions(self.v), "p": functions([self.p]), "rate": functions(self.v.diff(t))}

    def traction(self, side):
        """Return σ cof(F) N per reference area at a place, (2,) [Pa]."""
        F = sp.eye(2) + sp.Matrix(self.motion).jacobian([x, y])
        gradient = self.v.jacobian([x, y])
        stress = -self.p * sp.eye(2) + MU * (gradient + gradient.T)
        cofactor = sp.Matrix([[F[1, 1], -F[1, 0]], [-F[0, 1], F[0, 0]]])
        return self._on_mesh(stress) * cofactor * sp.Matrix(NORMALS[side])

    def _on_mesh(self, expressions):
        """Return expressions of the place as such of the reference position."""
        return expressions.subs({x: x + self.motion[0], y: y + self.motion[1]}, simultaneous=True)

    def overrides(self):
        """Return the changes that make a scene of this flow."""
        velocity = _vector(self._on_mesh(self.v))
        given = {side: f"velocity={velocity}" for side in NORMALS}
        given |= {side: f"traction={_vector(self.traction(side))}" for side in self.open}
        moves = _vector(self.motion)
        sides = [
            f"{{on='{side}', {condition}, displacement={moves}}}"
            for side, condition in given.items()
        ]
        start = (
            f"fluid_velocity={_vector(self.v.subs(t, 0))},"
            f" pressure='{sp.sympify(self.p).subs(t, 0)}'"
        )
        return f"boundary=[{', '.join(sides)}]", f"initial={{{start}}}"


def _vector(expressions):
    first, second = expressions
    return f"{{x='{first}', y='{second}'}}"


def at(functions, time, points):
    """Return functions at points (..., 2) and a time, (..., k)."""
    flat = points.reshape(-1, 2)
    return np.column_stack([f(time, flat) for f in functions]).reshape(*points.shape[:-1], -1)


def solved(flow, *options, disturbance=0.0):
    """Return the coupling of the scene of a flow at its end; the rate of v_f at t = 0 is the exact
    one.

    disturbance : random part of the values with which the iteration of every step starts
    """
    start()
    scene = load_scene(SCENE, (*flow.overrides(), *options))
    coupling = Simulation(scene, mesh=square(scene)).coupling
    fluid = coupling.fluid
    fluid.setup = replace(fluid.setup, body_force=_sources(flow, coupling))
    fluid.a[:] = at(flow.exact["rate"], 0.0, fluid.mesh.X)
    fluid.reset()
    _disturb(coupling, disturbance)
    for step, (time, schemes, rates) in enumerate(steps_to_end(scene), 1):
        coupling.motion.begin_step(
            schemes[0], time
        )  # the sources want to know where the mesh will be
        coupling.motion.follow(coupling.solid.end_displacement)
        coupling.step(schemes, rates, time, step)
        coupling.accept()
    return coupling


def _disturb(coupling, size):
    """Let the iteration of every step start away from the prediction; what is prescribed stays
    so.
    """
    fluid = coupling.fluid
    begin = fluid.begin_step
    rng = np.random.default_rng(2)
    free = ~fluid.setup.mask[: fluid.mesh.n_owned]

    def begin_elsewhere(*arguments):
        begin(*arguments)
        fluid.unknowns = fluid.unknowns + size * free * rng.standard_normal(free.shape)

    fluid.begin_step = begin_elsewhere


def _sources(flow, coupling):
    """Return the body force where the quadrature points of the moving mesh are."""

    def component(f):
        def where_the_mesh_is(time, reference):
            domain = coupling.fluid.domain
            motion = coupling.motion
            u = motion.mesh_state().displacement
            points = domain.mass.N @ domain.gather(domain.mesh.X + u)
            return f(time, points.reshape(-1, 2))

        return where_the_mesh_is

    return (BodyForce({i: component(f) for i, f in enumerate(flow.body_force)}),)


def errors(flow, coupling, time):
    """Return the relative L2 errors of v and p over the mesh at the end of the last step."""
    domain = coupling.fluid.domain
    position = coupling.fluid.mesh.X + coupling.motion.u
    fields = {"v": coupling.fluid.v, "p": coupling.fluid.p[:, None]}
    return {
        name: _error(domain, position, flow.exact[name], nodal, time)
        for name, nodal in fields.items()
    }


def _error(domain, position, exact, nodal, time):
    rule = Rule.of(domain.element, 2 * domain.element.order + 2)
    coordinates = domain.gather(position)
    dV = geometry(rule, coordinates).dV[..., None]
    values = at(exact, time, rule.N @ coordinates)
    return float(
        np.sqrt(
            (((rule.N @ domain.gather(nodal) - values) ** 2) * dV).sum() / (values**2 * dV).sum()
        )
    )
