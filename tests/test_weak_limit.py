"""Staggered coupling of one mass that carries a fluid: up to which added mass it is stable."""

import numpy as np
import pytest

from porofsi_petsc.clock import first_order, second_order


def amplification(added, rho_inf):
    """Return the matrix of one step of u, v, a of a unit mass and v_f, a_f of the fluid on it (dt =
    1).

    The fluid takes the velocity v_p that the predicted displacement has; the mass feels -added
    times its acceleration.
    """
    solid = second_order(rho_inf, 1.0)
    fluid = first_order(rho_inf, 1.0)

    def step(state):
        u, v, a, v_f, a_f = state
        predicted, _ = solid.rates(solid.predict(u, v, a), u, v, a)
        rate, _ = fluid.rates(predicted, v_f, a_f, a_f)
        force = -added * (a_f + fluid.alpha_m * (rate - a_f))
        a_new = a + (force - a) / solid.alpha_m
        u_new = u + v + (0.5 - solid.beta) * a + solid.beta * a_new
        return u_new, v + (1 - solid.gamma) * a + solid.gamma * a_new, a_new, predicted, rate

    return np.array([step(unit) for unit in np.eye(5)]).T


def growth(added, rho_inf):
    return np.abs(np.linalg.eigvals(amplification(added, rho_inf))).max()


# Bisected to the digits given; a double root 1 of the free motion is found to the square root of
# round-off.
@pytest.mark.parametrize("rho_inf, limit", [(0.0, 0.36), (0.5, 0.18)])
def test_the_added_mass_must_be_a_small_part(rho_inf, limit):
    below = growth(limit, rho_inf)
    above = growth(limit + 0.02, rho_inf)
    print(
        f"rho_inf = {rho_inf}: growth per step {below:.6f} at {limit}, {above:.4f} at"
        f" {limit + 0.02:.2f} of the own mass"
    )
    assert below < 1 + 1e-6 and above > 1 + 1e-3


def test_nothing_is_stable_without_dissipation():
    assert growth(0.01, 1.0) > 1 + 1e-3
