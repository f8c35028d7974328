"""What a body must do on a mesh of any sort: nothing without loads, nothing under a hydrostatic
pressure, and a linear displacement exactly.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from grids import grid
from mixed import cut, unit_grid
from test_mesh_cut import LAGRANGE, SERENDIPITY, quadratic
from test_mesh_cut import write as write_cut
from test_mesh_formats import abaqus, prisms
from test_mesh_read import write22

from porofsi_petsc import Simulation, load_scene
from porofsi_petsc.mesh import read_mesh
from porofsi_petsc.mesh.read import Reading

pytestmark = pytest.mark.usefixtures("petsc")
UNEVEN = SimpleNamespace(points=[0.0, 0.5, 1.0], cells=[2, 1], ratios=None)
EVEN = SimpleNamespace(points=[0.0, 1.0], cells=[2], ratios=None)
FAR = 2.0**20  # [m]; coordinates that are eighths have all their digits there


def as_gmsh(name, far=0.0, axes=(0, 1, 2), unit=1.0):
    """Return the writer of a grid without a name, as Gmsh file: far away, in a plane, in a unit."""

    def write(folder):
        axis = EVEN if name in ("T3", "H8") else UNEVEN
        mesh = grid(name, [axis] * (3 if name[0] == "H" else 2))
        points = np.full((len(mesh.points), 3), 0.25)
        points[:, axes[: mesh.dim]] = mesh.points
        group = (mesh.element.meshio_name, mesh.dim, None, mesh.cells)
        write22(folder / "a.msh", (points + far) / unit, [group])
        return {"path": str(folder / "a.msh"), "dim": mesh.dim, "scale": unit}

    return write


def as_abaqus(folder):
    (folder / "a.inp").write_text(abaqus(grid("Q8", [UNEVEN] * 2)))
    return {"path": str(folder / "a.inp"), "dim": 2}


def as_prisms(folder):
    (folder / "a.vtk").write_text(prisms(6))
    return {"path": str(folder / "a.vtk"), "dim": 3}


def as_cut(dim, kinds):
    """Return the writer of quadratic cells of several shapes, bent where they are plane."""

    def write(folder):
        points, cells = quadratic(*cut(unit_grid(dim, 2)), kinds)
        if dim == 2:
            points[:, 1] += points[:, 0] ** 2 / 4
        write_cut(folder / "a.msh", points, cells)
        return {"path": str(folder / "a.msh"), "dim": dim}

    return write


READINGS = {
    "nameless T3": as_gmsh("T3"),
    "nameless H20": as_gmsh("H20"),
    "far T6": as_gmsh("T6", far=FAR),
    "far H8": as_gmsh("H8", far=FAR),
    "x z in millimetres": as_gmsh("Q9", axes=(0, 2), unit=2.0**-10),
    "abaqus": as_abaqus,
    "prisms": as_prisms,
    "cut 2-D": as_cut(2, SERENDIPITY),
    "cut 3-D": as_cut(3, SERENDIPITY),
    "cut 3-D with middle nodes": as_cut(3, LAGRANGE),
}


@pytest.fixture(params=READINGS)
def mesh(request, tmp_path):
    """Return the section [mesh] of a file, and the mesh."""
    section = READINGS[request.param](tmp_path)
    reading = Reading(scale=section.get("scale", 1.0))
    return {"kind": "file", **section}, read_mesh(section["path"], section["dim"], reading)


SOLID = {"solid": {"law": "linear_elastic", "lambda": 8e6, "mu": 5e6, "density": 2000.0}}
POROUS = SOLID | {
    "porosity": 0.33,
    "fluid": {"density": 1000.0, "specific_weight": 1e4},
    "permeability": {"law": "constant", "k": 1e-3},
}


def solved(section, material, boundary, **more):
    """Return the fields of a linear body after a step."""
    scene = {
        "title": "a body",
        "mesh": section,
        "model": {"solid_inertia": False, "fluid_inertia": False},
        "time": {"end": 1.0, "step": 1.0},
        "coupling": {"tolerance": 1e-10},
        "material": [{"region": "all", **material}],
        "boundary": boundary,
        **more,
    }
    with Simulation.from_scene(load_scene(scene)) as simulation:
        simulation.step()
        return {name: simulation.fields[name].copy() for name in simulation.fields}


def test_nothing_happens_without_loads_or_under_a_hydrostatic_pressure(mesh):
    """The weight of the skeleton is its uplift, n_s rho_sR b_s = n_s grad p.

    Even linear elements: the stabilization sees the pressure come, and vanishes with h on others.
    """
    section, mesh = mesh
    held = {"displacement": dict.fromkeys("xyz"[: mesh.dim], 0.0)}
    first, *others = sorted(mesh.facets)
    sealed = [{"on": first, **held}, {"on": others}]
    fields = solved(section, POROUS, sealed)
    assert all(not fields[name].any() for name in ("displacement", "pressure", "fluid velocity"))
    level = float(mesh.points[:, 1].max()) + 2.5
    pressure = f"1e4*({level!r} - y)"
    weights = {"solid": {"y": -5.0}, "fluid": {"y": -10.0}}
    wet = [{"on": [first, *others], **held, "pressure": pressure}]
    fields = solved(section, POROUS, wet, body_force=weights)
    exact = 1e4 * (level - mesh.points[:, 1])
    assert np.abs(fields["pressure"].ravel() - exact).max() < 1e-9 * 2.5e4
    assert np.abs(fields["displacement"]).max() < 1e-9 * 2.5e4 / 18e6
    assert np.abs(fields["fluid velocity"]).max() < 1e-9 * 1e-3


def test_a_linear_displacement_is_exact(mesh):
    section, mesh = mesh
    middle = mesh.points.mean(axis=0)
    gradient = 1e-3 * np.array([[1.0, 2, 0.5], [-0.5, -1, 1], [0.25, 1, 0]])[: mesh.dim, : mesh.dim]
    terms = [
        " + ".join(
            f"{g!r}*({x} - {c!r})" for g, x, c in zip(row, "xyz", middle.tolist(), strict=False)
        )
        for row in gradient.tolist()
    ]
    prescribed = dict(zip("xyz", terms, strict=False))
    fields = solved(section, SOLID, [{"on": sorted(mesh.facets), "displacement": prescribed}])
    exact = (mesh.points - middle) @ gradient.T
    assert np.abs(fields["displacement"] - exact).max() < 1e-11 * np.abs(exact).max()
