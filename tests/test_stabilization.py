"""Stabilization parameters against numbers worked out by hand, of single formulas and of an element
of a scene.
"""

import numpy as np
import pytest
from mpi4py import MPI

from porofsi_petsc import load_scene
from porofsi_petsc.fem.geometry import element_size_tensor
from porofsi_petsc.kernels import stabilization
from porofsi_petsc.linalg.stopwatch import Stopwatch
from porofsi_petsc.phases.coupling_data import Rates
from porofsi_petsc.phases.parameters import StabilizationParameters
from porofsi_petsc.simulation.porous import PorousBuilder
from porofsi_petsc.simulation.simulation import Simulation

pytestmark = pytest.mark.usefixtures("petsc")
ROUND_OFF = 1e-13
WIDTH = 2.0
HEIGHT = 1.0


def test_tau_adds_the_four_scales_in_squares():
    assert stabilization.momentum_tau(3.0, 4.0, 12.0, 84.0) == pytest.approx(1 / 85, rel=ROUND_OFF)


def test_convective_scale_is_twice_the_speed_over_the_length_along_the_flow():
    """A right-angled triangle with legs 2 m and 1 m: 2 ρ |c|/h_c with h_c = 2 m along x, 1 m along
    y.
    """
    G = np.array([[[[-0.5, -1.0], [0.5, 0.0], [0.0, 1.0]]]] * 2)
    c = np.array([[[4.0, 0.0]] * 3, [[0.0, 4.0]] * 3])
    scale = stabilization.convective_scale(np.full((1, 3), 1 / 3), G, np.array([[3.0], [3.0]]), c)
    assert scale == pytest.approx(np.array([[12.0], [24.0]]), rel=ROUND_OFF)


def test_lsic_viscosity_is_half_of_density_speed_and_size():
    c = np.array([[[3.0, 4.0]] * 3])
    nu = stabilization.lsic_viscosity(np.full((1, 3), 1 / 3), np.array([[7.0]]), c, np.array([2.0]))
    assert nu == pytest.approx(np.array([[35.0]]), rel=ROUND_OFF)


@pytest.mark.parametrize(
    "inertia, expected",
    [(0.0, (1 / 10, 1 / 40)), (30.0, (0.3 / 10, 1 / 70)), (1e9, (0.3 / 10, 0.3 / 40))],
    ids=["static", "between", "inertia dominates"],
)
def test_grid_compliance_of_a_stretched_element(inertia, expected):
    """h² = 4 and 1 m² along the axes, E_c = 10 Pa: 4 E_c/h² = 10 and 40."""
    size = np.diag([4.0, 1.0])[None]
    assert stabilization.grid_compliance(10.0, size, inertia)[0] == pytest.approx(
        np.diag(expected), rel=ROUND_OFF
    )


def test_undrained_tau_is_the_compliance_times_the_square_of_what_moves():
    compliance = np.array([[[2.0, 0.5], [0.5, 1.0]]])
    tau = stabilization.undrained_tau(compliance, np.array([[0.5, 1.0]]))
    assert tau == pytest.approx(np.array([[compliance[0] / 4, compliance[0]]]), rel=ROUND_OFF)


def test_size_tensor_of_a_right_angled_triangle_has_the_determinant_of_its_size():
    """Vertices (0, 0), (2, 0), (0, 1): moments [[8, -2], [-2, 2]]/3 of determinant 4/3, scaled to
    det = h⁴ = 4.
    """
    vertices = np.array([[[0.0, 0.0], [2.0, 0.0], [0.0, 1.0]]])
    size = element_size_tensor(vertices, np.array([np.sqrt(2.0)]))[0]
    assert size == pytest.approx(np.array([[8.0, -2.0], [-2.0, 2.0]]) / np.sqrt(3), rel=ROUND_OFF)


def two_triangles(*overrides):
    """Return scene, domain, fluid setup and skeleton at rest of a rectangle of two right-angled
    triangles.
    """
    mesh = (
        f"mesh.x.points=[0.0, {WIDTH}]",
        f"mesh.y.points=[0.0, {HEIGHT}]",
        "mesh.y.cells=[1]",
        "mesh.y.ratios=[1.0]",
    )
    scene = load_scene("column_step", (*mesh, "probe=[]", "expect=[]", *overrides))
    scene = scene.model_copy(update={"reference": None})  # whose column is another one
    coupling = Simulation(scene, MPI.COMM_SELF).coupling
    domain = coupling.solid.domain
    setup = PorousBuilder(scene, domain.mesh, Stopwatch(), domain).fluid()
    return setup, coupling.solid.accepted_mesh_state()


