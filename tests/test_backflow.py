"""Open boundaries with a backflow term: exact flow that enters, its tangent, and a flow that it
keeps in bounds.
"""

from dataclasses import dataclass

import numpy as np
import pytest
import sympy as sp
from free_flow import RHO, Flow, solved
from manufactured import t, x, y
from mpi4py import MPI
from running import SCENES, Job, run_here

from porofsi_petsc import load_scene
from porofsi_petsc.conditions import State
from porofsi_petsc.errors import ConvergenceError, InputError
from porofsi_petsc.output.history import read_history
from porofsi_petsc.phases.coupling_data import Rates
from porofsi_petsc.simulation.simulation import Simulation

BETA = 0.8
# The top is at rest and the uniform flow (2, -1) m/s enters through it; everything else moves
# about.
WILD = (
    (1 - y) * sp.sin(7 * t) * t * (x + sp.sin(3 * y + 2 * x) / 2),
    (1 - y) * sp.sin(9 * t) * t * (-y + sp.cos(4 * x + y) / 2),
)
PRESSURE = 3.0


@dataclass(frozen=True)
class Entering(Flow):
    """A flow that enters through its open sides at rest: their traction is σ n - (β/2) ρ (v·n)
    v.
    """

    def traction(self, side):
        """Return what the backflow term leaves of σ n, (2,) [Pa]."""
        normal = {"top": sp.Matrix([0, 1])}[side]
        return (
            super().traction(side)
            - sp.Float(BETA) / 2 * sp.Float(RHO) * self.v.dot(normal) * self.v
        )

    def overrides(self):
        """Return the changes of the scene, with the backflow term on the open sides."""
        boundary, start = super().overrides()
        return boundary.replace("{on='top',", f"{{on='top', backflow={BETA},"), start


ENTERING = Entering(2 * y + x, sp.Float(PRESSURE) + 0 * x, WILD)


def test_a_uniform_flow_enters_undisturbed():
    """With the traction that balances the term the uniform flow is exact, on a moving mesh too."""
    coupling = solved(
        ENTERING,
        "mesh.order=2",
        "mesh_motion.stiffening=1.0",
        "coupling.tolerance=1e-12",
        disturbance=0.1,
    )
    v = np.abs(coupling.fluid.v - [2, -1]).max()
    p = np.abs(coupling.fluid.p - PRESSURE).max()
    print(f"mesh moved by {np.abs(coupling.motion.u).max():.2f}, errors v {v:.1e}, p {p:.1e}")
    assert (
        v < 1e-12 and p < 1e-11
    )  # round-off of ten steps: 1e-16 times the terms of an equation times the condition


def test_tangent():
    """The tangent with the term is the derivative of the residual by v, at a state that is no
    solution.
    """
    coupling = solved(ENTERING, "mesh.order=2", "coupling.tolerance=1e-9", disturbance=0.1)
    fluid = coupling.fluid
    mesh_state = coupling.motion.mesh_state()
    random = np.random.default_rng(5)
    pressure = fluid.unknowns[:, 2]
    start = fluid.unknowns[:, :2] + random.standard_normal(fluid.v.shape)
    change = random.standard_normal(fluid.v.shape)

    def residual(step):
        velocity = start + step * change / fluid.scheme.alpha_f
        fluid.unknowns = np.column_stack([velocity, pressure])
        return fluid.residual(mesh_state)[0].unconstrained

    step = 1e-6
    difference = (residual(step) - residual(-step)) / (2 * step)
    residual(0.0)
    vectors = np.empty((*fluid.domain.cells.shape, 2))
    for chunk, K in fluid.trial_tangents(Rates(fluid.scheme.c_v, 0.0, 0.0), mesh_state):
        vectors[chunk] = np.einsum(
            "eaibj,ebj->eai", K[:, :, :2, :, :2], change[fluid.domain.cells[chunk]]
        )
    exact = fluid.domain.scatter_add(vectors)
    error = np.abs(difference - exact).max() / np.abs(exact).max()
    top = fluid.mesh.X[:, 1] > 1 - 1e-9
    term = np.zeros_like(exact)
    (place,) = [place for place in fluid.surfaces if place.key.endswith("backflow:top")]
    state = State(0.0, mesh_state.displacement, start, start)
    place.surface.add_to(term, place.condition.residual(state))
    on_top, elsewhere = (np.abs(term[here]).max() for here in (top, ~top))
    print(
        f"derivative {error:.1e}; the term is {on_top:.2g} N on the top, {elsewhere:.1g} N"
        " elsewhere"
    )
    assert error < 1e-7  # of a central difference with steps of 1e-6
    assert on_top > 0.01 and elsewhere == 0


