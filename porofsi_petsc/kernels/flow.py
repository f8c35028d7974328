"""Element residual and tangent of the interstitial fluid in ALE description: equal order, PSPG, SUPG, LSIC and drag.

Momentum (w) and volume balance (q) over the current configuration, with c = v - v_m and w_rel = v - v_s:

    ∫ w·[ρ (a + c·∇v) + n ∇p + S w_rel - ρ b] + ∫ ∇w : 2 n μ sym ∇v + ∫ τ ρ (c·∇w)·r + ∫ n ν_L div w (div v_s + n div w_rel)
    ∫ q div v_s - ∫ n ∇q·w_rel + ∫ τ n ∇q·r + ∫ c_v τ_u ∇q·∇(p - p_n) + ∮ q n w_rel·n

r = ρ (a + c·∇v) + n ∇p + S w_rel - ρ b - div(2 n μ sym ∇v) is the full strong residual, n the fluid fraction, ρ = n ρ_fR.
On linear elements div(2 n μ sym ∇v) = 0.  LSIC is for constant n: its volume balance has no w_rel·∇n.
The pressure term is not integrated by parts, so that an impermeable surface, fixed or moving (w_rel·n = 0), is natural; a
drained one prescribes p (Tezduyar 1992 for PSPG and LSIC; the subgrid velocity is -τ r).  Terms are kept apart, see
`kernels.solid`.

A free fluid has n = 1 and no skeleton.  There the pressure is integrated by parts, so that the full traction
σ n = (-p I + 2 μ sym ∇v) n is natural: an outlet may be left alone, and the residual of a node on the boundary is the fluid's
traction ∮ w·σ n on it.

    ∫ w·[ρ (a + c·∇v) - ρ b] - ∫ p div w + ∫ ∇w : 2 μ sym ∇v + ∫ τ ρ (c·∇w)·r + ∫ ν_L div w div v
    ∫ q div v + ∫ τ ∇q·r

Where it flows through a porous solid, v is the volume-averaged velocity v_s + n_f w and S w_rel = S (v - v_s) is added to r.
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
    tau_u (E, Q, d, d) = c_v τ_u [m³ s/kg], None without the undrained term; second: `fem.geometry.SecondDerivatives`, None on
    linear elements or where μ = 0; grad_n (E, Q, d) [1/m] of a varying n, where there is `second`, None where n is constant;
    free: a free fluid, whose n is 1; its S is None, or [N s/m⁴] of a skeleton that it flows through.
    """

    N: np.ndarray
    geometry: Any
    n: np.ndarray
    rho: np.ndarray
    S: np.ndarray | None
    mu: float
    tau: np.ndarray
    tau_supg: np.ndarray
    nu_lsic: np.ndarray
    tau_u: np.ndarray | None
    second: Any
    grad_n: np.ndarray | None
    convection: bool
    order: int
    free: bool = False


@dataclass(frozen=True)
class FlowFields:
    """Nodal values on the collocation level: v, a, c = v - v_m, v_s (E, A, d); p, dp = p - p_n (E, A); b (E, Q, d).

    v_s is not read for a free fluid without drag, dp not without the undrained term.
    """

    v: np.ndarray
    a: np.ndarray
    c: np.ndarray
    v_s: np.ndarray
    p: np.ndarray
    dp: np.ndarray
    b: np.ndarray


@dataclass(frozen=True)
class FlowPoints:
    """Pointwise quantities that residual and tangent share; c None without convection, w None without drag."""

    c: np.ndarray | None
    grad_v: np.ndarray
    acceleration: np.ndarray
    grad_p: np.ndarray
    w: np.ndarray | None
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
    w = None if el.S is None else el.N @ (f.v - f.v_s)
    residual = acceleration - el.rho[..., None] * f.b + (grad_p if el.free else el.n[..., None] * grad_p)
    if w is not None:
        residual = residual + el.S[..., None] * w
    if el.second is not None:
        residual = residual - viscous_force(el, f, grad_v)
    return FlowPoints(c, grad_v, acceleration, grad_p, w, residual)


