"""Loads on points and lines, against exact solutions; their force on any number of ranks."""

import numpy as np
import pytest
from running import SCENES, Job, history, needs_mpirun, run_here, run_on

from porofsi_petsc import load_scene
from porofsi_petsc.errors import InputError

BAR = str(SCENES / "bar.toml")
BLOCK = str(SCENES / "pressed_block3d.toml")
STATIC = ("model.solid_inertia=false", "time.scheme=steady", "time.step=1.0")
YOUNG, LENGTH, DEPTH = 1000.0, 1.0, 0.04
INERTIA = DEPTH**3 / 12
BEAM = (
    *STATIC,
    "mesh.cell_type=quadrilateral",
    "mesh.diagonal=right",
    f"mesh.x={{points=[0.0, {LENGTH}], cells=[15]}}",
    f"mesh.y={{points=[{-DEPTH / 2}, {DEPTH / 2}], cells=[2]}}",
    f"material.0.solid={{law='linear_elastic', young={YOUNG}, poisson=0.0, density=1.0}}",
)
FORCE = 1e-4 * YOUNG * INERTIA  # [N/m]


def deflection(folder, boundary, x, at):
    """Return u_y at x of a beam under FORCE at another place of its axis."""
    load = f"load=[{{at=[{at}, 0.001], force={{y={-FORCE}}}}}]"
    probe = f"probe=[{{name='P', at=[{x}, 0.0], quantities=['u_y']}}]"
    run_here(Job(BAR, str(folder), (*BEAM, f"boundary=[{boundary}]", load, probe)))
    return history(folder)["P.u_y"][-1]


def test_cantilever_under_a_tip_load(tmp_path):
    """P L³/(3 EI), and the shear, 6/5 P L/(G h)."""
    boundary = "{on='left', displacement={x=0.0, y=0.0}}, {on=['right', 'top', 'bottom']}"
    found = deflection(tmp_path, boundary, LENGTH, LENGTH)
    exact = -FORCE * (LENGTH**3 / (3 * YOUNG * INERTIA) + 1.2 * LENGTH / (YOUNG / 2 * DEPTH))
    assert found == pytest.approx(exact, rel=2e-3)


def test_simply_supported_beam(tmp_path):
    """A load at a, off every node: P b x (L² - b² - x²)/(6 EI L), b = L - a, at x < a."""
    a, x = 0.61, 0.4
    boundary = (
        "{on=['left', 'right'], displacement={y=0.0}}, {on=['top', 'bottom']},"
        " {on='pin', displacement={y=0.0}, spring={normal=1e-3}}"  # a spring too soft to be felt
    )
    pin = "mesh.patches=[{name='pin', side='left', y=[-0.02, 0.0]}]"
    load = f"load=[{{at=[{a}, 0.001], force={{y={-FORCE}}}}}]"
    probe = f"probe=[{{name='P', at=[{x}, 0.0], quantities=['u_y']}}]"
    run_here(Job(BAR, str(tmp_path), (*BEAM, pin, f"boundary=[{boundary}]", load, probe)))
    found = history(tmp_path)["P.u_y"][-1]
    b = LENGTH - a
    bending = b * x * (LENGTH**2 - b**2 - x**2) / (6 * YOUNG * INERTIA * LENGTH)
    shear = 1.2 * b * x / (LENGTH * YOUNG / 2 * DEPTH)
    assert found == pytest.approx(-FORCE * (bending + shear), rel=2e-3)


LAME, MU = 6.0, 5.0
POISSON = LAME / 2 / (LAME + MU)
AT = (0.02, 0.03)


def kelvin(x, y, force=1e-3):
    """Return u of a force along y on a line through AT in an unbounded body (Kelvin)."""
    X, Y = x - AT[0], y - AT[1]
    r2 = X**2 + Y**2
    factor = force / (8 * np.pi * MU * (1 - POISSON))
    return factor * X * Y / r2, factor * (Y**2 / r2 - (3 - 4 * POISSON) * np.log(r2) / 2)


def formulas(force=1e-3):
    """Return `kelvin` as formulas of a scene."""
    X, Y = f"(x - {AT[0]})", f"(y - {AT[1]})"
    r2 = f"({X}**2 + {Y}**2)"
    factor = force / (8 * np.pi * MU * (1 - POISSON))
    log = f"{(3 - 4 * POISSON) / 2}*log({r2})"
    return f"'{factor}*{X}*{Y}/{r2}'", f"'{factor}*({Y}**2/{r2} - {log})'"


def sides(names):
    """Return the boundary on which Kelvin's displacement is prescribed."""
    u, v = formulas()
    return f"{{on={names}, displacement={{x={u}, y={v}}}}}"


