"""Plasticity of soils and rock at small strain, perfect or hardening: Drucker and Prager's cone.

    f = √J2 + α I1 - k <= 0      α, k of cohesion c and friction angle φ (`MATCHES`)
    dε^p = dλ (s/(2 √J2) + ᾱ I)  ᾱ as α, of the dilatancy angle ψ: associated where ψ = φ
    k = κ (c + h ε̄)              dε̄ = √(2/3 de^p:de^p), e^p the deviator of ε^p

of the effective stress σ = λ tr(ε - ε^p) I + 2μ (ε - ε^p), positive in tension, I1 = tr σ, J2 =
s:s/2 (Drucker & Prager, Q. Appl. Math. 10 (1952) 157).  A step is integrated by Euler's implicit
rule, in closed form on the cone and at its apex (de Souza Neto, Perić & Owen, Computational Methods
for Plasticity, 2008, sec. 8.3): from a trial stress (p, q = √J2) of an elastic step

    cone    Δλ = f/(μ + 9 K α ᾱ + κ h/√3)    q - μ Δλ,  p - 3 K ᾱ Δλ,  ε̄ + Δλ/√3
    apex    where q < μ Δλ:                  0,  k/(3 α) at ε̄ + q/(√3 μ)

With ε̄ of the deviator alone both returns have the same ε̄ where they meet, and the apex needs no
dilatancy.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from math import inf, radians, sin, sqrt
from typing import Any, NamedTuple

import numpy as np

from ..registry import parameter
from ..tensors import scaled_identity, three_dimensional, trace
from .linear import LinearElastic
from .strain import linear_strain

# of k: a stress that is nearer to the cone is on it, and a step that leaves it there is elastic
ON_CONE = 1e-12
PLASTIC_STRAIN = 9  # components of ε^p in the internal variables, before ε̄


class Cone(NamedTuple):
    """α [-] and κ = k/c [-] of √J2 + α I1 = κ c."""

    slope: float
    strength: float


def plane_strain(friction: float, dilatancy: float) -> Cone:
    """Return the cone that fails where Mohr and Coulomb's pyramid does in a plastic flow in plane
    strain; angles [rad].

    ε^p_zz = 0 gives s_zz = -2 ᾱ √J2, J2 (1 - 3ᾱ²) = τ² with the largest shear stress τ in the
    plane, and sin ψ = 3ᾱ/√(1 - 3ᾱ²); so τ = c cos φ - sin φ (σ_1 + σ_2)/2 is √J2 D + I1 sin φ/3 = c
    cos φ, D = √(1 - 3ᾱ²) + ᾱ sin φ.  With ψ = φ it is that of Drucker and Prager, α = tan φ/√(9 +
    12 tan²φ), inside the pyramid.
    """
    flow = sin(dilatancy) / sqrt(9 + 3 * sin(dilatancy) ** 2)
    D = sqrt(1 - 3 * flow**2) + flow * sin(friction)
    return Cone(sin(friction) / (3 * D), sqrt(1 - sin(friction) ** 2) / D)


def compression(friction: float, dilatancy: float) -> Cone:
    """Return the cone through the pyramid's edges of triaxial compression, outside of it."""
    return _through_edges(sin(friction), 3 - sin(friction))


def extension(friction: float, dilatancy: float) -> Cone:
    """Return the cone through the pyramid's edges of triaxial extension."""
    return _through_edges(sin(friction), 3 + sin(friction))


def _through_edges(sine, D):
    return Cone(2 * sine / (sqrt(3) * D), 6 * sqrt(1 - sine**2) / (sqrt(3) * D))


MATCHES = {"plane_strain": plane_strain, "compression": compression, "extension": extension}


