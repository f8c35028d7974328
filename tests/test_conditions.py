"""Conditions on surfaces: what each of them promises, and one that a script brings along."""

from dataclasses import dataclass

import numpy as np
import pytest
from running import SCENES, Job, run_here

from porofsi_petsc import Simulation, load_scene
from porofsi_petsc.conditions import CONDITIONS, SurfaceCondition
from porofsi_petsc.conditions.contract import (
    check_condition,
    exchanges,
    sample,
    sample_state,
    slopes,
)
from porofsi_petsc.config.conditions import boundary_table
from porofsi_petsc.errors import InputError
from porofsi_petsc.registry import parameter

FLAP = str(SCENES / "flap.toml")
BAR = str(SCENES / "bar.toml")
PLACES = [(name, kind) for name, of in CONDITIONS.items() for kind in of.behind]


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize(("name", "kind"), PLACES)
def test_the_tangent_is_the_slope_of_the_residual(name, kind, dim):
    tangent, expected = slopes(CONDITIONS[name], dim, kind)
    error = np.abs(tangent - expected).max()
    assert error < 1e-8 * max(1.0, np.abs(expected).max())  # of central differences with 1e-6


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("condition", [CONDITIONS["absorbing"], *CONDITIONS["absorbing"].beside])
def test_what_it_takes_of_the_other_phase_has_its_slope(condition, dim):
    given, expected = exchanges(condition, dim)
    assert np.abs(given).max() > 0
    assert np.abs(given - expected).max() < 1e-8 * max(1.0, np.abs(expected).max())


@pytest.mark.parametrize("name", CONDITIONS)
def test_the_package_keeps_its_own_contract(name):
    check_condition(CONDITIONS[name])


@pytest.mark.parametrize(("name", "kind"), PLACES)
def test_what_a_restart_needs_is_in_the_memory(name, kind):
    """After a step, a condition that is loaded goes on as the one whose memory it has."""
    first, second = (sample(CONDITIONS[name], 2, kind) for _ in range(2))
    first.accept(sample_state(2))
    second.load(first.memory())
    scheme = first_scheme(kind)
    for condition in (first, second):
        condition.begin_step(scheme, sample_state(2)._replace(t=0.1))
    state = sample_state(2)._replace(t=0.17)
    assert first.recorded() == second.recorded()
    assert np.array_equal(first.residual(state), second.residual(state))


def first_scheme(kind):
    """Return the scheme of a step of a phase."""
    from porofsi_petsc.clock import first_order, second_order

    return (first_order if kind == "fluid" else second_order)(0.5, 0.1)


def test_every_condition_is_a_key():
    assert set(CONDITIONS) <= set(boundary_table().model_fields)


# -- one that a script brings along ----------------------------------------------------------------


@dataclass
class Bedding(SurfaceCondition):
    """Winkler's foundation: the traction -k u."""

    behind = ("porous", "solid")
    holds = ("normal", "tangential")
    stiffness: float = parameter("Pa/m", "k", above=0.0, example=3.0)

    def bind(self, surface):
        super().bind(surface)
        self._rule = surface.rule(2 * surface.order)
        self._dA = np.linalg.norm(surface.normal(self._rule), axis=-1)

    def residual(self, state):
        u = self._rule.N @ self.surface.gather(state.u)
        return self.stiffness * self._rule.N.T @ (u * self._dA[..., None])

    def tangent(self, state, slope):
        N = self._rule.N
        mass = np.einsum("qa,fq,qb->fab", N, self._dA, N)
        identity = np.eye(self.surface.X.shape[-1])
        return slope.u * self.stiffness * np.einsum("fab,ij->faibj", mass, identity)


@pytest.fixture
def bedding():
    """Register the spring for one test."""
    CONDITIONS.register("bedding")(Bedding)
    yield
    CONDITIONS.forget("bedding")


def test_a_registered_condition_is_valid_in_scenes(bedding, tmp_path):
    """A bar between a load p and a foundation of springs: u at its foot is p/k to round-off."""
    foot = "boundary=[{on='bottom', bedding={stiffness=2e6}, displacement={x='0'}},"
    sides = "{on=['left', 'right'], displacement={x='0'}}, {on='top', traction={y='-1e4'}}]"
    probe = "probe=[{name='foot', at=[0.0, 0.0], quantities=['u_y']}]"
    static = ("model.solid_inertia=false", "expect=[]", probe, "time.scheme=steady")
    with Simulation.from_scene(BAR, overrides=(foot + sides, *static)) as simulation:
        simulation.run()
        found = simulation.history["foot.u_y"][-1]
    assert found == pytest.approx(-1e4 / 2e6, rel=1e-6)  # the tolerance of the iteration


def test_its_keys_are_those_of_a_scene(bedding):
    for given, message in (
        ("{stifness=1}", "unknown key 'stifness'; did you mean 'stiffness'"),
        ("{stiffness=-1}", "received -1"),
        ("{}", "stiffness"),
    ):
        with pytest.raises(InputError, match=message):
            load_scene(BAR, (f"boundary.0.bedding={given}",))


def test_a_condition_stands_only_where_its_material_is(bedding):
    with pytest.raises(InputError, match=r"boundary.2.bedding\]: tag 'right' is on the fluid, exp"):
        run_here(Job(FLAP, "unused", ("boundary.2.bedding={stiffness=1.0}",)))


def test_what_breaks_the_contract_is_refused():
    class Soft(Bedding):
        def tangent(self, state, slope):
            return 0.5 * super().tangent(state, slope)

    class Nowhere(Bedding):
        behind = ()

    class Empty(SurfaceCondition):
        behind = ("solid",)

    class Forgetful(Bedding):
        def bind(self, surface):
            super().bind(surface)
            self._pulled = 0.0

        def residual(self, state):
            return super().residual(state) + self._pulled

        def accept(self, state):
            self._pulled = self.surface.sum(self.surface.gather(state.u).sum(axis=(1, 2)))

    class Here(Bedding):
        def residual(self, state):
            facets = len(self.surface.nodes)
            return super().residual(state).reshape(facets, self.surface.nodes.shape[1], -1)

    refused = (
        (Here, "a rank that has no facet of the surface"),
        (Soft, "not the slope"),
        (Nowhere, "received behind = "),
        (Empty, "has no `residual`"),
        (Forgetful, "do not hold all that a restart needs"),
    )
    for broken, message in refused:
        with pytest.raises(ValueError, match=message):
            check_condition(dataclass(broken))


def test_a_class_without_its_decorator_is_told_so():
    class Bare(SurfaceCondition):
        behind = ("solid",)
        stiffness: float = parameter("Pa/m", "k", above=0.0, example=3.0)

    with pytest.raises(ValueError, match="decorate the class with @dataclass"):
        check_condition(Bare)
    with pytest.raises(ValueError, match="boundary condition 'pressure': expected another name"):
        CONDITIONS.register("pressure")(Bedding)