def test_point_load_in_the_plane(tmp_path):
    """Kelvin's solution at a distance, inside a boundary that moves as it does."""
    changes = (
        *STATIC,
        "mesh.x={points=[-1.0, 1.0], cells=[12]}",
        "mesh.y={points=[-1.0, 1.0], cells=[12]}",
        f"boundary=[{sides(['left', 'right', 'bottom', 'top'])}]",
        f"load=[{{at={list(AT)}, force={{y=1e-3}}}}]",
        "probe=[{name='P', at=[0.55, 0.3], quantities=['u_x', 'u_y']}]",
    )
    run_here(Job(BAR, str(tmp_path), changes))
    found = [history(tmp_path)[f"P.{name}"][-1] for name in ("u_x", "u_y")]
    exact = kelvin(0.55, 0.3)
    print(found, exact)
    assert np.abs(np.subtract(found, exact)).max() < 0.01 * np.linalg.norm(exact)


def slab(force, line):
    """Return the changes that make of the block a slab in plane strain with Kelvin's sides."""
    return (
        *STATIC,
        "expect=[]",
        "mesh={kind='box', order=2, cell_type='hexahedron', x={points=[-1.0, 1.0], cells=[6]},"
        " y={points=[-1.0, 1.0], cells=[6]}, z={points=[0.0, 0.5], cells=[1]}}",
        f"boundary=[{sides(['left', 'right', 'front', 'back'])},"
        " {on=['bottom', 'top'], displacement={z=0.0}}]",
        f"load=[{{line={line}, force={{y={force}}}}}]",
        "probe=[{name='P', at=[0.65, 0.35, 0.2], quantities=['u_x', 'u_y']}]",
        "force=[{name='support', on=['left', 'right', 'front', 'back']}]",
    )


def test_line_load_through_a_slab(tmp_path):
    """The same in three dimensions, a load along z."""
    line = [[*AT, 0.0], [*AT, 0.5]]
    run_here(Job(BAR, str(tmp_path), slab(1e-3, line)))
    found = history(tmp_path)
    at_probe = [found[f"P.{name}"][-1] for name in ("u_x", "u_y")]
    exact = kelvin(0.65, 0.35)
    print(at_probe, exact)
    assert np.abs(np.subtract(at_probe, exact)).max() < 0.02 * np.linalg.norm(exact)
    assert abs(found["support.f_y"][-1]) == pytest.approx(0.5e-3, rel=1e-6)


SKEW = [[-0.7, -0.43, 0.04], [0.61, 0.57, 0.41]]


@needs_mpirun
def test_the_force_is_the_same_on_any_number_of_ranks(tmp_path):
    """A line across the cells: its support takes all of it, whatever the ranks."""
    coarse = (*slab("'1e-3*(1 + x)'", SKEW), "mesh.x.cells=[3]", "mesh.y.cells=[3]")
    jobs = [Job(BAR, str(tmp_path / str(n)), coarse) for n in (1, 2, 3)]
    run_here(jobs[0])
    run_on(2, jobs[1:2], tmp_path)
    run_on(3, jobs[2:], tmp_path)
    found = [history(tmp_path / str(n)) for n in (1, 2, 3)]
    length = np.linalg.norm(np.subtract(*SKEW))
    total = 1e-3 * length * (1 + (SKEW[0][0] + SKEW[1][0]) / 2)
    for one in found:
        assert abs(one["support.f_y"][-1]) == pytest.approx(total, rel=1e-6)
        assert one["P.u_y"][-1] == pytest.approx(found[0]["P.u_y"][-1], rel=1e-8)


@pytest.mark.parametrize(
    ("load", "message"),
    [
        ("{at=[9.0, 0.5], force={y=1.0}}", r"load.0\]: received the point \(9, 0.5\) m, which is"),
        ("{at=[0.1, 0.5, 0.1], force={y=1.0}}", r"load.0.at\]: received 3 coordinates"),
        ("{line=[[0.1, 0.5], [0.2, 0.5]], force={y=1.0}}", "a line in a two-dimensional scene"),
        ("{at=[0.1, 0.5], force={}}", "received no component"),
        ("{force={y=1.0}}", "expected exactly one of at"),
        ("{at=[0.1, 0.5], force={z=1.0}}", "load.0.force.z"),
    ],
)
def test_what_no_load_is(tmp_path, load, message):
    with pytest.raises(InputError, match=message):
        run_here(Job(BAR, str(tmp_path), (f"load=[{load}]",)))


def test_a_load_needs_a_solid():
    with pytest.raises(InputError, match="received one without a solid"):
        load_scene(str(SCENES / "outlet.toml"), ("load=[{at=[0.1, 0.1], force={y=1.0}}]",))
