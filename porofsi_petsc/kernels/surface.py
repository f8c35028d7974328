"""Integrals over facets: loads that stay or follow, tractions, Robin terms, backflow, a field that
vanishes on a surface weakly.

N (Q, A) and dN (Q', A, d - 1) are those of the facet's element, Q' = 1 where gradients are
constant.
"""

import numpy as np

from .assemble import add_isotropic, bilinear, mass_matrix

# ε_ij and ε_ijk: the normal is ε_ij t_j on a line with the tangent t, ε_ijk t_j s_k on a surface
# with the tangents t, s.
_TURN = np.array([[0.0, 1.0], [-1.0, 0.0]])
_PERMUTATION = np.cross(np.eye(3)[:, None], np.eye(3)[None]).transpose(2, 0, 1)


def facet_normal(dN: np.ndarray, weights: np.ndarray, coordinates: np.ndarray) -> np.ndarray:
    """Return the outward normals times dA, (F, Q, d) [m^(d-1)], of facets with nodal coordinates
    (F, A, d); dN (Q, A, d - 1).
    """
    tangents = _tangents(dN, coordinates)
    if tangents.shape[-1] == 1:
        normal = tangents[..., 0] @ _TURN.T
    else:
        normal = np.cross(tangents[..., 0], tangents[..., 1])
    return normal * weights[:, None]


def _tangents(dN, coordinates):
    """Return dx_i/dxi_m, (F, Q', d, d - 1) [m]."""
    along = coordinates - coordinates[:, :1]  # digits, see `fem.geometry`
    return np.swapaxes(along, 1, 2)[:, None] @ dN


def facet_normal_by_positions(
    dN: np.ndarray, weights: np.ndarray, coordinates: np.ndarray
) -> np.ndarray:
    """Return the derivative of `facet_normal` (component i) by the positions x_bj, (F, Q, b, i, j)
    [m^(d-2)].

    ε_ij ∂N_b on a line, ε_ijk (∂_1 N_b s_k - ∂_2 N_b t_k) on a surface with the tangents t = ∂_1 x
    and s = ∂_2 x.
    """
    if dN.shape[-1] == 1:
        change = np.broadcast_to(dN[..., None] * _TURN, (len(coordinates), *dN.shape[:2], 2, 2))
    else:
        turned = np.einsum("ijk,fqkm->fqmij", _PERMUTATION, _tangents(dN, coordinates))
        change = (
            dN[..., 0, None, None] * turned[:, :, None, 1]
            - dN[..., 1, None, None] * turned[:, :, None, 0]
        )
    return change * weights[:, None, None, None]


def impedance_load(
    N: np.ndarray, normal: np.ndarray, factors: tuple[np.ndarray, np.ndarray], values: np.ndarray
) -> np.ndarray:
    """Return ∮ N_a Z v dA, (F, A, d), Z = z_n n n + z_t (I - n n), of nodal values (F, A, d).

    normal (F, Q, d) normals times dA; factors z_n, z_t, (F, 1) each
    """
    return N.T @ (impedance_weights(normal, factors) @ (N @ values)[..., None])[..., 0]


