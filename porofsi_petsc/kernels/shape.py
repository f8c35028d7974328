"""Derivatives of the element residuals by the positions of a mesh that carries them: gradients,
volumes, porosity and drag.

With H = ∂δy/∂x the geometry changes by δ(∂N_a/∂x_j) = -∂N_a/∂x_m H_mj, δdV = tr H dV, δJ = J tr H.
A residual of the form Σ_q dV (N_a A_k + ∂_j N_a B_kj) therefore has the derivative by y_bl

    Σ_q dV (N_a DA_kli + ∂_j N_a DB_kjli) ∂_i N_b        DA_kli  = A_k δ_li + ∂A_k/∂H_li
                                                         DB_kjli = B_kj δ_li - B_ki δ_jl +
                                                         ∂B_kj/∂H_li

Nodal values are kept, and so is what is frozen at the start of a step (τ, ν_L, τ_u).  The
dependence on v_s is in `exchange`.

Around an axis all this holds at a point in space with the directions r, z and, third, around the
axis, in which vectors have no component, but gradients v_r/r; below d is then 3.  Only the test
functions and δy know of the axis: ∇(N e_r) has the third diagonal entry N/r, ∇(N e_z) none.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .arguments import Drag, Geometry
from .assemble import bilinear, broadcast_gradient
from .flow import FlowElements, FlowFields, FlowPoints, flow_points
from .solid import displacement_gradient


@dataclass(frozen=True)
class VolumeDerivatives:
    """How the coefficients follow the volume: J dn/dJ and (J dρ/dJ)/ρ, both (E, Q), and J dS/dJ."""

    n: np.ndarray
    density: np.ndarray
    drag: Drag


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
    drag: Drag,
    derivatives: VolumeDerivatives,
    p: np.ndarray,
    w: np.ndarray,
) -> np.ndarray:
    """Return the derivative of `solid.coupling_residual` by y through the geometry, (E, A, d, A, d)
    [N/m].

    p (E, A) [Pa], w (E, A, d) = v_f - v_s [m/s].
    """
    d = _directions(geometry)
    identity = np.eye(d)
    w = _in_space(N @ w, d)
    grad_p = _in_space((np.swapaxes(geometry.G, 2, 3) @ p[:, None, :, None])[..., 0], d)
    x = Densities.zeros(geometry.dV.shape, d, d)
    x.A[...] = -n[..., None] * grad_p - drag.on(w)
    x.B[...] = -(p @ N.T)[..., None, None] * identity
    x.dA[...] = -_pressure_by_geometry(n, derivatives, grad_p) - _by_volume(derivatives.drag.on(w))
    return _assemble(N, geometry, x)


def drag_by_geometry(
    N: np.ndarray, geometry: Geometry, drag: Drag, slope: Drag, w: np.ndarray
) -> np.ndarray:
    """Return the derivative of the drag of `solid.coupling_residual` alone by y through the
    geometry, (E, A, d, A, d) [N/m].

    slope : J dS/dJ; w (E, A, d) = v - v_s [m/s].
    """
    d = _directions(geometry)
    w = _in_space(N @ w, d)
    x = Densities.zeros(geometry.dV.shape, d, d)
    x.A[...] = -drag.on(w)
    x.dA[...] = -_by_volume(slope.on(w))
    return _assemble(N, geometry, x)


def flow_by_geometry(
    el: FlowElements, f: FlowFields, derivatives: VolumeDerivatives | None
) -> np.ndarray:
    """Return the derivative of `flow.flow_residual` by y through the geometry, (E, A, d + 1, A, d)
    [N/m and m²/s].

    derivatives : `VolumeDerivatives`, None for a free fluid outside of pores
    """
    d = _directions(el.geometry)
    x = _points_in_space(flow_points(el, f), d)
    densities = Densities.zeros(el.geometry.dV.shape, d + 1, d)
    if el.free:
        _add_free(densities, el, f, x, derivatives)
    else:
        _add_porous(densities, el, f, x, derivatives)
    if el.tau_u is not None:
        _add_undrained(densities, el, f.dp)
    K = _assemble(el.N, el.geometry, densities)
    if el.second is not None:
        _add_curving(K, el, x, derivatives)
    if el.order > 1 and el.tau_u is not None:
        K[:, :, -1] += _undrained_means(el, f.dp)
    return K


def _directions(geometry):
    """Return the number of directions of a gradient of a vector: that of the space, around an axis
    too.
    """
    return geometry.G.shape[-1] + (geometry.hoop is not None)


def _in_space(X, d):
    """Return vectors (E, Q, d) of vectors that may lack the component around the axis, 0."""
    missing = d - X.shape[-1]
    if not missing:
        return X
    return np.concatenate([X, np.zeros((*X.shape[:-1], missing))], axis=-1)


def _points_in_space(x, d):
    """Return the `FlowPoints` with vectors in space."""
    c, acceleration, grad_p, w, residual = (
        None if vectors is None else _in_space(vectors, d)
        for vectors in (x.c, x.acceleration, x.grad_p, x.w, x.residual)
    )
    return FlowPoints(c, x.grad_v, acceleration, grad_p, w, residual)


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
            displacement_gradient(el.geometry.G, f.v_s, el.geometry.hoop), x.grad_v.shape
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
    body = el.rho[..., None] * _in_space(f.b, d)
    strong = _inertia_and_drag_by_volume(x, body, derivatives)
    strong += _pressure_by_geometry(el.n, derivatives, x.grad_p) + _convection_by_geometry(el, x)
    densities.A[..., :d] += x.acceleration + el.n[..., None] * x.grad_p + el.drag.on(x.w) - body
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


def _inertia_and_drag_by_volume(x, body, derivatives):
    """Return the derivative of ρ (a + c·∇v - b) + S w by H as far as ρ and S change with tr H,
    (E, Q, d, d, d).
    """
    relative = derivatives.density[..., None]
    return _by_volume(relative * (x.acceleration - body) + derivatives.drag.on(x.w))


def _add_free(densities, el, f, x, derivatives):
    """Add the rows of a free fluid: values ρ (a + c·∇v) - ρ b, with S w in pores, and div v,
    stresses with -p δ_mj, and stabilization.
    """
    d = x.grad_p.shape[-1]
    identity = np.eye(d)
    strong = _convection_by_geometry(el, x)
    div = np.trace(x.grad_v, axis1=2, axis2=3)
    d_div = -np.swapaxes(x.grad_v, 2, 3)
    body = el.rho[..., None] * _in_space(f.b, d)
    densities.A[..., :d] += x.acceleration - body
    if derivatives is not None:  # the weight of the fluid in pores is that of the whole volume
        densities.A[..., :d] += el.drag.on(x.w)
        strong = strong + _inertia_and_drag_by_volume(x, 0.0, derivatives)
    densities.dA[:, :, :d] += strong
    densities.B[:, :, :d] -= (f.p @ el.N.T)[..., None, None] * identity
    densities.A[..., d] += div
    densities.dA[:, :, d] += d_div
    strong = strong - np.einsum("eql,mi->eqmli", x.grad_p, identity)
    _add_stresses(densities, el, f, x, derivatives, strong)
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
    pspg = el.tau * el.n
    densities.B[:, :, d] += pspg[..., None] * x.residual
    by_n, by_density = strong, strong  # of what is before r
    if derivatives is not None:
        by_n = strong + _by_volume((derivatives.n / el.n)[..., None] * x.residual)
        by_density = strong + _by_volume(derivatives.density[..., None] * x.residual)
    densities.dB[:, :, d] += pspg[..., None, None, None] * by_n
    if el.convection:
        supg = el.tau_supg * el.rho
        densities.B[:, :, :d] += (
            supg[..., None, None] * x.residual[..., :, None] * x.c[..., None, :]
        )
        densities.dB[:, :, :d] += np.einsum(
            "eqmli,eqj->eqmjli", supg[..., None, None, None] * by_density, x.c
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
    d = x.grad_p.shape[-1]
    identity = np.eye(d)
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
        grad_n = _in_space(el.grad_n, d)
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
    densities.B[:, :, -1, :d] += f - mean
    densities.dB[:, :, -1, :d, :d, :d] -= np.einsum("eql,eqji->eqjli", g, el.tau_u)


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

    -(∫ τ_u ∇N_a)·δ(mean g) - (∫ ∇N_a)·δ(mean f); a mean changes with its weights too, δ(dV) =
    div(N_b e_l) dV.
    """
    G = el.geometry.G
    div = el.geometry.divergence
    dV = el.geometry.dV
    g, mean_g, f, mean_f = _undrained_fluxes(el, dp)
    turned = -np.einsum("eql,eqbj->eqblj", g, G)
    d_mean_g = _mean(dV, turned + np.einsum("eqbl,eqj->eqblj", div, g - mean_g))
    turned_f = np.einsum("eqblj,eqji->eqbli", turned - d_mean_g, el.tau_u)
    d_mean_f = _mean(dV, turned_f + np.einsum("eqbl,eqj->eqblj", div, f - mean_f))
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
    G = broadcast_gradient(el.geometry.G, dV.shape[1])
    E, Q, A, d = G.shape
    rows = shapes.reshape(E, Q, A * d, d)
    grad_v = x.grad_v[..., :d, :d]
    change = np.einsum("eqbii->eqb", shapes)[..., None, None] * grad_v[:, :, None]
    change += (rows @ grad_v).reshape(shapes.shape)
    change *= el.n[..., None, None, None]
    if derivatives is not None:
        stress = grad_v + np.swapaxes(grad_v, 2, 3)
        change -= np.swapaxes(
            (rows @ (derivatives.n[..., None, None] * stress)).reshape(shapes.shape), 3, 4
        )
    if el.geometry.hoop is not None:
        _add_curving_around(change, el, x, derivatives)
    change *= (el.mu * dV)[..., None, None, None]
    streamline = (
        (el.tau_supg * el.rho)[..., None] * (G @ x.c[..., :d, None])[..., 0]
        if el.convection
        else None
    )
    for m in range(d):
        right = change[:, :, :, m].reshape(E, Q, A * d)
        K[:, :, d] += bilinear((el.tau * el.n)[..., None] * G[..., m], right).reshape(E, A, A, d)
        if el.convection:
            K[:, :, m] += bilinear(streamline, right).reshape(E, A, A, d)


