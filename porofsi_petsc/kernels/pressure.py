"""Element matrices on the pressure space of a free fluid, of which the inverse of its Schur
complement is made.

A wave k of the pressure in a uniform stream c meets, with ν = 2 μ + ν_L the viscosity (with LSIC)
of a velocity along k,

    S(k) = k² (1 + τ ν k²)/(ρ c_f + iρ c·k + ν k²)

because PSPG takes the whole residual but its viscous part.  Hence, with Q = M/ν + τ Laplacian, L
the Laplacian over ρ and T mass and convection over ν,

    S⁻¹ = (1 + L⁻¹ T) Q⁻¹

With τ = 0 this is the pressure convection-diffusion of Elman, Silvester & Wathen (Finite Elements
and Fast Iterative Solvers, ch. 9) with the factors turned round; without convection that of Cahouet
& Chabard (Int. J. Numer. Meth. Fluids 8 (1988) 869). PSPG in Q is more than a detail: Q⁻¹ + L⁻¹ (ν
T) M⁻¹ instead, whose M⁻¹ amplifies the shortest waves, took 88 iterations for 21 in a steady flow
at Re = 80.
"""

import numpy as np

from .assemble import bilinear, broadcast_gradient, laplacian, mass_matrix
from .flow import FlowElements, FlowFields


def pressure_compliance(el: FlowElements, h: np.ndarray) -> np.ndarray:
    """Return Q = ∫ q p/ν + ∫ τ ∇q·∇p, (E, A, A) [m^(d+1) s/kg]; h (E,) [m] the sizes of the
    elements.
    """
    dV = el.geometry.dV
    return mass_matrix(el.N, dV / _viscosity(el, h)) + laplacian(el.geometry.G, el.tau * dV)


def pressure_laplacian(el: FlowElements) -> np.ndarray:
    """Return L = ∫ 1/ρ ∇q·∇p, (E, A, A) [m^(d+1)/kg]."""
    return laplacian(el.geometry.G, el.geometry.dV / el.rho)


def pressure_mass(el: FlowElements) -> np.ndarray:
    """Return ∫ 1/ρ q p, (E, A, A) [m^(d+2)/kg]."""
    return mass_matrix(el.N, el.geometry.dV / el.rho)


def pressure_transport(el: FlowElements, f: FlowFields, c_f: float, h: np.ndarray) -> np.ndarray:
    """Return T = ∫ c_f/ν q p - ∫ 1/ν p c·∇q, (E, A, A) [m^(d+1)/kg]; h (E,) [m] the sizes of the
    elements.

    Convection, ∫ 1/ν q c·∇p, is integrated by parts without its surface term: as an inflow wants it
    (with it 67 iterations for 29 in a steady flow at Re = 200).
    """
    dV = el.geometry.dV / _viscosity(el, h)
    T = mass_matrix(el.N, c_f * dV)
    if el.convection:
        G = broadcast_gradient(el.geometry.G, dV.shape[1])
        c = el.N @ f.c
        advected = (G @ c[..., None])[..., 0]
        T -= bilinear(dV[..., None] * advected, np.broadcast_to(el.N, advected.shape))
    return T


def _viscosity(el, h):
    """Return ν = max(2 μ + ν_L, h²/(4 τ)), (E, Q) [Pa s]: without viscosity that of the waves which
    the mesh does not resolve.
    """
    return np.maximum(2 * el.mu + el.nu_lsic, h[:, None] ** 2 / (4 * el.tau))
