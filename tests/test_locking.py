"""Locking of nearly incompressible solids: Cook's membrane, and what linear elements are
refused.
"""

import pytest
from running import SCENES, Job, run_here

from porofsi_petsc import load_scene
from porofsi_petsc.errors import InputError
from porofsi_petsc.output.history import read_history
from porofsi_petsc.simulation.build import serial_mesh
from porofsi_petsc.simulation.locking import poisson
from porofsi_petsc.studies.trial import attempt

FLAP = str(SCENES / "flap.toml")
NEARLY = "material.1.solid.poisson=0.4999"


def test_cooks_membrane_does_not_lock(tmp_path):
    """Its [[expect]] against F-bar elements of another program; 1.5 % is what is left of 16 by 16
    cells and of their 30 by 30.
    """
    run_here(Job("cook_membrane", str(tmp_path)))
    (expected,) = load_scene("cook_membrane").expect
    found = read_history(tmp_path / "history.csv")["corner.u_y"][-1]
    print(f"u_y of the corner {found:.4e} m, {expected.value:.4e} m")
    assert found == pytest.approx(expected.value, rel=expected.tolerance)


@pytest.mark.parametrize("steps", [4, 1])
def test_newtons_iteration_does_not_feel_the_bulk_modulus(steps):
    """The whole load at once too; with the stress of the law in the geometric stiffness 12
    iterations, or none that converge.
    """
    outcome = attempt(load_scene("cook_membrane", [f"time.step={1 / steps}"]))
    print(f"{steps} steps of the load: iterations {outcome.iterations}")
    assert not outcome.failure
    assert max(outcome.iterations) <= 6


def test_linear_elements_of_a_nearly_incompressible_solid_are_refused():
    sentence = (
        r"\[material\.1\.solid\]: received a Poisson ratio of 0\.4999 on linear elements, expected"
        r" 0\.49 at most.*order = 2"
    )
    with pytest.raises(InputError, match=sentence):
        serial_mesh(load_scene(FLAP, [NEARLY]))


def test_a_ratio_just_above_the_bound_is_told_from_it():
    with pytest.raises(
        InputError, match=r"a Poisson ratio of 0\.4900001\d* on .* expected 0\.49 at most"
    ):
        serial_mesh(load_scene(FLAP, ["material.1.solid.poisson=0.4900001"]))


@pytest.mark.parametrize("ratio", ["0.49", "0.45", "0.3", "0.4999"])
def test_a_ratio_at_the_bound_is_not_above_it_by_round_off(ratio):
    serial_mesh(load_scene(FLAP, [f"material.1.solid.poisson={ratio}", f"limits.locking={ratio}"]))


@pytest.mark.parametrize(
    "change",
    [
        "mesh.order=2",
        "limits.locking=report",
        "limits.locking=0.49999",
        "material.1.solid.poisson=0.48",
    ],
)
def test_others_are_not(change):
    serial_mesh(load_scene(FLAP, [NEARLY, change]))


def test_a_ratio_of_lame_parameters_is_seen():
    law = "material.1.solid={law='linear_elastic', lambda=1e8, mu=1e5, density=1000}"
    scene = load_scene(FLAP, [law])
    assert poisson(scene.material[1].solid) == pytest.approx(0.4995005, rel=1e-7)  # λ/μ = 1000
    with pytest.raises(InputError, match="received a Poisson ratio of 0.4995"):
        serial_mesh(scene)
