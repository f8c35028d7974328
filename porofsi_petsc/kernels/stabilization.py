"""Stabilization parameters of the fluid and of the undrained limit, frozen at the start of a
step.
"""

import numpy as np

from ..compiled import specialized


def momentum_tau(
    transient: float | np.ndarray,
    drag: float | np.ndarray,
    viscous: float | np.ndarray,
    convective: float | np.ndarray,
) -> np.ndarray:
    """Return τ = [(2ρ/Δt)² + S² + (4 n μ/h²)² + (ρ Σ_a |c·∇N_a|)²]^(-1/2), (E, Q) [m³ s/kg].

    The arguments are the four scales [kg/(m³ s)], arrays or floats; a term left out is 0 (Tezduyar
    & Osawa 2000, drag added).
    """
    return 1 / np.sqrt(transient**2 + drag**2 + viscous**2 + convective**2)


def convective_scale(N: np.ndarray, G: np.ndarray, rho: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Return ρ Σ_a |c·∇N_a| = 2 ρ |c|/h_c, (E, Q) [kg/(m³ s)], h_c the element length along c (E,
    A, d nodal).
    """
    advected = np.broadcast_to(G, (G.shape[0], len(N), *G.shape[2:])) @ (N @ c)[..., None]
    return rho * np.abs(advected[..., 0]).sum(axis=-1)


def lsic_viscosity(N: np.ndarray, rho: np.ndarray, c: np.ndarray, h: np.ndarray) -> np.ndarray:
    """Return ν_L = ρ |c| h/2, (E, Q) [Pa s]."""
    return rho * np.linalg.norm(N @ c, axis=-1) * h[:, None] / 2


# Part of the static compliance that stays on steps so short that inertia dominates at grid scale.
# Without it the stabilization fades like Δt² and pressure checkerboards grow
# (docs/pulse2d_convergence.md), also where such a step leaves the fluid free; with all of it the
# displacement under a load on linear triangles is 3.5 % off instead of 0.5 %.
STATIC_PART = 0.3


def grid_compliance(E_c: float, size: np.ndarray, inertia: float) -> np.ndarray:
    """Return Σ_i max(1/(4 E_c/h_i² + c_a ρ), 0.3 h_i²/(4 E_c)) e_i e_i, (E, d, d) [m⁴/N]; times α²
    it is τ_u.

    size : (E, d, d) [m²] with eigenvalues h_i² along e_i, see `fem.geometry.element_size_tensor`;
    inertia = c_a ρ [kg/(m³ s²)], ρ = ρ_s + ρ_f; α is the part of the pressure gradient that moves
    the skeleton
    """
    h2, e = np.linalg.eigh(size)
    compliance = np.maximum(1 / (4 * E_c / h2 + inertia), STATIC_PART * h2 / (4 * E_c))
    return (e * compliance[:, None, :]) @ np.swapaxes(e, 1, 2)


def undrained_tau(compliance: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """Return τ_u = α² times the compliance (E, d, d) of `grid_compliance` at the points, (E, Q, d,
    d); moved = α (E, Q), or symmetric tensors (E, Q, d, d) on both sides of the compliance.
    """
    if moved.ndim == 4:
        return moved @ compliance[:, None] @ moved
    E, Q = moved.shape
    tau = np.empty((E, Q, *compliance.shape[1:]))
    _undrained_loop(compliance.shape[-1])(compliance, moved, tau)
    return tau


@specialized
def _undrained_loop(d):
    """Return the loop of `undrained_tau`."""

    def loop(compliance, moved, tau):
        for e in range(tau.shape[0]):
            for q in range(tau.shape[1]):
                factor = moved[e, q] * moved[e, q]
                for i in range(d):
                    for j in range(d):
                        tau[e, q, i, j] = factor * compliance[e, i, j]

    return loop
