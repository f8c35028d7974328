"""Laws with directions: constants in closed form, stretches of arteries, columns along an axis."""

import numpy as np
import pytest
from mpi4py import MPI

from porofsi_petsc import Simulation, load_scene
from porofsi_petsc.config import scene_to_toml
from porofsi_petsc.errors import InputError
from porofsi_petsc.exact import Terzaghi
from porofsi_petsc.kernels.solid import volumetric_compliance
from porofsi_petsc.materials import ELASTIC
from porofsi_petsc.materials.contract import check_elastic
from porofsi_petsc.registry import examples

E, NU, E_A, NU_A, G_A = 2.0, 0.3, 5.0, 0.2, 1.4
LAME = E * NU / ((1 + NU) * (1 - 2 * NU)), E / (2 * (1 + NU))


def layered(axis, **changes):
    given = {"young_along": E_A, "poisson_along": NU_A, "shear_along": G_A} | changes
    return ELASTIC["transversely_isotropic"](*LAME, **given, axis=axis)


def turn_to(axis):
    """Return a rotation whose third column is the axis."""
    a = np.array(axis) / np.linalg.norm(axis)
    Q = np.linalg.qr(np.column_stack([a, np.eye(3)[:, :2] + 0.1]))[0]
    Q = Q[:, [1, 2, 0]]
    return Q * np.sign(Q[:, 2] @ a)


@pytest.mark.parametrize("axis", [(0.0, 0.0, 1.0), (0.0, 2.0, 0.0), (1.0, -2.0, 0.5)])
def test_the_strains_of_a_layered_cube_are_those_of_its_five_constants(axis):
    """ε = S σ in the axes of the material (Lekhnitskii 1963), for the six stresses."""
    S = np.diag([1 / E, 1 / E, 1 / E_A])
    S[0, 1] = S[1, 0] = -NU / E
    S[2, :2] = S[:2, 2] = -NU_A / E_A
    Q = turn_to(axis)
    for i, j, compliance in ((0, 1, (1 + NU) / E), (0, 2, 1 / (2 * G_A)), (1, 2, 1 / (2 * G_A))):
        strain = compliance * (np.eye(3)[i, :, None] * np.eye(3)[j])
        strain = strain + strain.T
        stress = layered(axis).stress((Q @ strain @ Q.T)[None])[0]
        expected = np.zeros((3, 3))
        expected[i, j] = expected[j, i] = 1.0
        np.testing.assert_allclose(Q.T @ stress @ Q, expected, rtol=0, atol=1e-14)
    for i in range(3):
        stress = layered(axis).stress((Q @ np.diag(S[i]) @ Q.T)[None])[0]
        np.testing.assert_allclose(Q.T @ stress @ Q, np.diag(np.eye(3)[i]), rtol=0, atol=1e-14)


def test_with_the_constants_of_the_plane_it_is_linear_elasticity():
    H = np.random.default_rng(3).standard_normal((4, 3, 3))
    law = layered((1.0, 2.0, 3.0), young_along=E, poisson_along=NU, shear_along=LAME[1])
    expected = ELASTIC["linear_elastic"](*LAME).stress(H)
    np.testing.assert_allclose(law.stress(H), expected, rtol=0, atol=1e-13)
    assert law.oedometer_modulus == pytest.approx(law.softest_modulus)


def test_the_answer_of_a_free_layered_body_bounds_the_split():
    """The compliance of `volumetric_compliance` is the mean of 1/E_c, E_c the mean modulus of the
    three directions, and of I:S:I = 2 (1 - ν)/E + (1 - 4 ν_a)/E_a.
    """
    law = layered((0.0, 0.0, 1.0))
    C = law.stiffness(3)
    free = 2 * (1 - NU) / E + (1 - 4 * NU_A) / E_A
    found = volumetric_compliance(law, np.zeros((1, 1, 3, 3)))[0, 0]
    assert found == pytest.approx((3 / np.einsum("iiii", C) + free) / 2)


