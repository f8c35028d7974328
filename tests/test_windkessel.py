"""Windkessel outlets: a plug flow in a channel makes of the equations ordinary ones."""

from functools import partial

import numpy as np
import pytest
from running import SCENES, Job, history, needs_mpirun, run_here, run_on
from scipy.integrate import solve_ivp

from porofsi_petsc.errors import InputError, LimitError

SCENE = str(SCENES / "outlet.toml")
FLAP = str(SCENES / "flap.toml")
LENGTH, HEIGHT, DENSITY = 1.0, 0.2, 1000.0
R_P, R_D, C = 2e3, 3e4, 2e-5  # time constant R_d C = 0.6 s


def outlet(proximal=R_P, distal=R_D, compliance=C, **more):
    """Return the change of the scene that sets the outlet."""
    values = {"proximal": proximal, "distal": distal, "compliance": compliance} | more
    keys = ", ".join(f"{key}={value}" for key, value in values.items())
    return f"boundary.1.windkessel={{ {keys} }}"


def errors(folder, steps, reference, *changes):
    """Return the largest errors of pressure and flow, over their largest values."""
    changes = (f"time.step={0.8 / steps}", *changes)
    run_here(Job(SCENE, str(folder / str(steps)), changes))
    found = history(folder / str(steps))
    exact = reference(found["t"][1:])
    return [
        np.abs(found[f"right.{name}"][1:] - values).max() / np.abs(values).max()
        for name, values in zip(("pressure", "flow_rate"), exact, strict=True)
    ]


def given_flow(t, proximal=R_P):
    """Return pressure and flow where the inflow is 0.3 + 0.2 sin 3t m/s."""
    tau, w = R_D * C, 3.0
    decay = np.exp(-t / tau)
    wave = (np.sin(w * t) - w * tau * (np.cos(w * t) - decay)) / (1 + (w * tau) ** 2)
    Q = HEIGHT * (0.3 + 0.2 * np.sin(w * t))
    return proximal * Q + R_D * HEIGHT * (0.3 * (1 - decay) + 0.2 * wave), Q


@pytest.mark.parametrize("proximal", [0.0, R_P])
def test_pressure_of_a_given_flow_converges_with_order_two(tmp_path, proximal):
    """Of two elements and of three."""
    change = (
        outlet(proximal),
        "boundary.0.velocity.x='0.3 + 0.2*sin(3*t)'",
        "initial.fluid_velocity.x=0.3",
    )
    reference = partial(given_flow, proximal=proximal)
    coarse, fine = (errors(tmp_path, n, reference, *change) for n in (16, 32))
    order = np.log2(coarse[0] / fine[0])
    print(f"errors of p {coarse[0]:.1e}, {fine[0]:.1e}, order {order:.2f}; of Q {fine[1]:.0e}")
    assert order > 1.9
    assert fine[0] < 1e-3
    assert fine[1] < 1e-12  # the flow is given


@pytest.mark.parametrize("compliance", [0.0, 1e-14, C, 1e3])
def test_pressure_of_a_constant_flow_is_exact(tmp_path, compliance):
    """However stiff or soft the outlet is: it neither rings nor loses digits."""
    change = (
        outlet(compliance=compliance),
        "boundary.0.velocity.x=0.3",
        "initial.fluid_velocity.x=0.3",
        "force=[{name='outlet', on='right'}]",
    )
    run_here(Job(SCENE, str(tmp_path), change))
    found = history(tmp_path)
    Q = 0.3 * HEIGHT
    grown = -np.expm1(-found["t"][1:] / (R_D * compliance)) if compliance else 1.0
    pressure = found["right.pressure"][1:]
    assert np.allclose(pressure, R_P * Q + R_D * Q * grown, rtol=1e-12)
    assert np.allclose(found["outlet.f_x"][1:], pressure * HEIGHT, rtol=1e-6)


@pytest.mark.parametrize("proximal", [2e3, 2e6])
def test_a_flow_that_is_driven_by_pressure(tmp_path, proximal):
    """ρ L/H dQ/dt = p_in - R_p Q - P: the outlet in the fluid's matrix, however stiff it is."""
    inertance = DENSITY * LENGTH / HEIGHT

    def rates(t, state):
        Q, P = state
        return [(800 * (1 - np.cos(4 * t)) - proximal * Q - P) / inertance, (Q - P / R_D) / C]

    def reference(t):
        method = {"method": "Radau", "rtol": 1e-10, "atol": 1e-12}
        Q, P = solve_ivp(rates, (0, t[-1]), [0.0, 0.0], t_eval=t, **method).y
        return proximal * Q + P, Q

    drive = outlet(proximal), "boundary.0={on='left', traction={x='800*(1 - cos(4*t))'}}"
    coarse, fine = (errors(tmp_path, n, reference, *drive) for n in (32, 64))
    orders = np.log2(np.divide(coarse, fine))
    print(f"R_p {proximal:g}: errors of p and Q {fine}, orders {orders}")
    assert orders.min() > 1.8 and max(fine) < 2e-3
    sweeps = history(tmp_path / "64")["coupling_iterations"]
    assert sweeps.max() <= 6  # of a lagged tangent, as convection grows; the outlet adds none


