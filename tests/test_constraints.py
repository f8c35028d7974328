"""Normal displacement on surfaces along no axis, components that nodes have in common, ties."""

from math import cos, radians, sin

import numpy as np
import pytest
from running import Job, history, needs_mpirun, run_here, run_on

from porofsi_petsc import Simulation, load_scene
from porofsi_petsc.config.geometry import Axis
from porofsi_petsc.errors import InputError
from porofsi_petsc.fem.normals import nodal_normals
from porofsi_petsc.linalg.options import start
from porofsi_petsc.mesh import Mesh, box, rectangle
from porofsi_petsc.mesh.write import write_mesh

LAMBDA, MU = 6.0, 5.0  # [Pa]
STEADY = {"end": 1.0, "step": 1.0, "scheme": "steady"}
STILL = {"solid_inertia": False, "fluid_inertia": False}
SOLID = {"law": "linear_elastic", "lambda": LAMBDA, "mu": MU, "density": 2.0}
DENSE = [{"region": "all", "solid": SOLID}]
POROUS = [
    {
        "region": "all",
        "porosity": 0.4,
        "solid": SOLID,
        "fluid": {"density": 1.0, "specific_weight": 1.0},
        "permeability": {"law": "constant", "k": 0.1},
    }
]


@pytest.fixture(scope="module", autouse=True)
def petsc():
    start()


def scene(mesh, **tables):
    base = {"title": "constraints", "mesh": mesh, "model": STILL, "limits": {"strain": "report"}}
    return base | {"time": STEADY, "material": DENSE} | tables


def displacement(of):
    """Return reference positions and final displacement of a scene in the order of its file."""
    with Simulation.from_scene(of) as simulation:
        simulation.run()
        return simulation.fields.gathered("displacement")


def file(path, mesh):
    write_mesh(path, mesh)
    return {"kind": "file", "path": str(path), "dim": mesh.dim}


def turned(mesh, angle):
    """Return a mesh turned about z by an angle."""
    c, s = cos(angle), sin(angle)
    Q = np.eye(mesh.dim)
    Q[:2, :2] = [[c, -s], [s, c]]
    return Mesh(mesh.points @ Q.T, mesh.cells, mesh.element, mesh.regions, *_rest(mesh)), Q


def _rest(mesh):
    return mesh.cell_region, mesh.facets


GRIDS = {
    "T3": lambda: rectangle(axis(1.0, 2), axis(2.0, 3)),
    "Q9": lambda: rectangle(axis(1.0, 2), axis(2.0, 3), order=2, cell_type="quadrilateral"),
    "T10": lambda: box(axis(1.0, 1), axis(1.0, 1), axis(2.0, 2), order=2),
}


def axis(length, cells):
    return Axis.model_validate({"points": [0.0, length], "cells": [cells]})


def test_rollers_on_an_incline_take_the_forces_on_the_upright_column(tmp_path):
    """A drained column under its load: the stress is uniform, so that corners are split exactly."""
    mesh, Q = turned(GRIDS["T3"](), radians(30))
    load = dict(zip("xy", Q @ [0.0, -0.3], strict=True))
    sides = ["left", "right", "bottom", "top"]
    inclined = scene(
        file(tmp_path / "turned.msh", mesh),
        boundary=[
            {"on": ["left", "right", "bottom"], "normal_displacement": 0.0},
            {"on": sides, "pressure": 0.0},
            {"on": "top", "traction": load},
        ],
        material=POROUS,
        time={"end": 1e4, "step": 5e3, "scheme": "backward_euler"},
        force=[{"name": side, "on": side} for side in sides],
        coupling={"tolerance": 1e-10},
    )
    with Simulation.from_scene(inclined) as simulation:
        simulation.run()
        rows = simulation.history
    found = {side: Q.T @ [rows[f"{side}.f_{axis}"][-1] for axis in "xy"] for side in sides}
    lateral = 0.3 * LAMBDA / (LAMBDA + 2 * MU)
    assert np.allclose(found["bottom"], [0.0, -0.3], atol=1e-7)
    assert np.allclose(found["top"], [0.0, 0.3], atol=1e-7)
    assert np.allclose(found["left"], [-2 * lateral, 0.0], atol=1e-7)
    assert np.allclose(found["right"], [2 * lateral, 0.0], atol=1e-7)


