"""Compiled loops of `flow` over elements and points.

At a point the residuals of node a are N_a A_i + ∂_j N_a B_ij dV, row i < d of the momentum and row
d of the volume balance.  The densities A, B and their derivatives by the nodal unknowns are those
in the docstring of `flow`.

A nodes, d dimensions, m unknowns per node in the matrix; affine: gradients are constant over an
element, and G has one point; even: so are second derivatives by the reference coordinates, and
hessian and bend have one; ring: the elements are rings around an axis, components r and z, and a
gradient of a vector has a third diagonal entry, v_r/r, an index d in what follows; tensor: the drag
is S D_ij, and what it adds comes after the rest, so that loops for S δ_ij have nothing of it.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..compiled import expanded, inlined, specialized, stack
from .contraction import add_point

# Terms of the balances: those of the momentum have d columns each, those of the volume balance,
# behind them, one.
MOMENTUM_TERMS = ("inertia", "pressure", "drag", "body", "viscous", "stabilization")
VOLUME_TERMS = ("skeleton", "seepage", "pspg", "undrained")
INERTIA, PRESSURE, DRAG, BODY, VISCOUS, STABILIZATION = range(len(MOMENTUM_TERMS))
VOLUME = len(MOMENTUM_TERMS)  # times d: the first column of the volume balance
SKELETON, SEEPAGE, PSPG, UNDRAINED = range(len(VOLUME_TERMS))


def term_columns(d: int) -> int:
    """Return the number of columns of all terms in d dimensions."""
    return VOLUME * d + len(VOLUME_TERMS)


class Elements(NamedTuple):
    """`flow.FlowElements` for a compiled loop: an array that is not there is empty, and a flag says
    so.

    D (d, d), empty for δ_ij; hoop (E, Q, A) of `fem.geometry.Geometry`; nodes (A, d) on the
    reference cell, hessian (Q' A, d, d) and bend (E Q', d, d²) of
    `fem.geometry.SecondDerivatives`, Q' = 1 where they are constant; drag: S δ_ij is there;
    fluctuation: the mean gradient is left out of the undrained term
    """

    N: np.ndarray
    G: np.ndarray
    dV: np.ndarray
    n: np.ndarray
    rho: np.ndarray
    S: np.ndarray
    D: np.ndarray
    mu: float
    tau: np.ndarray
    tau_supg: np.ndarray
    nu_lsic: np.ndarray
    tau_u: np.ndarray
    nodes: np.ndarray
    hessian: np.ndarray
    bend: np.ndarray
    grad_n: np.ndarray
    hoop: np.ndarray
    convection: bool
    drag: bool
    undrained: bool
    curved: bool
    graded: bool
    fluctuation: bool
    free: bool


class FlowFields(NamedTuple):
    """Nodal values on the collocation level: v, a, c = v - v_m, v_s (E, A, d); p, dp = p - p_n (E,
    A); b (E, Q, d).

    v_s is not read for a free fluid without drag, c not without convection, dp not without the
    undrained term.
    """

    v: np.ndarray
    a: np.ndarray
    c: np.ndarray
    v_s: np.ndarray
    p: np.ndarray
    dp: np.ndarray
    b: np.ndarray


class Point(NamedTuple):
    """State at a point: shape gradients g (A, d), ∇v, ∇v_s (d, d), ∇p, c, w, forces (d,); d xi/dx,
    ∇∇U, mean of g, dr/dv_b.  Of a ring g and the gradients have d + 1 directions.
    """

    g: np.ndarray
    grad_v: np.ndarray
    grad_vs: np.ndarray
    grad_p: np.ndarray
    acceleration: np.ndarray
    c: np.ndarray
    w: np.ndarray
    residual: np.ndarray
    inverse: np.ndarray
    bent: np.ndarray
    second: np.ndarray
    hessian_v: np.ndarray
    mean: np.ndarray
    strong: np.ndarray


@expanded
def new_point(A: int, d: int, directions: int) -> Point:
    """Return the memory of a point."""
    return Point(
        stack((A, directions)),
        stack((directions, directions)),
        stack((directions, directions)),
        stack((d,)),
        stack((d,)),
        stack((d,)),
        stack((d,)),
        stack((d,)),
        stack((d, d)),
        stack((d, d)),
        stack((d, d)),
        stack((d, d, d)),
        stack((A, d)),
        stack((d, d)),
    )


@inlined
def set_point(
    A: int,
    d: int,
    affine: bool,
    even: bool,
    ring: bool,
    el: Elements,
    f: FlowFields,
    e: int,
    q: int,
    x: Point,
) -> None:
    """Set the state at point q of element e: r = ρ (a + c·∇v) + n ∇p + S w - ρ b - div(2 n μ sym
    ∇v).
    """
    if q == 0 or not affine:
        for a in range(A):
            for j in range(d):
                x.g[a, j] = el.G[e, 0 if affine else q, a, j]
            if ring:
                x.g[a, d] = el.hoop[e, q, a]
        _set_gradients(A, d, ring, f.v, e, x.g, x.grad_v)
        if not el.free:
            _set_gradients(A, d, ring, f.v_s, e, x.g, x.grad_vs)
    for i in range(d):
        acceleration = 0.0
        grad_p = 0.0
        for a in range(A):
            acceleration += el.N[q, a] * f.a[e, a, i]
            grad_p += x.g[a, i] * f.p[e, a]
        x.acceleration[i] = el.rho[e, q] * acceleration
        x.grad_p[i] = grad_p
    x.c[:] = 0.0
    if el.convection:
        _add_convection(A, d, el, f, e, q, x)
    for i in range(d):
        x.residual[i] = x.acceleration[i] - el.rho[e, q] * f.b[e, q, i] + el.n[e, q] * x.grad_p[i]
    if el.drag:
        _add_drag(A, d, el, f, e, q, x)
    if el.curved:
        _set_inverse_jacobian(A, d, el, x)
        _subtract_viscous_force(A, d, even, ring, el, f, e, q, x)


@inlined
def _set_gradients(A, d, ring, U, e, g, gradient):
    """Set dU_i/dx_j, (d, d), of nodal values U (E, A, d); of a ring U_r/r with it."""
    for i in range(d):
        for j in range(d):
            total = 0.0
            for a in range(A):
                total += U[e, a, i] * g[a, j]
            gradient[i, j] = total
    if ring:
        total = 0.0
        for a in range(A):
            total += U[e, a, 0] * g[a, d]
        gradient[d, d] = total


@inlined
def _add_convection(A, d, el, f, e, q, x):
    """Set c and add ρ c·∇v to the acceleration."""
    for i in range(d):
        c = 0.0
        for a in range(A):
            c += el.N[q, a] * f.c[e, a, i]
        x.c[i] = c
    for i in range(d):
        carried = 0.0
        for j in range(d):
            carried += x.grad_v[i, j] * x.c[j]
        x.acceleration[i] += el.rho[e, q] * carried


@inlined
def _add_drag(A, d, el, f, e, q, x):
    """Set w = v - v_s and add S w to the residual."""
    for i in range(d):
        w = 0.0
        for a in range(A):
            w += el.N[q, a] * (f.v[e, a, i] - f.v_s[e, a, i])
        x.w[i] = w
        x.residual[i] += el.S[e, q] * w


@inlined
def _add_tensor_drag(A, d, el, f, e, q, x):
    """Set w = v - v_s and add S D w to the residual."""
    for i in range(d):
        w = 0.0
        for a in range(A):
            w += el.N[q, a] * (f.v[e, a, i] - f.v_s[e, a, i])
        x.w[i] = w
    for i in range(d):
        x.residual[i] += _tensor_force(d, el, e, q, x, i)


@inlined
def _tensor_force(d, el, e, q, x, i):
    """Return S (D w)_i."""
    total = 0.0
    for j in range(d):
        total += el.D[i, j] * x.w[j]
    return el.S[e, q] * total


@inlined
def _set_inverse_jacobian(A, d, el, x):
    """Set dxi_m/dx_i, (d, d) [1/m]: the map represents xi by its values at the nodes."""
    for m in range(d):
        for i in range(d):
            inverse = 0.0
            for a in range(A):
                inverse += el.nodes[a, m] * x.g[a, i]
            x.inverse[m, i] = inverse


@inlined
def _set_second_derivatives(d, U, row, gradient, k, el, point, x):
    """Set d²U_k/dx_i dx_j = (d²U_k/dxi_m dxi_n - ∂_r U_k d²x_r/dxi_m dxi_n) dxi_m/dx_i dxi_n/dx_j,
    (d, d), of d²U_k/dxi_m dxi_n in a row of U (K, d, d) and bend at a point of all elements.
    """
    for m in range(d):
        for n in range(d):
            bent = U[row, m, n]
            for r in range(d):
                bent -= gradient[k, r] * el.bend[point, r, m * d + n]
            x.bent[m, n] = bent
    for i in range(d):
        for j in range(i + 1):
            total = 0.0
            for m in range(d):
                for n in range(d):
                    total += x.bent[m, n] * x.inverse[m, i] * x.inverse[n, j]
            x.second[i, j] = x.second[j, i] = total


@inlined
def _set_reference_hessian(A, d, el, f, e, first, x):
    """Set d²v_i/dxi_m dxi_n, (d, d, d) [m/s], from the rows of the nodes of the hessian."""
    for i in range(d):
        for m in range(d):
            for n in range(d):
                total = 0.0
                for a in range(A):
                    total += el.hessian[first + a, m, n] * f.v[e, a, i]
                x.hessian_v[i, m, n] = total


@inlined
def _subtract_viscous_force(A, d, even, ring, el, f, e, q, x):
    """Subtract div(2 n μ sym ∇v) = μ [n (Δv + ∇ div v) + (∇v + ∇vᵀ) ∇n] from the residual,
    [N/m³]; of a ring n μ (2 (∂_r v_r - v_r/r), ∂_r v_z + ∂_z v_r)/r with it.
    """
    scale = el.mu * el.n[e, q]
    if q == 0 or not even:
        _set_reference_hessian(A, d, el, f, e, 0 if even else q * A, x)
    point = e if even else e * len(el.N) + q
    for i in range(d):
        _set_second_derivatives(d, x.hessian_v, i, x.grad_v, i, el, point, x)
        for j in range(d):
            x.residual[i] -= scale * x.second[j, j]
            x.residual[j] -= scale * x.second[i, j]
    if el.graded:
        for i in range(d):
            for j in range(d):
                x.residual[i] -= el.mu * (x.grad_v[i, j] + x.grad_v[j, i]) * el.grad_n[e, q, j]
    if ring:
        scale *= _over_r(A, d, x)
        x.residual[0] -= 2 * scale * (x.grad_v[0, 0] - x.grad_v[d, d])
        x.residual[1] -= scale * (x.grad_v[0, 1] + x.grad_v[1, 0])


@inlined
def _over_r(A, d, x):
    """Return 1/r, the sum of N_a/r."""
    total = 0.0
    for a in range(A):
        total += x.g[a, d]
    return total


@specialized
def points_loop(
    A: int, d: int, affine: bool, even: bool, ring: bool, tensor: bool
) -> Callable[..., None]:
    """Return the loop that writes the state at all points; grad_v (E, Q, d, d), of rings (E, Q, d +
    1, d + 1), whose entries beside the diagonal of the third direction it leaves alone.
    """

    directions = d + ring

    def loop(el, f, grad_v, grad_p, acceleration, c, w, residual):
        x = new_point(A, d, directions)
        for e in range(len(el.dV)):
            for q in range(len(el.N)):
                set_point(A, d, affine, even, ring, el, f, e, q, x)
                if tensor:
                    _add_tensor_drag(A, d, el, f, e, q, x)
                if ring:
                    grad_v[e, q, d, d] = x.grad_v[d, d]
                for i in range(d):
                    grad_p[e, q, i] = x.grad_p[i]
                    acceleration[e, q, i] = x.acceleration[i]
                    residual[e, q, i] = x.residual[i]
                    c[e, q, i] = x.c[i]
                    w[e, q, i] = x.w[i]
                    for j in range(d):
                        grad_v[e, q, i, j] = x.grad_v[i, j]

    return loop


@specialized
def residual_loop(
    A: int, d: int, affine: bool, even: bool, ring: bool, tensor: bool
) -> Callable[..., None]:
    """Return the loop that writes terms (E, A, `term_columns`), those of the momentum and of the
    volume balance one after the other.
    """

    directions = d + ring
    rows = 1 + directions
    columns = term_columns(d)

    def loop(el, f, terms):
        x = new_point(A, d, directions)
        D = stack((rows, columns))
        D[:] = 0.0
        for e in range(len(terms)):
            terms[e] = 0.0
            for q in range(len(el.N)):
                set_point(A, d, affine, even, ring, el, f, e, q, x)
                if tensor:
                    _add_tensor_drag(A, d, el, f, e, q, x)
                _set_balances(A, d, ring, el, f, e, q, x, D)
                if tensor:
                    _set_tensor_drag(d, el, e, q, x, D)
                if el.mu != 0.0:
                    _set_viscous_stress(d, ring, el, e, q, x, D)
                if el.convection:
                    _set_stabilization(d, ring, el, e, q, x, D)
                add_point(A, directions, columns, el.N, q, x.g, D, e, terms)
            if el.undrained:
                _set_mean_gradient(A, d, el, e, x)
                for q in range(len(el.N)):
                    _add_undrained(A, d, affine, el, f, e, q, x, terms)

    return loop


@inlined
def _set_balances(A, d, ring, el, f, e, q, x, D):
    """Set inertia, pressure, drag and body force, and skeleton, seepage and PSPG."""
    dV = el.dV[e, q]
    n = el.n[e, q]
    p = 0.0
    div = 0.0
    for a in range(A):
        p += el.N[q, a] * f.p[e, a]
    for i in range(d):
        div += x.grad_v[i, i] if el.free else x.grad_vs[i, i]
        D[0, INERTIA * d + i] = dV * x.acceleration[i]
        if el.free:
            D[1 + i, PRESSURE * d + i] = -dV * p
        else:
            D[0, PRESSURE * d + i] = dV * n * x.grad_p[i]
            D[1 + i, VOLUME * d + SEEPAGE] = -dV * n * x.w[i]
        if el.drag:
            D[0, DRAG * d + i] = dV * el.S[e, q] * x.w[i]
        D[0, BODY * d + i] = -dV * el.rho[e, q] * f.b[e, q, i]
        D[1 + i, VOLUME * d + PSPG] = dV * el.tau[e, q] * n * x.residual[i]
    if ring:
        div += x.grad_v[d, d] if el.free else x.grad_vs[d, d]
        if el.free:
            D[1 + d, PRESSURE * d] = -dV * p
    D[0, VOLUME * d + SKELETON] = dV * div


@inlined
def _set_tensor_drag(d, el, e, q, x, D):
    """Set the drag S D w."""
    for i in range(d):
        D[0, DRAG * d + i] = el.dV[e, q] * _tensor_force(d, el, e, q, x, i)


@inlined
def _set_viscous_stress(d, ring, el, e, q, x, D):
    """Set the stress 2 n μ sym ∇v."""
    weight = el.n[e, q] * el.mu * el.dV[e, q]
    for i in range(d):
        for j in range(d):
            D[1 + j, VISCOUS * d + i] = weight * (x.grad_v[i, j] + x.grad_v[j, i])
    if ring:
        D[1 + d, VISCOUS * d] = 2 * weight * x.grad_v[d, d]


@inlined
def _set_stabilization(d, ring, el, e, q, x, D):
    """Set SUPG, τ ρ r_i c_j, and LSIC, n ν_L (div v_s + n div w_rel) δ_ij."""
    n = el.n[e, q]
    div = 0.0
    div_s = 0.0
    for i in range(d):
        div += x.grad_v[i, i]
        if not el.free:
            div_s += x.grad_vs[i, i]
    if ring:
        div += x.grad_v[d, d]
        if not el.free:
            div_s += x.grad_vs[d, d]
    lsic = el.dV[e, q] * n * el.nu_lsic[e, q] * (div_s + n * (div - div_s))
    supg = el.dV[e, q] * el.tau_supg[e, q] * el.rho[e, q]
    for i in range(d):
        for j in range(d):
            D[1 + j, STABILIZATION * d + i] = supg * x.residual[i] * x.c[j]
        D[1 + i, STABILIZATION * d + i] += lsic
    if ring:
        D[1 + d, STABILIZATION * d] = lsic


@inlined
def _set_mean_gradient(A, d, el, e, x):
    """Set the mean over the element of the gradients, which the undrained-limit stabilization
    leaves out on elements of order 2; zero on those of order 1.

    A linear pressure is untouched by the fluctuation, and the order of convergence stays.
    """
    if not el.fluctuation:
        x.mean[:] = 0.0
        return
    volume = 0.0
    for q in range(len(el.N)):
        volume += el.dV[e, q]
    for a in range(A):
        for j in range(d):
            total = 0.0
            for q in range(len(el.N)):
                total += el.dV[e, q] * el.G[e, q, a, j]
            x.mean[a, j] = total / volume


@inlined
def _add_undrained(A, d, affine, el, f, e, q, x, terms):
    """Add ∫ c_v τ_u ∇q·∇(p - p_n) to the last term of the volume balance: compliance at grid scale
    times the pressure rate.
    """
    for i in range(d):
        flux = 0.0
        for a in range(A):
            for j in range(d):
                flux += (
                    el.tau_u[e, q, i, j]
                    * (el.G[e, 0 if affine else q, a, j] - x.mean[a, j])
                    * f.dp[e, a]
                )
        for a in range(A):
            terms[e, a, VOLUME * d + UNDRAINED] += (
                el.dV[e, q] * (el.G[e, 0 if affine else q, a, i] - x.mean[a, i]) * flux
            )


@specialized
def tangent_loop(
    A: int, d: int, affine: bool, even: bool, ring: bool, tensor: bool, m: int
) -> Callable[..., None]:
    """Return the loop that writes the derivative K (E, A, m A m) of the residual by the unknowns of
    the nodes.
    """

    directions = d + ring
    rows = 1 + directions
    balances = 1 + d
    columns = balances * A * m

    def loop(el, f, c_f, K):
        x = new_point(A, d, directions)
        D = stack((rows, balances, A, m))
        flat = D.reshape(rows, columns)
        D[:] = 0.0
        for e in range(len(K)):
            K[e] = 0.0
            for q in range(len(el.N)):
                set_point(A, d, affine, even, ring, el, f, e, q, x)
                if tensor:
                    _add_tensor_drag(A, d, el, f, e, q, x)
                _set_derivatives(A, d, even, ring, el, e, q, c_f, x, D)
                if tensor:
                    _add_tensor_derivatives(A, d, el, e, q, x, D)
                add_point(A, directions, columns, el.N, q, x.g, flat, e, K)
            if el.undrained:
                _set_mean_gradient(A, d, el, e, x)
                for q in range(len(el.N)):
                    _add_undrained_tangent(A, d, m, affine, el, e, q, x, K)

    return loop


@inlined
def _set_derivatives(A, d, even, ring, el, e, q, c_f, x, D):
    """Set the derivatives of the densities times dV by v_bk and p_b: D[0] that of A_i, D[1 + j]
    that of B_ij, rows i <= d.

    dr_i/dv_bk = [(ρ c_f + S) N_b + ρ c·∇N_b - μ (n ΔN_b + ∇n·∇N_b)] δ_ik + ρ N_b ∂_k v_i - μ (n
    ∂_i∂_k N_b + ∂_i N_b ∂_k n) dr_i/dp_b = n ∂_i N_b;  A_i has no viscous part of r_i and, in a
    free fluid, no pressure.
    """
    dV = el.dV[e, q]
    n = el.n[e, q]
    supg = 0.0
    lsic = 0.0
    viscous = dV * n * el.mu
    pspg = dV * el.tau[e, q] * n
    if el.convection:
        supg = dV * el.tau_supg[e, q] * el.rho[e, q]
        lsic = dV * n * n * el.nu_lsic[e, q]
    for b in range(A):
        N = el.N[q, b]
        _set_strong(d, el, e, q, b, c_f, x)
        for i in range(d):
            for k in range(d):
                D[0, i, b, k] = dV * x.strong[i, k]
        if el.curved:
            _subtract_viscous_tangent(A, d, even, ring, el, e, q, b, x)
        for i in range(d):
            grad = n * x.g[b, i]
            thrown = viscous * x.g[b, i] + supg * x.residual[i] * N
            for j in range(d):
                carried = supg * x.c[j]
                for k in range(d):
                    value = carried * x.strong[i, k]
                    if i == k:
                        value += viscous * x.g[b, j]
                    if j == k:
                        value += thrown
                    if i == j:
                        value += lsic * x.g[b, k]
                    D[1 + j, i, b, k] = value
                D[1 + j, i, b, d] = carried * grad
                D[1 + i, d, b, j] = pspg * x.strong[i, j]
            D[1 + i, d, b, d] = pspg * grad
            if el.free:
                D[0, d, b, i] = dV * x.g[b, i]
                D[1 + i, i, b, d] -= dV * N
            else:
                D[0, i, b, d] = dV * grad
                D[1 + i, d, b, i] -= dV * n * N
        if ring:
            _add_hoop_derivatives(d, el, dV, N, b, viscous, lsic, x, D)


@inlined
def _add_tensor_derivatives(A, d, el, e, q, x, D):
    """Add what dr_i/dv_bk = S D_ik N_b adds to the derivatives of the densities times dV."""
    dV = el.dV[e, q]
    pspg = dV * el.tau[e, q] * el.n[e, q]
    supg = dV * el.tau_supg[e, q] * el.rho[e, q] if el.convection else 0.0
    for b in range(A):
        for i in range(d):
            for k in range(d):
                strong = el.S[e, q] * el.D[i, k] * el.N[q, b]
                D[0, i, b, k] += dV * strong
                D[1 + i, d, b, k] += pspg * strong
                for j in range(d):
                    D[1 + j, i, b, k] += supg * x.c[j] * strong


@inlined
def _add_hoop_derivatives(d, el, dV, N, b, viscous, lsic, x, D):
    """Add v_br N_b/r to the divergences, and set the derivatives of the stress around the axis,
    that of the radial component.
    """
    hoop = x.g[b, d]
    for i in range(d):
        D[1 + i, i, b, 0] += lsic * hoop
        D[1 + d, 0, b, i] = lsic * x.g[b, i]
    D[1 + d, 0, b, 0] += (lsic + 2 * viscous) * hoop
    if el.free:
        D[0, d, b, 0] += dV * hoop
        D[1 + d, 0, b, d] = -dV * N


@inlined
def _set_strong(d, el, e, q, b, c_f, x):
    """Set dr_i/dv_bk without viscosity."""
    N = el.N[q, b]
    rho = el.rho[e, q]
    isotropic = rho * c_f * N
    if el.drag:
        isotropic += el.S[e, q] * N
    for i in range(d):
        for k in range(d):
            x.strong[i, k] = rho * N * x.grad_v[i, k] if el.convection else 0.0
    if el.convection:
        for j in range(d):
            isotropic += rho * x.c[j] * x.g[b, j]
    for i in range(d):
        x.strong[i, i] += isotropic


@inlined
def _subtract_viscous_tangent(A, d, even, ring, el, e, q, b, x):
    """Subtract the derivative of div(2 n μ sym ∇v)_i by v_bk."""
    scale = el.mu * el.n[e, q]
    row = b if even else q * A + b
    point = e if even else e * len(el.N) + q
    _set_second_derivatives(d, el.hessian, row, x.g, b, el, point, x)
    for i in range(d):
        for k in range(d):
            x.strong[i, k] -= scale * x.second[i, k]
            x.strong[i, i] -= scale * x.second[k, k]
            if el.graded:
                x.strong[i, k] -= el.mu * x.g[b, i] * el.grad_n[e, q, k]
                x.strong[i, i] -= el.mu * x.g[b, k] * el.grad_n[e, q, k]
    if ring:
        scale *= _over_r(A, d, x)
        x.strong[0, 0] -= 2 * scale * (x.g[b, 0] - x.g[b, d])
        x.strong[1, 0] -= scale * x.g[b, 1]
        x.strong[1, 1] -= scale * x.g[b, 0]


@inlined
def _add_undrained_tangent(A, d, m, affine, el, e, q, x, K):
    """Add ∫ c_v τ_u ∇N_a·∇N_b, of the fluctuating gradients on quadratic elements."""
    for a in range(A):
        for i in range(d):
            flux = 0.0
            for j in range(d):
                flux += (el.G[e, 0 if affine else q, a, j] - x.mean[a, j]) * el.tau_u[e, q, j, i]
            flux *= el.dV[e, q]
            for b in range(A):
                K[e, a, (d * A + b) * m + d] += flux * (
                    el.G[e, 0 if affine else q, b, i] - x.mean[b, i]
                )
