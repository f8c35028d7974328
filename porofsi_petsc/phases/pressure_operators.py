"""The operators on the pressure space of a free fluid that precondition its Schur complement, made
anew with every tangent.
"""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from petsc4py import PETSc

from ..fem.boundary import facet_masses, open_facets
from ..kernels import pressure as kernel
from ..linalg.convection_diffusion_pc import PressureConvectionDiffusion
from ..linalg.matrix import ElementMatrix
from .setup import FreeFluidSetup

# γ of the resistance ρ h/γ of an element beside a surface: 16 takes the same iterations, 1 two or
# three more.
LAYER = 4.0


class PressureOperators:
    """Q, L, T of `kernels.pressure` for a `phases.setup.FreeFluidSetup`, and the preconditioner
    that uses them.

    L has the conditions of the pressure where the solver knows no velocity: p = 0 weakly on an open
    boundary, p = α v_n on an interface with a Robin condition (6 iterations; with p = 0 there 8,
    with none 13 to 18); where the velocity is prescribed there is none (Neumann).  In a closed part
    1/ℓ² on top of the Laplacian, ℓ the size of the fluid, makes it regular.
    """

    def __init__(self, setup: FreeFluidSetup) -> None:
        """Find the open boundaries; the matrices come with the first operators (collective)."""
        self._setup = setup
        self.domain = setup.domain
        self.preconditioner = PressureConvectionDiffusion()
        self._matrix: ElementMatrix | None = None
        self._operators: dict[str, PETSc.Mat] = {}
        domain = self.domain
        self._rows, local = open_facets(domain, setup.solver_mask[:, : domain.dim])
        self._surface, _ = facet_masses(domain, self._rows, local)
        nodes = domain.cells[self._rows[:, None], np.array(domain.element.facets)[local]]
        self._on_interface = setup.no_slip[nodes].all(axis=1)
        self._extent = domain.sum_owned(domain.reference.section.sum(axis=1)) ** (1 / domain.dim)

    def assemble(
        self,
        chunks: Callable[[], Iterable[tuple[slice, Any, Any]]],
        c_f: float,
        speed: float,
        alpha: float,
        diagonal: np.ndarray,
    ) -> None:
        """Make the operators of a tangent and give them to the preconditioner (collective).

        chunks : function that yields (slice, `FlowElements`, `FlowFields`) of all elements, once
        for each operator; c_f = da/dv [1/s]; speed : largest |c| [m/s]; alpha : α of a Robin
        condition [Pa s/m];
        diagonal : of the pressure's block of the tangent, (owned rows,)
        """
        if self._matrix is None:
            free = np.zeros((self.domain.n_local, 1), dtype=bool)
            self._matrix = self._setup.new_matrix("pressure_", free)
        h = self.domain.h
        self._set(
            "compliance",
            ((chunk, kernel.pressure_compliance(el, h[chunk])) for chunk, el, _ in chunks()),
        )
        self._set("laplacian", self._laplacians(chunks(), c_f, speed, alpha))
        self._set(
            "transport",
            ((chunk, kernel.pressure_transport(el, f, c_f, h[chunk])) for chunk, el, f in chunks()),
        )
        self.preconditioner.replace(**self._operators, diagonal=diagonal)

    def _set(self, name, element_matrices):
        """Make one operator of (slice, (E, A, A)) of all elements (collective)."""
        self._matrix.clear()
        for chunk, values in element_matrices:
            self._matrix.add(chunk, values[:, :, None, :, None])
        self._matrix.finish()
        self._operators[name] = self._matrix.mat.copy(self._operators.get(name))

    def _laplacians(self, chunks, c_f, speed, alpha):
        """Yield (slice, L (E, A, A)) with ∮ q p/(α + ρ h/γ), both resistances over the rate of the
        flow [kg/m²], in series.
        """
        for chunk, elements, _ in chunks:
            values = kernel.pressure_laplacian(elements)
            for part in self._setup.closed:
                inside = part.has(chunk) / self._extent**2
                values += inside[:, None, None] * kernel.pressure_mass(elements)
            density = elements.rho.mean(axis=1)
            rate = c_f + (speed + elements.mu / (density * self._extent)) / self._extent
            here = np.flatnonzero((self._rows >= chunk.start) & (self._rows < chunk.stop))
            rows = self._rows[here] - chunk.start
            resistance = (density * self.domain.h[chunk])[rows] / LAYER
            total = resistance + np.where(self._on_interface[here], alpha / rate[rows], 0.0)
            np.add.at(values, rows, self._surface[here] / total[:, None, None])
            yield chunk, values