@pytest.mark.parametrize("coupling", ["partitioned", "quasi_direct", "direct"])
def test_a_column_on_inclined_rollers_is_the_upright_one(tmp_path, coupling):
    """Consolidation of a column that is turned by 30 degrees, its sides and its foot on rollers."""
    mesh, Q = turned(GRIDS["T3"](), radians(30))
    sides = [*{"left", "right", "front", "back", "bottom"} & set(mesh.facets)]
    load = dict(zip("xy", Q @ [0.0, -0.3], strict=True))
    common = {
        "material": POROUS,
        "time": {"end": 0.3, "step": 0.1},
        "coupling": {"scheme": coupling},
    }
    inclined = scene(
        file(tmp_path / "turned.msh", mesh),
        boundary=[
            {"on": sides, "normal_displacement": 0.0},
            {"on": "top", "traction": load, "pressure": 0.0},
        ],
        **common,
    )
    upright = scene(
        file(tmp_path / "upright.msh", GRIDS["T3"]()),
        boundary=[
            {"on": ["left", "right"], "displacement": {"x": 0.0}},
            {"on": "bottom", "displacement": {"y": 0.0}},
            {"on": "top", "traction": {"y": -0.3}, "pressure": 0.0},
        ],
        **common,
    )
    u, wanted = displacement(inclined), displacement(upright)
    size = abs(wanted).max()
    assert size > 0.01
    # both to coupling.tolerance of 1e-6 of the forces
    assert abs(u - wanted @ Q.T).max() < 1e-5 * size


@pytest.mark.parametrize("name", GRIDS)
def test_patch(tmp_path, name):
    """A prescribed normal displacement on all sides of a turned box: an affine field."""
    mesh, Q = turned(GRIDS[name](), radians(20))
    H = Q @ np.diag([0.02, -0.01, 0.03][: mesh.dim]) @ Q.T
    # n = Q e and u·n = x·H n = (stretch along e) x·n
    formulas = {}
    for tag in mesh.facets:
        k = {"left": 0, "right": 0, "bottom": mesh.dim - 1, "top": mesh.dim - 1}.get(tag, 1)
        sign = -1.0 if tag in ("left", "bottom", "front") else 1.0
        row = sign * (H @ Q[:, k])
        formulas[tag] = "+".join(f"({a:.17g})*{x}" for a, x in zip(row, "xyz", strict=False))
    given = scene(
        file(tmp_path / "box.msh", mesh),
        boundary=[{"on": tag, "normal_displacement": g} for tag, g in formulas.items()],
    )
    u = displacement(given)
    assert abs(u - mesh.points @ H).max() < 1e-9 * abs(mesh.points @ H).max()


def sector(n, order, angles=(20.0, 75.0)):
    """Return a sector of a ring, radii 1 and 2, by mapping a rectangle; its sides lie along no
    axis.
    """
    grid = rectangle(axis(1.0, n), axis(1.0, n), order=order, cell_type="quadrilateral")
    r = 1 + grid.points[:, 0]
    angle = np.radians(angles[0] + (angles[1] - angles[0]) * grid.points[:, 1])
    points = np.column_stack([r * np.cos(angle), r * np.sin(angle)])
    return Mesh(points, grid.cells, grid.element, grid.regions, *_rest(grid)), angle