def artery(kappa, **axes):
    """Media of a carotid artery of a rabbit (Holzapfel, Gasser & Ogden 2000): c = 3 kPa, k1 =
    2.3632 kPa, k2 = 0.8393, fibres at 29° to the circumference.
    """
    return ELASTIC["holzapfel_gasser_ogden"](
        50e3, 3e3, fibre_stiffness=2363.2, fibre_stiffening=0.8393, dispersion=kappa, **axes
    )


C, S = np.cos(np.radians(29)), np.sin(np.radians(29))


@pytest.mark.parametrize("kappa", [0.0, 0.226, 1 / 3])
@pytest.mark.parametrize("stretches", [(1.3, 0.9, 0.9), (1.2, 1.3, 0.7), (0.9, 0.95, 1.1)])
def test_the_stretched_artery_has_the_stress_in_closed_form(stretches, kappa):
    """Two families at ±29° in the plane of the first two stretches: I4 = λ1² c² + λ2² s², and P_a =
    μ (λ_a - 1/λ_a) + λ ln J/λ_a + 4 k1 <E> exp(k2 <E>²) λ_a m_a, m_a = κ + (1 - 3κ) (c², s², 0)_a.
    """
    law = artery(kappa, axis=(C, S, 0.0), second_axis=(C, -S, 0.0))
    stretches = np.array(stretches)
    m = kappa + (1 - 3 * kappa) * np.array([C**2, S**2, 0.0])
    fourth = stretches[0] ** 2 * C**2 + stretches[1] ** 2 * S**2
    strain = max(kappa * (stretches @ stretches - 3) + (1 - 3 * kappa) * (fourth - 1), 0.0)
    expected = 3e3 * (stretches - 1 / stretches) + 50e3 * np.log(stretches.prod()) / stretches
    expected += 4 * 2363.2 * strain * np.exp(0.8393 * strain**2) * stretches * m
    found = law.stress((np.diag(stretches) - np.eye(3))[None])[0]
    np.testing.assert_allclose(found, np.diag(expected), rtol=0, atol=1e-8)  # round-off of 1e5


def test_fibres_in_compression_leave_the_matrix_alone():
    H = np.diag([-0.1, 0.05, 0.0])[None]
    law = artery(0.0, axis=(1.0, 0.0, 0.0))
    matrix = ELASTIC["neo_hookean"](50e3, 3e3)
    assert np.array_equal(law.stress(H), matrix.stress(H))
    assert np.array_equal(law.tangent(H), matrix.tangent(H))


COARSE = ("expect=[]", "mesh.y.cells=[8]", "time.step=0.02", "time.growth=1.4")


@pytest.mark.parametrize("young", [3e6, 3e8])
@pytest.mark.parametrize("axis", [(0.0, 1.0, 0.0), (1.0, 0.0, 0.0)])
def test_a_column_along_or_across_the_axis_settles_by_its_own_modulus(young, axis):
    """In some ten sweeps of the default scheme, though the other direction is ten times as
    stiff or as soft.
    """
    solid = (f"material.0.solid.young_along={young}", f"material.0.solid.axis={list(axis)}")
    scene = load_scene("layered_column", (*COARSE, *solid))
    modulus = scene.material[0].elastic_law().stiffness(3)[1, 1, 1, 1]
    end = 0.3 * 10.0**2 / (modulus * 1e-7)  # [s], where T = 0.3
    changes = f"time.end={end}", f"time.step={1e-3 * end}"
    with Simulation(
        load_scene("layered_column", (*COARSE, *solid, *changes)), MPI.COMM_SELF
    ) as simulation:
        simulation.run()
        found = simulation.history["top.u_y"][-1]
        sweeps = simulation.history["coupling_iterations"][1:]
    exact = Terzaghi(1e4, 10.0, modulus, modulus * 1e-7).settlement(np.zeros(1), end)[0]
    assert found == pytest.approx(-exact, rel=5e-3)  # of large steps on eight elements
    assert np.mean(sweeps) < 12


