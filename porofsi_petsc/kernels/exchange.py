"""Off-diagonal tangents between the phases on a fixed mesh: what each residual feels of the other
phase's unknowns.

Derivatives are by the increments on the collocation level; dv_s = c_v dy.  The change of the
geometry itself (direct coupling) is not part of them.  A free fluid feels no skeleton, only the
velocity of its mesh.
"""

import numpy as np

from .arguments import Drag, Geometry
from .assemble import add_drag, bilinear, broadcast_gradient, mass_matrix
from .flow import FlowElements, FlowFields, flow_points, strong_gradient


def flow_by_skeleton(el: FlowElements, f: FlowFields, c_v: float, moving_mesh: bool) -> np.ndarray:
    """Return the derivative of `flow.flow_residual` by the skeleton's positions through v_s (and
    v_m = v_s where the mesh moves).

    (E, A, d + 1, A, d): rows v_f and p, columns y [N/m and m²/s].
    """
    x = flow_points(el, f)
    dV = el.geometry.dV
    n = el.n
    E, _, A, d = el.geometry.G.shape
    G = broadcast_gradient(el.geometry.G, dV.shape[1])
    div = broadcast_gradient(el.geometry.divergence, dV.shape[1])
    N = np.broadcast_to(el.N, G.shape[:3])
    K = np.zeros((E, A, d + 1, A, d))
    drag = _drag(el)
    weight = (drag.scale * dV)[..., None]
    add_drag(K, -bilinear(weight * _tests(el, x, G), N), drag.resistance, d)
    flux = (n * dV)[..., None, None] * G
    flux -= ((el.tau * n)[..., None] * weight)[..., None] * drag.turned(G)
    for j in range(d):
        if el.convection:
            for i in range(d):
                K[:, :, i, :, j] += bilinear(
                    (n * (1 - n) * el.nu_lsic * dV)[..., None] * div[..., i], div[..., j]
                )
        K[:, :, d, :, j] = bilinear(dV[..., None] * N, div[..., j]) + bilinear(flux[..., j], N)
    if el.convection and moving_mesh:
        _add_mesh_velocity(K, el, x, G)
    return c_v * K


def flow_by_drag(el: FlowElements, f: FlowFields, c_v: float) -> np.ndarray:
    """Return the derivative of a free fluid's residuals by the positions of a skeleton that it
    flows through, by the drag alone.

    (E, A, d + 1, A, d): rows v_f and p, columns y [N/m and m²/s].
    """
    x = flow_points(el, f)
    E, _, A, d = el.geometry.G.shape
    G = broadcast_gradient(el.geometry.G, el.geometry.dV.shape[1])
    N = np.broadcast_to(el.N, G.shape[:3])
    drag = _drag(el)
    weight = (drag.scale * el.geometry.dV)[..., None]
    K = np.zeros((E, A, d + 1, A, d))
    add_drag(K, -bilinear(weight * _tests(el, x, G), N), drag.resistance, d)
    turned = drag.turned(G)
    for j in range(d):
        K[:, :, d, :, j] = -bilinear(el.tau[..., None] * weight * turned[..., j], N)
    return c_v * K


def flow_by_mesh_velocity(el: FlowElements, f: FlowFields, c_m: float) -> np.ndarray:
    """Return the derivative of `flow.flow_residual` by the mesh's positions through v_m alone (c =
    v - v_m), dv_m = c_m dy.

    (E, A, d + 1, A, d): rows v_f and p, columns y [N/m and m²/s]; zero without convection.
    """
    G = broadcast_gradient(el.geometry.G, el.geometry.dV.shape[1])
    E, _, A, d = G.shape
    K = np.zeros((E, A, d + 1, A, d))
    if el.convection:
        _add_mesh_velocity(K, el, flow_points(el, f), G)
    return c_m * K


def _drag(el: FlowElements) -> Drag:
    """Return the drag of elements that a skeleton resists."""
    assert el.drag is not None
    return el.drag


def _tests(el, x, G):
    """Return N_a + τ ρ c·∇N_a, what the strong residual is tested with, (E, Q, A)."""
    N = np.broadcast_to(el.N, G.shape[:3])
    return (
        N + (el.tau_supg * el.rho)[..., None] * (G @ x.c[..., None])[..., 0] if el.convection else N
    )


def _add_mesh_velocity(K, el, x, G):
    """Add the derivative by v_m: d r_i/d v_m,j = -ρ ∂v_i/∂x_j, and SUPG's test function, whose c
    changes too.
    """
    dV = el.geometry.dV
    d = G.shape[-1]
    N = np.broadcast_to(el.N, G.shape[:3])
    tests = _tests(el, x, G)
    strong = -dV[..., None, None] * strong_gradient(el, x)
    for j in range(d):
        for i in range(d):
            supg = (el.tau_supg * el.rho * dV * x.residual[..., i])[..., None]
            K[:, :, i, :, j] += bilinear(tests * strong[..., i, j, None] - supg * G[..., j], N)
        carried = (G @ strong[..., j, None])[..., 0]  # Σ_i ∂_i N_a d r_i/d v_m,j
        K[:, :, d, :, j] += bilinear((el.tau * el.n)[..., None] * carried, N)


def solid_by_drag(N: np.ndarray, geometry: Geometry, drag: Drag) -> np.ndarray:
    """Return the derivative of the solid's drag by (v_f, p), (E, A, d, A, d + 1) [N s/m]; the
    columns of p are zero.
    """
    E, _, A, d = geometry.G.shape
    K = np.zeros((E, A, d, A, d + 1))
    add_drag(K, mass_matrix(N, -drag.scale * geometry.dV), drag.resistance, d)
    return K


def solid_by_flow(N: np.ndarray, geometry: Geometry, n: np.ndarray, drag: Drag) -> np.ndarray:
    """Return the derivative of the solid's pressure and drag terms by (v_f, p), (E, A, d, A, d + 1)
    [N s/m and m²].
    """
    dV = geometry.dV
    E, _, A, d = geometry.G.shape
    G = broadcast_gradient(geometry.G, dV.shape[1])
    div = broadcast_gradient(geometry.divergence, dV.shape[1])
    Nq = np.broadcast_to(N, G.shape[:3])
    K = np.zeros((E, A, d, A, d + 1))
    add_drag(K, mass_matrix(N, -drag.scale * dV), drag.resistance, d)
    for i in range(d):
        K[:, :, i, :, d] = -bilinear(dV[..., None] * div[..., i], Nq) - bilinear(
            (n * dV)[..., None] * Nq, G[..., i]
        )
    return K
