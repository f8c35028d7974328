"""Directions that turn from point to point: a tube with fibres around it, in the plane and in
space.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from mpi4py import MPI
from running import ROOT, SCENES

from porofsi_petsc import Simulation, load_scene
from porofsi_petsc.config.toml import read_toml
from porofsi_petsc.errors import InputError
from porofsi_petsc.materials import ELASTIC
from porofsi_petsc.materials.oriented import oriented
from porofsi_petsc.mesh.generate import box, rectangle
from porofsi_petsc.mesh.write import write_mesh
from porofsi_petsc.registry import examples

CONFIGS = ROOT / "configs"
INNER, OUTER = 0.1, 0.2  # [m]
PRESSURE = 1e6  # [Pa]
E, NU, E_A, NU_A, G_A = 1e9, 0.3, 1e10, 0.3, 5e8
LAW = {
    "law": "transversely_isotropic",
    "young": E,
    "poisson": NU,
    "young_along": E_A,
    "poisson_along": NU_A,
    "shear_along": G_A,
    "density": 1000.0,
}
AROUND = {"axis": [0.0, 1.0, 0.0], "orientation": {"center": [0.0, 0.0]}}


def wound_tube(r):
    """Return u_r(r) [m] of a long tube that is stiff around its axis, by C_rr (u'' + u'/r) = C_θθ
    u/r² (Lekhnitskii, Theory of Elasticity of an Anisotropic Body, 1981), ε_z = 0.
    """
    m = 1 - NU - 2 * NU_A**2 * E / E_A
    around, both = E_A * (1 - NU) / m, E * NU_A / m
    across = E * (NU + NU_A**2 * E / E_A) / ((1 + NU) * m) + E / (1 + NU)
    k = np.sqrt(around / across)
    ends = np.array([INNER, OUTER])[:, None]
    powers = np.array([k, -k])
    stress = (across * powers + both) * ends ** (powers - 1)
    return np.linalg.solve(stress, [-PRESSURE, 0.0]) @ r**powers


def quarter(path, cells, dim=2, axis=2):
    """Write a quarter of the tube, with `cells` quadratic ones along its radius and twice as many
    around; its line of centres is along an axis in space.
    """
    lines = Axis((INNER, OUTER), cells), Axis((0.0, np.pi / 2), 2 * cells), Axis((0.0, INNER), 1)
    kind = "quadrilateral" if dim == 2 else "hexahedron"
    generated = (rectangle if dim == 2 else box)(*lines[:dim], order=2, cell_type=kind)
    r, angle = generated.points.T[:2]
    bent = np.column_stack([r * np.cos(angle), r * np.sin(angle), *generated.points.T[2:]])
    write_mesh(
        path, replace(generated, points=np.roll(bent, axis + 1, axis=1) if dim == 3 else bent)
    )


class Axis(NamedTuple):
    """Equal cells between two ends."""

    points: tuple[float, float]
    count: int
    ratios: tuple[float, ...] = ()

    @property
    def cells(self):
        return (self.count,)


def tube(path, dim=2, axis=2, **solid):
    """Return the scene of a quarter of the tube under an inner pressure."""
    x, y = np.roll(np.array(["x", "y", "z"]), -axis - 1)[:2]
    sides = {"y": "bottom", "x": "top"} if dim == 2 else {"y": "front", "x": "back"}
    ends = [] if dim == 2 else [{"on": ["bottom", "top"], "displacement": {"xyz"[axis]: 0.0}}]
    push = {name: f"{PRESSURE}*{name}/{INNER}" for name in (x, y)}
    return {
        "title": "a tube with fibres around it",
        "mesh": {"kind": "file", "path": str(path), "dim": dim},
        "model": {"solid_inertia": False, "fluid_inertia": False},
        "time": {"scheme": "steady", "end": 1.0, "step": 1.0},
        "material": [{"region": "body", "solid": LAW | AROUND | solid}],
        "boundary": [
            {"on": sides["y"], "displacement": {y: 0.0}},
            {"on": sides["x"], "displacement": {x: 0.0}},
            {"on": "left", "traction": push},
            {"on": "right"},
            *ends,
        ],
    }


def error(path, cells, dim=2, axis=2, **solid):
    """Return the largest error of u_r over the largest u_r (collective)."""
    comm = MPI.COMM_WORLD
    if comm.rank == 0:
        quarter(path, cells, dim, axis)
    comm.barrier()
    with Simulation.from_scene(tube(path, dim, axis, **solid)) as simulation:
        simulation.run()
        names = "points", "displacement"
        X, u = comm.bcast([simulation.fields.gathered(name) for name in names])
    if dim == 3:
        X, u = (np.roll(field, -axis - 1, axis=1)[:, :2] for field in (X, u))
    r = np.linalg.norm(X, axis=1)
    exact = np.array([wound_tube(each) for each in r])
    return np.abs((u * X).sum(axis=1) / r - exact).max() / np.abs(exact).max()


def test_a_tube_with_fibres_around_it_is_of_the_order_of_its_elements(tmp_path):
    """Of quadratic ones h³, as the directions are those of every point: halved cells leave an
    eighth, or less where the coarse ones do not resolve the r^-k at the bore yet.
    """
    coarse, fine = (error(tmp_path / f"{n}.msh", n) for n in (2, 4))
    assert fine < 1e-3
    assert 7 < coarse / fine < 12


@pytest.mark.mpi
@pytest.mark.parametrize(
    "orientation",
    [
        {"center": [7.0, 0.0, 0.0], "along": [-2.0, 0.0, 0.0]},
        {"first": {"y": "y", "z": "z"}, "second": {"y": "-z", "z": "y + 0.1*z"}},
    ],
)
def test_axes_of_a_cylinder_and_formulas_are_those_of_the_plane(shared_path, orientation):
    """In space, around x; held at both ends the tube is the one of the plane, to what iterative
    solvers leave of the displacement.
    """
    found = error(shared_path / "space.msh", 2, 3, 0, orientation=orientation)
    assert found == pytest.approx(error(shared_path / "plane.msh", 2), abs=1e-7)


@pytest.mark.parametrize("name", ["transversely_isotropic", "holzapfel_gasser_ogden"])
@pytest.mark.parametrize("d", [2, 3])
def test_a_law_along_turned_axes_is_the_law_with_turned_directions(name, d):
    """In a plane around its normal, in space any way; energy, stress, tangent and bounds."""
    known = ELASTIC[name]
    given = examples(known)
    generator = np.random.default_rng(d)
    R = np.eye(3)
    R[:d, :d] = np.linalg.qr(generator.standard_normal((d, d)))[0]
    turned = {key: tuple(R.T @ given[key]) for key in ("axis", "second_axis") if key in given}
    plain = known(1.7, 0.8, **given | turned)
    law = oriented(known(1.7, 0.8, **given), lambda X, cells: R[None, None], np.zeros((1, d)))
    H = 0.1 * generator.standard_normal((4, 5, d, d))
    for quantity in ("energy", "stress", "tangent"):
        found, expected = (getattr(each, quantity)(H) for each in (law, plain))
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
    mixed = law.mixed_tangent(H, H / 2), plain.mixed_tangent(H, H / 2)
    np.testing.assert_allclose(*mixed, rtol=0, atol=1e-12)
    assert law.oedometer_modulus == plain.oedometer_modulus


# A direction in the coordinates has these components along axes whose first one is y and whose
# second one is -x.
LEFT = {"first": {"y": 2.0}, "second": {"x": -1.0, "y": 0.4}}


def along_the_left(axis):
    x, y, z = axis
    return [y, -x, z]


def test_stress_and_internal_variables_are_those_of_turned_directions():
    """A viscoelastic artery that is stretched, of fibres that are the same in other words."""
    start = load_scene("artery_biaxial").material[0].solid
    found = []
    for turned in (False, True):
        scene = read_toml(CONFIGS / "artery_biaxial.toml")
        solid = scene["material"][0]["solid"]
        solid["prony"] = [{"modulus": 0.5, "time": 0.5}]
        if turned:
            solid |= {"axis": along_the_left(start.axis), "orientation": LEFT}
            solid["second_axis"] = along_the_left(start.second_axis)
        scene["time"] = {"end": 0.5, "step": 0.25}
        scene["expect"] = []
        with Simulation.from_scene(scene) as simulation:
            simulation.run()
            found.append([simulation.fields[name] for name in ("displacement", "stress")])
    for one, other in zip(*found, strict=True):
        scale = np.abs(one).max()
        assert scale > 0
        np.testing.assert_allclose(other, one, rtol=0, atol=1e-8 * scale)


def test_a_solid_beside_a_free_fluid_has_axes_too():
    """A flap that is stiff along its height, in the words of its own axes: the same to what the
    coupling's tolerance leaves.
    """
    found = []
    for axis, more in (([0.0, 1.0, 0.0], {}), ([1.0, 0.0, 0.0], {"orientation": UP})):
        scene = read_toml(SCENES / "flap.toml")
        scene["material"][1]["solid"] = FLAP | {"axis": axis} | more
        scene["time"] = {"end": 0.02, "step": 0.01}
        with Simulation.from_scene(scene) as simulation:
            simulation.run()
            found.append(simulation.fields["displacement"])
    assert np.abs(found[0]).max() > 1e-4
    np.testing.assert_allclose(*found, rtol=0, atol=1e-7 * np.abs(found[0]).max())


UP = {"first": {"y": "1 + x"}}
FLAP = {
    "law": "holzapfel_gasser_ogden",
    "young": 1e5,
    "poisson": 0.4,
    "density": 1000.0,
    "fibre_stiffness": 1e5,
    "fibre_stiffening": 1.0,
}


@pytest.mark.parametrize(
    "solid, message",
    [
        ({"orientation": {}}, "solid.orientation.: expected exactly one of center"),
        ({"orientation": {"center": [0.0, 0.0, 0.0]}}, "center.: received 3 numbers, expected 2"),
        ({"orientation": {"center": [0, 0], "along": [0, 0, 1]}}, "along.*two-dimensional"),
        ({"orientation": {"first": {"x": 1.0, "z": 1.0}}}, "first.z.: received it in a two-dim"),
        ({"orientation": {"first": {"x": "z"}}}, "first.x.: received 'z' in a two-dim"),
        ({"orientation": {"first": {"x": "x - x"}}}, "first: received 0 at the point"),
        ({"orientation": {"first": {"x": {"cell": "a"}}}}, "asks for the array 'a'"),
        ({"law": "linear_elastic"}, "orientation.: received one with the law 'linear_elastic'"),
    ],
)
def test_axes_that_are_none_are_refused(tmp_path, solid, message):
    quarter(tmp_path / "tube.msh", 1)
    scene = tube(tmp_path / "tube.msh", **solid)
    if solid.get("law") == "linear_elastic":
        keys = ("law", "young", "poisson", "density", "orientation")
        given = scene["material"][0]["solid"]
        scene["material"][0]["solid"] = {key: given[key] for key in keys}
    with pytest.raises(InputError, match=message):
        Simulation.from_scene(scene)


def test_around_an_axis_directions_are_those_of_rings():
    with pytest.raises(InputError, match="orientation.: received one around an axis"):
        load_scene("cartilage_unconfined", ("material.0.solid.orientation={center=[0.0, 0.0]}",))
