"""Manufactured solutions: sources derived by sympy from chosen fields, and the phases driven by
them.

The fields are functions of the reference position and of time.  The total flux n_f v_f + n_s v_s is
the Piola transform of the curl of a stream function ψ, so that the volume balance holds without a
source; the momentum balances get body forces.  Nothing here uses the package's kernels or
materials: the balances are written out once more.
"""

from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
import sympy as sp
from mpi4py import MPI
from running import SCENES
from surfaces import flux, traction

from porofsi_petsc.fem.distribute import distribute
from porofsi_petsc.fem.domain import Configuration, Domain
from porofsi_petsc.fem.essential import Dirichlet
from porofsi_petsc.fem.geometry import Rule, geometry
from porofsi_petsc.linalg.options import start
from porofsi_petsc.linalg.stopwatch import Stopwatch
from porofsi_petsc.phases.coupling_data import Flow, MeshState, Rates
from porofsi_petsc.phases.loads import BodyForce
from porofsi_petsc.phases.pore_fluid import PoreFluid
from porofsi_petsc.phases.skeleton import Skeleton
from porofsi_petsc.simulation.build import serial_mesh
from porofsi_petsc.simulation.loop import Clock
from porofsi_petsc.simulation.porous import PorousBuilder

SCENE = str(SCENES / "manufactured.toml")
x, y, t = sp.symbols("x y t", real=True)
X = sp.Matrix([x, y])
CLOSED = ("left", "bottom", "right")  # displacement and flux; the top has traction and pressure
NORMALS = {"left": (-1, 0), "bottom": (0, -1), "right": (1, 0), "top": (0, 1)}
TOLERANCE, CAP = 1e-11, 30  # of Newton's iteration of a phase alone
WIGGLE = 0.15  # of the cell size, by which the inner nodes of a distorted mesh are moved


def functions(expressions):
    """Return the functions f(t, points (n, 2)) -> (n,) of sympy expressions, which share their
    common terms.
    """
    compiled = sp.lambdify((t, x, y), list(expressions), "numpy", cse=True)

    def component(i, time, points):
        return np.broadcast_to(
            np.asarray(compiled(time, points[:, 0], points[:, 1])[i], float), len(points)
        )

    return [partial(component, i) for i in range(len(list(expressions)))]


def inverse(matrix):
    """Return the inverse of a (2, 2) matrix of expressions as it stands, without the
    simplifications of sympy's.
    """
    (a, b), (c, d) = matrix.tolist()
    return sp.Matrix([[d, -b], [-c, a]]) / (a * d - b * c)


@dataclass(frozen=True)
class Fields:
    """Displacement u (2,) [m], stream function ψ [m³/s per m] and pressure p [Pa], sympy
    expressions of x, y, t.
    """

    u: tuple
    psi: object
    p: object


