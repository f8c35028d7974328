"""Compressible pore fluid and grains: exact solutions, order in time, balances, restart, ranks."""

import numpy as np
import pytest
from kernel_states import SHAPES, distorted
from running import Job, history, needs_mpirun, run_here, run_on, summary

from porofsi_petsc import Simulation, load_scene
from porofsi_petsc.errors import InputError
from porofsi_petsc.exact import CompressibleColumn, Cryer, DynamicColumn, Mandel, Terzaghi
from porofsi_petsc.fem.geometry import Rule, geometry
from porofsi_petsc.kernels import storage

FLUID = "material.0.fluid.bulk_modulus=2e7"
BIOT = ("material.0.biot_coefficient=0.8", "material.0.fluid.bulk_modulus=4e7")
BARE = ("expect=[]", "reference.times=[]")


@pytest.mark.parametrize("name", SHAPES)
def test_what_grains_bear_and_take_is_adjoint(name):
    """∫ p div w is one matrix for the force of the pressure and for the volume of the grains."""
    rng = np.random.default_rng(1)
    element = SHAPES[name]
    X = distorted(element, rng)
    rule = Rule.of(element, 2 * element.order + element.axisymmetric)
    geo = geometry(rule, X)
    p, v = rng.standard_normal(X.shape[:2]), rng.standard_normal(X.shape)
    force = storage.grain_force(rule.N, geo, 0.7, p)
    volume = storage.grain_volume(rule.N, geo, 0.7, v)
    assert (force * v).sum() == pytest.approx(-(volume * p).sum(), rel=1e-12)
    tangent = storage.grain_tangent(rule.N, geo, 0.7)
    np.testing.assert_allclose(np.einsum("eaib,eb->eai", tangent, p), force, rtol=1e-10)
    constant = storage.grain_force(rule.N, geo, 0.7, np.ones(X.shape[:2]))
    linear = storage.grain_volume(rule.N, geo, 0.7, X)  # div X = d, of rings 3 less what z has
    divergence = element.dim + element.axisymmetric
    assert linear.sum() == pytest.approx(-0.3 * divergence * geo.dV.sum(), rel=1e-12)
    assert constant.shape == X.shape


BOUNDS = {"terzaghi": (5e-4, 1e-3), "mandel": (5e-4, 2e-3)}  # those of the scenes


@pytest.mark.parametrize("constituents", [(FLUID,), BIOT], ids=["fluid", "grains"])
@pytest.mark.parametrize(
    ("scene", "scheme"),
    [("terzaghi", "partitioned"), ("terzaghi", "direct"), ("mandel", "partitioned")],
)
def test_consolidation_with_storage(tmp_path, scene, scheme, constituents):
    """Cheng & Detournay (1988), Biot (1941): within the bounds of incompressible constituents."""
    changes = (*constituents, f"coupling.scheme={scheme}", "time.end=1.1", "reference.times=[0.1]")
    run_here(Job(scene, str(tmp_path), changes))
    found = summary(tmp_path)
    assert all(e["u"] < BOUNDS[scene][0] and e["p"] < BOUNDS[scene][1] for e in found["errors"])
    assert found["energy"]["balance_error_relative"] < 1e-6
    assert found["coupling_iterations"]["max"] <= 9


def test_cryer_with_storage(tmp_path):
    """Verruijt (2016): the sphere on the section of the shipped scene, within its bounds."""
    run_here(Job("cryer_axisymmetric", str(tmp_path), (*BIOT, "time.end=0.6")))
    last = summary(tmp_path)["errors"][-1]
    assert last["u"] < 2e-3 and last["p"] < 4e-3


def test_the_exact_solutions_start_undrained():
    """p(0+) is Skempton's, and a storage that is nothing changes nothing."""
    sphere = Cryer(1.0, 1.0, 4.0, 6.0, 1.0, biot=0.8, storage=0.05)
    assert sphere.pressure(np.array([0.3]), 1e-5)[0] == pytest.approx(
        sphere.initial_pressure, rel=2e-2
    )
    slab = Mandel(1.0, 1.0, 4.0, 6.0, 1.0, biot=0.8, storage=0.05)
    assert slab.pressure(np.array([0.3]), 1e-5)[0] == pytest.approx(slab.initial_pressure, rel=1e-2)
    layer = Terzaghi(1.0, 1.0, 16.0, 1.0, biot=0.8, storage=0.05)
    # α/(α² + S E_c): at once the layer is compressed as its undrained modulus E_c + α²/S says
    assert layer.settlement(0.0, 1e-7) == pytest.approx(1 / (16 + 0.8**2 / 0.05), rel=1e-3)


