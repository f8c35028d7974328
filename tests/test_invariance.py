"""What no force may come of: constant pressure, uniform flow through a moving mesh, a frame that is
translated or turned.
"""

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp
from manufactured import (
    NORMALS,
    SCENE,
    Fields,
    Manufactured,
    entries,
    medium,
    prescribed_skeleton,
    square,
    steps_to_end,
    t,
    x,
    y,
)
from small_media import MESHES
from small_media import medium as small_medium
from surfaces import flux

from porofsi_petsc import load_scene
from porofsi_petsc.fem.domain import Domain
from porofsi_petsc.fem.essential import Dirichlet
from porofsi_petsc.linalg.stopwatch import Stopwatch
from porofsi_petsc.phases.coupling_data import Flow, Rates
from porofsi_petsc.phases.pore_fluid import PoreFluid
from porofsi_petsc.simulation.porous import PorousBuilder

pytestmark = pytest.mark.usefixtures("petsc")
FLOW = ("model.viscosity=true", "model.convection=true")
COARSE = ("mesh.x.cells=[3]", "mesh.y.cells=[3]", "time.step=0.05", "time.end=0.25")


def moments(X, force):
    """Return the moments of nodal forces (n, d) about the origin, one for each pair of axes."""
    return [
        (X[:, i] * force[:, j] - X[:, j] * force[:, i]).sum()
        for i in range(X.shape[1])
        for j in range(i)
    ]


@pytest.mark.parametrize("mesh", MESHES)
def test_a_constant_pressure_has_no_net_force_and_no_moment_on_a_deformed_body(mesh):
    """On the skeleton it acts on the surface alone, -∮ p n, whose sum and moment vanish; on the
    fluid it does not act.
    """
    coupling, (solid_scheme, fluid_scheme), rates = small_medium(
        mesh, "model.porosity=variable", "model.moving_mesh=true"
    )
    solid = coupling.solid
    fluid = coupling.fluid
    rng = np.random.default_rng(11)
    solid.u[:] = 0.02 * rng.standard_normal(solid.u.shape)
    pressure = 1e5
    fluid.set_initial(np.zeros_like(solid.u), pressure)
    for phase in (solid, fluid):
        phase.reset()
    fluid.begin_step(fluid_scheme, rates, 0.0, solid.accepted_mesh_state())
    solid.begin_step(solid_scheme, 0.0)
    solid.unknowns = solid.u
    fluid.unknowns = np.column_stack(
        [np.zeros_like(solid.u), np.full(solid.mesh.n_owned, pressure)]
    )
    force = solid.residual(
        Flow(np.zeros_like(solid.u), np.full(solid.mesh.n_local, pressure))
    ).terms["pressure"]
    positions = solid.mesh.X + solid.u
    inner = np.ones(solid.mesh.n_owned, dtype=bool)
    inner[np.concatenate([facets.nodes.ravel() for facets in solid.mesh.facets.values()])] = False
    largest = np.abs(force).max()
    # round-off of sums over some hundred nodes, and of moments with arms of 20 m; ∇p has the
    # cancellation of p/h
    assert np.abs(force[inner]).max(initial=0.0) < 1e-12 * largest
    assert np.abs(force.sum(axis=0)).max() < 1e-11 * largest
    assert np.abs(moments(positions, force)).max() < 1e-10 * largest
    momentum, volume = fluid.residual(solid.mesh_state())
    assert np.abs(momentum.terms["pressure"]).max() < 1e-11 * largest
    assert np.abs(volume.terms["undrained"]).max() == 0