def viscous_force(el, f, grad_v):
    """Return div(2 n μ sym ∇v) = μ [n (Δv + ∇ div v) + (∇v + ∇vᵀ) ∇n], (E, Q, d) [N/m³]."""
    force = el.mu * el.n[..., None] * el.second.viscous(f.v, grad_v)
    if el.grad_n is None:
        return force
    return force + el.mu * ((grad_v + np.swapaxes(grad_v, 2, 3)) @ el.grad_n[..., None])[..., 0]


def flow_residual(el, f):
    """Return momentum terms (T, E, A, d) [N] in the order of MOMENTUM_TERMS and volume terms (T, E, A) [m³/s] of VOLUME_TERMS.

    The skeleton's volume term of a free fluid is its own, ∫ q div v.
    """
    x = flow_points(el, f)
    G, dV = el.geometry.G, el.geometry.dV
    momentum, volume = np.zeros((len(MOMENTUM_TERMS), *f.v.shape)), np.zeros((len(VOLUME_TERMS), *f.p.shape))
    balances = _free_balances if el.free else _porous_balances
    div = balances(momentum, volume, el, f, x)
    if el.mu:
        viscous = (el.n * el.mu)[..., None, None] * (x.grad_v + np.swapaxes(x.grad_v, 2, 3))
        momentum[4] = test_gradient(G, dV, viscous)
    if el.convection:
        supg = (el.tau_supg * el.rho)[..., None, None] * x.residual[..., :, None] * x.c[..., None, :]
        lsic = el.n * el.nu_lsic * div
        momentum[5] = test_gradient(G, dV, supg + lsic[..., None, None] * np.eye(G.shape[-1]))
    if el.tau_u is not None:
        volume[3] = undrained_residual(el, f.dp)
    return momentum, volume


def _porous_balances(momentum, volume, el, f, x):
    """Set inertia, pressure, drag and body force, skeleton, seepage and PSPG; return div v_s + n div w, (E, Q) [1/s]."""
    G, dV, n = el.geometry.G, el.geometry.dV, el.n[..., None]
    d = G.shape[-1]
    div_vs = np.broadcast_to(np.einsum("eqii->eq", _nodal_gradient(G, f.v_s)), dV.shape)
    forces = [x.acceleration, n * x.grad_p, el.S[..., None] * x.w, -el.rho[..., None] * f.b]
    valued = test_value(el.N, dV, np.concatenate([*forces, div_vs[..., None]], axis=-1))
    for i in range(len(forces)):
        momentum[i] = valued[..., i * d : (i + 1) * d]
    volume[0] = valued[..., -1]
    fluxes = np.stack([-n * x.w, (el.tau * el.n)[..., None] * x.residual], axis=-2)
    volume[1:3] = np.moveaxis(test_gradient(G, dV, fluxes), -1, 0)
    return div_vs + el.n * (np.einsum("eqii->eq", x.grad_v) - div_vs)


def _free_balances(momentum, volume, el, f, x):
    """Set inertia, pressure, drag, body force, volume and PSPG of a free fluid; return div v, (E, Q) [1/s]."""
    G, dV = el.geometry.G, el.geometry.dV
    d = G.shape[-1]
    div = np.broadcast_to(np.einsum("eqii->eq", x.grad_v), dV.shape)
    values = np.concatenate([x.acceleration, -el.rho[..., None] * f.b, div[..., None]], axis=-1)
    valued = test_value(el.N, dV, values)
    momentum[0], momentum[3], volume[0] = valued[..., :d], valued[..., d : 2 * d], valued[..., -1]
    momentum[1] = test_gradient(G, dV, -(f.p @ el.N.T)[..., None, None] * np.eye(d))
    if x.w is not None:
        momentum[2] = test_value(el.N, dV, el.S[..., None] * x.w)
    volume[2] = test_gradient(G, dV, (el.tau[..., None] * x.residual)[..., None, :])[..., 0]
    return div


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
    Gq = broadcast_gradient(G, dV.shape[1])
    K = np.zeros((E, A, components, A, components))
    strong = _strong_isotropic(el, x, Gq, c_f)
    scalar = bilinear(np.broadcast_to(el.N, strong.shape) * dV[..., None], strong)
    if el.mu:
        scalar = scalar + _add_viscous(K, el, Gq)
    full = _strong_full(el, x, Gq) if el.convection or el.second is not None else None
    if el.second is not None:
        strong = strong - el.mu * _scalar_viscous_force(el, Gq)
    if el.convection:
        streamline = (el.tau_supg * el.rho * dV)[..., None] * _advected(x, Gq)
        scalar = scalar + bilinear(streamline, strong)
        _add_convection(K, el, x, Gq, full, streamline)
    add_isotropic(K, scalar, d)
    _add_pressure(K, el, Gq)
    _add_pspg(K, el, Gq, strong, full)
    if el.tau_u is not None:
        K[:, :, d, :, d] += diffusion(undrained_gradient(el), el.tau_u, dV)
    return K