@pytest.mark.parametrize("order", [1, 2])
def test_lame(tmp_path, order):
    """A thick ring (Lame 1852) widened by 0.01 m inside, free outside: a sector on two rollers."""
    errors = []
    # u = A r + B/r with σ_rr(2) = 2 (λ + μ) A - 2 μ B/4 = 0 and u(1) = 0.01
    A = 0.01 / (1 + 4 * (LAMBDA + MU) / MU)
    B = 0.01 - A
    for n in (2, 4, 8):
        mesh, angle = sector(n, order)
        given = scene(
            file(tmp_path / f"ring{n}.msh", mesh),
            boundary=[
                {"on": ["bottom", "top"], "normal_displacement": 0.0},
                {"on": "left", "normal_displacement": -0.01},
                {"on": "right"},
            ],
        )
        r = np.linalg.norm(mesh.points, axis=1)
        exact = (A * r + B / r)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        errors.append(np.sqrt(((displacement(given) - exact) ** 2).mean()))
    # a third of an order below that of the elements: the meshes are coarse
    assert np.log2(errors[-2] / errors[-1]) > order + 2 / 3, errors


def test_normals_at_an_edge_and_on_a_curve():
    """Two where planes meet, one on a curved surface, radial to second order."""
    grid = rectangle(axis(1.0, 2), axis(1.0, 2))
    found = nodal_normals(grid.points, [grid.facets["left"], grid.facets["bottom"]], grid.element)
    assert np.bincount(found.node)[0] == 2
    mesh, _ = sector(4, 1, (0.0, 90.0))
    found = nodal_normals(mesh.points, [mesh.facets["right"]], mesh.element)
    inner = ~np.isclose(mesh.points[found.node], 0).any(axis=1)
    # between equal chords the mean is exact
    assert abs(found.direction - mesh.points[found.node] / 2)[inner].max() < 1e-12


LAYER = {
    "kind": "rectangle",
    "order": 2,
    "x": {"points": [0.0, 0.5], "cells": [2]},
    "y": {"points": [0.0, 2.0], "cells": [3]},
}


def tied(**tables):
    return scene(
        LAYER,
        boundary=[
            {"on": "bottom", "displacement": {"x": 0.0, "y": 0.0}},
            {"on": ["left", "right", "top"]},
        ],
        tie=[{"first": "left", "second": "right"}],
        body_force={"solid": {"x": 3.0, "y": -1.0}},
        **tables,
    )


def test_tied_sides_make_a_column_of_a_layer():
    """Under a body force a layer with tied sides has the parabolas of an infinite one."""
    u = displacement(tied())
    y = load_points(tied())[:, 1]
    parabola = 2.0 * y - y**2 / 2
    assert abs(u[:, 0] - 2 * 3 / MU * parabola).max() < 1e-11
    assert abs(u[:, 1] + 2 * 1 / (LAMBDA + 2 * MU) * parabola).max() < 1e-11


def load_points(of):
    from porofsi_petsc.simulation.build import serial_mesh

    return serial_mesh(load_scene(of)).points


def test_a_rigid_plate_gives_one_displacement_to_all_its_nodes():
    """A block of two materials side by side under a plate: the force is shared by the moduli."""
    mesh = LAYER | {"regions": [{"name": "stiff", "x": [0.25, 0.5]}]}
    stiff = SOLID | {"lambda": 3 * LAMBDA, "mu": 3 * MU}
    of = scene(
        mesh,
        material=[{"region": "body", "solid": SOLID}, {"region": "stiff", "solid": stiff}],
        boundary=[
            {"on": "bottom", "displacement": {"y": 0.0}},
            {"on": "top", "equal_displacement": ["y"], "traction": {"y": -0.1}},
            {"on": ["left", "right"], "displacement": {"x": 0.0}},
        ],
    )
    u = displacement(of)
    top = u[np.isclose(load_points(of)[:, 1], 2.0), 1]
    assert np.ptp(top) < 1e-15
    # between the confined column of the mean modulus and that of the mean compliance
    E = LAMBDA + 2 * MU
    assert -2.0 * 0.1 / E * (1 + 1 / 3) / 2 < top[0] < -2.0 * 0.1 / (2 * E)