def test_a_resistance_alone_follows_the_flow(tmp_path):
    change = outlet(0.0, 5e3, 0.0, distal_pressure=100.0), "boundary.0.velocity.x='0.3*sin(t)'"

    def reference(t):
        Q = 0.3 * HEIGHT * np.sin(t)
        return 5e3 * Q + 100, Q

    assert max(errors(tmp_path, 16, reference, *change)) < 2e-3  # of a line over a step of 0.05 s


def test_steady_flow_through_a_resistance(tmp_path):
    steady = ("model.fluid_inertia=false", "time.scheme=steady")
    drive = outlet(), "boundary.0={on='left', traction={x='640'}}"
    viscous = ("model.viscosity=true", "material.0.fluid.viscosity=1.0", "mesh.order=2")
    walls = "boundary.2.velocity={x=0.0, y=0.0}", "mesh.y.cells=[2]"
    run_here(Job(SCENE, str(tmp_path / "run"), (*steady, *viscous, *drive, *walls)))
    found = history(tmp_path / "run")
    Q, p = (found[f"right.{name}"][-1] for name in ("flow_rate", "pressure"))
    poiseuille = 12 * 1.0 * LENGTH / HEIGHT**3
    print(f"Q {Q:.5f}, with Poiseuille's flow everywhere {640 / (R_P + R_D + poiseuille):.5f}")
    assert p == pytest.approx((R_P + R_D) * Q, rel=1e-9)
    # the channel has 4.5 % of the resistance, and other profiles than Poiseuille's at its ends
    assert Q == pytest.approx(640 / (R_P + R_D + poiseuille), rel=0.01)


BRANCHES = (
    "boundary=[{on='left', inflow={flow_rate=0.3}}, {on=['bottom', 'top'], velocity={x=0, y=0}},"
    " {on='lower', windkessel={distal=2e5, compliance=1e-6}},"
    " {on='upper', windkessel={proximal=1e5, distal=5e5, compliance=4e-7}}]",
    "mesh.patches=[{name='lower', side='right', y=[0, 0.1]},"
    " {name='upper', side='right', y=[0.1, 0.2]}]",
    "mesh.y.cells=[4]",
    "model.viscosity=true",
    "material.0.fluid={density=1.0, viscosity=1e-2}",
)


@pytest.mark.parametrize(
    "scheme",
    [
        ("model.fluid_inertia=false", "time.scheme=steady"),
        ("time.end=10", "time.growth=1.5"),  # 50 R C, with steps far above √(inertance C)
    ],
)
def test_a_steady_flow_divides_as_the_inverse_resistances(tmp_path, scheme):
    """Q₁/Q₂ = R₂/R₁ = 3 of two outlets beside each other, R Q = p of each."""
    run_here(Job(SCENE, str(tmp_path), (*BRANCHES, *scheme)))
    found = history(tmp_path)
    lower, upper = (found[f"{tag}.flow_rate"][-1] for tag in ("lower", "upper"))
    print(f"Q {lower:.6f}, {upper:.6f}, ratio {lower / upper:.6f}")
    assert lower + upper == pytest.approx(0.3, rel=1e-8)
    assert lower / upper == pytest.approx(3.0, rel=1e-3)  # the fluid between has 1e-4 of them
    assert found["lower.pressure"][-1] == pytest.approx(2e5 * lower, rel=1e-4)
    assert found["upper.pressure"][-1] == pytest.approx(6e5 * upper, rel=1e-4)


COUPLED = (
    "boundary.2.windkessel={proximal=2e3, distal=2e4, compliance=1e-5}",
    "time.end=0.05",
    "coupling.tolerance=1e-10",
    "coupling.max_iterations=100",
)


@pytest.mark.parametrize(
    "scheme",
    ["interface=dirichlet_neumann", "scheme=quasi_direct", "scheme=direct"],
)
def test_every_scheme_has_it(tmp_path, scheme):
    """Beside a flap: the partitioned schemes end in the solution of the condensed one."""
    for name, change in (("condensed", "interface=condensed"), ("other", scheme)):
        run_here(Job(FLAP, str(tmp_path / name), (*COUPLED, f"coupling.{change}")))
    a, b = (history(tmp_path / name) for name in ("condensed", "other"))
    columns = [name for name in a if name not in ("t", "coupling_iterations")]
    apart = max(np.abs(a[name] - b[name]).max() / np.abs(b[name]).max() for name in columns)
    assert apart < 1e-7  # the tolerance times the condition of a step
    assert b["right.pressure"].max() > 100


