"""What is measured of a step and what is written of a state, against numbers worked out by hand for
homogeneous states.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI

from porofsi_petsc import load_scene
from porofsi_petsc.errors import LimitError
from porofsi_petsc.materials import ELASTIC
from porofsi_petsc.simulation.build import local_mesh
from porofsi_petsc.simulation.builder import materials_of
from porofsi_petsc.simulation.loop import Clock
from porofsi_petsc.simulation.measures import Measures
from porofsi_petsc.simulation.simulation import Simulation

pytestmark = pytest.mark.usefixtures("petsc")
ROUND_OFF = 1e-12
WIDTH = 2.0
HEIGHT = 1.0
H = np.array([[-0.02, 0.03], [0.01, 0.04]])
N_S = 0.67
N_F = 0.33
RHO_F = 1000.0
MATERIAL = (
    "material.0.porosity=0.33",
    "material.0.solid.density=2000.0",
    "material.0.fluid.density=1000.0",
)
QUASI_STATIC = ("model.solid_inertia=false", "model.fluid_inertia=false")
VISCOUS = "material.0.fluid.viscosity=5.0"


class Body:
    """A rectangle of two right-angled triangles, its trial state displaced by u = H X, its phases
    at uniform velocities.
    """

    def __init__(self, *overrides):
        """Build a scene and its measures."""
        mesh = (f"mesh.x.points=[0.0, {WIDTH}]", f"mesh.y.points=[0.0, {HEIGHT}]", "mesh.order=1")
        mesh += ("mesh.y.cells=[1]", "mesh.y.ratios=[1.0]")
        fixed = ("probe=[]", "expect=[]", "time.scheme=generalized_alpha")
        self.scene = load_scene("drained_column", (*mesh, *fixed, *MATERIAL, *overrides))
        mesh = local_mesh(self.scene, MPI.COMM_SELF)
        self.coupling = Simulation(self.scene, mesh=mesh).coupling
        self.materials = materials_of(self.scene, mesh)
        self.measures = Measures(self.scene, self.coupling, self.materials)

    def sizes(self, dt=0.5, v_s=(0.0, 0.0), v_f=(0.0, 0.0), force=4.0):
        """Return the sizes of what is left out of a step that moves to u = H X; force is the
        largest of either phase [N].
        """
        solid = self.coupling.solid
        X = solid.mesh.X
        one = np.ones((solid.mesh.n_local, 1))
        residual = SimpleNamespace(largest_force=lambda: force)
        trial = SimpleNamespace(
            solid=SimpleNamespace(
                mesh=solid.mesh,
                unknowns=X @ H.T,
                v=np.zeros_like(X),
                mesh_state=lambda: SimpleNamespace(end_velocity=one * v_s),
            ),
            fluid=SimpleNamespace(
                unknowns=np.hstack([one * v_f, one]),
                v=np.zeros_like(X),
                scheme=SimpleNamespace(c_v=1 / dt),
            ),
            mesh_state=lambda: SimpleNamespace(end_velocity=one * v_s, displacement=X @ H.T),
            residuals=(residual, (residual, residual)),
        )
        return self.measures.neglected_sizes(trial, dt)


BASE = (
    "material.0.solid.law=linear_elastic",
    "model.moving_mesh=false",
    "model.porosity=constant",
    *QUASI_STATIC,
)


def set_of(body):
    return {omission.name for omission in body.measures.omissions}


def test_strain_is_the_norm_of_green():
    """E = (H + H^T + H^T H)/2 in decimals: E_xx = -0.01975, E_xy = 0.0199, E_yy = 0.04125."""
    expected = np.sqrt(0.01975**2 + 2 * 0.0199**2 + 0.04125**2)
    assert Body(*BASE).sizes()["strain"] == pytest.approx(expected, rel=ROUND_OFF)


def test_porosity_change_is_that_of_the_solid_fraction_over_the_volume_ratio():
    """J = 0.98·1.04 - 0.03·0.01 = 1.0189; n_s = 0.67/J."""
    expected = N_S * (1 - 1 / 1.0189) / N_F
    assert Body(*BASE).sizes()["porosity_change"] == pytest.approx(expected, rel=ROUND_OFF)


def drag(body):
    """Return S = n_f² γ/k of the scene [N s/m⁴]."""
    entry = body.scene.material[0]
    return N_F**2 * entry.fluid.specific_weight / entry.permeability.k


def test_reynolds_is_convection_over_drag_at_element_scale():
    """ρ_f Σ_a |c·∇N_a| = 2 n_f ρ |c|/h_c, along x with h_c = 2 m, over S; on a fixed mesh c is v_f
    itself.
    """
    body = Body(*BASE)
    expected = 2 * N_F * RHO_F * 3.0 / WIDTH / drag(body)
    assert body.sizes(v_f=(3.0, 0.0), v_s=(1.0, 0.0))["reynolds"] == pytest.approx(
        expected, rel=ROUND_OFF
    )


def test_reynolds_counts_transient_and_viscous_forces_that_are_modelled():
    """The resistance is S + 4 n_f μ/h² + n_f ρ c_v, h² = 2 m²."""
    body = Body(*BASE[:-1], "model.viscosity=true", VISCOUS, "model.fluid_inertia=true")
    resistance = drag(body) + 4 * N_F * 5.0 / 2 + N_F * RHO_F / 0.5
    expected = 2 * N_F * RHO_F * 3.0 / WIDTH / resistance
    assert body.sizes(dt=0.5, v_f=(3.0, 0.0))["reynolds"] == pytest.approx(expected, rel=ROUND_OFF)


def test_reynolds_on_a_moving_mesh_is_that_of_the_relative_velocity_in_the_present_volume():
    """c = v_f - v_m = 2 m/s; n_f is that of the present volume ratio."""
    body = Body(
        "model.moving_mesh=true", "model.porosity=variable", *QUASI_STATIC, "limits.reynolds=report"
    )
    n_f = 1 - N_S / 1.0189
    entry = body.scene.material[0]
    expected = (
        2 * n_f * RHO_F * 2.0 / WIDTH / body.materials["body"].drag(np.array([1.0189])).scale[0]
    )
    assert entry.fluid.density == RHO_F
    assert body.sizes(v_f=(3.0, 0.0), v_s=(1.0, 0.0))["reynolds"] == pytest.approx(
        expected, rel=ROUND_OFF
    )


def test_inertia_is_lumped_mass_times_the_rate_of_the_velocity_over_the_largest_force():
    """Two nodes belong to both triangles, two to one: lumped masses ρ A/6 · (2, 2, 1, 1), A = 6 m²
    of both.
    """
    body = Body(*BASE, "mesh.y.points=[0.0, 3.0]")
    norm = WIDTH * 3.0 / 6 * np.sqrt(10)
    sizes = body.sizes(dt=0.5, v_s=(0.3, 0.4), v_f=(0.0, 2.0), force=4.0)
    assert sizes["solid_inertia"] == pytest.approx(
        N_S * 2000.0 * norm * 0.5 / 0.5 / 4.0, rel=ROUND_OFF
    )
    assert sizes["fluid_inertia"] == pytest.approx(
        N_F * RHO_F * norm * 2.0 / 0.5 / 4.0, rel=ROUND_OFF
    )
    assert body.sizes(v_s=(0.3, 0.4), force=0.0)["solid_inertia"] == 0.0


def test_brinkman_ratio_is_the_viscous_over_the_drag_force_at_element_scale():
    body = Body(*BASE, VISCOUS)
    assert body.sizes()["viscosity"] == pytest.approx(4 * N_F * 5.0 / 2 / drag(body), rel=ROUND_OFF)


def test_only_what_is_left_out_is_measured():
    assert {"strain", "reynolds", "solid_inertia", "fluid_inertia", "porosity_change"} <= set_of(
        Body(*BASE)
    )
    assert "viscosity" not in set_of(Body(*BASE)) and "viscosity" in set_of(Body(*BASE, VISCOUS))
    everything = (
        "model.moving_mesh=true",
        "model.porosity=variable",
        "model.convection=true",
        "model.viscosity=true",
        VISCOUS,
    )
    inertia = ("model.solid_inertia=true", "model.fluid_inertia=true")
    assert set_of(Body("material.0.solid.law=neo_hookean", *everything, *inertia)) == set()
    # without the moving mesh the porosity cannot follow the volume ratio
    fixed = ("model.moving_mesh=false", "model.porosity=constant")
    assert "porosity_change" in set_of(Body("material.0.solid.law=neo_hookean", *fixed))


def test_a_bound_is_passed_above_it_and_not_at_it():
    body = Body(*BASE, "limits.strain=0.25")
    clock = Clock(body.scene.time)
    body.measures.watch_neglected({"strain": 0.25}, 0.1, clock)
    body.measures.require_limits(1.0)
    body.measures.watch_neglected({"strain": 0.2501}, 0.1, clock)
    body.measures.watch_neglected({"strain": 0.1}, 0.1, clock)  # the largest of the run counts
    with pytest.raises(LimitError, match="strain.*0.25"):
        body.measures.require_limits(1.0)
    assert body.measures.neglected()["strain"]["value"] == 0.2501


@pytest.mark.parametrize("law", ["linear_elastic", "neo_hookean", "saint_venant_kirchhoff"])
def test_stress_is_the_effective_cauchy_stress_of_plane_strain(law):
    """σ = P F^T/J with F_33 = 1, from the first Piola-Kirchhoff stress in three dimensions; a
    linear law's P is σ.
    """
    body = Body(f"material.0.solid.law={law}", *BASE[1:])
    solid = body.scene.material[0].solid
    full = np.zeros((3, 3))
    full[:2, :2] = H
    P = ELASTIC[law](solid.lambda_, solid.mu, N_S).stress(full[None])[0]
    F = full + np.eye(3)
    sigma = P if law == "linear_elastic" else P @ F.T / np.linalg.det(F)
    found = body.measures.stress(body.coupling.solid.mesh.X @ H.T)
    expected = [sigma[0, 0], sigma[0, 1], sigma[0, 2], sigma[1, 1], sigma[1, 2], sigma[2, 2]]
    assert found == pytest.approx(
        np.tile(expected, (4, 1)), rel=1e-10, abs=1e-10 * np.abs(sigma).max()
    )


def test_porosity_field_is_that_of_the_volume_ratio():
    body = Body("model.moving_mesh=true", "model.porosity=variable", *QUASI_STATIC)
    domain = body.coupling.fluid.domain
    J = np.full((domain.n_cells, len(domain.mass.weights)), 1.25)
    mesh_state = SimpleNamespace(configuration=SimpleNamespace(J=J))
    assert body.measures.porosity(mesh_state) == pytest.approx(
        np.full((4, 1), 1 - N_S / 1.25), rel=ROUND_OFF
    )


def test_pressure_oscillation_is_the_distance_from_the_average_over_the_neighbours():
    """Three by three nodes, p = 1 in the middle only: its triangles have the mean 1/3, so |p - p̄|
    is 2/3 of |p|.
    """
    body = Body(*BASE, "mesh.x.cells=[2]", "mesh.y.cells=[2]")
    mesh = body.coupling.solid.mesh
    p = (np.linalg.norm(mesh.X - [WIDTH / 2, HEIGHT / 2], axis=1) < 1e-9).astype(float)
    assert p.sum() == 1
    assert body.measures.oscillation_indicator == 0.0
    body.measures.watch_pressure(p)
    assert body.measures.oscillation_indicator == pytest.approx(2 / 3, rel=ROUND_OFF)
    body.measures.watch_pressure(
        np.full(len(p), 5.0)
    )  # a constant has none; the largest |p| is now 15
    assert body.measures.oscillation_indicator == pytest.approx(2 / 3 / 15, rel=ROUND_OFF)