def impedance_weights(normal: np.ndarray, factors: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Return Z dA of `impedance_load`, (F, Q, d, d)."""
    dA = np.linalg.norm(normal, axis=-1)[..., None, None]
    along = normal[..., :, None] * normal[..., None, :] / dA
    z_n, z_t = (factor[..., None, None] for factor in factors)
    return z_n * along + z_t * (np.eye(normal.shape[-1]) * dA - along)


def surface_load(N: np.ndarray, dA: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return ∮ N_a t dA, (F, A, k), for values (F, Q, k) at the quadrature points."""
    return N.T @ (values * dA[..., None])


def surface_mass(N: np.ndarray, dA: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return ∮ N_a α N_b dA, (F, A, A), for values α (F, Q) or (F, 1): the matrix of a Robin
    condition.
    """
    return mass_matrix(N, values * dA)


def pressure_load(N: np.ndarray, normal: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Return ∮ N_a p n dA, (F, A, d) [N], of a pressure p (F, Q) [Pa] on the current outward
    normals times dA (F, Q, d).

    A pressure from outside pushes with minus this load; its derivative is
    `pressure_load_by_normal`.
    """
    return surface_load(N, p, normal)


def pressure_coupling(N: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Return ∮ N_a n N_b dA, (F, A, d, A, 1): the derivative of `pressure_load` by nodal pressures;
    normal (F, Q, d) times dA.
    """
    return np.einsum("qa,fqi,qb->faib", N, normal, N, optimize=True)[..., None]


def pressure_load_by_normal(N: np.ndarray, change: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Return the derivative of `pressure_load` by the positions of the facet's nodes, (F, A, d, A,
    d) [N/m], at given p (F, Q), from that of the normals, change (F, Q, b, i, j).

    The load follows: n dA is the product of the current tangents, so it has no Jacobian (Simo,
    Taylor & Wriggers 1991).
    """
    _, _, A, d, _ = change.shape
    K = np.empty((len(change), A, d, A, d))
    for i in range(d):
        for j in range(d):
            K[:, :, i, :, j] = bilinear(p[..., None] * N, change[..., i, j])
    return K


def backflow_residual(
    N: np.ndarray, normal: np.ndarray, rho: np.ndarray, beta: float, v: np.ndarray, c: np.ndarray
) -> np.ndarray:
    """Return -(β/2) ∮ ρ (c·n)_- N_a v dA, (F, A, d) [N]: what enters through an open boundary
    brings no kinetic energy along.

    (x)_- = min(x, 0); c = v - v_m is the velocity through the boundary.  With β = 1 the power of
    the term is the kinetic energy that convection carries in (Esmaily-Moghadam et al. 2011;
    Bertoglio et al. 2018).  It is zero where the fluid leaves.

    normal (F, Q, d) current outward normals times dA; rho (F, Q) [kg/m³]; v, c (F, A, d) [m/s]
    """
    inflow, _ = _inflow(N, normal, rho, beta, c)
    return surface_load(N, inflow, N @ v)


def backflow_tangent(
    N: np.ndarray, normal: np.ndarray, rho: np.ndarray, beta: float, v: np.ndarray, c: np.ndarray
) -> np.ndarray:
    """Return the derivative of `backflow_residual` by v with c = v - v_m, (F, A, d, A, d) [N s/m].

    It is that of the side the flow is on: at c·n = 0, where (c·n)_- has a kink, that of the
    outflow.
    """
    inflow, slope = _inflow(N, normal, rho, beta, c)
    F, A, d = v.shape
    values = N @ v
    K = np.zeros((F, A, d, A, d))
    for i in range(d):
        for j in range(d):
            K[:, :, i, :, j] = mass_matrix(N, values[..., i] * slope[..., j])
    add_isotropic(K, mass_matrix(N, inflow), d)
    return K


def _inflow(N, normal, rho, beta, c):
    """Return -(β/2) ρ (c·n)_- dA, (F, Q) [kg/s], and its derivative by c, (F, Q, d)."""
    flux = ((N @ c) * normal).sum(axis=-1)
    weight = -beta / 2 * rho
    return weight * np.minimum(flux, 0), np.where(flux < 0, weight, 0)[..., None] * normal


def traction_load(
    N: np.ndarray,
    G: np.ndarray,
    normal: np.ndarray,
    v: np.ndarray,
    p: np.ndarray,
    mu: float | np.ndarray,
) -> np.ndarray:
    """Return ∮ N_a (-p I + μ (∇v + ∇vᵀ)) n dA, (F, A, d) [N], of the stress in the cells behind
    facets.

    N (Q, A), G (F, Q, A, d) of the cells at the facets' points; normal (F, Q, d) outward normal
    times dA; v (F, A, d), p (F, A), mu a number or (F, 1, 1) [Pa s]
    """
    gradient = np.swapaxes(v, 1, 2)[:, None] @ G
    viscous = (gradient + np.swapaxes(gradient, 2, 3)) @ normal[..., None]
    return N.T @ (mu * viscous[..., 0] - (p @ N.T)[..., None] * normal)


def flux_load(N: np.ndarray, normal: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Return ∮ N_a w·n dA, (F, A, 1) [m³/s], of nodal velocities w (F, A, d) [m/s] in the cells
    behind facets.

    N (Q, A) of the cells at the facets' points; normal (F, Q, d) outward normal times dA
    """
    return N.T @ ((N @ w) * normal).sum(axis=-1, keepdims=True)


def wall_shear(G: np.ndarray, normal: np.ndarray, v: np.ndarray, mu: np.ndarray) -> np.ndarray:
    """Return the tangential part of the viscous traction μ (∇v + ∇vᵀ) n, its size, (F, Q) [Pa].

    G (F, Q', A, d) of the cells at the facets' points; normal (F, Q, d) outward normal times dA; v
    (F, A, d); mu (F,) [Pa s]
    """
    n = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
    gradient = np.swapaxes(v, 1, 2)[:, None] @ G
    traction = ((gradient + np.swapaxes(gradient, 2, 3)) @ n[..., None])[..., 0]
    across = (traction * n).sum(axis=-1, keepdims=True)
    return mu[:, None] * np.linalg.norm(traction - across * n, axis=-1)


def weak_zero(N: np.ndarray, G: np.ndarray, normal: np.ndarray, penalty: np.ndarray) -> np.ndarray:
    """Return -∮ (q ∂_n s + s ∂_n q) dA + ∮ penalty q s dA, (F, A, A) [m^(d-2)]: s = 0 by Nitsche's
    method (1971).

    N (Q, A), G (F, Q, A, d) of the cells behind the facets at the facets' points; normal (F, Q, d)
    outward normal times dA; penalty (F,) [1/m]
    """
    slope = (G @ normal[..., None])[..., 0]
    crossed = np.swapaxes(slope, 1, 2) @ np.broadcast_to(N, slope.shape)
    dA = np.linalg.norm(normal, axis=-1)
    return surface_mass(N, dA, penalty[:, None]) - crossed - np.swapaxes(crossed, 1, 2)