def test_the_dynamic_column_tends_to_that_of_incompressible_constituents():
    """de Boer, Ehlers & Liu (1993) as K_f grows."""
    z = np.array([0.0, 0.5, 5.0])
    exact = DynamicColumn(10.0, 8e6, 6e6, 0.7, 2000.0, 1000.0, 1e-2, 1e4)
    u, _ = exact.harmonic(3000.0, 60.0, z, 0.03)
    errors = []
    for S in (1e-11, 1e-12):
        column = CompressibleColumn(10.0, 20e6, 1400.0, 300.0, 0.3, 9e4, 1.0, S)
        errors.append(np.abs(column.harmonic(3000.0, 60.0, z, 0.03)[0] - u).max() / u.max())
    assert errors[1] < 1e-3 and errors[1] < errors[0] / 3, errors


def test_the_dynamic_column_of_a_compressible_fluid(tmp_path):
    run_here(Job("column_compressible", str(tmp_path), ("time.end=0.02",)))
    last = summary(tmp_path)["errors"][-1]
    assert last["u"] < 3e-3 and last["p"] < 1e-3  # the bounds of the scene


def test_order_in_time():
    """The pressure of a column under a load that grows as sin²: 2, against 1/16 of the step."""
    load = "boundary.2.traction.y='-1e4*sin(t)**2'"
    changes = [FLUID, load, "time.growth=1.0", "time.end=0.8", *BARE]

    def pressure(step):
        scene = load_scene("terzaghi", [*changes, f"time.step={step}", "mesh.y.cells=[6]"])
        with Simulation.from_scene(scene) as simulation:
            simulation.run()
            return simulation.fields.gathered("pressure")

    fine = pressure(0.0125)
    errors = [np.linalg.norm(pressure(step) - fine) for step in (0.2, 0.1)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.25)


def test_a_sealed_body_keeps_its_fluid():
    """Loaded without drainage a column has p = α q/(α² + S E_c), everywhere and at all times."""
    sealed = "boundary.2={on='top', traction={y=-1e4}}"
    scene = load_scene("terzaghi", [*BIOT, sealed, "time.end=0.5", *BARE])
    with Simulation.from_scene(scene) as simulation:
        simulation.run()
        p = simulation.fields.gathered("pressure")
    bulk = 8.375e6 + 2 / 3 * 5.583e6
    S = 0.33 / 4e7 + (0.8 - 0.33) * 0.2 / bulk
    E_c = 8.375e6 + 2 * 5.583e6
    np.testing.assert_allclose(p, 0.8e4 / (0.64 + S * E_c), rtol=1e-5)


def test_a_restart_is_the_whole_run(tmp_path):
    changes = (*BIOT, *BARE, "time.growth=1.0", "output.checkpoint_every=1", "mesh.y.cells=[6]")
    run_here(Job("terzaghi", str(tmp_path / "whole"), (*changes, "time.end=0.02")))
    run_here(Job("terzaghi", str(tmp_path / "half"), (*changes, "time.end=0.01")))
    point = str(tmp_path / "half/checkpoint.h5")
    again = Job("terzaghi", str(tmp_path / "again"), (*changes, "time.end=0.02"), restart=point)
    run_here(again)
    whole, continued = (history(tmp_path / name) for name in ("whole", "again"))
    assert len(continued["t"]) > 1
    assert whole["base.p"][-1] > 0
    for name in ("base.p", "top.u_y"):
        assert continued[name][-1] == whole[name][-1]


@needs_mpirun
def test_two_ranks_solve_like_one(tmp_path):
    changes = (*BIOT, "reference.times=[]", "time.end=0.01")
    jobs = [Job("mandel", str(tmp_path / str(n)), changes) for n in (1, 2)]
    run_here(jobs[0])
    run_on(2, [jobs[1]], tmp_path)
    one, two = (history(tmp_path / str(n)) for n in (1, 2))
    np.testing.assert_allclose(two["centre.p"], one["centre.p"], rtol=1e-5)


@pytest.mark.parametrize(
    ("scene", "changes", "sentence"),
    [
        ("terzaghi", ("material.0.biot_coefficient=0.3",), "more than the porosity 0.33"),
        ("terzaghi", ("material.0.biot_coefficient=1.5",), "biot_coefficient"),
        ("strip_footing", (FLUID,), "with compressible constituents, expected"),
        ("cavity", (FLUID,), "which is incompressible"),
        ("porous_flag", (FLUID.replace("0", "1", 1),), "incompressible|beside a free fluid"),
    ],
)
def test_what_is_refused(scene, changes, sentence):
    with pytest.raises(InputError, match=sentence):
        load_scene(scene, changes)