@dataclass(frozen=True)
class Manufactured:
    """The balances of docs/physics.md at given fields with the terms of a scene's model; everything
    else is derived.
    """

    fields: Fields
    scene: object

    @cached_property
    def _model(self):
        return self.scene.model

    @cached_property
    def _u(self):
        return sp.Matrix(self.fields.u)

    @cached_property
    def _F(self):
        return sp.eye(2) + self._u.jacobian(X)

    @cached_property
    def _mesh_F(self):
        """Return the deformation of the mesh that the integrals are taken over."""
        return self._F if self._model.moving_mesh else sp.eye(2)

    @cached_property
    def _J(self):
        return self._mesh_F.det()

    @cached_property
    def _material(self):
        return self.scene.material[0]

    @cached_property
    def _n_s(self):
        n_s0 = sp.Float(1 - self._material.porosity)
        return n_s0 / self._J if self._model.porosity == "variable" else n_s0

    @cached_property
    def _n_f(self):
        return 1 - self._n_s

    @cached_property
    def _drag(self):
        """Return S of Kozeny and Carman or of a constant permeability."""
        n_f = 1 - (1 - self._material.porosity) / self._J
        n_f0 = self._material.porosity
        ratio = {
            "constant": 1,
            "kozeny_carman": (n_f / n_f0) ** 3 * ((1 - n_f0) / (1 - n_f)) ** 2,
        }[self._material.permeability.law]
        return (
            self._n_f**2
            * self._material.fluid.specific_weight
            / (self._material.permeability.k * ratio)
        )

    @cached_property
    def _v_s(self):
        return self._u.diff(t)

    @cached_property
    def _seepage(self):
        """Return n_f (v_f - v_s) = q - v_s with q = F curl ψ / J."""
        curl = sp.Matrix([self.fields.psi.diff(y), -self.fields.psi.diff(x)])
        return self._mesh_F * curl / self._J - self._v_s

    @cached_property
    def _v_f(self):
        return self._v_s + self._seepage / self._n_f

    def _gradient(self, vector):
        """Return ∂v_i/∂x_j in the configuration of the mesh."""
        return sp.Matrix(vector).jacobian(X) * inverse(self._mesh_F)

    def _divergence(self, tensor):
        """Return ∂T_ij/∂x_j in the configuration of the mesh."""
        rows = [self._gradient(tensor[i, :].T).trace() for i in range(2)]
        return sp.Matrix(rows)

    @cached_property
    def _grad_p(self):
        return self._gradient([self.fields.p]).T

    @cached_property
    def _effective_stress(self):
        """Return the first Piola stress of the neo-Hookean (ln J) or the linear law."""
        lam = self._material.solid.lambda_
        mu = self._material.solid.mu
        F = self._F
        if self._material.solid.law == "linear_elastic":
            strain = (F + F.T) / 2 - sp.eye(2)
            return lam * strain.trace() * sp.eye(2) + 2 * mu * strain
        return mu * (F - inverse(F).T) + lam * sp.log(F.det()) * inverse(F).T

    def _skeleton_force(self, flow):
        """Return ρ_s b per reference volume: inertia - div P (+ pressure and drag when flow is
        true).
        """
        P = self._effective_stress
        rho = self._material.solid.density * (1 - self._material.porosity)
        force = -sp.Matrix([P[i, :].T.jacobian(X).trace() for i in range(2)])
        if self._model.solid_inertia:
            force += rho * self._v_s.diff(t)
        if flow:
            force += self._J * (self._n_s * self._grad_p - self._drag * self._seepage / self._n_f)
        return force / rho

    @cached_property
    def solid_body_force(self):
        """Return the functions of b on the skeleton in the medium [m/s²]."""
        return functions(self._skeleton_force(flow=True))

    @cached_property
    def dry_body_force(self):
        """Return the functions of b on the skeleton alone [m/s²]."""
        return functions(self._skeleton_force(flow=False))

    @cached_property
    def fluid_body_force(self):
        """Return the functions of b on the fluid [m/s²]."""
        rho = self._n_f * self._material.fluid.density
        v = self._v_f
        force = self._n_f * self._grad_p + self._drag * self._seepage / self._n_f
        if self._model.fluid_inertia:
            force += rho * v.diff(t)
        if self._model.convection:
            mesh_velocity = self._v_s if self._model.moving_mesh else sp.zeros(2, 1)
            force += rho * self._gradient(v) * (v - mesh_velocity)
        if self._model.viscosity:
            L = self._gradient(v)
            force -= self._divergence(self._n_f * self._material.fluid.viscosity * (L + L.T))
        return functions(force / rho)

    def traction(self, side, flow=True):
        """Return the functions of the traction per reference area, of the mixture or of the
        skeleton alone [Pa].
        """
        total = self._effective_stress
        if flow:
            total -= self.fields.p * self._J * inverse(self._mesh_F).T
        return functions(total * sp.Matrix(NORMALS[side]))

    def flux(self, side):
        """Return the function of the outward seepage flux per reference area [m/s]."""
        return functions(
            [(self._J * inverse(self._mesh_F) * self._seepage).dot(sp.Matrix(NORMALS[side]))]
        )[0]

    @cached_property
    def exact(self):
        """Return dict name -> functions of the fields and of their rates."""
        fields = {
            "u": self._u,
            "v_s": self._v_s,
            "a_s": self._v_s.diff(t),
            "v_f": self._v_f,
            "a_f": self._v_f.diff(t),
        }
        return {name: functions(field) for name, field in (fields | {"p": [self.fields.p]}).items()}

    def at(self, name, time, points):
        """Return an exact field at points, (n, k)."""
        return np.column_stack([f(time, points) for f in self.exact[name]])


# -- phases driven by the sources ------------------------------------------------------------------


