"""Derivatives of the element residuals by the positions of a mesh that carries them: gradients, volumes, porosity and drag.

With H = ∂δy/∂x the geometry changes by δ(∂N_a/∂x_j) = -∂N_a/∂x_m H_mj, δdV = tr H dV, δJ = J tr H.  A residual of the form
Σ_q dV (N_a A_k + ∂_j N_a B_kj) therefore has the derivative by y_bl

    Σ_q dV (N_a DA_kli + ∂_j N_a DB_kjli) ∂_i N_b        DA_kli  = A_k δ_li + ∂A_k/∂H_li
                                                         DB_kjli = B_kj δ_li - B_ki δ_jl + ∂B_kj/∂H_li

Nodal values are kept, and so is what is frozen at the start of a step (τ, ν_L, τ_u).  The dependence on v_s is in `exchange`.
"""

from dataclasses import dataclass

import numpy as np

from .assemble import bilinear, broadcast_gradient
from .flow import flow_points


@dataclass(frozen=True)
class VolumeDerivatives:
    """How the coefficients follow the volume: J dn_f/dJ and J dS/dJ, (E, Q)."""

    n: np.ndarray
    S: np.ndarray


@dataclass(frozen=True)
class Densities:
    """A (E, Q, k), B (E, Q, k, d) and their derivatives by H, DA (E, Q, k, d, d) and DB (E, Q, k, d, d, d), geometry left out."""

    A: np.ndarray
    B: np.ndarray
    dA: np.ndarray
    dB: np.ndarray

    @classmethod
    def zeros(cls, points, k, d):
        """Return densities of k components at points (E, Q)."""
        return cls(*(np.zeros((*points, *shape)) for shape in ((k,), (k, d), (k, d, d), (k, d, d, d))))


def solid_by_geometry(N, geometry, n, S, derivatives, p, w):
    """Return the derivative of `solid.coupling_residual` by y through the geometry, (E, A, d, A, d) [N/m].

    p (E, A) [Pa], w (E, A, d) = v_f - v_s [m/s].
    """
    d = geometry.G.shape[-1]
    identity, w = np.eye(d), N @ w
    grad_p = (np.swapaxes(geometry.G, 2, 3) @ p[:, None, :, None])[..., 0]
    x = Densities.zeros(geometry.dV.shape, d, d)
    x.A[...] = -n[..., None] * grad_p - S[..., None] * w
    x.B[...] = -(p @ N.T)[..., None, None] * identity
    x.dA[...] = -_pressure_by_geometry(n, derivatives, grad_p) - _by_volume(derivatives.S[..., None] * w)
    return _assemble(N, geometry, x)


def flow_by_geometry(el, f, derivatives):
    """Return the derivative of `flow.flow_residual` by y through the geometry, (E, A, d + 1, A, d) [N/m and m²/s]."""
    x = flow_points(el, f)
    d = el.geometry.G.shape[-1]
    densities = Densities.zeros(el.geometry.dV.shape, d + 1, d)
    gradients = _Gradients.of(el, f, x)
    strong = _add_momentum(densities, el, f, x, derivatives, gradients)
    _add_volume(densities, el, x, derivatives, gradients, strong)
    _add_undrained(densities, el, f.dp)
    K = _assemble(el.N, el.geometry, densities)
    if el.second is not None:
        _add_curving(K, el, x, derivatives)
    if el.order > 1:
        K[:, :, d] += _undrained_means(el, f.dp)
    return K


@dataclass(frozen=True)
class _Gradients:
    """∇v_s and div v, div v_s with their derivatives by H, -∂v_i/∂x_l."""

    v_s: np.ndarray
    div: np.ndarray
    div_s: np.ndarray
    d_div: np.ndarray
    d_div_s: np.ndarray

    @classmethod
    def of(cls, el, f, x):
        v_s = np.broadcast_to(np.swapaxes(f.v_s, 1, 2)[:, None] @ el.geometry.G, (*el.n.shape, *x.grad_v.shape[2:]))
        div, div_s = (np.trace(gradient, axis1=2, axis2=3) for gradient in (x.grad_v, v_s))
        return cls(v_s, div, div_s, -np.swapaxes(x.grad_v, 2, 3), -np.swapaxes(v_s, 2, 3))


def _by_volume(X):
    """Return X δ_li, the derivative by H of what changes by X tr H."""
    return X[..., None, None] * np.eye(X.shape[-1])


