"""Exact flows satisfy the Navier-Stokes equations, by differences in place and time."""

import numpy as np
import pytest

from porofsi_petsc.exact import (
    EthierSteinman,
    Kovasznay,
    TaylorGreen,
    WomersleyChannel,
    WomersleyPipe,
)

RHO = 2.0
MU = 0.3
U = 1.5
L = 0.7
FLOWS = {
    2: (
        Kovasznay(RHO, MU, U, L),
        TaylorGreen(RHO, MU, U, L),
        WomersleyChannel(RHO, MU, U, L, 3.0),
    ),
    3: (EthierSteinman(RHO, MU, U, L), WomersleyPipe(RHO, MU, U, L, 3.0)),
}
# of central differences, whose error is 1e-6 of the derivatives times their scale
STEP = 1e-3
TIME = 0.2


def differences(field, X):
    """Return the field, its gradient [..., j] and its Laplacian at points X (n, d)."""
    here = field(X)
    gradient = []
    laplacian = 0.0
    for axis in np.eye(X.shape[1]):
        ahead = field(X + STEP * axis)
        behind = field(X - STEP * axis)
        gradient.append((ahead - behind) / (2 * STEP))
        laplacian = laplacian + (ahead - 2 * here + behind) / STEP**2
    return here, np.stack(gradient, axis=-1), laplacian


@pytest.mark.parametrize(
    "flow",
    [flow for flows in FLOWS.values() for flow in flows],
    ids=lambda flow: type(flow).__name__,
)
def test_a_flow_satisfies_the_equations(flow):
    dim = next(d for d, flows in FLOWS.items() if flow in flows)
    X = np.random.default_rng(1).uniform(-0.5, 0.5, (20, dim))
    v, gradient, laplacian = differences(lambda X: flow.velocity(TIME, X), X)
    _, slope, _ = differences(lambda X: flow.pressure(TIME, X), X)
    rate = (flow.velocity(TIME + STEP, X) - flow.velocity(TIME - STEP, X)) / (2 * STEP)
    convection = np.einsum("nij,nj->ni", gradient, v)
    forces = RHO * rate, RHO * convection, slope, -MU * laplacian
    size = max(np.abs(force).max() for force in forces)
    assert np.abs(sum(forces)).max() < 1e-4 * size
    assert np.abs(np.einsum("nii->n", gradient)).max() < 1e-4 * np.abs(gradient).max()


def test_flows_have_the_published_numbers():
    # Kovasznay's κ at Re = 40, of countless papers: -0.9637405442; p = ρU²/2 (1 - exp(2κx/L))
    pressure = Kovasznay(1.0, 1 / 40, 1.0, 1.0).pressure(0.0, np.array([[1.0, 0.0]]))[0]
    assert np.log1p(-2 * pressure) / 2 == pytest.approx(-0.9637405442, rel=1e-9)
    # Ethier and Steinman's flow with a = π/4, d = π/2 in the middle of the cube: v = -a (1, 1, 1),
    # p = -3 a²/2
    a = np.pi / 4
    flow = EthierSteinman(1.0, 1.0, a, 1.0)
    np.testing.assert_allclose(flow.velocity(0.0, np.zeros((1, 3))), -a * np.ones((1, 3)))
    assert flow.pressure(0.0, np.zeros((1, 3)))[0] == pytest.approx(-1.5 * a**2)