def distorted(mesh, seed=7):
    """Return a serial mesh whose inner vertices are moved by up to WIGGLE cells, mid-edge nodes
    staying in the middle.
    """
    rng = np.random.default_rng(seed)
    cells = mesh.cells
    points = mesh.points.copy()
    vertices = np.unique(cells[:, : mesh.element.n_vertices])
    inner = vertices[np.all((points[vertices] > 1e-12) & (points[vertices] < 1 - 1e-12), axis=1)]
    h = np.sqrt(mesh.element.cell.count_in_cube / len(cells))
    points[inner] += WIGGLE * h * rng.uniform(-1, 1, (len(inner), 2))
    for middle, around in enumerate(mesh.element.supports, mesh.element.n_vertices):
        points[cells[:, middle]] = points[cells[:, list(around)]].mean(axis=1)
    return replace(mesh, points=points)


def square(scene):
    """Return the `LocalMesh` of a distorted mesh of the scene on this rank alone."""
    mesh = distorted(serial_mesh(scene))
    return distribute(MPI.COMM_SELF, mesh, np.zeros(len(mesh.points), dtype=int))


def entries(sides, functions):
    """Return the entries of a `Dirichlet` that prescribes all components on sides."""
    return [(side, i, f) for side in sides for i, f in enumerate(functions)]


def skeleton_setup(truth, scene, domain, flow=True):
    """Return the `SkeletonSetup` with the sources of a solution, of the medium or of the skeleton
    alone: traction on the top.
    """
    mesh = domain.mesh
    setup = PorousBuilder(scene, mesh, Stopwatch(), domain).skeleton()
    return replace(
        setup,
        body_force=sources(truth.solid_body_force if flow else truth.dry_body_force),
        dirichlet=Dirichlet(mesh, 2, entries(CLOSED, truth.exact["u"])),
        surfaces=(traction(domain, "top", truth.traction("top", flow)),),
    )


def sources(functions):
    """Return the body force with these components."""
    return (BodyForce(dict(enumerate(functions))),)


def flow_setup(truth, scene, domain):
    """Return the `PoreFluidSetup` with the sources of a solution: pressure on the top, flux
    elsewhere, velocity if needed.
    """
    mesh = domain.mesh
    setup = PorousBuilder(scene, mesh, Stopwatch(), domain).fluid()
    needs_velocity = truth.scene.model.viscosity or truth.scene.model.convection
    return replace(
        setup,
        body_force=sources(truth.fluid_body_force),
        velocity=Dirichlet(mesh, 2, entries(NORMALS, truth.exact["v_f"]) if needs_velocity else []),
        pressure=Dirichlet(mesh, 1, entries(["top"], truth.exact["p"])),
        fluxes=tuple(flux(domain, side, truth.flux(side)) for side in CLOSED),
    )


def put_at_start(truth, solid=None, fluid=None, as_scene=False):
    """Give phases the exact state at t = 0; as_scene: accelerations and pressure are zero, as where
    a load is sudden.
    """
    if solid is not None:
        points = solid.mesh.X
        solid.set_initial(truth.at("u", 0.0, points), truth.at("v_s", 0.0, points))
        solid.a[:] = 0.0 if as_scene else truth.at("a_s", 0.0, points)
        solid.reset()
    if fluid is not None:
        points = fluid.mesh.X
        fluid.set_initial(
            truth.at("v_f", 0.0, points), 0.0 if as_scene else truth.at("p", 0.0, points)[:, 0]
        )
        fluid.a[:] = 0.0 if as_scene else truth.at("a_f", 0.0, points)
        fluid.reset()


def steps_to_end(scene):
    """Yield (t, schemes, rates) of the steps of a scene."""
    clock = Clock(scene.time)
    while not clock.finished:
        target = clock.next_target()
        dt = clock.next_size()
        yield clock.t, *clock.schemes(scene.model, dt)
        clock.advance(dt, target)


def converge(residuals, correct):
    """Do Newton's iteration until the residuals are round-off beside their terms."""
    for _ in range(CAP):
        found = residuals()
        if all(norm <= TOLERANCE * force for norm, force in (r.norms() for r in found)):
            return
        correct(found)
    raise AssertionError([r.norms() for r in found])


def solid_alone(truth, scene):
    """Return the skeleton without fluid at the end of the scene."""
    domain = _domain(scene)
    solid = Skeleton(skeleton_setup(truth, scene, domain, flow=False))
    put_at_start(truth, solid=solid)
    for time, (scheme, _), rates in steps_to_end(scene):
        rates = Rates(0.0, rates.c_v, rates.c_a)  # no fluid that the skeleton would drag
        solid.begin_step(scheme, time)

        def correct(residuals, rates=rates):
            solid.renew_tangent(rates)
            solid.correct(residuals[0].total)

        converge(lambda: [solid.residual(Flow(solid.velocity, np.zeros(domain.n_local)))], correct)
        solid.accept()
    return solid