def _pressure_by_geometry(n, derivatives, grad_p):
    """Return the derivative of n ∂p/∂x_m by H, (E, Q, d, d, d)."""
    turned = n[..., None] * grad_p
    identity = np.eye(grad_p.shape[-1])
    return _by_volume(derivatives.n[..., None] * grad_p) - np.einsum("eql,mi->eqmli", turned, identity)


def _add_momentum(densities, el, f, x, derivatives, gradients):
    """Add the momentum rows; return the derivative of the strong residual by H, (E, Q, d, d, d)."""
    d = x.w.shape[-1]
    relative = (derivatives.n / el.n)[..., None]
    weight = relative * (x.acceleration - el.rho[..., None] * f.b) + derivatives.S[..., None] * x.w
    strong = _by_volume(weight) + _pressure_by_geometry(el.n, derivatives, x.grad_p)
    if el.convection:
        strong -= el.rho[..., None, None, None] * np.einsum("eqml,eqi->eqmli", x.grad_v, x.c)
    pressure, drag = el.n[..., None] * x.grad_p, el.S[..., None] * x.w
    densities.A[..., :d] += x.acceleration + pressure + drag - el.rho[..., None] * f.b
    densities.dA[:, :, :d] += strong
    if el.mu:
        _add_viscous(densities, el, x, derivatives)
    if el.second is not None:
        strong = strong - _viscous_force_by_geometry(el, f, x, derivatives)
    if el.convection:
        _add_convection(densities, el, x, derivatives, gradients, strong)
    return strong


def _add_viscous(densities, el, x, derivatives):
    d, mu = x.w.shape[-1], el.mu
    identity, stress = np.eye(d), x.grad_v + np.swapaxes(x.grad_v, 2, 3)
    turned = np.einsum("eqml,ji->eqmjli", x.grad_v, identity) + np.einsum("eqjl,mi->eqmjli", x.grad_v, identity)
    densities.B[:, :, :d] += mu * el.n[..., None, None] * stress
    densities.dB[:, :, :d] += mu * np.einsum("eq,eqmj,li->eqmjli", derivatives.n, stress, identity)
    densities.dB[:, :, :d] -= mu * el.n[..., None, None, None, None] * turned


def _viscous_force_by_geometry(el, f, x, derivatives):
    """Return the derivative of `flow.viscous_force` by H, (E, Q, d, d, d); that by ∇H is in `_add_curving`.

    δ(∂_i∂_j v) = -∂_m∂_j v H_mi - ∂_i∂_m v H_mj, and δ(∂_j n) = -∂_m n H_mj - ∂_j n tr H because J n_s is constant (or n).
    """
    identity, n = np.eye(x.w.shape[-1]), el.n[..., None, None, None]
    s, stress = el.second.field(f.v, x.grad_v), x.grad_v + np.swapaxes(x.grad_v, 2, 3)
    d_inner = 2 * np.einsum("eqmil->eqmli", s) + np.einsum("eqiml->eqmli", s) + np.einsum("eqjjl,mi->eqmli", s, identity)
    d_stress = np.einsum("eqml,eqi->eqmli", x.grad_v, el.grad_n) + np.einsum("eqjl,eqj,mi->eqmli", x.grad_v, el.grad_n, identity)
    d_grad_n = np.einsum("eqmi,eql->eqmli", stress, el.grad_n)
    volume = derivatives.n[..., None] * el.second.viscous(f.v, x.grad_v) - (stress @ el.grad_n[..., None])[..., 0]
    return el.mu * (_by_volume(volume) - n * d_inner - d_stress - d_grad_n)


def _add_convection(densities, el, x, derivatives, gradients, strong):
    """Add SUPG, τ ρ r_m c_j, and LSIC, n ν_L (div v_s + n div w) δ_mj."""
    d = x.w.shape[-1]
    identity, rho = np.eye(d), el.tau_supg * el.rho
    by_volume = _by_volume((rho * derivatives.n / el.n)[..., None] * x.residual)
    densities.B[:, :, :d] += rho[..., None, None] * x.residual[..., :, None] * x.c[..., None, :]
    densities.dB[:, :, :d] += np.einsum("eqmli,eqj->eqmjli", by_volume + rho[..., None, None, None] * strong, x.c)
    n_nu, n = el.n * el.nu_lsic, el.n[..., None, None]  # n is constant where ν_L is not zero
    total = gradients.div_s + el.n * (gradients.div - gradients.div_s)
    change = n_nu[..., None, None] * (gradients.d_div_s + n * (gradients.d_div - gradients.d_div_s))
    densities.B[:, :, :d] += (n_nu * total)[..., None, None] * identity
    densities.dB[:, :, :d] += np.einsum("eqli,mj->eqmjli", change, identity)


