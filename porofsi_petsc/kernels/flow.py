"""Element residual and tangent of the interstitial fluid in ALE description: equal order, PSPG, SUPG, LSIC and drag.

Momentum (w) and volume balance (q) over the current configuration, with c = v - v_m and w_rel = v - v_s:

    ∫ w·[ρ (a + c·∇v) + n ∇p + S w_rel - ρ b] + ∫ ∇w : 2 n μ sym ∇v + ∫ τ ρ (c·∇w)·r + ∫ n ν_L div w (div v_s + n div w_rel)
    ∫ q div v_s - ∫ n ∇q·w_rel + ∫ τ n ∇q·r + ∫ c_v τ_u ∇q·∇(p - p_n) + ∮ q n w_rel·n

r = ρ (a + c·∇v) + n ∇p + S w_rel - ρ b - div(2 n μ sym ∇v) is the full strong residual, n the fluid fraction, ρ = n ρ_fR.
On linear elements div(2 n μ sym ∇v) = 0.  LSIC is for constant n: its volume balance has no w_rel·∇n.
The pressure term is not integrated by parts, so that an impermeable surface, fixed or moving (w_rel·n = 0), is natural; a
drained one prescribes p (Tezduyar 1992 for PSPG and LSIC; the subgrid velocity is -τ r).  Terms are kept apart, see
`kernels.solid`.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from .assemble import add_isotropic, bilinear, broadcast_gradient, diffusion, laplacian, mass_matrix, test_gradient, test_value

MOMENTUM_TERMS = ("inertia", "pressure", "drag", "body", "viscous", "stabilization")
VOLUME_TERMS = ("skeleton", "seepage", "pspg", "undrained")


@dataclass(frozen=True)
class FlowElements:
    """Elements and coefficients of one chunk, frozen during an iteration.

    N (Q, A); geometry (G, dV); n, rho, S (E, Q): fluid fraction, partial density [kg/m³], drag [N s/m⁴]; mu [Pa s];
    tau, tau_supg (E, Q) [m³ s/kg] of PSPG and SUPG; nu_lsic (E, Q) [Pa s], 0 where n varies;
    tau_u (E, Q, d, d) = c_v τ_u [m³ s/kg]; second: `fem.geometry.SecondDerivatives`, None on linear elements or where μ = 0;
    grad_n (E, Q, d) [1/m] of a varying n, where there is `second`.
    """

    N: np.ndarray
    geometry: Any
    n: np.ndarray
    rho: np.ndarray
    S: np.ndarray
    mu: float
    tau: np.ndarray
    tau_supg: np.ndarray
    nu_lsic: np.ndarray
    tau_u: np.ndarray
    second: Any
    grad_n: np.ndarray | None
    convection: bool
    order: int


@dataclass(frozen=True)
class FlowFields:
    """Nodal values on the collocation level: v, a, c = v - v_m, v_s (E, A, d); p, dp = p - p_n (E, A); b (E, Q, d)."""

    v: np.ndarray
    a: np.ndarray
    c: np.ndarray
    v_s: np.ndarray
    p: np.ndarray
    dp: np.ndarray
    b: np.ndarray


@dataclass(frozen=True)
class FlowPoints:
    """Pointwise quantities that residual and tangent share."""

    c: np.ndarray
    grad_v: np.ndarray
    acceleration: np.ndarray
    grad_p: np.ndarray
    w: np.ndarray
    residual: np.ndarray


def _nodal_gradient(G, U):
    """Return dU_k/dx_j, (E, Q', k, d), of nodal values U (E, A, k)."""
    return np.swapaxes(U, 1, 2)[:, None] @ G


def flow_points(el, f):
    """Return the pointwise quantities of a state."""
    G = el.geometry.G
    grad_v = _nodal_gradient(G, f.v)
    grad_p = _nodal_gradient(G, f.p[..., None])[:, :, 0]
    acceleration = el.rho[..., None] * (el.N @ f.a)
    c = el.N @ f.c if el.convection else None
    if el.convection:
        acceleration = acceleration + el.rho[..., None] * (grad_v @ c[..., None])[..., 0]
    w = el.N @ (f.v - f.v_s)
    residual = acceleration + el.n[..., None] * grad_p + el.S[..., None] * w - el.rho[..., None] * f.b
    if el.second is not None:
        residual = residual - viscous_force(el, f, grad_v)
    return FlowPoints(c, grad_v, acceleration, grad_p, w, residual)


def viscous_force(el, f, grad_v):
    """Return div(2 n μ sym ∇v) = μ [n (Δv + ∇ div v) + (∇v + ∇vᵀ) ∇n], (E, Q, d) [N/m³]."""
    turned = ((grad_v + np.swapaxes(grad_v, 2, 3)) @ el.grad_n[..., None])[..., 0]
    return el.mu * (el.n[..., None] * el.second.viscous(f.v, grad_v) + turned)


def flow_residual(el, f):
    """Return momentum terms (T, E, A, d) [N] in the order of MOMENTUM_TERMS and volume terms (T, E, A) [m³/s] of VOLUME_TERMS."""
    x = flow_points(el, f)
    G, dV = el.geometry.G, el.geometry.dV
    d = G.shape[-1]
    n = el.n[..., None]
    pressure, drag, body = n * x.grad_p, el.S[..., None] * x.w, -el.rho[..., None] * f.b
    div_vs = np.einsum("eqii->eq", _nodal_gradient(G, f.v_s))
    values = np.concatenate([x.acceleration, pressure, drag, body, np.broadcast_to(div_vs, dV.shape)[..., None]], axis=-1)
    valued = test_value(el.N, dV, values)
    momentum = np.zeros((len(MOMENTUM_TERMS), *f.v.shape))
    for i in range(4):
        momentum[i] = valued[..., i * d : (i + 1) * d]
    if el.mu:
        viscous = (el.n * el.mu)[..., None, None] * (x.grad_v + np.swapaxes(x.grad_v, 2, 3))
        momentum[4] = test_gradient(G, dV, viscous)
    if el.convection:
        supg = (el.tau_supg * el.rho)[..., None, None] * x.residual[..., :, None] * x.c[..., None, :]
        lsic = el.n * el.nu_lsic * (div_vs + el.n * (np.einsum("eqii->eq", x.grad_v) - div_vs))
        momentum[5] = test_gradient(G, dV, supg + lsic[..., None, None] * np.eye(d))
    volume = np.empty((len(VOLUME_TERMS), *f.p.shape))
    volume[0] = valued[..., -1]
    fluxes = np.stack([-n * x.w, (el.tau * el.n)[..., None] * x.residual], axis=-2)
    volume[1:3] = np.moveaxis(test_gradient(G, dV, fluxes), -1, 0)
    volume[3] = undrained_residual(el, f.dp)
    return momentum, volume


def undrained_gradient(el):
    """Return the gradients the undrained-limit stabilization acts on: all of them (order 1), their fluctuation (order 2).

    For order 2 the mean over the element is left out, so that a linear pressure is untouched and the order of convergence stays.
    """
    G, dV = el.geometry.G, el.geometry.dV
    if el.order == 1:
        return G
    mean = np.einsum("eq,eqaj->eaj", dV / dV.sum(axis=1, keepdims=True), broadcast_gradient(G, dV.shape[1]))
    return G - mean[:, None]


def undrained_residual(el, dp):
    """Return ∫ c_v τ_u ∇q·∇(p - p_n), (E, A) [m³/s]: the skeleton's compliance at grid scale times the pressure rate."""
    G = undrained_gradient(el)
    gradient = _nodal_gradient(G, dp[..., None])
    return test_gradient(G, el.geometry.dV, gradient @ el.tau_u)[..., 0]


def flow_tangent(el, f, c_f, components):
    """Return the derivative of `flow_residual` by (v, p) on the collocation level, (E, A, m, A, m), m = components >= d + 1.

    c_f = d a/d v [1/s], zero without inertia.  τ and ν_L are frozen (they belong to the start of the step), so this is exact.
    """
    x = flow_points(el, f)
    G, dV = el.geometry.G, el.geometry.dV
    E, _, A, d = G.shape
    Q = dV.shape[1]
    Gq = broadcast_gradient(G, Q)
    K = np.zeros((E, A, components, A, components))
    n = el.n
    advected = (Gq @ x.c[..., None])[..., 0] if el.convection else None  # c·∇N_b, (E, Q, A)
    strong = (el.rho * c_f + el.S)[..., None] * el.N  # scalar part of d r/d v
    if el.convection:
        strong = strong + el.rho[..., None] * advected
    scalar = bilinear(np.broadcast_to(el.N, strong.shape) * dV[..., None], strong)
    if el.mu:
        scalar = scalar + laplacian(G, n * el.mu * dV)
        for i in range(d):
            for j in range(d):
                K[:, :, i, :, j] += bilinear((n * el.mu * dV)[..., None] * Gq[..., j], Gq[..., i])
    full = _strong_full(el, x, Gq) if el.convection or el.second is not None else None
    if el.second is not None:
        along = (Gq @ el.grad_n[..., None])[..., 0]
        strong = strong - el.mu * (n[..., None] * np.einsum("eqaii->eqa", el.second.shapes) + along)
    if el.convection:
        streamline = (el.tau_supg * el.rho * dV)[..., None] * advected
        scalar = scalar + bilinear(streamline, strong)
        _add_convection(K, el, x, Gq, full, streamline)
    add_isotropic(K, scalar, d)
    pspg = (el.tau * n * dV)[..., None]
    for j in range(d):
        K[:, :, j, :, d] = bilinear((n * dV)[..., None] * np.broadcast_to(el.N, (E, Q, A)), Gq[..., j])
        if el.convection:
            K[:, :, j, :, d] += bilinear(streamline * n[..., None], Gq[..., j])
        K[:, :, d, :, j] = bilinear(pspg * Gq[..., j], strong) - bilinear(
            (n * dV)[..., None] * Gq[..., j], np.broadcast_to(el.N, (E, Q, A))
        )
        if full is not None:
            for i in range(d):
                K[:, :, d, :, j] += bilinear(pspg * Gq[..., i], full[..., i, j])
    K[:, :, d, :, d] = laplacian(G, el.tau * n**2 * dV) + diffusion(undrained_gradient(el), el.tau_u, dV)
    return K


def strong_gradient(el, x):
    """Return ρ ∂v_i/∂x_j, (E, Q, d, d): the derivative of the convective force by c_j."""
    return el.rho[..., None, None] * x.grad_v


def _strong_full(el, x, Gq):
    """Return the non-isotropic part of d r_i/d v_bj, (E, Q, A, d, d)."""
    d = Gq.shape[-1]
    full = np.zeros((*Gq.shape[:3], d, d))
    if el.convection:
        full += el.N[..., None, None] * strong_gradient(el, x)[:, :, None]
    if el.second is not None:
        full -= el.mu * (el.n[..., None, None, None] * el.second.shapes + Gq[..., None] * el.grad_n[:, :, None, None])
    return full


def _add_convection(K, el, x, Gq, full, streamline):
    """Add the Newton part of convection, the change of SUPG's test function and LSIC to K."""
    dV, N = el.geometry.dV, el.N
    newton = (el.rho * dV)[..., None] * N
    supg = (el.tau_supg * el.rho * dV)[..., None] * x.residual
    lsic = el.n**2 * el.nu_lsic * dV
    values = np.broadcast_to(N, newton.shape)
    for i in range(Gq.shape[-1]):
        for j in range(Gq.shape[-1]):
            K[:, :, i, :, j] += bilinear(newton * x.grad_v[..., i, j, None], values)
            K[:, :, i, :, j] += bilinear(streamline, full[..., i, j])
            K[:, :, i, :, j] += bilinear(supg[..., i, None] * Gq[..., j], values)
            K[:, :, i, :, j] += bilinear(lsic[..., None] * Gq[..., i], Gq[..., j])


def add_skeleton_answer(K, el, mass_weight, laplacian_weight):
    """Add the answer of the skeleton to a pressure change to the tangent K with the auxiliary field s after p (or without it).

    The answer B_m (δp - s), (B_m + B_L) s = B_m δp is the parallel sum of B_m = ∫ α² c_v/E_c q p (stiffness) and
    B_L = ∫ α² c_v/(ρ_χ c_a) ∇q·∇p (inertia), an inertia-aware fixed-stress term; with d + 1 components only B_m is added.

    mass_weight, laplacian_weight : (E, Q) coefficients without dV
    """
    G, dV = el.geometry.G, el.geometry.dV
    p = G.shape[-1]
    B_m = mass_matrix(el.N, mass_weight * dV)
    K[:, :, p, :, p] += B_m
    if K.shape[2] == p + 1:
        return
    s = p + 1
    K[:, :, p, :, s] -= B_m
    K[:, :, s, :, p] -= B_m
    K[:, :, s, :, s] += B_m + laplacian(G, laplacian_weight * dV)


def add_free_surface(K, laplacian_weight, rows, terms):
    """Add Nitsche's terms of a free impermeable surface to the auxiliary field s, see `surface.weak_zero`, in place.

    laplacian_weight : (E, Q) α² c_v/(ρ_χ c_a) without dV; rows (F,) elements in K, terms (F, A, A) [m^(d-2)]
    """
    weight = laplacian_weight[rows].mean(axis=1)
    np.add.at(K[:, :, -1, :, -1], rows, weight[:, None, None] * terms)
