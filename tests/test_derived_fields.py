"""Fields that are made of others: exact where displacement, pressure and velocities are linear."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from running import SCENES, Job, run_here

from porofsi_petsc import Simulation, load_scene, read_fields
from porofsi_petsc.errors import InputError

PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
PLANE = ("pulse2d", ("mesh.order=1", "mesh.x.cells=[2, 2, 2]", "mesh.y.cells=[3]"))
QUADRATIC = ("pulse2d", ("mesh.order=2", "mesh.x.cells=[1, 1, 1]", "mesh.y.cells=[2]"))
SPACE = (str(SCENES / "block3d.toml"), ())
CASES = {"plane": PLANE, "quadratic": QUADRATIC, "space": SPACE}
# What is left of 16 digits after differences of displacements and velocities on small elements.
EXACT = {"rtol": 1e-9, "atol": 1e-9}


def linear(dim, scale):
    """Return a matrix without symmetries, (dim, dim)."""
    return scale * np.array([[0.3, 0.7, -0.2], [-0.4, 0.5, 0.6], [0.1, -0.8, 0.9]])[:dim, :dim]


@pytest.fixture(params=CASES)
def state(request, petsc):
    """Return a simulation with u = H X, p = p_0 + g·X, v_s = B X, v_f = A X, and H, p, A, B, X."""
    name, overrides = CASES[request.param]
    law = 'material.0.solid={ law="linear_elastic", lambda=3e6, mu=2e6, density=2000.0 }'
    motion = ("model.moving_mesh=true", "model.porosity=constant")
    with Simulation.from_scene(name, overrides=(*overrides, law, *motion)) as simulation:
        coupling = simulation.coupling
        X = coupling.solid.mesh.X
        dim = X.shape[1]
        H, A, B = (linear(dim, scale) for scale in (1e-3, 1.0, 0.2))
        p = 1e3 + X @ np.array([50.0, -70.0, 20.0])[:dim]
        coupling.solid.u[:] = X @ H.T
        coupling.solid.v[:] = X @ B.T
        coupling.fluid.v[:] = X @ A.T
        coupling.fluid.p[:] = p
        own = slice(coupling.solid.mesh.n_owned)
        yield simulation, H, p[own], A, B, X[own]


def stress_of(H):
    """Return λ tr ε I + 2 μ ε in space; in the plane ε_zz = 0."""
    whole = np.zeros((3, 3))
    whole[: len(H), : len(H)] = (H + H.T) / 2
    return 3e6 * np.trace(whole) * np.eye(3) + 2 * 2e6 * whole, whole


def six(tensor):
    return np.array([tensor[pair] for pair in PAIRS])


@pytest.mark.mpi
def test_stresses_of_a_linear_displacement(state):
    simulation, H, p, *_ = state
    stress, strain = stress_of(H)
    fields = simulation.fields
    n = len(p)
    assert_allclose(fields["effective stress"], np.tile(six(stress), (n, 1)), rtol=1e-9, atol=1e-6)
    np.testing.assert_array_equal(fields["effective stress"], fields["stress"])
    total = six(stress) - p[:, None] * six(np.eye(3))
    assert_allclose(fields["total stress"], total, rtol=1e-9, atol=1e-6)
    assert_allclose(fields["strain"], np.tile(six(strain), (n, 1)), rtol=1e-9, atol=1e-14)
    assert_allclose(fields["mean effective stress"][:, 0], -np.trace(stress) / 3, rtol=1e-9)
    deviator = stress - np.trace(stress) / 3 * np.eye(3)
    q = np.sqrt(1.5 * np.sum(deviator**2))
    assert_allclose(fields["von Mises stress"][:, 0], q, rtol=1e-9)
    largest_first = np.linalg.eigvalsh(stress)[::-1]
    assert_allclose(fields["principal stresses"], np.tile(largest_first, (n, 1)), rtol=1e-9)


@pytest.mark.mpi
def test_flow_of_linear_velocities(state):
    simulation, H, _, A, B, X = state
    F = np.eye(len(H)) + H
    grad = A @ np.linalg.inv(F)  # by the present positions x = F X
    dim = len(H)
    spin = grad - grad.T
    curl = [spin[1, 0]] if dim == 2 else [spin[2, 1], spin[0, 2], spin[1, 0]]
    vorticity = simulation.fields["vorticity"]
    assert_allclose(vorticity, np.tile(curl, (len(X), 1)), **EXACT)
    n_f = simulation.scene.material[0].porosity
    assert_allclose(simulation.fields["Darcy velocity"], n_f * X @ (A - B).T, **EXACT)


def test_vorticity_of_a_free_fluid_on_a_mesh_at_rest(petsc):
    with Simulation.from_scene(str(SCENES / "free_fluid.toml")) as simulation:
        X = simulation.coupling.fluid.mesh.X
        A = linear(2, 1.0)
        simulation.coupling.fluid.v[:] = X @ A.T
        assert_allclose(simulation.fields["vorticity"], A[1, 0] - A[0, 1], **EXACT)
        assert "total stress" not in simulation.fields
        with pytest.raises(KeyError, match="received 'von Mises stress', expected one of pressure"):
            simulation.fields["von Mises stress"]


def test_derived_fields_are_not_counted_and_have_units(petsc):
    with Simulation.from_scene(*PLANE[:1], overrides=PLANE[1]) as simulation:
        assert "stress" in list(simulation.fields) and "strain" not in list(simulation.fields)
        assert simulation.fields.units["vorticity"] == "1/s"


@pytest.mark.parametrize("file_format", ["xdmf", "vtkhdf"])
def test_derived_fields_are_written_where_asked_for(tmp_path, petsc, file_format):
    names = ["displacement", "principal stresses", "total stress", "vorticity", "Darcy velocity"]
    output = f"output={{ fields_every=1, fields={names}, format='{file_format}' }}"
    run_here(Job(PLANE[0], str(tmp_path), (*PLANE[1], "time.end=0.002", output)))
    found = read_fields(tmp_path)
    assert {name: found[name].shape[1:] for name in names} == {
        "displacement": (3,),
        "principal stresses": (3,),
        "total stress": (6,),
        "vorticity": (),
        "Darcy velocity": (3,),
    }
    assert all(np.abs(found[name]).max() > 0 for name in names)


@pytest.mark.parametrize(
    "scene, name, sentence",
    [
        ("free_fluid", "von Mises stress", "which the scene has not; choose from pressure, fluid"),
        ("bar", "vorticity", "received 'vorticity', which the scene has not"),
        ("bar", "total stress", "received 'total stress', which the scene has not"),
    ],
)
def test_fields_without_their_phase_are_refused(scene, name, sentence):
    with pytest.raises(InputError, match=sentence):
        load_scene(
            str(SCENES / f"{scene}.toml"), [f'output={{ fields_every=1, fields=["{name}"] }}']
        )


def test_total_stress_on_a_dry_solid_is_that_of_the_porous_medium(petsc):
    """As a probe on the surface, where a mean over both elements would be neither's."""
    with Simulation.from_scene("dry_fill", overrides=["time.end=0.011"]) as simulation:
        simulation.run()
        total = simulation.fields["total stress"]
        stress = simulation.fields["stress"]
        y = simulation.fields.points[:, 1]
        joint = np.abs(y - 10.0) < 1e-9
        recorded = simulation.history["joint.total_yy"][-1]
        # the sides have the same values; a probe between nodes interpolates them
        assert_allclose(total[joint, 3], recorded, rtol=1e-9)
        assert (
            np.abs(stress[joint, 3] - simulation.fields["pressure"][joint, 0] - recorded).min() > 1
        )
        np.testing.assert_array_equal(total[y > 10.1], stress[y > 10.1])
