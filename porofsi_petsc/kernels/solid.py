"""Element residual and tangent of the skeleton in positional form, total Lagrangian.

    ρ_s a = Div P + (n_s-part of the pressure gradient) + S (v_f - v_s) + ρ_s b

tested with w and collocated in time by the caller.  The pressure enters as -∫ p div w - ∫ n_f ∇p·w
over the current configuration: the adjoint of the volume balance ∫ q div v_s - ∫ n_f ∇q·(v_f -
v_s), whose natural traction is that of the mixture, (σ_E - p I) n = t̄.  A residual is internal
minus external force; its terms are kept apart because their norms scale the convergence test and
their powers make the energy balance.

Around an axis (arguments `hoop`, N/r of `fem.geometry.Geometry`) a gradient of a vector is one in
space with the directions r, z and, third, around the axis: H_θθ = u_r/R, and the law sees it with
the others.  Nodal vectors have the components r and z, forces are those on the whole ring.
"""

import numpy as np

from ..compiled import inlined, plain, specialized, stack
from .arguments import Geometry, Pores, StrainEnergy, Stress
from .assemble import add_isotropic, mass_matrix, test_value
from .contraction import add_point

TERMS = ("stress", "inertia", "pressure", "drag", "body")


def displacement_gradient(
    G0: np.ndarray, u: np.ndarray, hoop: np.ndarray | None = None
) -> np.ndarray:
    """Return H_iJ = u_ai dN_a/dX_J = F_iJ - δ_iJ, (E, Q', d, d), for G0 (E, Q', A, d) and u = y - X
    (E, A, d) [m]; around an axis (E, Q, 3, 3), with hoop (E, Q, A).

    The positions enter as displacements from the reference: y would lose the digits of X/h
    (measured: 5e-6 of the force in a first small step of a 10 m column).
    """
    E, points, A, d = G0.shape
    H = np.empty((E, points, d, d))
    _gradient_loop(A, d)(plain(G0), plain(u), H)
    if hoop is None:
        return H
    spatial = np.zeros((E, points, d + 1, d + 1))
    spatial[..., :d, :d] = H
    spatial[..., d, d] = (hoop @ u[:, :, :1])[..., 0]
    return spatial


@specialized
def _gradient_loop(A, d):
    def loop(G0, u, H):
        for e in range(len(H)):
            for q in range(H.shape[1]):
                for i in range(d):
                    for J in range(d):
                        total = 0.0
                        for a in range(A):
                            total += u[e, a, i] * G0[e, q, a, J]
                        H[e, q, i, J] = total

    return loop


def stress_residual(
    G0: np.ndarray, dV0: np.ndarray, law: Stress, u: np.ndarray, hoop: np.ndarray | None = None
) -> np.ndarray:
    """Return ∫ ∇_X w : P dV0, (E, A, d) [N], for nodal displacements u = y - X, (E, A, d) [m]."""
    P = law.stress(displacement_gradient(G0, u, hoop))
    vectors = np.empty(u.shape)
    A, d = u.shape[1:]
    _stress_loop(A, d, hoop is not None)(
        plain(G0), _around(hoop), _volumes(G0, dV0), plain(P), vectors
    )
    return vectors


def _around(hoop):
    """Return hoop (E, Q, A) for a compiled loop, empty where there is no axis."""
    return np.empty((0, 0, 0)) if hoop is None else plain(hoop)


def stress_load(
    N: np.ndarray,
    G0: np.ndarray,
    normal: np.ndarray,
    law: Stress,
    u: np.ndarray,
    hoop: np.ndarray | None = None,
) -> np.ndarray:
    """Return ∮ N_a P·N dA0, (F, A, d) [N], of the stress in the cells behind facets.

    N (Q, A), G0 (F, Q, A, d) of the cells at the facets' points; normal (F, Q, d) outward normal
    times dA0; u (F, A, d) [m]
    """
    d = u.shape[-1]
    P = law.stress(displacement_gradient(G0, u, hoop))[..., :d, :d]
    return N.T @ (P @ normal[..., None])[..., 0]


@specialized
def _stress_loop(A, d, ring):
    def loop(G0, hoop, dV0, P, vectors):
        for e in range(len(vectors)):
            vectors[e] = 0.0
            for q in range(P.shape[1]):
                for a in range(A):
                    for i in range(d):
                        total = 0.0
                        for J in range(d):
                            total += G0[e, q, a, J] * P[e, q, i, J]
                        vectors[e, a, i] += dV0[e, q] * total
                    if ring:
                        vectors[e, a, 0] += dV0[e, q] * hoop[e, q, a] * P[e, q, d, d]

    return loop