FREE = Rates(0.0, 10.0, 100.0)
NEARLY_FREE = Rates(1e9, 10.0, 0.0)


def test_tau_of_an_element_in_a_flow_through_a_porous_body():
    """n_f = 0.33, ρ_f = 330 kg/m³, Δt = 0.01 s, S = 0.33²·1e4/0.01, μ = 5 Pa s, h² = 2 A 2 / 2 = 2
    m², flow along x at 3 m/s.
    """
    overrides = (
        "model.convection=true",
        "model.viscosity=true",
        "material.0.fluid.viscosity=5.0",
        "stabilization.lsic=true",
    )
    setup, mesh_state = two_triangles(*overrides)
    parameters = StabilizationParameters(setup)
    v = np.zeros((setup.domain.mesh.n_local, 2))
    v[:, 0] = 3.0
    parameters.update(0.01, FREE, mesh_state, v)
    scales = np.array([2 * 330 / 0.01, 0.33**2 * 1e6, 4 * 0.33 * 5 / 2, 2 * 330 * 3 / WIDTH])
    assert parameters.tau == pytest.approx(
        np.full(parameters.tau.shape, 1 / np.linalg.norm(scales)), rel=ROUND_OFF
    )
    assert parameters.nu_lsic == pytest.approx(
        np.full(parameters.tau.shape, 330 * 3 * np.sqrt(2) / 2), rel=ROUND_OFF
    )


def test_tau_without_inertia_and_convection_is_that_of_the_drag():
    overrides = ("model.solid_inertia=false", "model.fluid_inertia=false", "limits.inertia=report")
    setup, mesh_state = two_triangles(*overrides)
    parameters = StabilizationParameters(setup)
    parameters.update(0.01, FREE, mesh_state, np.zeros((setup.domain.mesh.n_local, 2)))
    assert parameters.tau == pytest.approx(
        np.full(parameters.tau.shape, 1 / (0.33**2 * 1e6)), rel=ROUND_OFF
    )
    assert not parameters.nu_lsic.any()


@pytest.mark.parametrize(
    "rates, moved", [(FREE, 1.0), (NEARLY_FREE, 0.67)], ids=["dragged along", "free"]
)
def test_undrained_parameter_of_an_element(rates, moved):
    """c_v α² times the compliance; α = n_s + χ n_f, χ = S/(S + ρ_f c_f) = 1 without inertia of the
    fluid, 3e-7 at c_f = 1e9/s.

    E_c = 8.375e6 + 2·5.583e6 Pa, ρ = 0.67·2000 + 0.33·1000 kg/m³; the size is that of a triangle
    with legs 2 m and 1 m.
    """
    setup, mesh_state = two_triangles()
    parameters = StabilizationParameters(setup)
    parameters.update(0.01, rates, mesh_state, np.zeros((setup.domain.mesh.n_local, 2)))
    h2, e = np.linalg.eigh(np.array([[8.0, -2.0], [-2.0, 2.0]]) / np.sqrt(3))
    modulus = 8.375e6 + 2 * 5.583e6
    inertia = rates.c_a * 1670
    stiffness = 4 * modulus / h2
    compliance = e @ np.diag(np.maximum(1 / (stiffness + inertia), 0.3 / stiffness)) @ e.T
    expected = np.broadcast_to(
        10.0 * moved**2 * compliance,
        (len(setup.domain.cells), len(setup.domain.mass.weights), 2, 2),
    )
    ours = np.concatenate([parameters.undrained(chunk) for _, chunk in setup.domain.chunks(1)])
    # the sign of the mixed entry follows the diagonal; χ = 3e-7 is left out in the free case
    assert np.abs(ours) == pytest.approx(np.abs(expected), rel=1e-6)


def test_parameters_are_kept_while_the_rates_are():
    """`StabilizationParameters` keeps its arrays where nothing in them changes, and renews them
    with the step size.
    """
    setup, mesh_state = two_triangles(
        "model.solid_inertia=false", "model.fluid_inertia=false", "limits.inertia=report"
    )
    parameters = StabilizationParameters(setup)
    v = np.zeros((setup.domain.mesh.n_local, 2))
    parameters.update(0.01, FREE, mesh_state, v)
    kept = parameters.tau.copy()
    parameters.tau[:] = 0.0
    parameters.update(0.01, FREE, mesh_state, v)
    assert not parameters.tau.any()
    parameters.update(0.02, Rates(0.0, 5.0, 25.0), mesh_state, v)
    assert (parameters.tau == kept).all()