def test_restart_and_ranks_give_the_same(tmp_path):
    whole = Job(FLAP, str(tmp_path / "whole"), (*COUPLED, "output.checkpoint_every=1"))
    run_here(whole)
    half = Job(
        FLAP, str(tmp_path / "half"), (*COUPLED, "time.end=0.03", "output.checkpoint_every=3")
    )
    run_here(half)
    rest = Job(FLAP, str(tmp_path / "rest"), COUPLED, restart=str(tmp_path / "half/checkpoint.h5"))
    run_here(rest)
    end, again = (history(tmp_path / name) for name in ("whole", "rest"))
    for name in ("right.pressure", "right.flow_rate", "tip.u_x"):
        assert again[name][-1] == end[name][-1]


@needs_mpirun
def test_two_ranks(tmp_path):
    jobs = [Job(FLAP, str(tmp_path / str(n)), COUPLED) for n in (1, 2)]
    run_here(jobs[0])
    run_on(2, jobs[1:], tmp_path)
    a, b = (history(tmp_path / str(n)) for n in (1, 2))
    for name in ("right.pressure", "right.flow_rate", "tip.u_x"):
        assert np.abs(a[name] - b[name]).max() < 1e-8 * np.abs(a[name]).max()


def test_a_consistent_start_leaves_its_pressure(tmp_path):
    """The small step that finds the accelerations at t = 0 is none of the outlet's."""
    start = "boundary.2.windkessel={distal=2e4, compliance=1e-5, start=50.0}"
    run_here(Job(FLAP, str(tmp_path), (start, "time.consistent_start=true", "time.end=0.02")))
    found = history(tmp_path)["right.pressure"]
    assert found[0] == 50.0
    assert found[1] != 50.0


def test_with_a_velocity_along_it_the_flow_leaves_as_it_came(tmp_path):
    """Without, the traction along the outlet is zero, which is not Poiseuille's flow."""
    steady = ("model.fluid_inertia=false", "time.scheme=steady", "mesh.order=2")
    viscous = ("model.viscosity=true", "material.0.fluid.viscosity=1.0", "mesh.y.cells=[2]")
    inlet = "boundary.0={on='left', traction={x=640.0}, velocity={y=0.0}}"
    walls = "boundary.2.velocity={x=0.0, y=0.0}"
    sides = outlet(), "boundary.1.velocity.y=0.0", inlet, walls
    run_here(Job(SCENE, str(tmp_path), (*steady, *viscous, *sides)))
    Q = history(tmp_path)["right.flow_rate"][-1]
    exact = 640 / (R_P + R_D + 12 * 1.0 * LENGTH / HEIGHT**3)
    assert Q == pytest.approx(exact, rel=1e-9)  # quadratic elements have it


def test_it_excludes_a_normal_velocity_on_its_surface(tmp_path):
    message = r"boundary.1.windkessel\]: tag 'right' has a prescribed normal velocity"
    with pytest.raises(InputError, match=message):
        run_here(Job(SCENE, str(tmp_path), (outlet(), "boundary.1.velocity.x=0.0")))


def test_a_resistance_whose_pressure_hides_the_flow_is_an_error(tmp_path):
    """Pressures of 1e15 Pa: the round-off of their gradient moves the fluid more than the inflow
    does, and the first step makes a third of what flows through it.
    """
    hard = "boundary.1.windkessel.proximal=1e20", "time.end=0.04"
    sentence = r"\[limits\] volume: at t = 0.02 s the fluid has made 0\.\d+ > 0\.01 of the volume"
    with pytest.raises(LimitError, match=sentence):
        run_here(Job("windkessel", str(tmp_path / "error"), hard))
    reported = run_here(Job("windkessel", str(tmp_path / "said"), (*hard, "limits.volume=report")))
    assert reported["volume_error"] > 0.01
    usual = run_here(Job("windkessel", str(tmp_path / "usual"), ("time.end=0.04",)))
    assert usual["volume_error"] == 0.0


def test_what_was_made_goes_on_from_a_checkpoint(tmp_path):
    hard = "boundary.1.windkessel.proximal=1e20", "limits.volume=report", "time.end=0.04"
    hard = *hard, "output.checkpoint_every=1"
    whole = run_here(Job("windkessel", str(tmp_path / "whole"), hard))
    run_here(Job("windkessel", str(tmp_path / "half"), (*hard, "time.end=0.02")))
    file = str(tmp_path / "half/checkpoint.h5")
    half = run_here(Job("windkessel", str(tmp_path / "half"), hard, restart=file))
    assert half["volume_error"] == whole["volume_error"] > 0