def stress_tangent(
    G0: np.ndarray,
    dV0: np.ndarray,
    law: Stress,
    u: np.ndarray,
    before: np.ndarray | None = None,
    hoop: np.ndarray | None = None,
) -> np.ndarray:
    """Return the derivative of `stress_residual` by y (or u), (E, A, d, A, d) [N/m].

    before (E, A, d) : displacement from which the stress of the geometric part is linear, see
    `ElasticLaw.mixed_tangent`
    """
    E, A, d = u.shape
    K = np.empty((E, A, d, A, d))
    H = displacement_gradient(G0, u, hoop)
    tangent = plain(
        law.tangent(H)
        if before is None
        else law.mixed_tangent(H, displacement_gradient(G0, before, hoop))
    )
    _tangent_loop(A, d, hoop is not None)(
        plain(G0), _around(hoop), _volumes(G0, dV0), tangent, K.reshape(E, A, -1)
    )
    return K


@specialized
def _tangent_loop(A, d, ring):
    """Return the loop over points: D[J, (i, b, k)] = dP_iJ/dF_kL dN_b/dX_L dV0, contracted with
    dN_a/dX_J for node a; around an axis with a third direction, whose dN/dX_θ is N/R for radial
    components and 0 for the others.
    """
    columns = d * A * d
    directions = d + ring

    def loop(G0, hoop, dV0, tangent, K):
        g = stack((A, directions))
        D = stack((directions, columns))
        if ring:
            D[:] = 0.0
        for e in range(len(K)):
            K[e] = 0.0
            for q in range(tangent.shape[1]):
                for a in range(A):
                    for J in range(d):
                        g[a, J] = G0[e, q, a, J]
                    if ring:
                        g[a, d] = hoop[e, q, a]
                for J in range(d):
                    for i in range(d):
                        for b in range(A):
                            for k in range(d):
                                total = 0.0
                                for L in range(d):
                                    total += tangent[e, q, i, J, k, L] * g[b, L]
                                if ring and k == 0:
                                    total += tangent[e, q, i, J, d, d] * g[b, d]
                                D[J, (i * A + b) * d + k] = dV0[e, q] * total
                if ring:
                    for b in range(A):
                        for k in range(d):
                            total = 0.0
                            for L in range(d):
                                total += tangent[e, q, d, d, k, L] * g[b, L]
                            if k == 0:
                                total += tangent[e, q, d, d, d, d] * g[b, d]
                            D[d, b * d + k] = dV0[e, q] * total
                for a in range(A):
                    if directions == 2:
                        for z in range(columns):
                            K[e, a, z] += g[a, 0] * D[0, z] + g[a, 1] * D[1, z]
                    else:
                        for z in range(columns):
                            K[e, a, z] += g[a, 0] * D[0, z] + g[a, 1] * D[1, z] + g[a, 2] * D[2, z]

    return loop


def _volumes(G0, dV0):
    """Return dV0 at the points of the gradients, (E, Q'): that of all points where they are
    constant.
    """
    return plain(dV0.sum(axis=1, keepdims=True) if G0.shape[1] == 1 else dV0)


def volumetric_compliance(law: Stress, H: np.ndarray) -> np.ndarray:
    """Return (1/E_c + 1/K_d)/2, (E, Q) [1/Pa], of the present tangent A = dP/dF: what a pressure
    makes of the volume.

    E_c = (1/d) Σ_i F_iJ F_iL A_iJiL/J is the stiffness against a compression wave, λ + 2μ at H = 0:
    the answer of a body that is held at its sides.  K_d = (1/d²) Σ_ik F_iJ F_kL A_iJkL/J is that
    against a uniform dilation, λ + 2μ/d at H = 0: the answer of one that is free.  Every body
    answers with a compliance between the two, so that with their mean the error of a fixed-stress
    split falls by (E_c - K_d)/(E_c + K_d) or better: 1/2 at ν = 0 in 3-D, 1/3 in plane strain (with
    1/E_c: 2 and 1).  Of an anisotropic law 1/K_d is I:A^-1:I, the answer of a free body.
    """
    d = H.shape[-1]
    F = H + np.eye(d)
    A = law.tangent(H)
    volume = np.linalg.det(H + np.eye(d))
    along = np.einsum("...ij,...il,...ijil->...", F, F, A)
    dilation = np.einsum("...ij,...kl,...ijkl->...", F, F, A)
    free = _free_compliance(F, A) if law.anisotropic else d**2 / dilation
    return 0.5 * volume * (d / along + free)


def _free_compliance(F, A):
    """Return I:c^-1:I, (...), c_ijkl = F_jJ F_lL A_iJkL made symmetric in ij and in kl."""
    d = F.shape[-1]
    c = np.einsum("...jJ,...lL,...iJkL->...ijkl", F, F, A)
    c = (c + np.swapaxes(c, -4, -3)) / 2
    c = (c + np.swapaxes(c, -2, -1)) / 2
    rows, columns = np.triu_indices(d)
    matrix = c[..., rows, columns, :, :][..., rows, columns]
    matrix *= np.where(rows == columns, 1, 2)  # of ε_ij and ε_ji together
    identity = (rows == columns).astype(float)
    strain = np.linalg.solve(matrix, np.broadcast_to(identity, matrix.shape[:-1])[..., None])
    return strain[..., 0] @ identity


