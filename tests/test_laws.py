"""Laws of users: registered, checked in scenes, differentiated from their energy."""

import time
from dataclasses import dataclass
from importlib.metadata import EntryPoint

import numpy as np
import pytest
from mpi4py import MPI

from porofsi_petsc import Simulation, load_scene, registry
from porofsi_petsc.config import scene_to_toml
from porofsi_petsc.errors import InputError
from porofsi_petsc.materials import (
    ELASTIC,
    PERMEABILITY,
    ElasticLaw,
    FromEnergy,
    PermeabilityLaw,
    parameter,
)
from porofsi_petsc.materials.contract import check_elastic
from porofsi_petsc.materials.from_energy import invariants
from porofsi_petsc.registry import Registry

pytestmark = pytest.mark.usefixtures("petsc")


@dataclass(frozen=True)
class NeoHookeanByEnergy(FromEnergy):
    """The energy of `neo_hookean`, whose stress and tangent are written by hand there, and a factor
    of it.
    """

    factor: float = parameter(
        "-", "of the energy", above=0.0, at_most=10.0, default=1.0, example=1.0
    )

    def energy(self, H):
        I1_3, _, J_1 = invariants(H)
        log = np.log(1 + J_1)
        return self.factor * (self.mu / 2 * I1_3 - self.mu * log + self.lam / 2 * log**2)


@dataclass(frozen=True)
class Linear(PermeabilityLaw):
    """k/k0 = J^2 by another name, with a number that it needs."""

    power: float = parameter("-", "of J", example=2.0)

    def factor(self, J, n_s0):
        return J**self.power


@pytest.fixture(autouse=True)
def own_laws():
    """Register the laws for a test."""
    ELASTIC.register("by_energy")(NeoHookeanByEnergy)
    PERMEABILITY.register("power")(Linear)
    yield
    ELASTIC.forget("by_energy")
    PERMEABILITY.forget("power")


@pytest.mark.parametrize("dim", [2, 3])
def test_an_energy_gives_the_stress_and_the_tangent_written_by_hand(dim):
    H = 0.2 * np.random.default_rng(5).standard_normal((50, 2, dim, dim))
    own = NeoHookeanByEnergy(1.7, 0.8)
    by_hand = ELASTIC["neo_hookean"](1.7, 0.8)
    np.testing.assert_allclose(
        own.stress(H), by_hand.stress(H), rtol=0, atol=1e-13
    )  # round-off of stresses of order one
    A = by_hand.tangent(H)
    np.testing.assert_allclose(
        own.tangent(H), A, rtol=0, atol=1e-9 * np.abs(A).max()
    )  # truncation and round-off of 1e-10
    start = time.perf_counter()
    own.tangent(H)
    print(f"{dim}-D: {(time.perf_counter() - start) / 100 * 1e6:.0f} us for the tangent of a point")


def test_invariants_keep_the_digits_of_a_small_strain():
    H = 1e-10 * np.random.default_rng(6).standard_normal((4, 3, 3))
    first, second, volume = invariants(H)
    trace = np.trace(H, axis1=1, axis2=2)
    for found, expected in ((first, 2 * trace), (second, 4 * trace), (volume, trace)):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-18)  # terms of the second order


def test_a_scene_takes_a_registered_law_with_its_parameters():
    run = ("expect=[]", "time.end=0.05")
    own = (
        "material.0.solid.law=by_energy",
        "material.0.permeability={law='power', k=1e-2, power=2.0}",
    )
    found = []
    for changes in (
        own,
        ("material.0.solid.law=neo_hookean", "material.0.permeability={law='xie_leo', k=1e-2}"),
    ):
        with Simulation.from_scene(
            "ehlers_eipper", MPI.COMM_SELF, overrides=(*run, *changes)
        ) as simulation:
            simulation.run()
            found.append(simulation.history["top.u_y"])
    assert found[1][-1] < -1e-3
    np.testing.assert_allclose(
        *found, rtol=0, atol=1e-6 * np.abs(found[1]).max()
    )  # the tolerance of the coupling


def test_the_scene_that_a_run_writes_has_the_parameters(tmp_path):
    scene = load_scene(
        "ehlers_eipper", ("material.0.solid.law=by_energy", "material.0.solid.factor=2.0")
    )
    assert scene.material[0].solid.of_law() == {"factor": 2.0}
    (tmp_path / "scene.toml").write_text(scene_to_toml(scene))
    assert load_scene(tmp_path / "scene.toml") == scene


