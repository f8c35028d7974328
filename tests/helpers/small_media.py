"""Media of a few elements, also within a step from a random state to another, whose tangents are
compared with differences.
"""

import numpy as np
from mpi4py import MPI
from running import SCENES

from porofsi_petsc import load_scene
from porofsi_petsc.simulation.loop import Clock
from porofsi_petsc.simulation.simulation import Simulation

BLOCK3D = str(SCENES / "block3d.toml")
PLANE = (
    "mesh.x.cells=[1, 1, 1]",
    "mesh.x.ratios=[1.0, 1.0, 1.0]",
    "mesh.y.cells=[2]",
    "mesh.y.ratios=[1.0]",
)
SPACE = ("mesh.x.cells=[1, 1]", "mesh.y.cells=[1]", "mesh.z.cells=[1]", "mesh.z.ratios=[1.0]")
QUADRILATERAL = "mesh.cell_type=quadrilateral", "mesh.diagonal=right"
MESHES = {
    "T3": ("pulse2d", (*PLANE, "mesh.order=1")),
    "T6": ("pulse2d", (*PLANE, "mesh.order=2")),
    "Q4": ("pulse2d", (*PLANE, "mesh.order=1", *QUADRILATERAL)),
    "Q9": ("pulse2d", (*PLANE, "mesh.order=2", *QUADRILATERAL)),
    "Q8": (
        "pulse2d",
        (*PLANE, "mesh.order=2", "mesh.cell_type=serendipity", "mesh.diagonal=right"),
    ),
    "T4": (BLOCK3D, SPACE),
    "T10": (BLOCK3D, (*SPACE, "mesh.order=2")),
    "H8": (BLOCK3D, (*SPACE, "mesh.cell_type=hexahedron")),
}
DARCY = ("model.viscosity=false", "model.convection=true", "model.moving_mesh=true")
BRINKMAN = (
    "model.viscosity=true",
    "material.0.fluid.viscosity=500.0",
    "model.convection=true",
    "model.moving_mesh=true",
)
VARIABLE = ("model.porosity=variable", "material.0.permeability.law=kozeny_carman")
RINGS = {  # bodies of revolution, the left side their axis
    "rings of T3": ("pulse2d", (*PLANE, "mesh.order=1", "mesh.axisymmetric=true")),
    "rings of T6": ("pulse2d", (*PLANE, "mesh.order=2", "mesh.axisymmetric=true")),
}
# Central differences: truncation of the terms that are not quadratic (1e-8 at a step of 1e-4 of the
# scale) and the round-off of residuals against their change (1e-12/1e-4).
FD_STEP = 1e-4
FD_TOLERANCE = 2e-7


def medium(mesh, *overrides):
    """Return the coupling of a scene on a small mesh on this rank alone, with the schemes and the
    rates of its first step.
    """
    name, changes = (MESHES | RINGS)[mesh]
    scene = load_scene(name, (*changes, "coupling.split=plain", *overrides))
    coupling = Simulation(scene, MPI.COMM_SELF).coupling
    return coupling, *Clock(scene.time).next_schemes(scene.model)


def in_motion(mesh, *overrides):
    """Return a coupling within a step from a random accepted state to a random trial state, and the
    rates.
    """
    rng = np.random.default_rng(3)
    coupling, (solid_scheme, fluid_scheme), rates = medium(mesh, *overrides)
    solid = coupling.solid
    fluid = coupling.fluid
    for array, scale in (
        (solid.u, 0.02),
        (solid.v, 0.3),
        (solid.a, 1.0),
        (fluid.v, 0.3),
        (fluid.a, 1.0),
        (fluid.p, 1e4),
    ):
        array[:] = scale * rng.standard_normal(array.shape)
    for phase in (solid, fluid):
        phase.reset()
    fluid.begin_step(fluid_scheme, rates, 0.0, solid.accepted_mesh_state())
    solid.begin_step(solid_scheme, 0.0)
    solid.unknowns = solid.unknowns + 0.02 * rng.standard_normal(solid.unknowns.shape)
    fluid.unknowns = fluid.unknowns + np.array(
        [0.3] * solid.mesh.dim + [1e4]
    ) * rng.standard_normal(fluid.unknowns.shape)
    return coupling, rates


def dense(matrix):
    matrix = matrix.copy()
    matrix.convert("dense")
    return matrix.getDenseArray().copy()
