"""Pressures on solids and outlets: dead and following, against exact solutions."""

import numpy as np
import pytest
from running import SCENES, Job, run_here
from scipy.integrate import solve_bvp

from porofsi_petsc import Simulation
from porofsi_petsc.elements import FAMILIES
from porofsi_petsc.errors import InputError
from porofsi_petsc.fem.geometry import Rule, facet_measure, facet_measure_by_positions

BAR = str(SCENES / "bar.toml")
STATIC = ("model.solid_inertia=false", "expect=[]", "time.scheme=steady", "time.step=1.0")
A, B = 1.0, 2.0  # radii [m]
YOUNG, POISSON = 1000.0, 0.3


def displacement(overrides, at, quantity):
    """Return the last value of a displacement [m] at a point."""
    probe = f"probe=[{{name='P', at={list(at)}, quantities=['{quantity}']}}]"
    with Simulation.from_scene(BAR, overrides=(*STATIC, *overrides, probe)) as simulation:
        simulation.run()
        return simulation.history[f"P.{quantity}"][-1]


def solid(law, young=YOUNG, poisson=POISSON):
    """Return the change of the scene that sets the material."""
    keys = f"law='{law}', young={young}, poisson={poisson}, density=1.0"
    return f"material=[{{region='body', solid={{{keys}}}}}]"


def cylinder(law, load, cells):
    """Return the changes of the scene that make of it a thick wall in plane strain."""
    return (
        "mesh.axisymmetric=true",
        "mesh.cell_type=quadrilateral",
        "mesh.diagonal=right",
        f"mesh.x={{points=[{A}, {B}], cells=[{cells}]}}",
        "mesh.y={points=[0.0, 0.2], cells=[1]}",
        solid(law),
        "boundary=[{on='left', " + load + "}, {on='right'},"
        " {on=['bottom', 'top'], displacement={y=0.0}}]",
    )


@pytest.mark.parametrize("name", ["dead_pressure", "follower_pressure"])
def test_thick_wall_of_lame(name):
    """At a pressure of 1e-4 E both loads are the same, to the square of the strain."""
    p = 1e-4 * YOUNG
    found = displacement(cylinder("linear_elastic", f"{name}={p}", 6), (A, 0.1), "u_x")
    factor = (1 + POISSON) / YOUNG * p * A**2 / (B**2 - A**2)
    exact = factor * ((1 - 2 * POISSON) * A + B**2 / A)
    assert found == pytest.approx(exact, rel=5e-4)


def wall(p):
    """Return the displacement of the inner face of a neo-Hookean wall under a follower pressure, by
    integration of (R P_rr)' = P_θθ.
    """
    mu = YOUNG / 2 / (1 + POISSON)
    lam = 2 * mu * POISSON / (1 - 2 * POISSON)

    def stress(own, other):
        return mu * (own - 1 / own) + lam * np.log(own * other) / own

    def slope(R, y):
        r, stretch = y
        hoop = r / R
        radial = mu * (1 + 1 / stretch**2) + lam * (1 - np.log(stretch * hoop)) / stretch**2
        mixed = lam / (stretch * hoop)
        hoop_rate = (stretch - hoop) / R
        rate = (stress(hoop, stretch) - stress(stretch, hoop)) / R - mixed * hoop_rate
        return np.vstack([stretch, rate / radial])

    def ends(inner, outer):
        load = stress(inner[1], inner[0] / A) + p * inner[0] / A
        return np.array([load, stress(outer[1], outer[0] / B)])

    R = np.linspace(A, B, 41)
    found = solve_bvp(slope, ends, R, np.vstack([R, np.ones_like(R)]), tol=1e-8)
    assert found.success
    return found.y[0, 0] - A


def test_neo_hookean_wall_under_a_follower_pressure():
    """The inner radius grows by more than a third: the pressure acts on a larger circle."""
    p = 0.16 * YOUNG
    load = f"follower_pressure='{p}*t'"
    steps = ("time.step=0.25", "mesh.order=2")
    found = displacement((*cylinder("neo_hookean", load, 6), *steps), (A, 0.1), "u_x")
    exact = wall(p)
    print(f"u {found:.6f}, exact {exact:.6f}")
    assert exact > 0.33
    assert found == pytest.approx(exact, rel=5e-4)


LENGTH, DEPTH = 1.0, 0.02