def stored_energy(
    G0: np.ndarray,
    dV0: np.ndarray,
    law: StrainEnergy,
    u: np.ndarray,
    hoop: np.ndarray | None = None,
) -> np.ndarray:
    """Return ∫ Psi dV0 of every element, (E,) [J]."""
    return (law.energy(displacement_gradient(G0, u, hoop)) * dV0).sum(axis=1)


def inertia_residual(
    N: np.ndarray, dV0: np.ndarray, rho_s: float | np.ndarray, a: np.ndarray
) -> np.ndarray:
    """Return ∫ ρ_s w·a dV0, (E, A, d) [N], for nodal accelerations a (E, A, d); ρ_s a number or (E,
    1) [kg/m³].
    """
    return test_value(N, dV0, np.expand_dims(rho_s, -1) * (N @ a))


def coupling_residual(
    N: np.ndarray, geometry: Geometry, material: Pores, J: np.ndarray, p: np.ndarray, w: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the pressure term -∫ p div w - ∫ n_f ∇p·w and the drag term -∫ S w_rel·w over the
    current configuration.

    p (E, A) [Pa], w (E, A, d) = v_f - v_s nodal [m/s]; both results (E, A, d) [N].
    """
    A, d = w.shape[1:]
    n = plain(material.fluid_fraction(J))
    drag = material.drag(J)
    tensor = drag.resistance is not None
    D = np.empty((0, 0)) if drag.resistance is None else plain(drag.resistance)
    vectors = np.empty((len(w), A, 2 * d))
    hoop = geometry.hoop
    arrays = plain(N), plain(geometry.G), _around(hoop), plain(geometry.dV)
    _coupling_loop(A, d, geometry.G.shape[1] == 1, hoop is not None, tensor)(
        *arrays, n, plain(drag.scale), D, plain(p), plain(w), vectors
    )
    return vectors[..., :d], vectors[..., d:]


@specialized
def _coupling_loop(A, d, affine, ring, tensor):
    """Return the loop that writes the pressure term and the drag term side by side, (E, A, 2 d);
    tensor: the drag is S D_ij, else S δ_ij.
    """
    directions = d + ring
    rows = 1 + directions
    columns = 2 * d

    def loop(N, G, hoop, dV, n, S, resistance, p, w, vectors):
        g = stack((A, directions))
        D = stack((rows, columns))
        D[:] = 0.0
        for e in range(len(vectors)):
            vectors[e] = 0.0
            for q in range(len(N)):
                value = 0.0
                for a in range(A):
                    value += N[q, a] * p[e, a]
                    for j in range(d):
                        g[a, j] = G[e, 0 if affine else q, a, j]
                    if ring:
                        g[a, d] = hoop[e, q, a]
                for i in range(d):
                    gradient = 0.0
                    relative = 0.0
                    for a in range(A):
                        gradient += g[a, i] * p[e, a]
                        relative += N[q, a] * w[e, a, i]
                    D[0, i] = -dV[e, q] * n[e, q] * gradient
                    D[0, d + i] = -dV[e, q] * S[e, q] * relative
                    D[1 + i, i] = -dV[e, q] * value
                if tensor:
                    _turn(d, resistance, D)
                if ring:
                    D[1 + d, 0] = -dV[e, q] * value
                add_point(A, directions, columns, N, q, g, D, e, vectors)

    return loop


@inlined
def _turn(d, resistance, D):
    """Multiply the drag, D_0z for z from d to 2 d - 1, by the tensor (d, d), in place."""
    force = stack((d,))
    for i in range(d):
        force[i] = D[0, d + i]
    for i in range(d):
        total = 0.0
        for j in range(d):
            total += resistance[i, j] * force[j]
        D[0, d + i] = total


def body_residual(
    N: np.ndarray, dV0: np.ndarray, rho_s: float | np.ndarray, b: np.ndarray
) -> np.ndarray:
    """Return -∫ ρ_s b·w dV0, (E, A, d) [N], for the acceleration b (E, Q, d) [m/s²]; ρ_s a number
    or (E, 1) [kg/m³].
    """
    return test_value(N, dV0, -np.expand_dims(rho_s, -1) * b)


def mass_tangent(N: np.ndarray, weights: np.ndarray, dim: int) -> np.ndarray:
    """Return ∫ m w·δ, (E, A, d, A, d), for weights (E, Q) = m dV0."""
    block = mass_matrix(N, weights)
    E, A, _ = block.shape
    K = np.zeros((E, A, dim, A, dim))
    add_isotropic(K, block, dim)
    return K
