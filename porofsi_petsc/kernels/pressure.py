"""Element matrices on the pressure space of a free fluid, of which the inverse of its Schur complement is made.

For a wave k in a uniform stream c, with r = ρ c_f + S and the pressure integrated by parts, momentum and volume balance leave

    S_p(k) = k² (1 + τ ν k²)/(r + iρ c·k + ν k²)        ν = 2 μ + ν_L, what a velocity along k meets: viscosity and LSIC

because PSPG takes the whole residual but the viscous one.  The sum of 1/(1/ν + τ k²) and (r + iρ c·k)/k² is 1/S_p where either
is small, and at most twice it between.  So S_p⁻¹ ≈ Q⁻¹ + L⁻¹ T M⁻¹ with Q = M/ν + τ Laplacian (Cahouet & Chabard, Int. J. Numer.
Meth. Fluids 8 (1988) 869, stabilized) and the pressure convection-diffusion L⁻¹ T M⁻¹ (Elman, Silvester & Wathen, Finite Elements
and Fast Iterative Solvers, ch. 9).  A weight w in L and T lets r vary in space: w = r makes T M⁻¹ the identity.
"""

import numpy as np

from .assemble import bilinear, broadcast_gradient, laplacian, mass_matrix

RESOLVED = 16.0  # ν >= h²/(16 τ): a mass that Q keeps where nothing is viscous, k h > 4 of the waves only


def resistance(el, c_f):
    """Return r = ρ c_f + S, force per velocity and volume of inertia and drag, (E, Q) [kg/(m³ s)]."""
    return el.rho * c_f if el.S is None else el.rho * c_f + el.S


def pressure_compliance(el, h):
    """Return Q = ∫ q p/ν + ∫ τ ∇q·∇p, (E, A, A) [m^(d+1) s/kg], ν = 2 μ + ν_L; h (E,) [m] the sizes of the elements."""
    viscosity = np.maximum(2 * el.mu + el.nu_lsic, h[:, None] ** 2 / (RESOLVED * el.tau))
    dV = el.geometry.dV
    return mass_matrix(el.N, dV / viscosity) + laplacian(el.geometry.G, el.tau * dV)


def pressure_laplacian(el, weight):
    """Return L = ∫ 1/w ∇q·∇p, (E, A, A) [m^(d+1) s/kg], for a weight w (E, Q) [kg/(m³ s)]."""
    return laplacian(el.geometry.G, el.geometry.dV / weight)


def pressure_transport(el, f, c_f, weight):
    """Return T = ∫ r/w q p - ∫ ρ/w p c·∇q, (E, A, A) [m^d], for a weight w (E, Q) [kg/(m³ s)].

    Integrated by parts, convection has the surface term of the inflow that it needs there (without it: several times the
    iterations).
    """
    dV = el.geometry.dV / weight
    T = mass_matrix(el.N, resistance(el, c_f) * dV)
    if el.convection:
        G, c = broadcast_gradient(el.geometry.G, dV.shape[1]), el.N @ f.c
        advected = (G @ c[..., None])[..., 0]
        T -= bilinear((el.rho * dV)[..., None] * advected, np.broadcast_to(el.N, advected.shape))
    return T
