"""When the sweeps of full Newton make new tangents (`phases.tangent.Travel`)."""

from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI

from porofsi_petsc.phases.coupling_data import Rates
from porofsi_petsc.phases.tangent import Travel

RATES = Rates(1.0, 1.0, 1.0)


def phases(linear=False):
    """Return a solid and a fluid with two nodes in the plane, u = v = 1 and p = 5."""
    solid = SimpleNamespace(unknowns=np.ones((2, 2)), mesh=SimpleNamespace(dim=2), is_linear=linear)
    return solid, SimpleNamespace(unknowns=np.array([[1.0, 1.0, 5.0]] * 2), is_linear=linear)


def travel(solid, fluid):
    """Return the rule in a step whose first tangents are made."""
    rule = Travel(solid, fluid, MPI.COMM_SELF)
    rule.begin_step()
    assert rule.are_stale(RATES, 1.0)
    return rule


@pytest.mark.parametrize("phase", [0, 1])
def test_a_move_of_three_per_cent_wants_new_ones(phase):
    """The move counts from the last tangents on: two steps of 2 % are one of 4 %."""
    pair = phases()
    rule = travel(*pair)
    pair[phase].unknowns[:, :2] *= 1.02
    assert not rule.are_stale(RATES, 0.1)
    pair[phase].unknowns[:, :2] *= 1.02
    assert rule.are_stale(RATES, 0.1) and not rule.are_stale(RATES, 0.1)


def test_the_pressure_does_not_count():
    """The tangent of the fluid hardly depends on it."""
    solid, fluid = phases()
    rule = travel(solid, fluid)
    fluid.unknowns[:, 2] *= 2
    assert not rule.are_stale(RATES, 0.1)


def test_slow_iterations_other_rates_and_steps_want_new_ones():
    """A slender beam moves little and stiffens much."""
    rule = travel(*phases())
    assert rule.are_stale(RATES, 0.6)
    assert rule.are_stale(Rates(2.0, 1.0, 1.0), 0.1)
    rule.begin_step()
    assert rule.are_stale(Rates(2.0, 1.0, 1.0), 0.1)


def test_a_linear_problem_wants_them_with_other_rates_alone():
    """Neither moves nor steps change its tangents."""
    solid, fluid = phases(linear=True)
    rule = travel(solid, fluid)
    solid.unknowns *= 2
    rule.begin_step()
    assert not rule.are_stale(RATES, 0.9)
    assert rule.are_stale(Rates(2.0, 1.0, 1.0), 0.1)