def test_it_keeps_a_flow_that_reverses_in_bounds(tmp_path):
    """A channel that sucks: what enters through the outlet grows without bound, with the term it
    stays that of the inlet.

    The speed in the middle of the channel cannot pass the 10 m/s of the profile that the inlet
    prescribes.
    """
    scene = str(SCENES / "reversing_channel.toml")
    out = str(tmp_path)
    run_here(Job(scene, out))
    found = read_history(tmp_path / "history.csv")["A.vf_x"]
    largest = np.abs(found).max()
    print(f"largest speed at A: {largest:.3g} m/s, 10 m/s at the inlet")
    assert largest < 10
    run_here(Job(scene, out, ("boundary.2.backflow=0.0",), force=True))  # by itself
    assert np.array_equal(read_history(tmp_path / "history.csv")["A.vf_x"], found)
    with pytest.raises(
        ConvergenceError, match="; try backflow = 1 on a boundary through which the flow comes back"
    ):
        off = "boundary.2.backflow=0.0", "stabilization.backflow=false"
        run_here(Job(scene, out, off, force=True))


OUTLET = "{on='right', %s}"
SIDES = "boundary=[{on='left', velocity={x=1, y=0}}, {on=['bottom', 'top'], velocity={y=0}}, %s]"


@pytest.mark.parametrize(
    "outlet, has_it",
    [
        ("displacement={x=0}", True),
        ("velocity={y=0}", True),
        ("windkessel={distal=1}", True),
        ("velocity={x=1}", False),
        ("traction={x=0}", False),
        ("dead_pressure=0", False),
        ("backflow=0.3", False),
    ],
)
def test_an_open_boundary_has_it_by_itself(outlet, has_it):
    """Where nothing across it is given but a windkessel, and the fluid has inertia and
    convection.
    """
    changes = SIDES % (OUTLET % outlet), "model.fluid_inertia=true", "model.convection=true"
    for more, wanted in (
        ((), has_it),
        (("stabilization.backflow=false",), False),
        (("model.convection=false",), False),
    ):
        scene = load_scene(str(SCENES / "outlet.toml"), (*changes, *more))
        fluid = Simulation(scene, MPI.COMM_SELF).coupling.fluid
        keys = [place.key for place in fluid.surfaces]
        assert ("backflow:right" in keys) == wanted


def test_refused_where_it_has_no_meaning(tmp_path):
    """In a porous medium, with the wrong sign, on a solid."""
    with pytest.raises(
        InputError,
        match=("received one with porous materials, expected a surface of a free fluid; leave it"),
    ):
        load_scene("column_step", ("boundary.0.backflow=1.0",))
    with pytest.raises(InputError, match="boundary.2.backflow.*received -1"):
        load_scene(str(SCENES / "reversing_channel.toml"), ("boundary.2.backflow=-1.0",))
    with pytest.raises(
        InputError,
        match="backflow.*is on the solid, expected a surface of a free fluid; leave it out",
    ):
        run_here(Job(str(SCENES / "piston.toml"), str(tmp_path), ("boundary.0.backflow=1.0",)))
