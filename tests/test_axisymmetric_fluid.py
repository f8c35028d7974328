"""A free fluid around an axis: flow in a pipe, the order of convergence on a manufactured flow, a
uniform flow on a mesh that moves.
"""

import numpy as np
import pytest
import sympy as sp

from porofsi_petsc import load_scene
from porofsi_petsc.errors import IncompatibleData
from porofsi_petsc.fem.geometry import Rule, geometry
from porofsi_petsc.simulation.simulation import Simulation

pytestmark = pytest.mark.usefixtures("petsc")
RHO, MU = 2.0, 0.3  # [kg/m³], [Pa s]
SIDES = (
    "right",
    "bottom",
    "top",
)  # of a cylinder of radius and height 1 m; the left one is its axis
SCENE = {
    "title": "A fluid around the axis x = 0",
    "mesh": {
        "kind": "rectangle",
        "axisymmetric": True,
        "diagonal": "alternating",
        "x": {"points": [0.0, 1.0], "cells": [4]},
        "y": {"points": [0.0, 1.0], "cells": [4]},
    },
    "time": {"scheme": "steady", "end": 1.0, "step": 1.0},
    "model": {"solid_inertia": False, "fluid_inertia": False},
    "material": [{"region": "all", "fluid": {"density": RHO, "viscosity": MU}}],
    "coupling": {"tolerance": 1e-10},
}
SLACK = 0.25  # between two meshes the leading term of the error is not alone yet


def solved(boundary, *overrides, **tables):
    """Return the simulation of a scene at its end."""
    simulation = Simulation(load_scene(SCENE | {"boundary": boundary} | tables, overrides))
    simulation.run()
    return simulation


def test_flow_in_a_pipe_is_that_of_hagen_and_poiseuille():
    """v_z = 1 - r², p = 4 μ (1 - z), which quadratic elements hold; the wall is pulled by 2 π R L
    times the shear stress 2 μ, as the pressure pushes on π R².
    """
    boundary = [
        {"on": "right", "velocity": {"x": 0.0, "y": 0.0}},
        {"on": "bottom", "velocity": {"x": 0.0, "y": "1 - x**2"}},
        {"on": "top", "velocity": {"x": 0.0}},
    ]
    force = [{"name": "wall", "on": "right"}, {"name": "inlet", "on": "bottom"}]
    found = solved(boundary, "mesh.order=2", force=force)
    fluid = found.coupling.fluid
    r, z = fluid.mesh.X.T
    assert np.abs(fluid.v - np.column_stack([0 * r, 1 - r**2])).max() < 1e-8
    assert np.abs(fluid.p - 4 * MU * (1 - z)).max() < 1e-8
    assert found.history["wall.f_y"][-1] == pytest.approx(4 * np.pi * MU, rel=1e-7)
    assert found.history["inlet.f_y"][-1] == pytest.approx(-4 * np.pi * MU, rel=1e-7)


class Flow:
    """A steady flow from ψ = r² f(r, z), v = (-r ∂_z f, 2 f + r ∂_r f), and the body force that it
    wants, written out once more in cylindrical coordinates.
    """

    def __init__(self):
        r, z = sp.symbols("r z", positive=True)
        f = sp.sin(1.5 * z + 0.2) * (1 + sp.cos(1.3 * r**2)) / 4
        p = sp.cos(1.2 * r**2 + 0.7 * z)
        v_r, v_z = -r * f.diff(z), 2 * f + r * f.diff(r)
        assert sp.simplify((r * v_r).diff(r) / r + v_z.diff(z)) == 0

        def carried(v):
            return v_r * v.diff(r) + v_z * v.diff(z)

        def laplacian(v):
            return (r * v.diff(r)).diff(r) / r + v.diff(z, 2)

        b = (
            carried(v_r) + (p.diff(r) - MU * (laplacian(v_r) - v_r / r**2)) / RHO,
            carried(v_z) + (p.diff(z) - MU * laplacian(v_z)) / RHO,
        )
        top = MU * (v_r.diff(z) + v_z.diff(r)), -p + 2 * MU * v_z.diff(z)
        self.v, self.b, self.top = (
            [self._function(e, r, z) for e in es] for es in ((v_r, v_z), b, top)
        )
        self.p = self._function(p, r, z)

    @staticmethod
    def _function(expression, r, z):
        compiled = sp.lambdify((r, z), sp.simplify(expression), "numpy", cse=True)
        return lambda t, X: compiled(X[:, 0], X[:, 1]) + np.zeros(len(X))


FLOW = Flow()


def distance(fluid):
    """Return the relative L2 errors of v and p over the body."""
    domain = fluid.domain
    rule = Rule.of(domain.element, 2 * domain.element.order + 2)
    X = domain.gather(domain.mesh.X)
    dV = geometry(rule, X).dV.ravel()
    points = (rule.N @ X).reshape(-1, 2)
    errors = []
    for found, functions in ((fluid.v, FLOW.v), (fluid.p[:, None], [FLOW.p])):
        exact = np.column_stack([f(0.0, points) for f in functions])
        wrong = (rule.N @ domain.gather(found)).reshape(exact.shape) - exact
        errors.append(np.sqrt(dV @ (wrong**2).sum(axis=1) / (dV @ (exact**2).sum(axis=1))))
    return np.array(errors)


