"""A free fluid against manufactured flows: orders in space and time, on meshes that rest and that
move.
"""

import pytest
import sympy as sp
from free_flow import Flow, errors, solved
from manufactured import orders, t, x, y

WAVE = sp.sin(1.5 * x - y + 0.2) / 2
PRESSURE = sp.cos(1.2 * x + 0.7 * y)
STEADY = (
    "time.scheme=steady",
    "model.fluid_inertia=false",
    "model.solid_inertia=false",
    "time.end=1.0",
    "time.step=1.0",
)
# The top stays straight, so that its traction is that of the formula; the other sides are curved,
# and so are elements of order 2.
BEND = (
    x / 5 + y / 10 - (1 - y) * sp.sin(3 * y) / 6,
    -x / 8 - y / 10 + (1 - y) * sp.sin(2 * x + 1) / 6,
)
AT_REST = Flow(WAVE, PRESSURE)
BENT = Flow(WAVE, PRESSURE, BEND)
SPACE = {
    "P1 at rest": (1, AT_REST, "linear_elastic"),
    "P2 at rest": (2, AT_REST, "linear_elastic"),
    "P1 bent": (1, BENT, "linear_elastic"),
    "P2 bent": (2, BENT, "neo_hookean"),
}
CELLS = {1: (16, 32), 2: (8, 16)}
# On these meshes the leading term of the error is not alone yet, and the meshes are not similar to
# each other.
SLACK = 0.25


def report(case, found, theory):
    """Print what was measured beside the theory."""
    for name, order in theory.items():
        error, rate = found[name]
        print(f"{case}: {name} errors {error}, order {rate[-1]:.2f}, theory {order}")


@pytest.mark.parametrize("case", SPACE)
def test_order_in_space(case):
    """With PSPG on an equal-order pair v is of order k + 1 and p of order k in L2."""
    (order, flow, law), found = SPACE[case], []
    for cells in CELLS[order]:
        mesh = (
            f"mesh.order={order}",
            f"mesh.x.cells=[{cells}]",
            f"mesh.y.cells=[{cells}]",
            f"mesh_motion.law={law}",
        )
        found.append(errors(flow, solved(flow, *mesh, *STEADY), 1.0))
    table = orders(found)
    theory = {"v": order + 1, "p": order}
    report(case, table, theory)
    assert all(table[field][1][-1] > expected - SLACK for field, expected in theory.items())
    assert all(table[field][0][-1] < 0.01 for field in theory)  # that the limit is the exact flow


# Fields that quadratic elements hold exactly, also on a mesh that is stretched and turned: only
# time errs.
STREAM = (sp.cos(3 * t) * x * y + sp.sin(2 * t) * (x**2 - y**2) / 4) / 3
SLOPE = (1 + sp.sin(4 * t)) * (1 + x / 2 - y / 3)
TURN = (4 * t**2 * (x / 5 + y / 10), -4 * t**2 * (0.15 * x + y / 10))
STEPS = (0.05, 0.025)


@pytest.mark.parametrize("rho_inf", [0.0, 0.5, 1.0])
def test_order_in_time(rho_inf):
    """Velocity and pressure are of second order for every ρ∞, on a mesh that is in motion."""
    flow = Flow(STREAM, SLOPE, TURN, ("bottom", "right", "top"))
    mesh = ("mesh.order=2", "mesh.x.cells=[2]", "mesh.y.cells=[2]")
    runs = [solved(flow, *mesh, f"time.step={step}", f"time.rho_inf={rho_inf}") for step in STEPS]
    table = orders([errors(flow, coupling, 0.5) for coupling in runs])
    report(f"rho_inf = {rho_inf}", table, {"v": 2, "p": 2})
    assert all(rate[-1] > 2 - SLACK for _, rate in table.values())