@pytest.mark.parametrize(
    "change, message",
    [
        ("solid.factor=11", r"solid.factor\]: received 11, expected a number <= 10"),
        ("solid.factor=0", r"solid.factor\]: received 0, expected a number > 0"),
        ("solid.facto=1", "unknown key 'facto'; did you mean 'factor'?"),
        (
            "permeability={law='power', k=1e-2}",
            r"permeability.power\]: received nothing, expected this key",
        ),
    ],
)
def test_the_parameters_of_a_law_are_checked(change, message):
    with pytest.raises(InputError, match=message):
        load_scene("ehlers_eipper", ("material.0.solid.law=by_energy", f"material.0.{change}"))


def test_a_name_has_one_law():
    with pytest.raises(
        ValueError,
        match=(
            "elastic law 'neo_hookean': the name has NeoHookean of"
            " porofsi_petsc.materials.neo_hookean"
        ),
    ):
        ELASTIC.register("neo_hookean")(NeoHookeanByEnergy)
    assert (
        ELASTIC.register("by_energy")(NeoHookeanByEnergy) is NeoHookeanByEnergy
    )  # a script that is run again


def test_packages_bring_laws_by_entry_points(monkeypatch):
    entry = EntryPoint("of_a_package", f"{__name__}:NeoHookeanByEnergy", "porofsi_petsc.elastic")
    monkeypatch.setattr(
        registry, "entry_points", lambda group: [entry] if group == entry.group else []
    )
    found = Registry("elastic law", "porofsi_petsc.elastic", {})
    assert list(found) == ["of_a_package"] and found["of_a_package"] is NeoHookeanByEnergy


def broken(**members):
    """Return a law with other members than that of `NeoHookeanByEnergy`."""
    return type("Broken", (NeoHookeanByEnergy,), members)


def energy(density):
    return {"energy": lambda self, H: density(self, H)}


RIGHT = NeoHookeanByEnergy.energy


@pytest.mark.parametrize(
    "members, message",
    [
        (energy(lambda s, H: RIGHT(s, H) + 0.1 * s.mu * H[..., 0, 0]), "stress of .* at rest"),
        (energy(lambda s, H: 2 * RIGHT(s, H)), "the tangent at rest is not that of λ = 1.7"),
        (energy(lambda s, H: RIGHT(s, H) + H[..., 0, 1] ** 3), "does not turn with the body"),
        (energy(lambda s, H: RIGHT(s, np.abs(H))), "expected none|not the slope|at rest"),
        (energy(lambda s, H: H.sum()), "expected real numbers|could not broadcast|at rest"),
        ({"tangent": lambda s, H: 0 * H[..., None, None] + np.ones(H.shape[-2:])}, "at rest"),
    ],
    ids=["stressed", "stiffer", "turning", "abs", "shape", "tangent"],
)
def test_a_law_that_breaks_the_contract_is_refused(members, message):
    with pytest.raises(ValueError, match=f"elastic law 'broken': .*({message})"):
        ELASTIC.register("broken")(broken(**members))
    assert "broken" not in ELASTIC


def test_a_law_without_a_stress_is_refused_by_name():
    class Without(ElasticLaw):
        pass

    with pytest.raises(ValueError, match="elastic law 'without': Without has no stress"):
        ELASTIC.register("without")(Without)


@pytest.mark.parametrize("key", ["law", "density", "young", "copy", "model_fields"])
def test_a_parameter_has_a_name_of_its_own(key):
    made = dataclass(frozen=True)(
        type(
            "Named",
            (NeoHookeanByEnergy,),
            {"__annotations__": {key: float}, key: parameter("-", "x", example=1.0)},
        )
    )
    with pytest.raises(ValueError, match=f"the parameter '{key}' has the name of something else"):
        ELASTIC.register("named")(made)
    load_scene("ehlers_eipper")  # scenes are read as before


def test_a_permeability_is_one_at_rest():
    class Twice(Linear):
        def factor(self, J, n_s0):
            return 2 * J**self.power

    with pytest.raises(ValueError, match="permeability law 'twice': k/k0 = 2 at J = 1, expected 1"):
        PERMEABILITY.register("twice")(Twice)


@pytest.mark.parametrize("name", ELASTIC)
def test_the_laws_of_the_package_keep_the_contract(name):
    check_elastic(ELASTIC[name])
