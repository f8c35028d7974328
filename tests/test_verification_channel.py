"""Brinkman flow along a channel filled with a rigid skeleton, against its exact profile."""

import numpy as np
import pytest
from mpi4py import MPI
from running import SCENES

from porofsi_petsc import load_scene
from porofsi_petsc.config.fields import Cells
from porofsi_petsc.linalg.options import start
from porofsi_petsc.simulation.loop import Clock
from porofsi_petsc.simulation.simulation import Simulation

CHANNEL = str(SCENES / "channel.toml")
HEIGHT, POROSITY, DENSITY, FORCE = 1.0, 0.4, 1000.0, 2.0  # [m], [-], [kg/m³], [m/s²]


def exact(y, viscosity, mobility):
    """Return v_x of 0 = n μ v'' - S v + ρ_f b, v = 0 at both walls, S = n²/mobility."""
    S = POROSITY**2 / mobility
    wave = np.sqrt(POROSITY / mobility / viscosity)
    return (
        POROSITY
        * DENSITY
        * FORCE
        / S
        * (1 - np.cosh(wave * (y - HEIGHT / 2)) / np.cosh(wave * HEIGHT / 2))
    )


def error(order, cells, viscosity=10.0, mobility=1e-3):
    """Return the error of v_x in L2, relative, after one quasi-static step on elements of one
    height.
    """
    start()
    # one element wide: for order 1 every node lies on the boundary and the skeleton is rigid by its
    # conditions
    mesh = (
        f"mesh.order={order}",
        f"mesh.y.cells=[{cells}]",
        f"mesh.x.points=[0.0, {HEIGHT / cells}]",
    )
    scene = load_scene(CHANNEL, mesh)
    assert (scene.material[0].fluid.viscosity, scene.material[0].mobility_at(Cells.none())) == (
        viscosity,
        pytest.approx(mobility, rel=1e-14),
    )
    coupling = Simulation(scene, MPI.COMM_SELF).coupling
    schemes, rates = Clock(scene.time).next_schemes(scene.model)
    coupling.step(schemes, rates, 0.0, 1)
    coupling.accept()
    fluid = coupling.fluid
    domain = coupling.fluid.domain
    v, y = (
        (domain.mass.N @ domain.gather(field))[..., i]
        for field, i in ((fluid.v, 0), (domain.mesh.X, 1))
    )
    profile = exact(y, viscosity, mobility)
    dV = domain.reference.dV
    return np.sqrt(((v - profile) ** 2 * dV).sum() / (profile**2 * dV).sum())


@pytest.mark.parametrize("order, rate, finest", [(1, 1.9, 1e-2), (2, 2.8, 1e-4)])
def test_flow_between_walls_without_slip_converges_to_the_exact_profile(order, rate, finest):
    """Order 2 for P1, 3 for P2 in L2, up to what is left of higher orders."""
    errors = np.array([error(order, cells) for cells in (8, 16, 32)])
    assert np.all(np.log2(errors[:-1] / errors[1:]) > rate), errors
    assert errors[-1] < finest
