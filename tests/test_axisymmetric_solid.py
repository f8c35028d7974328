"""A solid around an axis: exact cylinder and sphere under pressure, a patch at large strain, what
the axis holds by itself.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from mixed import cut, one_mesh, unit_grid
from mpi4py import MPI

from porofsi_petsc import load_scene
from porofsi_petsc.errors import InputError
from porofsi_petsc.fem.distribute import distribute
from porofsi_petsc.linalg.options import start
from porofsi_petsc.mesh import rectangle
from porofsi_petsc.mesh.axis import around_axis, tags_on_axis
from porofsi_petsc.simulation.simulation import Simulation

E, NU, PRESSURE, INNER, OUTER = 1e3, 0.3, 10.0, 1.0, 2.0  # [Pa], [-], [Pa], [m], [m]
LINEAR = {"law": "linear_elastic", "young": E, "poisson": NU, "density": 1.0}
SCENE = {
    "title": "A body around the axis x = 0",
    "mesh": {
        "kind": "rectangle",
        "axisymmetric": True,
        "order": 2,
        "x": {"points": [INNER, OUTER], "cells": [4]},
        "y": {"points": [0.0, 0.5], "cells": [2]},
    },
    "time": {"scheme": "steady", "end": 1.0, "step": 1.0},
    "model": {"solid_inertia": False},
    "material": [{"region": "all", "solid": LINEAR}],
    "limits": {"strain": "report"},
}
CYLINDER = [
    {"on": ["bottom", "top"], "displacement": {"y": 0.0}},
    {"on": "left", "traction": {"x": PRESSURE}},
    {"on": "right"},
]
SLACK = 0.25  # between two meshes the leading term of the error is not alone yet


@pytest.fixture(scope="module", autouse=True)
def petsc():
    start()


def scene(boundary, *overrides):
    return load_scene(SCENE | {"boundary": boundary}, overrides)


def solved(scene, mesh=None):
    """Return the simulation of a scene at its end; mesh : a serial one instead of its own."""
    if mesh is not None:
        mesh = distribute(MPI.COMM_SELF, mesh, np.zeros(len(mesh.points), dtype=int))
    simulation = Simulation(scene, MPI.COMM_SELF, mesh=mesh)
    simulation.run()
    return simulation


def cells(n):
    return f"mesh.x.cells=[{n}]", f"mesh.y.cells=[{n // 2}]"


@pytest.mark.parametrize(
    ("order", "kind"), [(1, "triangle"), (2, "triangle"), (1, "quadrilateral")]
)
def test_thick_cylinder_under_pressure(order, kind):
    """Lamé: u_r = (1 + ν) C/E ((1 - 2ν) r + b²/r), C = p a²/(b² - a²), in plane strain."""
    C = PRESSURE * INNER**2 / (OUTER**2 - INNER**2)

    def exact(r):
        return (1 + NU) / E * C * ((1 - 2 * NU) * r + OUTER**2 / r)

    errors = []
    for n in (4, 8):
        found = solved(scene(CYLINDER, *cells(n), f"mesh.order={order}", f"mesh.cell_type={kind}"))
        solid = found.coupling.solid
        errors.append(np.sqrt(np.mean((solid.u[:, 0] - exact(solid.mesh.X[:, 0])) ** 2)))
    assert np.log2(errors[0] / errors[1]) > order + 1 - SLACK
    energy = np.pi * INNER * 0.5 * PRESSURE * exact(INNER)  # half of the work of the pressure
    assert solid.energies()[1] == pytest.approx(energy, rel=3e-3 if order == 1 else 1e-5)


def test_a_support_takes_the_force_on_the_whole_ring():
    """A pull of 5 Pa on π (b² - a²), and the weight of the whole body."""
    boundary = [
        {"on": "bottom", "displacement": {"x": 0.0, "y": 0.0}},
        {"on": "top", "traction": {"y": 5.0}},
        {"on": ["left", "right"]},
    ]
    tables = SCENE | {"boundary": boundary, "force": [{"name": "foot", "on": "bottom"}]}
    found = solved(load_scene(tables | {"body_force": {"solid": {"y": -4.0}}}))
    area = np.pi * (OUTER**2 - INNER**2)
    assert found.history["foot.f_y"][-1] == pytest.approx((5.0 - 4.0 * 0.5) * area, rel=1e-9)


def sphere(n):
    """Return an eighth of a hollow ball as a serial mesh: rings between the equator and the axis,
    curved edges.
    """
    rho, angle = (
        SimpleNamespace(points=points, cells=[n], ratios=None)
        for points in ([INNER, OUTER], [0.0, np.pi / 2])
    )
    plane = rectangle(rho, angle, order=2)
    r, phi = plane.points.T
    points = np.column_stack([r * np.cos(phi), r * np.sin(phi)])
    return around_axis(replace(plane, points=points), "test")


def test_hollow_sphere_under_pressure():
    """Lamé: u = A ρ + B/ρ², with the axis as a side of the section; the stress on the axis, too."""
    A = PRESSURE * INNER**3 / (OUTER**3 - INNER**3) * (1 - 2 * NU) / E
    B = PRESSURE * INNER**3 * OUTER**3 / (OUTER**3 - INNER**3) * (1 + NU) / (2 * E)
    boundary = [
        {"on": "bottom", "displacement": {"y": 0.0}},
        {"on": "left", "traction": {"x": f"{PRESSURE}*x", "y": f"{PRESSURE}*y"}},
        {"on": "right"},
        {"on": "top"},
    ]
    errors = []
    for n in (3, 6):
        found = solved(scene(boundary), sphere(n))
        X = found.coupling.solid.mesh.X
        rho = np.linalg.norm(X, axis=1)
        exact = X * (A + B / rho**3)[:, None]
        errors.append(np.sqrt(np.mean((found.coupling.solid.u - exact) ** 2)))
        assert not found.coupling.solid.u[X[:, 0] == 0, 0].any()
    assert np.log2(errors[0] / errors[1]) > 3 - SLACK
    stress = found.fields["stress"]
    hoop = (E * A / (1 - 2 * NU)) * (1 + OUTER**3 / (2 * rho**3))
    axis = X[:, 0] == 0
    # of order h² at the nodes, h² = 1/36; on the axis radial and hoop stress are the same
    assert np.abs(stress[:, 5] - hoop).max() < 0.03 * hoop.max()
    assert np.abs(stress[axis, 0] - stress[axis, 5]).max() < 1e-12 * hoop.max()


@pytest.mark.parametrize("law", ["neo_hookean", "saint_venant_kirchhoff"])
@pytest.mark.parametrize("order", [1, 2])
def test_patch(order, law):
    """u_r = r/5, u_z = -z/4 is the exact state of the whole body, for the axis as a side."""
    sides = [
        {
            "on": ["left", "right", "bottom", "top"],
            "displacement": {"x": "0.2*x", "y": "-0.25*y"},
        }
    ]
    free_axis = [{"on": ["right", "bottom", "top"]} | {"displacement": sides[0]["displacement"]}]
    for boundary, points in ((sides, "[1.0, 2.0]"), (free_axis, "[0.0, 1.0]")):
        made = scene(
            boundary,
            f"mesh.order={order}",
            f"mesh.x.points={points}",
            f"material.0.solid.law={law}",
            "coupling.tolerance=1e-12",
        )
        solid = solved(made).coupling.solid
        exact = solid.mesh.X * [0.2, -0.25]
        assert np.abs(solid.u - exact).max() < 1e-10  # the tolerance, and round-off


def test_patch_of_triangles_and_quadrilaterals():
    """The same on a mesh of two shapes, some of whose triangles have a corner on the axis."""
    section = around_axis(one_mesh(*cut(unit_grid(2, 4))), "test")
    exact = {"x": "0.2*x", "y": "-0.25*y"}
    made = scene(
        [{"on": ["right", "bottom", "top"], "displacement": exact}],
        "mesh.x.points=[0.0, 1.0]",
        "material.0.solid.law=neo_hookean",
        "coupling.tolerance=1e-12",
    )
    solid = solved(made, section).coupling.solid
    assert np.abs(solid.u - solid.mesh.X * [0.2, -0.25]).max() < 1e-10


def test_a_tag_on_the_axis_and_beside_it_is_refused():
    mesh = around_axis(
        rectangle(*[SimpleNamespace(points=[0.0, 1.0], cells=[2], ratios=None)] * 2), ""
    )
    both = np.concatenate([mesh.facets["left"], mesh.facets["top"]])
    with pytest.raises(InputError, match="'both' on the axis and beside it"):
        tags_on_axis(replace(mesh, facets=mesh.facets | {"both": both}), "test")


def test_only_a_motion_along_the_axis_needs_a_support():
    with pytest.raises(InputError, match="nothing holds the solid in y"):
        solved(
            scene([{"on": "left", "traction": {"x": PRESSURE}}, {"on": ["right", "bottom", "top"]}])
        )


@pytest.mark.parametrize(
    ("overrides", "text"),
    [
        (["mesh.x.points=[-1.0, 2.0]"], "received a node at (-1, 0) m, expected x >= 0"),
        (
            ["mesh.x.points=[0.0, 2.0]"],
            "tag 'left' is the axis of symmetry, which is no boundary",
        ),
    ],
)
def test_what_an_axis_is_not_is_refused(overrides, text):
    with pytest.raises(InputError) as refused:
        solved(scene(CYLINDER, *overrides))
    assert text in str(refused.value)


def test_three_dimensions_have_no_section():
    box = {
        "kind": "box",
        "axisymmetric": True,
        **{axis: {"points": [0.0, 1.0], "cells": [1]} for axis in "xyz"},
    }
    with pytest.raises(InputError, match=r"\[mesh.axisymmetric\]: received true in three"):
        load_scene(SCENE | {"mesh": box})
    file = {"kind": "file", "axisymmetric": True, "path": "a.msh", "dim": 3}
    with pytest.raises(InputError, match=r"\[mesh.axisymmetric\]: received true in three"):
        load_scene(SCENE | {"mesh": file})


def test_a_mesh_that_touches_the_axis_in_a_point_is_refused():
    ring = sphere(2)
    points = ring.points @ np.array([[1.0, 1.0], [-1.0, 1.0]]) / np.sqrt(2)
    corner = replace(ring, points=points - points[:, 0].min() * np.eye(2)[0])
    with pytest.raises(InputError, match=r"touches the axis in the point .* alone"):
        around_axis(corner, "test")