@dataclass(frozen=True)
class DruckerPrager(LinearElastic):
    """√J2 + α I1 <= κ (c + h ε̄) of the effective stress, tension positive, elastic as
    `linear_elastic` inside; plastic strain along s/(2 √J2) + ᾱ I, ε̄ = ∫ √(2/3 de^p:de^p) of its
    deviator (Drucker & Prager, Q. Appl. Math. 10 (1952) 157).

    Stress, tangent and energy of the law itself are those of the elastic material.
    """

    cohesion: float = parameter("Pa", "c", above=0.0, example=1e4)
    friction_angle: float = parameter("degrees", "φ", at_least=0.0, at_most=80.0, example=30.0)
    dilatancy_angle: float = parameter(
        "degrees", "ψ, at most φ", at_least=0.0, at_most=80.0, example=10.0
    )
    hardening: float = parameter("Pa", "h", at_least=0.0, default=0.0, example=1e4)
    match: str = parameter(
        "-",
        "where the cone has the strength of Mohr and Coulomb's pyramid",
        kind="word",
        words=tuple(MATCHES),
        example="plane_strain",
    )

    plastic = True

    def __post_init__(self) -> None:
        """Raise ValueError where the parameters make no material together."""
        if self.dilatancy_angle > self.friction_angle:
            raise ValueError(
                f"dilatancy_angle: received {self.dilatancy_angle:g} degrees, with which a flow"
                " makes energy; expected at most the friction_angle"
                f" {self.friction_angle:g}"
            )
        if self.prony:
            raise ValueError(
                "prony: received branches with the law 'drucker_prager', which has no rate; leave"
                " them out"
            )

    @property
    def memory(self) -> int:
        """Return the number of internal variables of a point: ε^p (3, 3) and ε̄."""
        return PLASTIC_STRAIN + 1

    @property
    def symmetric(self) -> bool:
        """Return whether the tangents are symmetric: of an associated flow, hardening on the cone
        alone.
        """
        associated = self.dilatancy_angle == self.friction_angle
        return associated and (self.hardening == 0 or self.friction_angle == 0)

    @cached_property
    def unyielding(self) -> DruckerPrager:
        """Return the law without a limit."""
        return replace(self, cohesion=inf)

    @property
    def bulk(self) -> float:
        """Return K [Pa]."""
        return self.lam + 2 / 3 * self.mu

    @cached_property
    def cone(self) -> Cone:
        """Return the cone of the yield stress."""
        return MATCHES[self.match](radians(self.friction_angle), radians(self.dilatancy_angle))

    @cached_property
    def dilatancy(self) -> float:
        """Return ᾱ [-]."""
        psi = radians(self.dilatancy_angle)
        return MATCHES[self.match](psi, psi).slope

    def yield_stress(self, accumulated: np.ndarray) -> np.ndarray:
        """Return k [Pa] of ε̄, the same shape."""
        return self.cone.strength * (self.cohesion + self.hardening * accumulated)

    def after(self, internal: np.ndarray, duration: float) -> Flowing:
        """Return stress, tangent and energy as functions of H, of which the time is no variable."""
        return Flowing(self, internal)

    def updated(self, internal: np.ndarray, duration: float, H: np.ndarray) -> np.ndarray:
        """Return the internal variables, (..., 10), of H (..., d, d)."""
        state = Flowing(self, internal).returned(H)
        flow = state.flow.reshape(*internal.shape[:-1], PLASTIC_STRAIN)
        plastic = internal[..., :PLASTIC_STRAIN] + flow
        return np.concatenate([plastic, state.accumulated[..., None]], axis=-1)

    def plastic_strain(self, internal: np.ndarray) -> np.ndarray:
        """Return ε̄ [-] of internal variables (..., 10), (...)."""
        return internal[..., PLASTIC_STRAIN]


class Returned(NamedTuple):
    """The end of a step at points (...): mean stress p, factor of the trial deviator, change of ε^p
    (..., 3, 3), ε̄; of the trial stress q and the direction n = s/q (..., 3, 3), Δλ; where it is
    elastic, and where at the apex.
    """

    pressure: np.ndarray
    factor: np.ndarray
    flow: np.ndarray
    accumulated: np.ndarray
    trial: np.ndarray
    direction: np.ndarray
    multiplier: np.ndarray
    elastic: np.ndarray
    apex: np.ndarray