def _advected(x, Gq):
    """Return c·∇N_b, (E, Q, A) [1/s]."""
    return (Gq @ x.c[..., None])[..., 0]


def _strong_isotropic(el, x, Gq, c_f):
    """Return the isotropic part of d r/d v_b without viscosity, (E, Q, A) [kg/(m³ s)]."""
    rate = el.rho * c_f if el.S is None else el.rho * c_f + el.S
    strong = rate[..., None] * el.N
    return strong + el.rho[..., None] * _advected(x, Gq) if el.convection else strong


def _scalar_viscous_force(el, Gq):
    """Return the isotropic part of div(2 n sym ∇v) by v_b, n ΔN_b + ∇n·∇N_b, (E, Q, A) [1/m²]."""
    force = el.n[..., None] * np.einsum("eqaii->eqa", el.second.shapes)
    return force if el.grad_n is None else force + (Gq @ el.grad_n[..., None])[..., 0]


def _add_viscous(K, el, Gq):
    """Add ∫ n μ ∂_j N_a ∂_i N_b to K; return the isotropic part ∫ n μ ∇N_a·∇N_b, (E, A, A) [N s/m]."""
    weight = el.n * el.mu * el.geometry.dV
    for i in range(Gq.shape[-1]):
        for j in range(Gq.shape[-1]):
            K[:, :, i, :, j] += bilinear(weight[..., None] * Gq[..., j], Gq[..., i])
    return laplacian(el.geometry.G, weight)


def _add_pressure(K, el, Gq):
    """Add the pressure's force and the adjoint volume balance: ±∫ N_a n ∂_j N_b and ∓ its transpose (upper sign: porous)."""
    d = Gq.shape[-1]
    values = (el.n * el.geometry.dV)[..., None] * el.N
    for j in range(d):
        gradient = bilinear(values, Gq[..., j])
        adjoint = np.swapaxes(gradient, 1, 2)
        K[:, :, j, :, d] += -adjoint if el.free else gradient
        K[:, :, d, :, j] += gradient if el.free else -adjoint


def _add_pspg(K, el, Gq, strong, full):
    """Add ∫ τ n ∇q·δr; δr has an isotropic part by v (E, Q, A), a full one (E, Q, A, d, d) or None, and n ∇δp."""
    dV, d = el.geometry.dV, Gq.shape[-1]
    weight = (el.tau * el.n * dV)[..., None]
    for j in range(d):
        K[:, :, d, :, j] += bilinear(weight * Gq[..., j], strong)
        if full is not None:
            for i in range(d):
                K[:, :, d, :, j] += bilinear(weight * Gq[..., i], full[..., i, j])
    K[:, :, d, :, d] += laplacian(el.geometry.G, el.tau * el.n**2 * dV)


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
        full -= el.mu * el.n[..., None, None, None] * el.second.shapes
    if el.second is not None and el.grad_n is not None:
        full -= el.mu * Gq[..., None] * el.grad_n[:, :, None, None]
    return full


def _add_convection(K, el, x, Gq, full, streamline):
    """Add the Newton part of convection, SUPG (with the change of its test function) and LSIC to K."""
    dV, N = el.geometry.dV, el.N
    newton = (el.rho * dV)[..., None] * N
    supg = (el.tau_supg * el.rho * dV)[..., None] * x.residual
    lsic = el.n**2 * el.nu_lsic * dV
    values, d = np.broadcast_to(N, newton.shape), Gq.shape[-1]
    for i in range(d):
        K[:, :, i, :, d] += bilinear(streamline * el.n[..., None], Gq[..., i])
        for j in range(d):
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