@pytest.mark.parametrize(
    ("order", "kind", "orders"),
    [(1, "triangle", (2, 1)), (2, "triangle", (3, 2)), (1, "quadrilateral", (2, 1))],
)
def test_a_manufactured_flow_has_the_orders_of_its_elements(order, kind, orders):
    """With convection and the axis as a side, given velocity but for the traction on the top."""
    boundary = [
        {"on": ["right", "bottom"], "velocity": {"x": FLOW.v[0], "y": FLOW.v[1]}},
        {"on": "top", "traction": {"x": FLOW.top[0], "y": FLOW.top[1]}},
    ]
    body = {"fluid": {"x": FLOW.b[0], "y": FLOW.b[1]}}
    errors = []
    for n in (8, 16):
        cells = f"mesh.x.cells=[{n}]", f"mesh.y.cells=[{n}]"
        kinds = f"mesh.order={order}", f"mesh.cell_type={kind}"
        cut = ("mesh.diagonal=right",) if kind == "quadrilateral" else ()
        found = solved(boundary, *cells, *kinds, *cut, body_force=body)
        errors.append(distance(found.coupling.fluid))
    print(order, kind, errors, np.log2(errors[0] / errors[1]))
    assert (np.log2(errors[0] / errors[1]) > np.array(orders) - SLACK).all()


@pytest.mark.parametrize("law", ["neo_hookean", "harmonic"])
@pytest.mark.parametrize("order", [1, 2])
def test_a_uniform_flow_stays_uniform_however_the_mesh_moves(order, law):
    """Along the axis, while the outer wall bulges and the bottom goes up; nodes of the axis slide
    on it.
    """
    bulge = {"x": "0.5*t*x**2*sin(2*y)", "y": "0.4*t*(1 - y)*(1 + x)"}
    boundary = [
        {"on": ["right", "bottom"], "velocity": {"x": 0.0, "y": 1.0}, "displacement": bulge},
        {"on": "top", "displacement": {"x": "0.5*t*x**2*sin(2)", "y": 0.0}},
    ]
    found = solved(
        boundary,
        f"mesh.order={order}",
        f"mesh_motion.law={law}",
        time={"end": 0.5, "step": 0.1},
        model={"moving_mesh": True, "convection": True},
        initial={"fluid_velocity": {"y": 1.0}},
        coupling={"tolerance": 1e-12, "tangent": "newton"},
    )
    coupling = found.coupling
    on_axis = coupling.fluid.mesh.X[:, 0] == 0
    assert np.abs(coupling.motion.u).max() > 0.2 and coupling.motion.smallest_ratio < 0.9
    assert np.abs(coupling.motion.u[on_axis, 1]).max() > 0.1
    # of five steps, in each 1e-16 times the terms of an equation times the condition of the system
    assert np.abs(coupling.fluid.v - [0.0, 1.0]).max() < 1e-11
    assert np.abs(coupling.fluid.p).max() < 1e-10


def test_a_closed_vessel_keeps_its_volume():
    """A piston of the area π R² drives what a ring of the wall lets out: the data balance as those
    of the whole body, and what does not is refused.
    """

    def vessel(leak):
        return [
            {"on": "bottom", "velocity": {"x": 0.0, "y": 1.0}},
            {"on": "top", "velocity": {"x": 0.0, "y": 0.0}},
            {"on": "right", "velocity": {"x": leak, "y": 0.0}, "priority": -1},
        ]

    found = solved(vessel(0.5), "mesh.order=2")  # π R² · 1 = 2 π R H · 1/2
    assert np.isfinite(found.coupling.fluid.p).all()
    with pytest.raises(IncompatibleData, match="m³/s"):
        solved(vessel(1.0), "mesh.order=2")


def test_an_outlet_feels_the_flow_of_the_whole_pipe():
    """A plug flow through a resistance: Q = π R² v, p = R_d Q everywhere."""
    boundary = [
        {"on": "right", "velocity": {"x": 0.0}},
        {"on": "bottom", "velocity": {"x": 0.0, "y": 2.0}},
        {"on": "top", "windkessel": {"distal": 3.0}},
    ]
    ideal = [{"region": "all", "fluid": {"density": RHO}}]
    found = solved(
        boundary,
        material=ideal,
        model={"viscosity": False},
        time={"end": 0.2, "step": 0.1},
        initial={"fluid_velocity": {"y": 2.0}},
    )
    flow = 2 * np.pi
    assert found.history["top.flow_rate"][-1] == pytest.approx(flow, rel=1e-10)
    assert np.abs(found.coupling.fluid.p - 3 * flow).max() < 1e-8 * flow
