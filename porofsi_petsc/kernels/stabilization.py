"""Stabilization parameters of the fluid and of the undrained limit, frozen at the start of a
step.
"""

import numpy as np

from ..compiled import specialized

# Of the viscous scale: τ = α h²/(4 ν) with the α = 1/3 of linear elements (Donea & Huerta, Finite
# Element Methods for Flow Problems, 2003, chapter 6), h being the leg of a right-angled simplex.
# Measured on the flow that a pressure drives through a square duct of 4, 8 and 16 linear tetrahedra
# a side: it is 3.1, 0.8 and 0.2 % off; with 4 it was 23, 7.1 and 1.9 %, with 24 -2.7, -0.9, -0.3 %.
VISCOUS_FACTOR = 12.0
# Where n_f = 1 - n_s0/J differs from element to element by its error, PSPG answers the fluxes of
# this error with a pressure that grows as 1/τ: with 12 the pressure on linear triangles converged
# with order 0.3 (tests/test_manufactured_space.py, Brinkman on a moving mesh), with 4 with 0.9.
VISCOUS_FACTOR_OF_VARIABLE_POROSITY = 4.0


def viscous_scale(
    viscosity: float | np.ndarray, h: np.ndarray, variable_porosity: bool
) -> np.ndarray:
    """Return 12 n μ/h², with variable porosity 4 n μ/h², (E, 1) or (E, Q) [kg/(m³ s)].

    viscosity = n μ [Pa s]; h (E,) [m]
    """
    factor = VISCOUS_FACTOR_OF_VARIABLE_POROSITY if variable_porosity else VISCOUS_FACTOR
    return factor * viscosity / h[:, None] ** 2


def momentum_tau(
    transient: float | np.ndarray,
    drag: float | np.ndarray,
    viscous: float | np.ndarray,
    convective: float | np.ndarray,
) -> np.ndarray:
    """Return τ = [(2ρ/Δt)² + S² + (C n μ/h²)² + (ρ Σ_a |c·∇N_a|)²]^(-1/2), (E, Q) [m³ s/kg].

    The arguments are the four scales [kg/(m³ s)], arrays or floats; a term left out is 0 (Tezduyar
    & Osawa 2000, drag added; C = 12, see `viscous_scale`).
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


def grid_compliance(
    E_c: float | np.ndarray, size: np.ndarray, inertia: float | np.ndarray
) -> np.ndarray:
    """Return Σ_i max(1/(4 E_c/h_i² + c_a ρ), 0.3 h_i²/(4 E_c)) e_i e_i, (E, d, d) [m⁴/N]; times α²
    it is τ_u.

    size : (E, d, d) [m²] with eigenvalues h_i² along e_i, see `fem.geometry.element_size_tensor`;
    E_c [Pa] and inertia = c_a ρ [kg/(m³ s²)], ρ = ρ_s + ρ_f, numbers or (E, 1); α is the part of
    the pressure gradient that moves the skeleton
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
