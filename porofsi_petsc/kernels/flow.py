"""Element residual and tangent of the interstitial fluid in ALE description: equal order, PSPG,
SUPG, LSIC and drag.

Momentum (w) and volume balance (q) over the current configuration, with c = v - v_m and w_rel = v -
v_s:

    ∫ w·[ρ (a + c·∇v) + n ∇p + S w_rel - ρ b] + ∫ ∇w : 2 n μ sym ∇v + ∫ τ ρ (c·∇w)·r + ∫ n ν_L div w
    (div v_s + n div w_rel) ∫ q div v_s - ∫ n ∇q·w_rel + ∫ τ n ∇q·r + ∫ c_v τ_u ∇q·∇(p - p_n) + ∮ q
    n w_rel·n

r = ρ (a + c·∇v) + n ∇p + S w_rel - ρ b - div(2 n μ sym ∇v) is the full strong residual, n the fluid
fraction, ρ = n ρ_fR. On affine elements div(2 n μ sym ∇v) = 0.  LSIC is for constant n: its volume
balance has no w_rel·∇n. The pressure term is not integrated by parts, so that an impermeable
surface, fixed or moving (w_rel·n = 0), is natural; a drained one prescribes p (Tezduyar 1992 for
PSPG and LSIC; the subgrid velocity is -τ r).  Terms are kept apart, see `kernels.solid`.

A free fluid has n = 1 and no skeleton.  There the pressure is integrated by parts, so that the full
traction σ n = (-p I + 2 μ sym ∇v) n is natural: an outlet may be left alone, and the residual of a
node on the boundary is the fluid's traction ∮ w·σ n on it.

    ∫ w·[ρ (a + c·∇v) - ρ b] - ∫ p div w + ∫ ∇w : 2 μ sym ∇v + ∫ τ ρ (c·∇w)·r + ∫ ν_L div w div v
    ∫ q div v + ∫ τ ∇q·r

Around an axis (`geometry.hoop`) the components are r and z, gradients of vectors have the third
diagonal entry v_r/r, which div and sym take with the others, and dV is that of the whole ring.
Where it flows through a porous solid, v is the volume-averaged velocity v_s + n_f w and S w_rel = S
(v - v_s) is added to r.

At a point the forms are N_a A + ∂_j N_a B_j for the test functions of node a: with the rows i of
the momentum and the last one of the volume balance (free fluid in brackets where it differs)

    A_i = r_i + div(2 n μ sym ∇v)_i  [- ∂_i p]      B_ij = n μ (∂_j v_i + ∂_i v_j) + τ ρ r_i c_j + n
    ν_L div δ_ij  [- p δ_ij] A   = div v_s  [div v]                          B_j  = -n w_rel,j  [0]
    + τ n r_j + c_v τ_u,jk ∂_k (p - p_n)

The tangent is the same sum with the derivatives of A and B by the nodal unknowns; `flow_loops` has
both, compiled.
"""

from dataclasses import dataclass
from math import comb
from typing import Any

import numpy as np

from ..compiled import plain
from . import flow_loops
from .arguments import Drag, Geometry
from .assemble import laplacian, mass_matrix
from .flow_loops import MOMENTUM_TERMS, FlowFields, term_columns


@dataclass(frozen=True)
class FlowElements:
    """Elements and coefficients of one chunk, frozen during an iteration.

    N (Q, A); geometry (G, dV); n, rho (E, Q): fluid fraction, partial density [kg/m³]; drag S
    [N s/m⁴]; mu [Pa s]; tau, tau_supg (E, Q) [m³ s/kg] of PSPG and SUPG; nu_lsic (E, Q) [Pa s], 0
    where n varies; tau_u (E, Q, d, d) = c_v τ_u [m³ s/kg], None without the undrained term; second:
    `fem.geometry.SecondDerivatives`, None on affine elements or where μ = 0; grad_n (E, Q, d) [1/m]
    of a varying n, where there is `second`, None where n is constant; free: a free fluid, whose n
    is 1; its drag is None, or that of a skeleton that it flows through.
    """

    N: np.ndarray
    geometry: Geometry
    n: np.ndarray
    rho: np.ndarray
    drag: Drag | None
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
class FlowPoints:
    """Pointwise quantities that residual and tangents share; c None without convection, w None
    without drag; grad_v of rings (E, Q, 3, 3).
    """

    c: np.ndarray | None
    grad_v: np.ndarray
    acceleration: np.ndarray
    grad_p: np.ndarray
    w: np.ndarray | None
    residual: np.ndarray