def elastica(p):
    """Return the displacement of the tip of an inextensible beam whose upper side a pressure
    follows.

    r' = (cos θ, sin θ), EI θ' = M, F' = p (1 - κ h/2) n, M' = -r' × F; its upper side is shorter
    than the axis by κ h/2.
    """
    stiffness = YOUNG * DEPTH**3 / 12

    def slope(s, state):
        theta, M, fx, fy, _, _ = state
        load = p * (1 - M / stiffness * DEPTH / 2)
        c, sn = np.cos(theta), np.sin(theta)
        turning = -(c * fy - sn * fx)
        return np.vstack([M / stiffness, turning, -load * sn, load * c, c, sn])

    def ends(root, tip):
        return np.array([root[0], root[4], root[5], tip[1], tip[2], tip[3]])

    s = np.linspace(0, LENGTH, 101)
    start = np.zeros((6, len(s)))
    start[4] = s
    found = solve_bvp(slope, ends, s, start, tol=1e-8)
    assert found.success
    return found.y[4, -1] - LENGTH, found.y[5, -1]


def test_cantilever_under_a_follower_pressure():
    """A beam that bends by more than half of its length."""
    p = 6 * YOUNG * DEPTH**3 / 12 / LENGTH**3
    beam = (
        "mesh.cell_type=quadrilateral",
        "mesh.diagonal=right",
        f"mesh.x={{points=[0.0, {LENGTH}], cells=[20]}}",
        f"mesh.y={{points=[{-DEPTH / 2}, {DEPTH / 2}], cells=[1]}}",
        solid("saint_venant_kirchhoff", poisson=0.0),
        "boundary=[{on='left', displacement={x=0.0, y=0.0}}, {on=['right', 'bottom']},"
        f" {{on='top', follower_pressure='{p}*t'}}]",
        "time.step=0.2",
    )
    exact = elastica(p)
    found = [displacement(beam, (LENGTH, 0.0), name) for name in ("u_x", "u_y")]
    print(f"tip {found}, elastica {exact}")
    assert exact[1] < -0.5 * LENGTH
    assert np.abs(np.subtract(found, exact)).max() < 2e-3 * LENGTH


def test_slope_of_the_normals_of_rings():
    """Around an axis the measure grows with the radius, and the load with it."""
    element = next(e for e in FAMILIES[2]["quadrilateral"] if e.order == 2).around_axis()
    facet = element.facet
    rule = Rule.of(facet, 6)
    x = np.array([[[1.0, 0.1], [1.3, 0.8], [1.2, 0.5]]])
    exact = facet_measure_by_positions(rule, x)
    for b in range(3):
        for j in range(2):
            step = np.zeros_like(x)
            step[0, b, j] = 1e-6
            change = facet_measure(rule, x + step) - facet_measure(rule, x - step)
            assert np.abs(change / 2e-6 - exact[:, :, b, :, j]).max() < 1e-8


@pytest.mark.parametrize("name", ["dead_pressure", "follower_pressure"])
@pytest.mark.parametrize(
    ("scene", "field", "surface", "traction"),
    [
        ("outlet.toml", "fluid velocity", "1={{on='right', {}}}", "{x=-3.0}"),
        ("confined_column.toml", "displacement", "2={{on='top', {}, pressure=0}}", "{y=-3.0}"),
    ],
)
def test_on_a_flat_surface_it_is_a_traction(name, scene, field, surface, traction):
    """σ n = -p n of an outlet, of the mixture on a drained surface."""
    found = []
    for load in (f"traction={traction}", f"{name}=3.0"):
        given = (f"boundary.{surface.format(load)}", "expect=[]")
        given += ("boundary.0={on='left'}",) if scene == "outlet.toml" else ()
        with Simulation.from_scene(str(SCENES / scene), overrides=given) as simulation:
            simulation.run(until=2 * simulation.scene.time.step)
            found.append(simulation.fields[field])
    assert np.abs(found[0]).max() > 0
    assert np.allclose(*found, rtol=0, atol=1e-6 * np.abs(found[0]).max())


def test_it_is_refused_where_it_has_no_effect(tmp_path):
    message = r"boundary.0.dead_pressure\]: tag 'bottom' has a prescribed normal displacement"
    changes = ("boundary.0.dead_pressure=1.0",)
    with pytest.raises(InputError, match=message):
        run_here(Job(BAR, str(tmp_path), changes))
    normal = "boundary.0={on='bottom', normal_displacement=0.0}"
    with pytest.raises(InputError, match=message):
        run_here(Job(BAR, str(tmp_path), (normal, *changes)))