def _add_volume(densities, el, x, derivatives, gradients, strong):
    """Add the volume row: div v_s, the seepage -n w and PSPG's τ n r."""
    d = x.w.shape[-1]
    flux = el.tau[..., None] * x.residual - x.w
    densities.A[..., d] += gradients.div_s
    densities.dA[:, :, d] += gradients.d_div_s
    densities.B[:, :, d] += el.n[..., None] * flux
    densities.dB[:, :, d] += _by_volume(derivatives.n[..., None] * flux) + (el.tau * el.n)[..., None, None, None] * strong


def _add_undrained(densities, el, dp):
    """Add the undrained-limit term, B = f - mean f with f = τ_u (g - mean g), as far as it depends on g at the point."""
    d = el.geometry.G.shape[-1]
    g, _, f, mean = _undrained_fluxes(el, dp)
    densities.B[:, :, d] += f - mean
    densities.dB[:, :, d] -= np.einsum("eql,eqji->eqjli", g, el.tau_u)


def _undrained_fluxes(el, dp):
    """Return g = ∇dp (E, Q, d), its mean, f = τ_u (g - mean g) and the mean of f; means (E, 1, d), zero on linear elements."""
    dV = el.geometry.dV
    g = broadcast_gradient((np.swapaxes(el.geometry.G, 2, 3) @ dp[:, None, :, None])[..., 0][:, :, None], dV.shape[1])[:, :, 0]
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
    """Return what the change of the two means adds to the volume row on quadratic elements, (E, A, A, d).

    -(∫ τ_u ∇N_a)·δ(mean g) - (∫ ∇N_a)·δ(mean f); a mean changes with its weights too, δ(dV) = ∂_l N_b dV.
    """
    G, dV = el.geometry.G, el.geometry.dV
    g, mean_g, f, mean_f = _undrained_fluxes(el, dp)
    turned = -np.einsum("eql,eqbj->eqblj", g, G)
    d_mean_g = _mean(dV, turned + np.einsum("eqbl,eqj->eqblj", G, g - mean_g))
    turned_f = np.einsum("eqblj,eqji->eqbli", turned - d_mean_g, el.tau_u)
    d_mean_f = _mean(dV, turned_f + np.einsum("eqbl,eqj->eqblj", G, f - mean_f))
    left = np.einsum("eq,eqaj,eqji->eai", dV, G, el.tau_u, optimize=True)
    return -np.einsum("eaj,eblj->eabl", left, d_mean_g[:, 0]) - np.einsum("eq,eqaj,eblj->eabl", dV, G, d_mean_f[:, 0])


def _add_curving(K, el, x, derivatives):
    """Add the part of SUPG and PSPG by ∇H, the second derivatives of δy, in place.

    Of -div(2 n μ sym ∇v): μ n (∂_l v_m ∂_i∂_i + ∂_l v_i ∂_m∂_i) δy_l - μ J dn/dJ (∂_m v_j + ∂_j v_m) ∂_j∂_l δy_l.
    """
    dV, shapes, d = el.geometry.dV, el.second.shapes, x.w.shape[-1]
    G = broadcast_gradient(el.geometry.G, dV.shape[1])
    stress = x.grad_v + np.swapaxes(x.grad_v, 2, 3)
    E, Q, A = G.shape[:3]
    rows = shapes.reshape(E, Q, A * d, d)
    change = np.einsum("eqbii->eqb", shapes)[..., None, None] * x.grad_v[:, :, None]
    change += (rows @ x.grad_v).reshape(shapes.shape)
    change *= el.n[..., None, None, None]
    change -= np.swapaxes((rows @ (derivatives.n[..., None, None] * stress)).reshape(shapes.shape), 3, 4)
    change *= (el.mu * dV)[..., None, None, None]
    streamline = (el.tau_supg * el.rho)[..., None] * (G @ x.c[..., None])[..., 0] if el.convection else None
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
    right[:, :, :, 1:] = x.dB + x.B[..., None, None] * identity - np.einsum("eqki,jl->eqkjli", x.B, identity)
    tests = np.concatenate([np.broadcast_to(N, (E, Q, A))[:, :, None], np.swapaxes(G, 2, 3)], axis=2) * dV[..., None, None]
    tests = tests.reshape(E, Q * (1 + d), A)
    K = np.empty((E, A, k, A, d))
    for row in range(k):
        for column in range(d):
            change = right[:, :, row, :, column] @ np.swapaxes(G, 2, 3)
            K[:, :, row, :, column] = bilinear(tests, change.reshape(E, Q * (1 + d), A))
    return K