def flow_points(el: FlowElements, f: FlowFields) -> FlowPoints:
    """Return the pointwise quantities of a state."""
    sizes, elements, fields = _arguments(el, f)
    E, Q, d = f.b.shape
    directions = d if el.geometry.hoop is None else d + 1
    grad_v = np.zeros((E, Q, directions, directions))
    grad_p, acceleration, c, w, residual = (np.empty((E, Q, d)) for _ in range(5))
    flow_loops.points_loop(*sizes)(elements, fields, grad_v, grad_p, acceleration, c, w, residual)
    return FlowPoints(
        c if el.convection else None,
        grad_v,
        acceleration,
        grad_p,
        None if el.drag is None else w,
        residual,
    )


def flow_residual(
    el: FlowElements, f: FlowFields, terms: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return momentum terms (T, E, A, d) [N] in the order of MOMENTUM_TERMS and volume terms (T, E,
    A) [m³/s] of VOLUME_TERMS.

    The skeleton's volume term of a free fluid is its own, ∫ q div v.
    terms : (E, A, `term_columns`), where they are written: views of it are returned
    """
    sizes, elements, fields = _arguments(el, f)
    E, A, d = fields.v.shape
    if terms is None:
        terms = np.empty((E, A, term_columns(d)))
    flow_loops.residual_loop(*sizes)(elements, fields, terms)
    return split_terms(terms, d)


def split_terms(terms: np.ndarray, d: int) -> tuple[np.ndarray, np.ndarray]:
    """Return views on momentum terms (T, ..., d) and volume terms (T, ...) of terms (...,
    `term_columns`).
    """
    count = len(MOMENTUM_TERMS)
    momentum = terms[..., : count * d].reshape(*terms.shape[:-1], count, d)
    return np.moveaxis(momentum, -2, 0), np.moveaxis(terms[..., count * d :], -1, 0)


def flow_tangent(
    el: FlowElements, f: FlowFields, c_f: float, components: int | None = None
) -> np.ndarray:
    """Return the derivative of `flow_residual` by (v, p) on the collocation level, (E, A, m, A, m),
    m = d + 1.

    c_f = d a/d v [1/s], zero without inertia.  τ and ν_L are frozen (they belong to the start of
    the step), so this is exact.
    components : m, if there are more unknowns per node; the rows and columns of the others are zero
    """
    sizes, elements, fields = _arguments(el, f)
    E, A, d = fields.v.shape
    m = components or d + 1
    K = np.empty((E, A, m, A, m))
    sizes = (*sizes, m)
    flow_loops.tangent_loop(*sizes)(elements, fields, float(c_f), K.reshape(E, A, -1))
    return K


def _arguments(el, f):
    """Return the sizes (A, d, affine, even, ring, tensor), elements and fields for a compiled loop;
    even: the second derivatives of the shape functions are constant; tensor: of the drag.
    """
    G = el.geometry.G
    hoop = el.geometry.hoop
    dV = el.geometry.dV
    second = el.second
    drag = el.drag is not None
    resistance = el.drag.resistance if drag else None
    tensor = resistance is not None
    undrained = el.tau_u is not None
    graded = el.grad_n is not None
    curved = second is not None
    none = np.empty((0, 0))
    elements = flow_loops.Elements(
        N=plain(el.N),
        G=plain(G),
        dV=plain(dV),
        n=plain(el.n),
        rho=plain(el.rho),
        S=plain(el.drag.scale) if drag else none,
        D=plain(resistance) if tensor else none,
        mu=float(el.mu),
        tau=plain(el.tau),
        tau_supg=plain(el.tau_supg),
        nu_lsic=plain(el.nu_lsic),
        tau_u=plain(el.tau_u) if undrained else np.empty((0, 0, 0, 0)),
        nodes=plain(second.rule.element.node_coordinates) if curved else none,
        hessian=_in_rows(second.rule.hessian) if curved else np.empty((0, 0, 0)),
        bend=_in_rows(second.bend) if curved else np.empty((0, 0, 0)),
        grad_n=plain(el.grad_n) if graded else np.empty((0, 0, 0)),
        hoop=np.empty((0, 0, 0)) if hoop is None else plain(hoop),
        convection=bool(el.convection),
        drag=drag and not tensor,
        undrained=undrained,
        curved=curved,
        graded=graded,
        fluctuation=el.order > 1,
        free=bool(el.free),
    )
    unread = np.empty((0, 0, 0))
    c = f.c if el.convection else unread
    v_s = f.v_s if drag or not el.free else unread
    fields = FlowFields(*map(plain, f._replace(c=c, v_s=v_s, dp=f.dp if undrained else none)))
    A, d = G.shape[2:]
    even = comb(d + el.order, d) == A  # all polynomials of the order, 2 at most, and no others
    return (A, d, G.shape[1] == 1, even, hoop is not None, tensor), elements, fields


def _in_rows(array):
    """Return an array (i, j, k, l) as (i j, k, l), as the loops want it."""
    return plain(array).reshape(-1, *array.shape[2:])


def strong_gradient(el: FlowElements, x: FlowPoints) -> np.ndarray:
    """Return ρ ∂v_i/∂x_j, (E, Q, d, d): the derivative of the convective force by c_j."""
    d = el.geometry.G.shape[-1]
    return el.rho[..., None, None] * x.grad_v[..., :d, :d]


def add_skeleton_answer(
    K: np.ndarray, el: FlowElements, mass_weight: np.ndarray, laplacian_weight: np.ndarray
) -> None:
    """Add the answer of the skeleton to a pressure change to the tangent K with the auxiliary field
    s after p (or without it).

    The answer B_m (δp - s), (B_m + B_L) s = B_m δp is the parallel sum of B_m = ∫ α² c_v β q p
    (stiffness, β [1/Pa]) and B_L = ∫ α² c_v/(ρ_χ c_a) ∇q·∇p (inertia), an inertia-aware
    fixed-stress term; with d + 1 components only B_m is added.

    mass_weight, laplacian_weight : (E, Q) coefficients without dV
    """
    G = el.geometry.G
    dV = el.geometry.dV
    p = G.shape[-1]
    B_m = mass_matrix(el.N, mass_weight * dV)
    K[:, :, p, :, p] += B_m
    if K.shape[2] == p + 1:
        return
    s = p + 1
    K[:, :, p, :, s] -= B_m
    K[:, :, s, :, p] -= B_m
    K[:, :, s, :, s] += B_m + laplacian(G, laplacian_weight * dV)


def add_free_surface(
    K: np.ndarray, laplacian_weight: np.ndarray, rows: np.ndarray, terms: np.ndarray
) -> None:
    """Add Nitsche's terms of a free impermeable surface to the auxiliary field s, see
    `surface.weak_zero`, in place.

    laplacian_weight : (E, Q) α² c_v/(ρ_χ c_a) without dV; rows (F,) elements in K, terms (F, A, A)
    [m^(d-2)]
    """
    weight = laplacian_weight[rows].mean(axis=1)
    np.add.at(K[:, :, -1, :, -1], rows, weight[:, None, None] * terms)