@dataclass(frozen=True)
class Flowing:
    """A step that starts with internal variables (..., 10), the same in plane strain as in space:
    ε^p_zz is there.
    """

    law: DruckerPrager
    internal: np.ndarray

    small_strain = True

    def returned(self, H: np.ndarray) -> Returned:
        """Return the end of the step at displacement gradients (..., d, d)."""
        law = self.law
        mu, K = law.mu, law.bulk
        strain = self._trial_strain(H)
        before = law.plastic_strain(self.internal)
        p = K * trace(strain)
        s = 2 * mu * (strain - scaled_identity(trace(strain) / 3, 3))
        q = np.sqrt(np.einsum("...ij,...ij->...", s, s) / 2)
        n = s / np.where(q > 0, q, 1.0)[..., None, None]
        alpha = law.cone.slope
        k = law.yield_stress(before)
        f = q + 3 * alpha * p - k
        multiplier = np.where(f > ON_CONE * k, f, 0.0) / self._modulus
        apex = q < mu * multiplier
        shear = np.where(apex, q / mu, multiplier)
        accumulated = before + shear / sqrt(3)
        at_apex = law.yield_stress(accumulated) / (3 * (alpha or 1.0))  # a cylinder has none
        end = np.where(apex, at_apex, p - 3 * K * law.dilatancy * multiplier)
        flow = shear[..., None, None] / 2 * n + scaled_identity((p - end) / (3 * K), 3)
        factor = 1 - mu * shear / np.where(q > 0, q, 1.0)
        return Returned(end, factor, flow, accumulated, q, n, multiplier, multiplier == 0, apex)

    @property
    def _modulus(self):
        """Return μ + 9 K α ᾱ + κ h/√3 [Pa]."""
        law = self.law
        alpha, kappa = law.cone
        return law.mu + 9 * law.bulk * alpha * law.dilatancy + kappa * law.hardening / sqrt(3)

    def _trial_strain(self, H):
        """Return the elastic strain without any flow, (..., 3, 3)."""
        plastic = self.internal[..., :PLASTIC_STRAIN]
        return linear_strain(three_dimensional(H)) - plastic.reshape(*plastic.shape[:-1], 3, 3)

    def energy(self, H: np.ndarray) -> np.ndarray:
        """Return the elastic energy K/2 (p/K)² + q²/(2μ), (...) [J/m³]."""
        end = self.returned(H)
        shear = end.factor * end.trial
        return end.pressure**2 / (2 * self.law.bulk) + shear**2 / (2 * self.law.mu)

    def stress(self, H: np.ndarray) -> np.ndarray:
        """Return σ, (..., d, d) [Pa]."""
        d = H.shape[-1]
        end = self.returned(H)
        s = (end.factor * end.trial)[..., None, None] * end.direction
        return (s + scaled_identity(end.pressure, 3))[..., :d, :d]

    def tangent(self, H: np.ndarray) -> np.ndarray:
        """Return dσ_iJ/dF_kL of the step, (..., d, d, d, d) [Pa].

        Cone: 2μ (1 - r) I_dev + K I I + r μ n n - (μ n + 3 K ᾱ I)(μ n + 3 K α I)/(μ + 9 K α ᾱ + κ
        h/√3), r = μ Δλ/q; apex: κ h/(3 √3 α) I n.
        """
        d = H.shape[-1]
        law = self.law
        end = self.returned(H)
        alpha, kappa = law.cone
        I = np.eye(3)  # noqa: E741
        n = end.direction
        flow = law.mu * n + 3 * law.bulk * law.dilatancy * I
        normal = law.mu * n + 3 * law.bulk * alpha * I
        A = _times(end.factor, 2 * law.mu * _deviator()) + law.bulk * _dyad(I, I)
        A += _times((1 - end.factor) * law.mu, _dyad(n, n))
        A -= _times(np.where(end.elastic, 0.0, 1 / self._modulus), _dyad(flow, normal))
        growth = kappa * law.hardening / (3 * sqrt(3) * (alpha or 1.0))
        A = np.where(end.apex[..., None, None, None, None], growth * _dyad(I, n), A)
        return A[..., :d, :d, :d, :d]

    def mixed_tangent(self, H: np.ndarray, before: np.ndarray) -> np.ndarray:
        """Return the tangent: there is no geometric part."""
        return self.tangent(H)


def _dyad(a: np.ndarray, b: np.ndarray) -> Any:
    """Return a_iJ b_kL, (..., 3, 3, 3, 3)."""
    return np.einsum("...iJ,...kL->...iJkL", a, b)


def _times(values, tensor):
    """Return values (...) times a tensor of four indices."""
    return values[..., None, None, None, None] * tensor


def _deviator():
    """Return the symmetric deviator of a tensor, (3, 3, 3, 3)."""
    I = np.eye(3)  # noqa: E741
    symmetric = np.einsum("ik,JL->iJkL", I, I) + np.einsum("iL,Jk->iJkL", I, I)
    return symmetric / 2 - _dyad(I, I) / 3
