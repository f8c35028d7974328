"""What partitioned schemes share: lagged or new tangents of the phases, an accelerator and what it
leaves to the next step.
"""

import itertools
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
from mpi4py import MPI

from ..accelerators import Anderson, Plain, QuasiNewton
from ..clock import Scheme
from ..phases.coupling_data import MeshState, Rates
from ..phases.tangent import Travel
from .medium import Medium
from .protocols import Arrays, Fluid, Memory, Solid

PATIENCE = 2  # sweeps between two renewals of lagged tangents within a step
NAMES = ("residual", "image")  # of the vectors that an accelerator reuses


class PartitionedMedium(Medium):
    """Two phases solved in turn; a scheme says what a sweep is, what its accelerated vector and the
    inner product `_dot` are.
    """

    def __init__(
        self,
        solid: Solid,
        fluid: Fluid,
        comm: MPI.Comm,
        tolerance: float,
        max_iterations: int,
        accelerator: Callable[..., Plain],
        full_newton: bool,
    ) -> None:
        """Take the medium, what makes an accelerator, and whether tangents are new in every sweep
        or lagged.

        accelerator : inner product, and a name where it is not the scene's -> accelerator
        """
        super().__init__(solid, fluid, comm, tolerance, max_iterations)
        self._accelerator = accelerator(self._dot)
        self._travel = Travel(solid, fluid, comm) if full_newton else None
        self._spare = accelerator(
            self._dot, "iqn_ils" if isinstance(self._accelerator, Anderson) else "anderson"
        )
        self._linear = solid.is_linear and fluid.is_linear

    @property
    def remedies(self) -> tuple[str, ...]:
        """Return what a step that failed is tried with, in turn."""
        lagged = not (self._linear or self._travel or self.solid.is_plastic)
        return ("accelerator", "tangents") if lagged else ("accelerator",)

    @contextmanager
    def remedied(self, remedy: str) -> Iterator[None]:
        """Sweep with the spare accelerator, by the remedy "tangents" with tangents of full Newton
        besides.
        """
        own = self._accelerator, self._travel
        self._accelerator = self._spare
        if remedy == "tangents":
            self._travel = Travel(self.solid, self.fluid, self._comm)
        try:
            yield
        finally:
            self._accelerator, self._travel = own

    def _dot(self, a: np.ndarray, b: np.ndarray) -> float:
        """Return the inner product of two accelerated vectors."""
        raise NotImplementedError

    def _alternatives(self) -> dict[str, str]:
        """Return name -> what to try."""
        alternatives = super()._alternatives()
        if not isinstance(self._accelerator, Anderson | QuasiNewton):
            alternatives["accelerator"] = 'coupling.accelerator = "iqn_ils"'
        if "tangents" in self.remedies:
            alternatives["tangents"] = 'coupling.tangent = "newton"'
        return alternatives | {"scheme": 'coupling.scheme = "direct"'}

    def _begin(self, t: float, rates: Rates, accepted: MeshState) -> None:
        self._accelerator.begin_step()
        self._renewed_at = 0
        if self._travel:
            self._travel.begin_step()
        else:
            self.fluid.prepare_tangent(rates, self.iterations, accepted)
            if not self.solid.is_plastic:
                self.solid.prepare_tangent(rates, self.iterations)

    def _renew_tangents(self, iteration: int, rates: Rates) -> bool:
        """Renew both tangents at the trial state: by full Newton where it has moved, else where
        lagged ones are slow or far away.

        Return whether lagged ones were renewed, which makes the sweep another map.  A plastic solid
        has a new tangent in every sweep, by which none is another map.
        """
        if self._travel:
            moved = self._travel.are_stale(rates, self.convergence.contraction)
            stale = self.fluid.has_switched() or moved
        else:
            stale = not self._linear and (
                self.fluid.volume_has_changed(self.mesh_state())
                or self.fluid.has_switched()
                or self._slow(iteration)
            )
        if stale:
            self.fluid.renew_tangent(rates, self.mesh_state())
            self._renewed_at = iteration
        if stale or self.solid.is_plastic:
            self.solid.renew_tangent(rates)
        return stale and not self._travel

    def _slow(self, iteration: int) -> bool:
        return iteration - self._renewed_at >= PATIENCE and self.convergence.slow

    # -- what a step leaves to the next ------------------------------------------------------------

    def reset(self) -> None:
        """Forget the trial states and what the accelerator has learnt, and ask for new tangents."""
        super().reset()
        self._accelerator.restart()
        if self._travel:
            self._travel.forget()

    def state(self) -> Arrays:
        """Return the arrays a restart needs, name -> (n_owned, ...), with the vectors that the
        accelerator reuses.
        """
        pairs = [pair for step in self._accelerator.columns() for pair in step]
        return super().state() | {
            f"accelerator.{i}.{name}": a
            for i, pair in enumerate(pairs)
            for name, a in zip(NAMES, pair, strict=True)
        }

    def memory(self) -> Memory:
        """Return the numbers a restart needs beside the arrays."""
        return super().memory() | {"columns": [len(step) for step in self._accelerator.columns()]}

    def load_state(
        self, arrays: Arrays, memory: Memory, schemes: tuple[Scheme, Scheme], rates: Rates
    ) -> None:
        """Continue from `state` and `memory`; schemes and rates are those of the next step."""
        super().load_state(arrays, memory, schemes, rates)
        number = itertools.count()
        counts = memory.get("columns", ())
        residual, image = NAMES
        steps = [
            [
                (arrays[f"accelerator.{i}.{residual}"], arrays[f"accelerator.{i}.{image}"])
                for i in itertools.islice(number, n)
            ]
            for n in counts
        ]
        self._accelerator.load(steps)
