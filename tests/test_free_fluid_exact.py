"""Flows that the elements hold exactly: uniform on any moving mesh, Poiseuille with the force on
every wall.
"""

from itertools import product

import numpy as np
import pytest
import surfaces
import sympy as sp
from free_flow import MU, NORMALS, Flow, at, solved
from manufactured import functions, t, x, y

from porofsi_petsc.coupling.convergence import EPSILON
from porofsi_petsc.phases.coupling_data import Rates

LAWS = ("harmonic", "linear_elastic", "neo_hookean")
QUADRILATERAL = ("neo_hookean", "quadrilateral")
# The top is at rest, so that a uniform pressure has a simple traction there; everything else moves
# about, elements change to between 0.1 and 2 times their size.
WILD = (
    (1 - y) * sp.sin(7 * t) * t * (x + sp.sin(3 * y + 2 * x) / 2),
    (1 - y) * sp.sin(9 * t) * t * (-y + sp.cos(4 * x + y) / 2),
)
# of about ten steps, in each 1e-16 times the number of terms of an equation times the condition of
# the system
ROUND_OFF = 1e-12


def cells(cell_type):
    """Return the changes that make a mesh of the cells."""
    diagonal = "alternating" if cell_type == "triangle" else "right"
    return f"mesh.cell_type={cell_type}", f"mesh.diagonal={diagonal}"


@pytest.mark.parametrize("pressure", [0.0, 3.0])
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("law, cell_type", [*product(LAWS, ["triangle"]), QUADRILATERAL])
def test_a_uniform_flow_stays_uniform_however_the_mesh_moves(law, cell_type, order, pressure):
    flow = Flow(2 * y - x, sp.Float(pressure) + 0 * x, WILD)
    options = f"mesh.order={order}", f"mesh_motion.law={law}", "mesh_motion.stiffening=1.0"
    options += cells(cell_type)
    coupling = solved(flow, *options, "coupling.tolerance=1e-12", disturbance=0.1)
    moved = np.abs(coupling.motion.u).max()
    v = np.abs(coupling.fluid.v - [2, 1]).max()
    p = np.abs(coupling.fluid.p - pressure).max()
    print(
        f"P{order} {law}: mesh moved by {moved:.2f}, min J {coupling.motion.smallest_ratio:.2f},"
        f" errors v {v:.1e}, p {p:.1e}"
    )
    assert moved > 0.1 and coupling.motion.smallest_ratio < 0.9
    assert v < ROUND_OFF and p < 10 * ROUND_OFF


def test_what_passes_for_round_off_is_that_of_a_uniform_flow():
    """Its residuals are below the bound and less than a hundredth of those of a flow that differs
    in the tenth digit.
    """
    flow = Flow(2 * y - x, sp.S.Zero, WILD)
    coupling = solved(flow, "mesh.order=2")
    fluid = coupling.fluid
    mesh_state = coupling.motion.mesh_state()
    rates = Rates(fluid.scheme.c_v, 0.0, 0.0)
    bounds = {
        field: EPSILON * np.linalg.norm(size)
        for field, size in fluid.cancelling(mesh_state, rates).items()
    }
    uniform = norms(fluid.residual(mesh_state))
    factor = np.ones_like(fluid.unknowns)
    factor[:, :2] += 1e-10 * np.random.default_rng(3).standard_normal(fluid.v.shape)
    fluid.unknowns = fluid.unknowns * factor
    disturbed = norms(fluid.residual(mesh_state))
    for field, bound in bounds.items():
        print(
            f"{field}: residual {uniform[field]:.1e}, bound {bound:.1e}, disturbed"
            f" {disturbed[field]:.1e}"
        )
        assert 0 < uniform[field] < bound < disturbed[field] / 100


def norms(residuals):
    return dict(zip(("fluid momentum", "volume"), (r.norms()[0] for r in residuals), strict=True))


POISEUILLE = Flow(
    2 * y**2 - sp.Rational(4, 3) * y**3, 8 * sp.nsimplify(MU) * (1 - x), open=("right",)
)  # v_x = 4 y (1 - y)


def traction(flow, side):
    """Return the functions of σ n on a side of a mesh at rest [Pa]."""
    return functions(flow.traction(side))


@pytest.mark.parametrize("cell_type", ["triangle", "quadrilateral"])
@pytest.mark.parametrize("steady", [True, False])
def test_poiseuille_is_exact_on_quadratic_elements_with_the_force_on_every_node_of_the_boundary(
    steady, cell_type
):
    """The flow is in the space of the elements, and the force is their residual: no stress is
    recovered, nothing is lost.
    """
    inertia = "false" if steady else "true"
    scheme = ("time.scheme=steady",) if steady else ()
    model = (
        f"model.fluid_inertia={inertia}",
        f"model.solid_inertia={inertia}",
        "model.moving_mesh=false",
        *scheme,
    )
    options = (
        *model,
        *cells(cell_type),
        "mesh.order=2",
        "limits.mesh_displacement=report",
        "coupling.tolerance=1e-12",
    )
    coupling = solved(POISEUILLE, *options, disturbance=0.1)
    fluid = coupling.fluid
    error = {
        name: np.abs(a - at(POISEUILLE.exact[name], 0.5, fluid.mesh.X)).max()
        for name, a in fields(fluid).items()
    }
    expected = np.zeros_like(fluid.force)
    for side in NORMALS:
        place = surfaces.traction(fluid.domain, side, traction(POISEUILLE, side))
        expected -= surfaces.residual(fluid.domain, 2, place, 0.5)
    force = np.abs(fluid.force + expected).max()
    largest = np.abs(expected).max()
    drag = fluid.force[np.isclose(fluid.mesh.X[:, 1], 0.0)].sum(axis=0)
    print(
        f"Poiseuille: errors v {error['v']:.1e}, p {error['p']:.1e}, nodal forces {force:.1e} of"
        f" {largest:.2f} N"
    )
    assert (
        max(error.values()) < 1e-10 and force < 1e-11
    )  # the tolerance of the iteration times the condition of the system
    assert largest > 0.05 and drag[0] > 0 > drag[1]  # along the flow, and pressed outwards


def fields(fluid):
    return {"v": fluid.v, "p": fluid.p[:, None]}