def fluid_alone(truth, scene):
    """Return the fluid on a skeleton that moves as prescribed, at the end of the scene."""
    domain = _domain(scene)
    fluid = PoreFluid(replace(flow_setup(truth, scene, domain), split="plain", has_auxiliary=False))
    put_at_start(truth, fluid=fluid)
    for time, (_, scheme), rates in steps_to_end(scene):
        rates = Rates(rates.c_f, 0.0, 0.0)  # no skeleton that would answer
        begin, middle = (
            prescribed_skeleton(truth, domain, time, scheme, part) for part in (0.0, scheme.alpha_f)
        )
        fluid.begin_step(scheme, rates, time, begin)

        def correct(residuals, rates=rates, mesh_state=middle):
            fluid.renew_tangent(rates, mesh_state)
            fluid.correct(residuals)

        converge(lambda mesh_state=middle: fluid.residual(mesh_state), correct)
        fluid.accept()
    return fluid


def prescribed_skeleton(truth, domain, time, scheme, part):
    """Return the `MeshState` at a part of the step: values between those at its ends, as the solid
    phase has them.
    """
    X = domain.mesh.X
    end = time + scheme.dt
    moving = truth.scene.model.moving_mesh
    u, v = (
        (1 - part) * truth.at(name, time, X) + part * truth.at(name, end, X)
        for name in ("u", "v_s")
    )
    configuration = Configuration.at(domain, X + moving * u, truth.scene.model.viscosity)
    return MeshState(configuration, v, truth.at("v_s", end, X), u, moving)


class _WithSources(PorousBuilder):
    """Builds a scene with the sources of a solution."""

    def __init__(self, truth, scene):
        super().__init__(scene, square(scene), Stopwatch())
        self._truth = truth

    def skeleton(self):
        return skeleton_setup(self._truth, self.scene, self.domain)

    def fluid(self):
        return flow_setup(self._truth, self.scene, self.domain)


def medium(truth, scene, as_scene=False, watch=lambda coupling: None):
    """Return the coupled phases at the end of the scene, built as every scene is but for the
    sources of the solution.

    as_scene : start as a scene does, see `put_at_start`; watch : called with the coupling after
    every step
    """
    start()
    coupling = _WithSources(truth, scene).medium()
    put_at_start(truth, coupling.solid, coupling.fluid, as_scene)
    if scene.time.consistent_start:
        coupling.start(*Clock(scene.time).starting_schemes(scene.model))
    for step, (time, schemes, rates) in enumerate(steps_to_end(scene), 1):
        coupling.step(schemes, rates, time, step)
        coupling.accept()
        watch(coupling)
    return coupling


def _domain(scene):
    start()
    return Domain(square(scene))


# -- errors and orders -----------------------------------------------------------------------------


def l2_error(truth, domain, name, nodal, time):
    """Return |nodal - exact|/|exact| in L2 over the reference configuration; nodal (n_local, k)."""
    rule = Rule.of(domain.element, 2 * domain.element.order + 2)
    points = rule.N @ domain.gather(domain.mesh.X)
    dV = geometry(rule, domain.gather(domain.mesh.X)).dV[..., None]
    exact = truth.at(name, time, points.reshape(-1, 2)).reshape(*points.shape[:2], -1)
    found = rule.N @ domain.gather(nodal)
    return float(np.sqrt((((found - exact) ** 2) * dV).sum() / (exact**2 * dV).sum()))


def errors(truth, end, solid=None, fluid=None):
    """Return dict field -> relative L2 error of the accepted state of the phases at the time
    `end`.
    """
    found = {}
    if solid is not None:
        found |= {
            name: l2_error(truth, solid.domain, name, field, end)
            for name, field in (("u", solid.u), ("v_s", solid.v))
        }
    if fluid is not None:
        fields = ("v_f", fluid.v), ("p", fluid.p[:, None])
        found |= {name: l2_error(truth, fluid.domain, name, field, end) for name, field in fields}
    return found


def orders(sequence, ratio=2.0):
    """Return dict field -> (errors, orders between neighbours) of error dicts on refinements by a
    ratio.
    """
    table = {name: np.array([found[name] for found in sequence]) for name in sequence[0]}
    return {name: (e, np.log(e[:-1] / e[1:]) / np.log(ratio)) for name, e in table.items()}
