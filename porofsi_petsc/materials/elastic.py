"""What a hyperelastic law has: energy per reference volume, first Piola-Kirchhoff stress and its
tangent.

All take the displacement gradient H_iJ = du_i/dX_J = F_iJ - delta_iJ, (..., d, d); d = 2 is plane
strain (F_33 = 1).  With H instead of F a strain of 1e-9 keeps its digits.  Stress in tension is
positive.  Units: Pa for energy density, stress and tangent.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np

from ..tensors import three_dimensional
from .viscoelastic import Branch, Overstressed, relaxed


@dataclass(frozen=True)
class ElasticLaw:
    """Lamé parameters [Pa] that every isotropic law reduces to at small strain.

    A new law: a subclass with `energy`, `stress` and `tangent`, its own numbers as fields by
    `law.parameter`, and a line of `materials.ELASTIC`; one with the energy alone is a
    `from_energy.FromEnergy`.

    n_s0 : initial solid fraction [-]; only a law with a compaction point, `compacts`, looks at it
    prony : branches of a generalized Maxwell body, of which the law is the spring that remains
    """

    lam: float
    mu: float
    n_s0: float = 0.0
    prony: tuple[Branch, ...] = ()

    # true: the stress is one of sym F alone, and of a law that is not plastic linear in it
    small_strain = False
    # true: beyond a limit the stress flows; its tangent is that of a step and may be singular
    plastic = False
    # true: the stress is infinite at J = n_s0, where no pore is left, and NaN beyond
    compacts = False
    anisotropic = False  # true: at small strain it is not that of λ and μ alone
    turns = False  # true: its directions follow the position, and `placed` gives those of points
    most_lame_ratio = inf  # the largest λ/μ with which it is a law [-]

    @property
    def oedometer_modulus(self) -> float:
        """Return E_c = lambda + 2 mu [Pa], the modulus of a laterally confined compression; of an
        anisotropic law that of the stiffest direction.
        """
        return self.lam + 2 * self.mu

    @property
    def largest_ratio(self) -> float:
        """Return λ/μ [-], the largest one of a law with fields."""
        return self.lam / self.mu

    def at(self, cells: slice | np.ndarray) -> ElasticLaw:
        """Return the law of some cells of the mesh, by their numbers: the same for all."""
        return self

    def placed(self, X: np.ndarray) -> ElasticLaw:
        """Return the law at points X (E, P, d) [m] of its cells: the same at all."""
        return self

    @property
    def axes(self) -> tuple[np.ndarray, ...]:
        """Return the unit vectors (3,) of an anisotropic law."""
        return ()

    @property
    def softest_modulus(self) -> float:
        """Return the modulus of a laterally confined compression in the softest direction [Pa]."""
        return self.oedometer_modulus

    @property
    def symmetric(self) -> bool:
        """Return whether the tangents are symmetric, dP_iJ/dF_kL = dP_kL/dF_iJ."""
        return True

    @property
    def unyielding(self) -> ElasticLaw:
        """Return the law without a limit, with the same internal variables; of a plastic one."""
        return self

    @property
    def memory(self) -> int:
        """Return the number of internal variables of a point, 0 of a law of the present strain
        alone.
        """
        return 9 * (1 + len(self.prony)) if self.prony else 0

    def after(self, internal: np.ndarray, duration: float) -> Any:
        """Return stress, tangent and energy as functions of H at the end of a time [s] that starts
        with the internal variables (..., memory); of a law with memory.
        """
        return Overstressed(self, internal, duration)

    def updated(self, internal: np.ndarray, duration: float, H: np.ndarray) -> np.ndarray:
        """Return the internal variables, (..., memory), at the end of a time [s] that starts with
        others and ends with H, (..., d, d); of a law with memory.
        """
        return relaxed(self, internal, duration, three_dimensional(H))

    def plastic_strain(self, internal: np.ndarray) -> np.ndarray:
        """Return the accumulated plastic strain [-] of internal variables (..., memory), (...); of
        a plastic law.
        """
        raise NotImplementedError(f"{type(self).__name__} is not plastic")

    lowest_ratio = 0.0  # J in confined compression below which the law softens, or has no stress

    def confined(self, J: float | np.ndarray) -> Any:
        """Return the nominal stress of F = diag(1, 1, J) along it, the shape of J [Pa]; in closed
        form where a law has one.
        """
        H = np.zeros((*np.shape(J), 3, 3))
        H[..., 2, 2] = np.subtract(J, 1)
        return self.stress(H)[..., 2, 2]

    def energy(self, H: np.ndarray) -> np.ndarray:
        """Return Psi, (...)."""
        raise NotImplementedError(f"{type(self).__name__} has no energy")

    def stress(self, H: np.ndarray) -> np.ndarray:
        """Return P, (..., d, d)."""
        raise NotImplementedError(f"{type(self).__name__} has no stress")

    def tangent(self, H: np.ndarray) -> np.ndarray:
        """Return dP/dF, (..., d, d, d, d)."""
        raise NotImplementedError(f"{type(self).__name__} has no tangent")

    def mixed_tangent(self, H: np.ndarray, before: np.ndarray) -> np.ndarray:
        """Return dP/dF at H with the stress that is linear from another H, of the iterate before,
        in its geometric part.

        A change of displacement that keeps the volume to first order changes it in the second: at λ
        >> μ the stress λ (J - 1) of such an iterate is of no meaning, and in the geometric
        stiffness it spoils the next one.  A stress that is an unknown of its own and eliminated
        from Newton's equations is linear in the change (Magisano, Leonetti & Garcea, CMAME 313
        (2017) 986); the residual stays that of the displacement.  Quadratic convergence is kept.
        """
        return self.tangent(H)