@pytest.mark.parametrize(
    "scene, change, message",
    [
        ("layered_column", "axis=[0.0, 1.0]", r"axis: received \[0.0, 1.0\], expected three"),
        ("layered_column", "axis=[0.0, 0.0, 0.0]", "axis: received .* not all 0"),
        ("layered_column", "axis=[0.0, 1.0, 1.0]", "out of the plane without its mirror image"),
        ("layered_column", "poisson_along=0.9", "poisson_along: received 0.9, with which 1 - ν"),
        ("artery_biaxial", "second_axis=[1.0]", "second_axis: received .*1.0.*, expected three"),
        ("artery_biaxial", "dispersion=0.4", "dispersion.*expected a number <= 0.33"),
    ],
)
def test_constants_that_are_no_material_are_refused(scene, change, message):
    with pytest.raises(InputError, match=message):
        load_scene(scene, (f"material.0.solid.{change}",))


@pytest.mark.parametrize(
    "changes, message",
    [
        (("material.0.biot_coefficient=0.9",), "biot_coefficient.*isotropic"),
        (
            ("reference={solution='terzaghi', load=1e4, length=10.0}",),
            "reference.solution.*isotropic",
        ),
        (("boundary.1={on='bottom', absorbing={}}",), "beside an absorbing boundary"),
    ],
)
def test_what_knows_isotropic_materials_alone_is_refused(changes, message):
    with pytest.raises(InputError, match=message):
        load_scene("layered_column", changes)


def test_the_scene_that_a_run_writes_has_one_family_of_fibres(tmp_path):
    scene = load_scene("artery_biaxial", ("material.0.solid.second_axis=[]",))
    (tmp_path / "scene.toml").write_text(scene_to_toml(scene))
    assert load_scene(tmp_path / "scene.toml") == scene
    assert len(scene.material[0].elastic_law().axes) == 1


def test_fibres_around_a_tube_are_the_third_direction_of_an_axisymmetric_scene():
    """Along θ they answer to the stretch u_r/r, in the third row of F."""
    law = artery(0.0, axis=(0.0, 0.0, 1.0))
    P = law.stress(np.diag([0.0, 0.0, 0.2])[None])[0]
    matrix = ELASTIC["neo_hookean"](50e3, 3e3).stress(np.diag([0.0, 0.0, 0.2])[None])[0]
    strain = 1.2**2 - 1
    fibres = 4 * 2363.2 * strain * np.exp(0.8393 * strain**2) * 1.2 / 2
    np.testing.assert_allclose(P - matrix, np.diag([0, 0, fibres]), rtol=0, atol=1e-9)


@pytest.mark.parametrize("law", ["transversely_isotropic", "holzapfel_gasser_ogden"])
def test_the_plane_is_a_section_of_space(law):
    body = ELASTIC[law](*LAME, **examples(ELASTIC[law]))
    plane = 0.1 * np.random.default_rng(4).standard_normal((5, 2, 2))
    space = np.zeros((5, 3, 3))
    space[:, :2, :2] = plane
    for quantity, cut in (
        ("energy", ()),
        ("stress", (slice(2),) * 2),
        ("tangent", (slice(2),) * 4),
    ):
        found, whole = getattr(body, quantity)(plane), getattr(body, quantity)(space)
        np.testing.assert_allclose(found, whole[(..., *cut)], rtol=0, atol=1e-13)


@pytest.mark.parametrize("bound, factor", [("oedometer_modulus", 0.9), ("softest_modulus", 1.1)])
def test_a_law_whose_moduli_are_not_within_its_bounds_is_refused(bound, factor):
    known = ELASTIC["transversely_isotropic"]
    wrong = property(lambda self: factor * getattr(known, bound).fget(self))
    with pytest.raises(ValueError, match=f"the {bound}"):
        check_elastic(type("Broken", (known,), {bound: wrong}))
