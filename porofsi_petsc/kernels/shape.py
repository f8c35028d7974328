"""Derivatives of the element residuals by the positions of a mesh that carries them: gradients,
volumes, porosity and drag.

With H = ∂δy/∂x the geometry changes by δ(∂N_a/∂x_j) = -∂N_a/∂x_m H_mj, δdV = tr H dV, δJ = J tr H.
A residual of the form Σ_q dV (N_a A_k + ∂_j N_a B_kj) therefore has the derivative by y_bl

    Σ_q dV (N_a DA_kli + ∂_j N_a DB_kjli) ∂_i N_b        DA_kli  = A_k δ_li + ∂A_k/∂H_li
                                                         DB_kjli = B_kj δ_li - B_ki δ_jl +
                                                         ∂B_kj/∂H_li

Nodal values are kept, and so is what is frozen at the start of a step (τ, ν_L, τ_u).  The
dependence on v_s is in `exchange`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .arguments import Geometry
from .assemble import bilinear, broadcast_gradient
from .flow import FlowElements, FlowFields, flow_points


@dataclass(frozen=True)
class VolumeDerivatives:
    """How the coefficients follow the volume: J dn_f/dJ and J dS/dJ, (E, Q)."""

    n: np.ndarray
    S: np.ndarray


@dataclass(frozen=True)
class Densities:
    """A (E, Q, k), B (E, Q, k, d) and their derivatives by H, DA (E, Q, k, d, d) and DB (E, Q, k,
    d, d, d), geometry left out.
    """

    A: np.ndarray
    B: np.ndarray
    dA: np.ndarray
    dB: np.ndarray

    @classmethod
    def zeros(cls, points: tuple[int, ...], k: int, d: int) -> Densities:
        """Return densities of k components at points (E, Q)."""
        return cls(
            *(np.zeros((*points, *shape)) for shape in ((k,), (k, d), (k, d, d), (k, d, d, d)))
        )


def solid_by_geometry(
    N: np.ndarray,
    geometry: Geometry,
    n: np.ndarray,
    S: np.ndarray,
    derivatives: VolumeDerivatives,
    p: np.ndarray,
    w: np.ndarray,
) -> np.ndarray:
    """Return the derivative of `solid.coupling_residual` by y through the geometry, (E, A, d, A, d)
    [N/m].

    p (E, A) [Pa], w (E, A, d) = v_f - v_s [m/s].
    """
    d = geometry.G.shape[-1]
    identity = np.eye(d)
    w = N @ w
    grad_p = (np.swapaxes(geometry.G, 2, 3) @ p[:, None, :, None])[..., 0]
    x = Densities.zeros(geometry.dV.shape, d, d)
    x.A[...] = -n[..., None] * grad_p - S[..., None] * w
    x.B[...] = -(p @ N.T)[..., None, None] * identity
    x.dA[...] = -_pressure_by_geometry(n, derivatives, grad_p) - _by_volume(
        derivatives.S[..., None] * w
    )
    return _assemble(N, geometry, x)


def flow_by_geometry(
    el: FlowElements, f: FlowFields, derivatives: VolumeDerivatives | None
) -> np.ndarray:
    """Return the derivative of `flow.flow_residual` by y through the geometry, (E, A, d + 1, A, d)
    [N/m and m²/s].

    derivatives : `VolumeDerivatives`, None for a free fluid
    """
    x = flow_points(el, f)
    d = el.geometry.G.shape[-1]
    densities = Densities.zeros(el.geometry.dV.shape, d + 1, d)
    if el.free:
        _add_free(densities, el, f, x)
    else:
        _add_porous(densities, el, f, x, derivatives)
    if el.tau_u is not None:
        _add_undrained(densities, el, f.dp)
    K = _assemble(el.N, el.geometry, densities)
    if el.second is not None:
        _add_curving(K, el, x, derivatives)
    if el.order > 1 and el.tau_u is not None:
        K[:, :, d] += _undrained_means(el, f.dp)
    return K


@dataclass(frozen=True)
class _Gradients:
    """div v and div v_s with their derivatives by H, -∂v_i/∂x_l."""

    div: np.ndarray
    div_s: np.ndarray
    d_div: np.ndarray
    d_div_s: np.ndarray

    @classmethod
    def of(cls, el, f, x):
        v_s = np.broadcast_to(
            np.swapaxes(f.v_s, 1, 2)[:, None] @ el.geometry.G, (*el.n.shape, *x.grad_v.shape[2:])
        )
        div, div_s = (np.trace(gradient, axis1=2, axis2=3) for gradient in (x.grad_v, v_s))
        return cls(div, div_s, -np.swapaxes(x.grad_v, 2, 3), -np.swapaxes(v_s, 2, 3))


def _by_volume(X):
    """Return X δ_li, the derivative by H of what changes by X tr H."""
    return X[..., None, None] * np.eye(X.shape[-1])


def _pressure_by_geometry(n, derivatives, grad_p):
    """Return the derivative of n ∂p/∂x_m by H, (E, Q, d, d, d)."""
    turned = n[..., None] * grad_p
    identity = np.eye(grad_p.shape[-1])
    return _by_volume(derivatives.n[..., None] * grad_p) - np.einsum(
        "eql,mi->eqmli", turned, identity
    )


def _convection_by_geometry(el, x):
    """Return the derivative of ρ c·∇v_m by H, -ρ ∂_l v_m c_i, (E, Q, d, d, d); 0 without
    convection.
    """
    return (
        -el.rho[..., None, None, None] * np.einsum("eqml,eqi->eqmli", x.grad_v, x.c)
        if el.convection
        else 0.0
    )


def _add_porous(densities, el, f, x, derivatives):
    """Add the rows of the porous form: values r without viscosity and div v_s, the seepage -n w,
    stresses and stabilization.
    """
    d = x.w.shape[-1]
    gradients = _Gradients.of(el, f, x)
    relative = (derivatives.n / el.n)[..., None]
    body = el.rho[..., None] * f.b
    strong = _by_volume(relative * (x.acceleration - body) + derivatives.S[..., None] * x.w)
    strong += _pressure_by_geometry(el.n, derivatives, x.grad_p) + _convection_by_geometry(el, x)
    densities.A[..., :d] += (
        x.acceleration + el.n[..., None] * x.grad_p + el.S[..., None] * x.w - body
    )
    densities.dA[:, :, :d] += strong
    densities.A[..., d] += gradients.div_s
    densities.dA[:, :, d] += gradients.d_div_s
    densities.B[:, :, d] -= el.n[..., None] * x.w
    densities.dB[:, :, d] -= _by_volume(derivatives.n[..., None] * x.w)
    _add_stresses(densities, el, f, x, derivatives, strong)
    if el.convection:
        n = el.n[..., None, None]  # constant where ν_L is not zero
        div = gradients.div_s + el.n * (gradients.div - gradients.div_s)
        _add_lsic(densities, el, div, gradients.d_div_s + n * (gradients.d_div - gradients.d_div_s))


def _add_free(densities, el, f, x):
    """Add the rows of a free fluid: values ρ (a + c·∇v) - ρ b and div v, stresses with -p δ_mj, and
    stabilization.
    """
    d = x.grad_p.shape[-1]
    identity = np.eye(d)
    convection = _convection_by_geometry(el, x)
    div = np.trace(x.grad_v, axis1=2, axis2=3)
    d_div = -np.swapaxes(x.grad_v, 2, 3)
    densities.A[..., :d] += x.acceleration - el.rho[..., None] * f.b
    densities.dA[:, :, :d] += convection
    densities.B[:, :, :d] -= (f.p @ el.N.T)[..., None, None] * identity
    densities.A[..., d] += div
    densities.dA[:, :, d] += d_div
    _add_stresses(
        densities, el, f, x, None, convection - np.einsum("eql,mi->eqmli", x.grad_p, identity)
    )
    if el.convection:
        _add_lsic(densities, el, div, d_div)


def _add_stresses(densities, el, f, x, derivatives, strong):
    """Add viscosity, SUPG, τ ρ r_m c_j, and PSPG, τ n r_j.

    strong : (E, Q, d, d, d), the derivative of r without viscosity by H
    """
    d = x.grad_p.shape[-1]
    if el.mu:
        _add_viscous(densities, el, x, derivatives)
    if el.second is not None:
        strong = strong - _viscous_force_by_geometry(el, f, x, derivatives)
    if derivatives is not None:  # ρ and n before r, which both change like n
        strong = strong + _by_volume((derivatives.n / el.n)[..., None] * x.residual)
    pspg = el.tau * el.n
    densities.B[:, :, d] += pspg[..., None] * x.residual
    densities.dB[:, :, d] += pspg[..., None, None, None] * strong
    if el.convection:
        supg = el.tau_supg * el.rho
        densities.B[:, :, :d] += (
            supg[..., None, None] * x.residual[..., :, None] * x.c[..., None, :]
        )
        densities.dB[:, :, :d] += np.einsum(
            "eqmli,eqj->eqmjli", supg[..., None, None, None] * strong, x.c
        )


def _add_lsic(densities, el, div, change):
    """Add LSIC, n ν_L div δ_mj, of a divergence (E, Q) and its derivative by H (E, Q, d, d)."""
    d = change.shape[-1]
    weight = el.n * el.nu_lsic
    densities.B[:, :, :d] += (weight * div)[..., None, None] * np.eye(d)
    densities.dB[:, :, :d] += np.einsum(
        "eqli,mj->eqmjli", weight[..., None, None] * change, np.eye(d)
    )


def _add_viscous(densities, el, x, derivatives):
    """Add the viscous stress n μ (∂_j v_m + ∂_m v_j)."""
    d = x.grad_p.shape[-1]
    mu = el.mu
    identity = np.eye(d)
    stress = x.grad_v + np.swapaxes(x.grad_v, 2, 3)
    turned = np.einsum("eqml,ji->eqmjli", x.grad_v, identity) + np.einsum(
        "eqjl,mi->eqmjli", x.grad_v, identity
    )
    densities.B[:, :, :d] += mu * el.n[..., None, None] * stress
    densities.dB[:, :, :d] -= mu * el.n[..., None, None, None, None] * turned
    if derivatives is not None:
        densities.dB[:, :, :d] += mu * np.einsum(
            "eq,eqmj,li->eqmjli", derivatives.n, stress, identity
        )


def _viscous_force_by_geometry(el, f, x, derivatives):
    """Return the derivative of `flow.viscous_force` by H, (E, Q, d, d, d); that by ∇H is in
    `_add_curving`.

    δ(∂_i∂_j v) = -∂_m∂_j v H_mi - ∂_i∂_m v H_mj, and δ(∂_j n) = -∂_m n H_mj - ∂_j n tr H because J
    n_s is constant (or n).
    """
    s = el.second.field(f.v, x.grad_v)
    identity = np.eye(x.grad_p.shape[-1])
    d_inner = (
        2 * np.einsum("eqmil->eqmli", s)
        + np.einsum("eqiml->eqmli", s)
        + np.einsum("eqjjl,mi->eqmli", s, identity)
    )
    force = -el.n[..., None, None, None] * d_inner
    if derivatives is not None:
        force += _by_volume(derivatives.n[..., None] * el.second.viscous(f.v, x.grad_v))
    if el.grad_n is not None:
        stress = x.grad_v + np.swapaxes(x.grad_v, 2, 3)
        grad_n = el.grad_n
        force -= np.einsum("eqml,eqi->eqmli", x.grad_v, grad_n) + np.einsum(
            "eqjl,eqj,mi->eqmli", x.grad_v, grad_n, identity
        )
        force -= np.einsum("eqmi,eql->eqmli", stress, grad_n) + _by_volume(
            (stress @ grad_n[..., None])[..., 0]
        )
    return el.mu * force


def _add_undrained(densities, el, dp):
    """Add the undrained-limit term, B = f - mean f with f = τ_u (g - mean g), as far as it depends
    on g at the point.
    """
    d = el.geometry.G.shape[-1]
    g, _, f, mean = _undrained_fluxes(el, dp)
    densities.B[:, :, d] += f - mean
    densities.dB[:, :, d] -= np.einsum("eql,eqji->eqjli", g, el.tau_u)


def _undrained_fluxes(el, dp):
    """Return g = ∇dp (E, Q, d), its mean, f = τ_u (g - mean g) and the mean of f; means (E, 1, d),
    zero on linear elements.
    """
    dV = el.geometry.dV
    g = broadcast_gradient(
        (np.swapaxes(el.geometry.G, 2, 3) @ dp[:, None, :, None])[..., 0][:, :, None], dV.shape[1]
    )[:, :, 0]
    if el.order == 1:
        none = np.zeros((len(g), 1, g.shape[-1]))
        return g, none, _times(el.tau_u, g), none
    mean = _mean(dV, g)
    f = _times(el.tau_u, g - mean)
    return g, mean, f, _mean(dV, f)


def _times(tensors, vectors):
    """Return T·x, (E, Q, d), of tensors (E, Q, d, d)."""
    return (tensors @ vectors[..., None])[..., 0]


def _mean(dV, X):
    """Return the mean over the element of X (E, Q, ...), (E, 1, ...)."""
    weights = (dV / dV.sum(axis=1, keepdims=True)).reshape(*dV.shape, *(1,) * (X.ndim - 2))
    return (weights * X).sum(axis=1, keepdims=True)


def _undrained_means(el, dp):
    """Return what the change of the two means adds to the volume row on quadratic elements, (E, A,
    A, d).

    -(∫ τ_u ∇N_a)·δ(mean g) - (∫ ∇N_a)·δ(mean f); a mean changes with its weights too, δ(dV) = ∂_l
    N_b dV.
    """
    G = el.geometry.G
    dV = el.geometry.dV
    g, mean_g, f, mean_f = _undrained_fluxes(el, dp)
    turned = -np.einsum("eql,eqbj->eqblj", g, G)
    d_mean_g = _mean(dV, turned + np.einsum("eqbl,eqj->eqblj", G, g - mean_g))
    turned_f = np.einsum("eqblj,eqji->eqbli", turned - d_mean_g, el.tau_u)
    d_mean_f = _mean(dV, turned_f + np.einsum("eqbl,eqj->eqblj", G, f - mean_f))
    left = np.einsum("eq,eqaj,eqji->eai", dV, G, el.tau_u, optimize=True)
    return -np.einsum("eaj,eblj->eabl", left, d_mean_g[:, 0]) - np.einsum(
        "eq,eqaj,eblj->eabl", dV, G, d_mean_f[:, 0]
    )


def _add_curving(K, el, x, derivatives):
    """Add the part of SUPG and PSPG by ∇H, the second derivatives of δy, in place.

    Of -div(2 n μ sym ∇v): μ n (∂_l v_m ∂_i∂_i + ∂_l v_i ∂_m∂_i) δy_l - μ J dn/dJ (∂_m v_j + ∂_j
    v_m) ∂_j∂_l δy_l.
    """
    dV = el.geometry.dV
    shapes = el.second.shapes
    d = x.grad_p.shape[-1]
    G = broadcast_gradient(el.geometry.G, dV.shape[1])
    E, Q, A = G.shape[:3]
    rows = shapes.reshape(E, Q, A * d, d)
    change = np.einsum("eqbii->eqb", shapes)[..., None, None] * x.grad_v[:, :, None]
    change += (rows @ x.grad_v).reshape(shapes.shape)
    change *= el.n[..., None, None, None]
    if derivatives is not None:
        stress = x.grad_v + np.swapaxes(x.grad_v, 2, 3)
        change -= np.swapaxes(
            (rows @ (derivatives.n[..., None, None] * stress)).reshape(shapes.shape), 3, 4
        )
    change *= (el.mu * dV)[..., None, None, None]
    streamline = (
        (el.tau_supg * el.rho)[..., None] * (G @ x.c[..., None])[..., 0] if el.convection else None
    )
    for m in range(d):
        right = change[:, :, :, m].reshape(E, Q, A * d)
        K[:, :, d] += bilinear((el.tau * el.n)[..., None] * G[..., m], right).reshape(E, A, A, d)
        if el.convection:
            K[:, :, m] += bilinear(streamline, right).reshape(E, A, A, d)


def _assemble(N, geometry, x):
    """Return the element matrices (E, A, k, A, d) of densities by the formula above."""
    dV = geometry.dV
    E, _, A, d = geometry.G.shape
    Q, k = x.A.shape[1:]
    G = broadcast_gradient(geometry.G, Q)
    identity = np.eye(d)
    right = np.empty((E, Q, k, 1 + d, d, d))
    right[:, :, :, 0] = x.dA + x.A[..., None, None] * identity
    right[:, :, :, 1:] = (
        x.dB + x.B[..., None, None] * identity - np.einsum("eqki,jl->eqkjli", x.B, identity)
    )
    tests = (
        np.concatenate([np.broadcast_to(N, (E, Q, A))[:, :, None], np.swapaxes(G, 2, 3)], axis=2)
        * dV[..., None, None]
    )
    tests = tests.reshape(E, Q * (1 + d), A)
    K = np.empty((E, A, k, A, d))
    for row in range(k):
        for column in range(d):
            change = right[:, :, row, :, column] @ np.swapaxes(G, 2, 3)
            K[:, :, row, :, column] = bilinear(tests, change.reshape(E, Q * (1 + d), A))
    return K
