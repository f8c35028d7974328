"""A fluid that a solid closes: filled by an inflow all around it, it keeps its volume and finds the
pressure of the solid.
"""

import numpy as np
import pytest
from mpi4py import MPI
from running import ROOT
from test_nonmatching import joined, region_of

from porofsi_petsc import load_scene
from porofsi_petsc.coupling.interface import InterfaceMonolithic
from porofsi_petsc.exact import Ring
from porofsi_petsc.linalg.options import start
from porofsi_petsc.mesh import read_mesh
from porofsi_petsc.mesh.write import write_mesh
from porofsi_petsc.simulation.simulation import Simulation
from porofsi_petsc.studies.trial import attempt

RING = Ring(0.95, 1.05, 1.5, 1e6 * 0.3 / (1.3 * 0.4), 1e6 / 2.6, 1000.0)  # as in ring_added_mass
STEP, STEPS, SPEED = 0.5, 8, 5e-5  # [s], [m/s²]: so slow that inertia is 1e-4 of the pressure
# A quarter of a ring in a fluid that is pressed through the wall around it; the fluid's edges are
# planes of symmetry (slip).
BOUNDARY = (
    "{on='inside'}",
    "{on='ring_bottom', displacement={y=0}}",
    "{on='ring_left', displacement={x=0}}",
    "{on='fluid_bottom', velocity={y=0}, displacement={y=0}}",
    "{on='fluid_left', velocity={x=0}, displacement={x=0}}",
    (
        f"{{on='wall', velocity={{x='-{SPEED}*t*x/1.5', y='-{SPEED}*t*y/1.5'}}, displacement={{x=0,"
        " y=0}}"
    ),
)
BALLOON = (
    f"boundary=[{', '.join(BOUNDARY)}]",
    "initial={}",
    "expect=[]",
    "material.1.fluid.viscosity=1e-3",
)
BALLOON += (
    f"time.step={STEP}",
    f"time.end={STEP * STEPS}",
    "coupling.tolerance=1e-9",
    "time.rho_inf=1.0",
)


def filled(*options):
    """Return t, volume of the fluid and displacement of the ring after every step, and the pressure
    beside it in its middle.
    """
    rows = []

    def watcher(coupling):
        X = coupling.solid.mesh.X
        domain = coupling.fluid.domain
        here = np.hypot(X[:, 0] - RING.outer, X[:, 1]) < 1e-9
        dry, wet = (
            np.flatnonzero(here & part.holds)[0] for part in (coupling.solid.domain, domain)
        )

        def look(clock, coupling, energy):
            volume = domain.sum_owned(
                coupling.accepted_mesh_state().configuration.geometry.dV.sum(axis=1)
            )
            pressure = coupling.fluid.state()["p_collocated"]
            rows.append((clock.t, volume, coupling.solid.u[dry, 0], pressure[wet]))

        return look

    outcome = attempt(load_scene("ring_added_mass", (*BALLOON, *options)), watcher)
    assert outcome.failure == ""
    return np.array(rows).T


def apart(folder):
    """Return the changes for a fluid of the coarse mesh beside the ring of the fine one, whose
    facets are half as long.
    """
    parts = [read_mesh(ROOT / f"configs/meshes/ring_{level}_p2.msh", 2) for level in (0, 1)]
    sides = region_of(parts[0], "fluid", "wet_fluid"), region_of(parts[1], "ring", "wet_ring")
    write_mesh(folder / "apart.msh", joined(*sides))
    return (
        f"mesh={{kind='file', path='{folder}/apart.msh', dim=2}}",
        "interface=[{fluid='wet_fluid', solid='wet_ring'}]",
    )


CHOICES = ["interface=auto", "interface=robin_neumann", "scheme=direct"]


@pytest.mark.parametrize("choice", CHOICES)
@pytest.mark.parametrize("meshes", [1, 2])
def test_a_balloon_grows_by_what_flows_in_and_presses_as_its_ring_does(meshes, choice, tmp_path):
    """On one mesh, and on two with nodes of their own on the interface."""
    t, volume, displacement, pressure = filled(
        f"coupling.{choice}", *(apart(tmp_path) if meshes == 2 else ())
    )
    # the nodes of the wall have the exact speed, 16 arcs of second order between them a length of
    # 1e-7 less than the circle's; the trapezoidal rule is exact for a linear inflow, and for the
    # area that a line sweeps: the coupling's tolerance is left
    inflow = SPEED * t**2 / 2 * 1.5 * np.pi / 2
    growth = volume - volume[0] + inflow[0]
    np.testing.assert_allclose(growth, inflow, rtol=1e-6)
    middle = (displacement + np.append(0.0, displacement[:-1])) / 2
    # strains up to 6e-4 of a law of large ones; the inertia of ring and fluid, (ρ_s H + ρ_f R
    # ln(b/R)) ü = 0.011 Pa, at the start
    np.testing.assert_allclose(
        RING.compression(pressure), -middle, rtol=1e-3, atol=RING.compression(0.011)
    )
    area = (RING.outer**2 - (RING.outer + displacement) ** 2) * np.pi / 4
    np.testing.assert_allclose(area, inflow, rtol=1e-4)


def chosen(*options):
    start()
    scene = load_scene("ring_added_mass", (*BALLOON, "coupling.interface=auto", *options))
    return Simulation(scene, MPI.COMM_WORLD).coupling


def test_where_the_solid_without_inertia_closes_the_fluid_the_scheme_is_chosen_and_said():
    """With inertia the condensed solid gives the pressure its level; without, both are solved
    together.
    """
    assert not isinstance(chosen(), InterfaceMonolithic)
    coupling = chosen(
        "time.scheme=backward_euler", "model.solid_inertia=false", "model.fluid_inertia=false"
    )
    assert isinstance(coupling, InterfaceMonolithic)
    assert "the solid closes the fluid" in coupling.notices[0]