@pytest.mark.parametrize(
    ("boundary", "sentence"),
    [
        (
            [{"on": "top", "normal_displacement": 0.0, "displacement": {"y": 0.0}}],
            "normal_displacement, which excludes displacement.y|displacement.y.*excludes",
        ),
        ([{"on": "top", "equal_displacement": ["z"]}], "received 'z' in a two-dimensional scene"),
        ([{"on": "top", "equal_displacement": ["x"]}], "has one that is prescribed"),
        ([{"on": "top", "equal_displacement": "up"}], "equal_displacement"),
    ],
)
def test_refusals(boundary, sentence):
    of = scene(
        LAYER,
        boundary=[
            {"on": "bottom", "displacement": {"x": 0.0, "y": 0.0}},
            {"on": "left", "displacement": {"x": 0.0}},
            {"on": "right"},
            *boundary,
        ],
    )
    with pytest.raises(InputError, match=sentence), Simulation.from_scene(load_scene(of)):
        pass


def test_what_a_roller_leaves_free_is_refused():
    of = scene(
        LAYER,
        boundary=[{"on": ["left", "top", "right"]}, {"on": "bottom", "normal_displacement": 0.0}],
    )
    with pytest.raises(InputError, match="nothing holds the solid in x"):
        displacement(of)


def test_a_tie_of_sides_that_do_not_match_is_refused():
    of = tied() | {"tie": [{"first": "left", "second": "top"}]}
    with pytest.raises(InputError, match="do not lie opposite each other"):
        displacement(of)


def test_a_tie_of_a_side_with_itself_is_refused():
    of = tied() | {"tie": [{"first": "left", "second": "left"}]}
    with pytest.raises(InputError, match="'left' and 'left' with the node at .* tied to itself"):
        displacement(of)


@needs_mpirun
def test_ranks(tmp_path):
    """Mandel's plate, and inclined rollers in 3-D by multigrid, on 1, 2 and 3 ranks."""
    mesh, Q = turned(box(axis(1.0, 3), axis(1.0, 3), axis(1.0, 3)), radians(25))
    write_mesh(tmp_path / "box.msh", mesh)
    (tmp_path / "box.toml").write_text(BOX)
    jobs = [
        ("mandel", ("time.end=0.003", "reference.times=[]")),
        (str(tmp_path / "box.toml"), ()),
    ]
    found = []
    for ranks in (1, 2, 3):
        folders = [tmp_path / f"{i}_{ranks}" for i in range(len(jobs))]
        made = [Job(name, str(d), o) for (name, o), d in zip(jobs, folders, strict=True)]
        if ranks == 1:
            for job in made:
                run_here(job)
        else:
            run_on(ranks, made, tmp_path)
        found.append([history(folder) for folder in folders])
    for other in found[1:]:
        for one, two in zip(found[0], other, strict=True):
            for name in one:
                if name != "coupling_iterations":
                    scale = abs(one[name]).max()
                    # each to coupling.tolerance
                    np.testing.assert_allclose(two[name], one[name], atol=2e-5 * scale)


BOX = """
title = "block on inclined rollers"
mesh = { kind = "file", path = "box.msh", dim = 3 }
time = { end = 0.02, step = 0.01 }
[[material]]
region = "all"
porosity = 0.4
solid = { law = "linear_elastic", lambda = 6.0, mu = 5.0, density = 2.0 }
fluid = { density = 1.0, specific_weight = 1.0 }
permeability = { law = "constant", k = 0.1 }
[[boundary]]
on = ["left", "front", "bottom"]
normal_displacement = 0.0
[[boundary]]
on = "right"
normal_displacement = "1e-3*t"
[[boundary]]
on = ["top", "back"]
pressure = 0.0
[[probe]]
name = "A"
at = [0.0, 1.0, 1.0]
quantities = ["u_x", "u_y", "u_z", "p"]
"""