def _add_curving_around(change, el, x, derivatives):
    """Add to (E, Q, A, m, l) what the second derivatives of δy around the axis change, in place;
    those of δy = N e_r are ∂_θ∂_θ δy_r = ∂_r∂_θ δy_θ = ∂_r (N/r) and ∂_z∂_θ δy_θ = ∂_z N/r, that of
    N e_z ∂_θ∂_θ δy_z = ∂_r N/r.
    """
    radial, axial, other = el.second.shapes_around
    grad_v = x.grad_v[:, :, None]
    n = el.n[..., None]
    change[..., 0] += (n * radial)[..., None] * grad_v[..., :2, 0]
    change[..., 1] += (n * other)[..., None] * grad_v[..., :2, 1]
    change[..., 0, 0] += n * radial * grad_v[..., 2, 2]
    change[..., 1, 0] += n * axial * grad_v[..., 2, 2]
    if derivatives is not None:
        slope = np.stack([radial, axial], axis=-1)
        stress = grad_v[..., :2, :2] + np.swapaxes(grad_v[..., :2, :2], -1, -2)
        change[..., 0] -= derivatives.n[..., None, None] * (stress @ slope[..., None])[..., 0]


def _assemble(N, geometry, x):
    """Return the element matrices (E, A, k, A, d) of densities by the formula above; around an axis
    without the row of the third direction.
    """
    dV = geometry.dV
    E, _, A, d = geometry.G.shape
    Q, k = x.A.shape[1:]
    G = broadcast_gradient(geometry.G, Q)
    right = _changes(x)
    tests = (
        np.concatenate([np.broadcast_to(N, (E, Q, A))[:, :, None], np.swapaxes(G, 2, 3)], axis=2)
        * dV[..., None, None]
    )
    tests = tests.reshape(E, Q * (1 + d), A)

    def change(row, test, column):
        """Return what δy = N_b e_column does to what tests are multiplied with, (E, Q, T, A)."""
        found = right[:, :, row, test, column, :d] @ np.swapaxes(G, 2, 3)
        if geometry.hoop is not None and column == 0:
            found += right[:, :, row, test, d, d, None] * geometry.hoop[:, :, None]
        return found

    rows = range(k) if geometry.hoop is None else [row for row in range(k) if row != d]
    K = np.empty((E, A, len(rows), A, d))
    for i, row in enumerate(rows):
        for column in range(d):
            plane = change(row, slice(1 + d), column)
            K[:, :, i, :, column] = bilinear(tests, plane.reshape(E, Q * (1 + d), A))
    if geometry.hoop is not None:
        for column in range(d):
            around = change(d, slice(1 + d, 2 + d), column)[:, :, 0]
            K[:, :, 0, :, column] += bilinear(geometry.hoop * dV[..., None], around)
    return K


def _changes(x):
    """Return DA and DB of the formula above, (E, Q, k, 1 + d, d, d)."""
    E, Q, k, d = x.B.shape
    identity = np.eye(d)
    right = np.empty((E, Q, k, 1 + d, d, d))
    right[:, :, :, 0] = x.dA + x.A[..., None, None] * identity
    right[:, :, :, 1:] = (
        x.dB + x.B[..., None, None] * identity - np.einsum("eqki,jl->eqkjli", x.B, identity)
    )
    return right
