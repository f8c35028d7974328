"""When tangents are renewed, and what a restart needs to make the same lagged ones again."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
from mpi4py import MPI

from ..fem.distribute import LocalMesh
from .coupling_data import Rates

WEAR_FACTOR = 1.5
WEAR_OFFSET = 2
# relative change of the state, and contraction, after which full Newton renews tangents
GROWTH = 0.03
SLOW = 0.5


class TangentRule:
    """Keep a tangent over iterations and steps while the coupling iteration stays as quick as when
    it was made.

    Renew it when the rates (step size) change, or when the last step took more than 1.5 n + 2
    iterations, n those of the first step with it.  Renewal happens between steps, so that the
    linearization point is an accepted state, which a checkpoint can hold.  A linear phase renews
    its tangent only with the rates and stores no point.
    """

    def __init__(self, linear: bool) -> None:
        """Start without a tangent."""
        self._linear = linear
        self.rates: Rates | None = None
        self._point: dict[str, np.ndarray] = {}
        self._built_with: int | None = None

    def due(self, rates: Rates, iterations: int) -> bool:
        """Return whether a new tangent is wanted at the start of a step; iterations are those of
        the last step, 0 at first.
        """
        if rates != self.rates:
            return True
        if self._built_with is None:
            self._built_with = iterations
        return not self._linear and iterations > WEAR_FACTOR * self._built_with + WEAR_OFFSET

    def store(self, rates: Rates, fields: Mapping[str, np.ndarray]) -> None:
        """Remember the rates and the linearization point, name -> (n_local, ...)."""
        self.rates = rates
        self._built_with = None
        self._point = {} if self._linear else {name: field.copy() for name, field in fields.items()}

    def forget(self) -> None:
        """Make the next `due` true."""
        self.rates = None

    def state(self, n_owned: int) -> dict[str, np.ndarray]:
        """Return the linearization point on the owned nodes for a checkpoint."""
        return {f"tangent_{name}": field[:n_owned] for name, field in self._point.items()}

    def memory(self) -> dict[str, Any]:
        """Return the rates and the iteration count of the rule for a checkpoint."""
        rates = None if self.rates is None else [self.rates.c_f, self.rates.c_v, self.rates.c_a]
        return {"rates": rates, "built_with": self._built_with}

    def load(
        self, arrays: Mapping[str, np.ndarray], memory: Mapping[str, Any], mesh: LocalMesh
    ) -> dict[str, np.ndarray] | None:
        """Restore from a checkpoint; return the linearization point (empty for a linear phase),
        None without a tangent.
        """
        self.rates = None if memory["rates"] is None else Rates(*memory["rates"])
        self._built_with = memory["built_with"]
        if self.rates is None:
            return None
        named = {
            name.removeprefix("tangent_"): array
            for name, array in arrays.items()
            if name.startswith("tangent_")
        }
        self._point = {name: mesh.halo.extend(owned) for name, owned in named.items()}
        return self._point


class Moving(Protocol):
    """A phase as `Travel` sees it."""

    mesh: LocalMesh
    unknowns: np.ndarray

    @property
    def is_linear(self) -> bool: ...


class Travel:
    """Say when the sweeps of full Newton want new tangents: where the trial state has moved since,
    or they are slow.

    Moved is a change of v_f or u by more than 3 %, to which the error of a tangent is proportional;
    slow is an iteration that leaves more than half of the residual: a slender beam stiffens by a
    fraction of a per cent of its bending.  Factorizations and sweeps, with new tangents in every
    sweep and by this rule: FSI1 on P2 level 1 16, 16 and 7, 18; CFD2 17, 17 and 10, 24; CSM1 19, 19
    and 12, 28 (by the move alone it stalls). Every step starts with new ones, so that a restart
    needs none.  A linear problem renews them with the rates alone.
    """

    def __init__(self, solid: Moving, fluid: Moving, comm: MPI.Comm) -> None:
        """Take the phases, whose trial states it looks at."""
        self._solid = solid
        self._fluid = fluid
        self._comm = comm
        self._linear = solid.is_linear and fluid.is_linear
        self._rates: Rates | None = None
        self._start: tuple[np.ndarray, ...] | None = None

    def begin_step(self) -> None:
        """Forget the state of the last step's tangents."""
        if not self._linear:
            self._start = None

    def forget(self) -> None:
        """Ask for new tangents."""
        self._start = None

    def are_stale(self, rates: Rates, contraction: float) -> bool:
        """Return whether the tangents are to be made anew at the trial state, as which it is then
        remembered (collective).

        contraction : residual over that of the iteration before, 1 on the first
        """
        state = self._solid.unknowns, self._fluid.unknowns[:, : self._solid.mesh.dim]
        stale = self._start is None or rates != self._rates
        if not (stale or self._linear):
            stale = contraction > SLOW or self._moved(state)
        if stale:
            self._rates = rates
            self._start = tuple(field.copy() for field in state)
        return stale

    def _moved(self, state):
        squares = [
            [np.vdot(a - b, a - b), np.vdot(a, a)] for a, b in zip(state, self._start, strict=True)
        ]
        return any(
            change > GROWTH**2 * size for change, size in self._comm.allreduce(np.array(squares))
        )
