"""Off-diagonal tangents between the phases on a fixed mesh: what each residual feels of the other phase's unknowns.

Derivatives are by the increments on the collocation level; dv_s = c_v dy.  The change of the geometry itself (direct
coupling) is not part of them.
"""

import numpy as np

from .assemble import bilinear, broadcast_gradient, mass_matrix
from .flow import flow_points, strong_gradient


def flow_by_skeleton(el, f, c_v, moving_mesh):
    """Return the derivative of `flow.flow_residual` by the skeleton's positions through v_s (and v_m = v_s where the mesh moves).

    (E, A, d + 1, A, d): rows v_f and p, columns y [N/m and m²/s].
    """
    x = flow_points(el, f)
    dV, n = el.geometry.dV, el.n
    E, _, A, d = el.geometry.G.shape
    G = broadcast_gradient(el.geometry.G, dV.shape[1])
    N = np.broadcast_to(el.N, G.shape[:3])
    carried = el.convection and moving_mesh
    strong = _strong_by_skeleton(el, x, carried)  # d r_i / d v_s,j at a point; times N_b
    K = np.zeros((E, A, d + 1, A, d))
    pspg = (el.tau * n * dV)[..., None]
    for j in range(d):
        for i in range(d):
            rows = dV[..., None] * N
            if el.convection:
                rows = rows + (el.tau_supg * el.rho * dV)[..., None] * (G @ x.c[..., None])[..., 0]
            K[:, :, i, :, j] = bilinear(rows * strong[..., i, j, None], N)
            if carried:
                supg = (el.tau_supg * el.rho * dV * x.residual[..., i])[..., None]
                K[:, :, i, :, j] -= bilinear(supg * G[..., j], N)
            if el.convection:
                K[:, :, i, :, j] += bilinear((n * (1 - n) * el.nu_lsic * dV)[..., None] * G[..., i], G[..., j])
            K[:, :, d, :, j] += bilinear(pspg * G[..., i] * strong[..., i, j, None], N)
        K[:, :, d, :, j] += bilinear(dV[..., None] * N, G[..., j]) + bilinear((n * dV)[..., None] * G[..., j], N)
    return c_v * K


def _strong_by_skeleton(el, x, carried):
    """Return d r_i/d v_s,j = -S δ_ij - ρ ∂v_i/∂x_j (the latter where the mesh carries the fluid), (E, Q, d, d)."""
    d = el.geometry.G.shape[-1]
    drag = -el.S[..., None, None] * np.eye(d)
    return drag - strong_gradient(el, x) if carried else drag


def solid_by_flow(N, geometry, n, S):
    """Return the derivative of the solid's pressure and drag terms by (v_f, p), (E, A, d, A, d + 1) [N s/m and m²]."""
    dV = geometry.dV
    E, _, A, d = geometry.G.shape
    G = broadcast_gradient(geometry.G, dV.shape[1])
    Nq = np.broadcast_to(N, G.shape[:3])
    drag = mass_matrix(N, -S * dV)
    K = np.zeros((E, A, d, A, d + 1))
    for i in range(d):
        K[:, :, i, :, i] = drag
        K[:, :, i, :, d] = -bilinear(dV[..., None] * G[..., i], Nq) - bilinear((n * dV)[..., None] * Nq, G[..., i])
    return K