UNIFORM = (0.7, -0.4)  # [m/s]
SHAKEN = (
    sp.sin(2 * sp.pi * x) * sp.sin(sp.pi * y) * sp.sin(8 * t) / 25
)  # [m]; the sides do not move


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("rho_inf", [0.0, 0.5])
def test_a_uniform_flow_stays_uniform_while_the_mesh_is_shaken(order, rho_inf):
    """An almost empty skeleton of vanishing drag carries the mesh: what is left is the fluid in ALE
    form.
    """
    empty = (
        "material.0.porosity=0.99999999999999",
        "material.0.permeability.k=1e18",
        "material.0.permeability.law=constant",
    )
    constant = ("model.porosity=constant", f"mesh.order={order}", f"time.rho_inf={rho_inf}")
    scene = load_scene(SCENE, (*COARSE, *FLOW, *empty, *constant))
    motion = Manufactured(Fields((SHAKEN, SHAKEN / 2), x * y, x), scene)
    mesh = square(scene)
    domain = Domain(mesh)
    constants = [lambda time, points, c=c: np.full(len(points), c) for c in UNIFORM]
    outflow = {side: np.dot(normal, UNIFORM) for side, normal in NORMALS.items()}
    setup = replace(
        PorousBuilder(scene, mesh, Stopwatch(), domain).fluid(),
        velocity=Dirichlet(mesh, 2, entries(NORMALS, constants)),
        fluxes=tuple(
            flux(domain, side, lambda time, points, g=outflow[side]: np.full(len(points), g))
            for side in ("left", "bottom", "right")
        ),
        split="plain",
        has_auxiliary=False,
    )
    fluid = PoreFluid(setup)
    fluid.set_initial(np.tile(UNIFORM, (mesh.n_local, 1)), np.zeros(mesh.n_local))
    moved = 0.0
    for time, (_, scheme), rates in steps_to_end(scene):
        rates = Rates(rates.c_f, 0.0, 0.0)
        begin, middle = (
            prescribed_skeleton(motion, domain, time, scheme, part)
            for part in (0.0, scheme.alpha_f)
        )
        fluid.begin_step(scheme, rates, time, begin)
        fluid.renew_tangent(rates, middle)
        fluid.correct(fluid.residual(middle))
        fluid.accept()
        moved = max(moved, np.abs(middle.displacement).max())
    assert moved > 0.03
    dynamic = 2.0 * np.dot(UNIFORM, UNIFORM)  # ρ v² [Pa]
    print(
        f"P{order} rho_inf = {rho_inf}: v_f {np.abs(fluid.v - UNIFORM).max():.1e}, p"
        f" {np.abs(fluid.p).max():.1e}, exact 0"
    )
    # round-off of some linear solves; 1e-14 of the volume is skeleton, whose divergence the fluid
    # must make room for
    assert np.abs(fluid.v - UNIFORM).max() < 1e-12
    assert np.abs(fluid.p).max() < 1e-10 * dynamic


U = (sp.sin(1.3 * x + 0.4 * y + 3 * t) / 10, sp.cos(0.9 * x - 1.1 * y + 2 * t) / 12)
PSI = sp.sin(1.5 * x - y + 2 * t) / 2
P = (1 + sp.sin(4 * t)) * sp.cos(1.2 * x + 0.7 * y)
SPEED = (3.0, -2.0)
ANGLE = 0.8


def translated():
    """Return the fields seen from a frame that moves with -SPEED: q gains SPEED, the curl of its
    own stream function.
    """
    a, b = SPEED
    return Fields((U[0] + a * t, U[1] + b * t), PSI + a * (y + U[1]) - b * (x + U[0]), P)


def turned():
    """Return the fields turned by ANGLE about the origin."""
    c = np.cos(ANGLE)
    s = np.sin(ANGLE)
    X = x + U[0]
    Y = y + U[1]
    return Fields((c * X - s * Y - x, s * X + c * Y - y), PSI, P)


@pytest.fixture(scope="module")
def solutions():
    """Return the three solutions, derived once for both orders."""
    frames = {"at rest": Fields(U, PSI, P), "translated": translated(), "turned": turned()}
    return {name: Manufactured(fields, load_scene(SCENE, FLOW)) for name, fields in frames.items()}


def end_state(truth, order):
    """Return X, u, v_f, p of the medium at the end, with every term of the model, finite strain and
    variable porosity.
    """
    scene = load_scene(
        SCENE,
        (
            *COARSE,
            *FLOW,
            f"mesh.order={order}",
            "coupling.tolerance=1e-11",
            "coupling.scheme=direct",
        ),
    )
    coupling = medium(truth, scene)
    return coupling.solid.mesh.X, coupling.solid.u, coupling.fluid.v, coupling.fluid.p


def difference(a, b):
    """Return the largest difference over the largest value."""
    return np.abs(a - b).max() / np.abs(b).max()


# Coupling tolerance 1e-11 of the forces, times the number of steps; Newton's last iteration leaves
# far less.
SAME = 1e-10


@pytest.mark.parametrize("order", [1, 2])
def test_the_discrete_solution_does_not_feel_a_translating_or_turned_frame(solutions, order):
    """Galilei's principle and objectivity of the discrete equations: not the exact solution, but
    its approximation is carried.
    """
    X, u, v, p = end_state(solutions["at rest"], order)
    _, u_t, v_t, p_t = end_state(solutions["translated"], order)
    _, u_r, v_r, p_r = end_state(solutions["turned"], order)
    c = np.cos(ANGLE)
    s = np.sin(ANGLE)
    turn = np.array([[c, s], [-s, c]])
    found = {
        "translated": (
            difference(u_t - 0.25 * np.array(SPEED), u),
            difference(v_t - SPEED, v),
            difference(p_t, p),
        ),
        "turned": (
            difference(X + u_r, (X + u) @ turn),
            difference(v_r, v @ turn),
            difference(p_r, p),
        ),
    }
    for frame, values in found.items():
        print(f"P{order} {frame}: differences of u, v_f, p {values}, exact 0")
        assert max(values) < SAME
