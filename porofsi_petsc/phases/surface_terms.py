"""What the conditions on its surfaces add to the balances of a phase."""

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..clock import Scheme
from ..conditions import Slope, State, SurfaceCondition
from ..errors import InputError
from ..fem.surface import Surface
from ..linalg.low_rank import Coupled


@dataclass(frozen=True)
class OnSurface:
    """A condition and where it is; key : its place in the scene."""

    condition: SurfaceCondition
    surface: Surface
    key: str


class SurfaceTerms:
    """The conditions of one balance, k components, of a phase; empty where there are none."""

    def __init__(self, n_owned: int, k: int, places: Iterable[OnSurface]) -> None:
        """Bind the conditions to their surfaces (collective)."""
        self._shape = n_owned, k
        self.places = tuple(places)
        for place in self.places:
            place.condition.bind(place.surface)
        self._dead = np.zeros(self._shape)

    def __iter__(self) -> Iterator[OnSurface]:
        return iter(self.places)

    def begin_step(self, scheme: Scheme, state: State) -> None:
        """Start a step from the accepted state (collective)."""
        accepted = state._replace(accepted=True)
        for place in self.places:
            place.condition.begin_step(scheme, accepted)
        collocated = state._replace(t=state.t + scheme.alpha_f * scheme.dt)
        self._dead = self._sum(collocated, dead=True)

    def residual(self, state: State) -> np.ndarray:
        """Return the sum of the residuals, (n_owned, k) [N or m³/s] (collective)."""
        return self._dead + self._sum(state, dead=False)

    def _sum(self, state, dead):
        nodal = np.zeros(self._shape)
        for place in self.places:
            if place.condition.dead == dead:
                place.surface.add_to(nodal, place.condition.residual(state))
        return nodal

    def given(self, state: State) -> tuple[tuple[np.ndarray, np.ndarray], ...]:
        """Return the facets, nodes (F, Af), and the residuals (F, Af, k) of every condition in the
        accepted state (collective).
        """
        state = state._replace(accepted=True)
        return tuple((place.surface.nodes, place.condition.residual(state)) for place in self)

    @property
    def is_unilateral(self) -> bool:
        """Return whether a condition acts on one side alone."""
        return any(place.condition.unilateral for place in self)

    def active(self, state: State) -> np.ndarray:
        """Return where the unilateral conditions act, one after the other, (n,) bool."""
        found = [p.condition.active(state).ravel() for p in self if p.condition.unilateral]
        return np.concatenate(found) if found else np.zeros(0, dtype=bool)

    def tangents(self, state: State, slope: Slope) -> "SurfaceTangents":
        """Return the derivative of `residual` by the unknown of the phase (collective)."""
        live = [place for place in self.places if not place.condition.dead]
        local = [(place.surface, place.condition.tangent(state, slope)) for place in live]
        low_rank = [(place.surface, place.condition.low_rank(state, slope)) for place in live]
        return SurfaceTangents(
            tuple((surface, tangent) for surface, tangent in local if tangent is not None),
            tuple(self._coupled(surface, term) for surface, term in low_rank if term is not None),
        )

    def exchanges(self, state: State, slope: Slope) -> "SurfaceTangents":
        """Return the derivative of `residual` by the unknown of the other phase of a porous
        medium.
        """
        found = [(place.surface, place.condition.exchange(state, slope)) for place in self.places]
        local = tuple((surface, value) for surface, value in found if value is not None)
        return SurfaceTangents(local, ())

    def _coupled(self, surface, term):
        nodal = np.zeros(self._shape)
        surface.add_to(nodal, term.vectors)
        return Coupled(nodal, term.factor)

    def accept(self, state: State) -> None:
        """Make the trial step, which ends with this state, the accepted one (collective)."""
        for place in self.places:
            place.condition.accept(state._replace(accepted=True))

    def memory(self) -> dict[str, Any]:
        """Return the numbers a restart needs, by the places of the conditions that have some;
        raises InputError where they are not the same on all ranks (collective).
        """
        found = {place.key: place.condition.memory() for place in self.places}
        for place in self.places:
            self._require_one_memory(place, found[place.key])
        return {key: memory for key, memory in found.items() if memory}

    def _require_one_memory(self, place, memory):
        everywhere = set(place.surface.comm.allgather(json.dumps(memory, sort_keys=True)))
        if len(everywhere) > 1:
            raise InputError(
                f"[{place.key}]: received from `memory` other numbers on each rank, expected the"
                " same on all of them, as those of the whole surface are; run on one rank, or keep"
                " what `Surface.sum` returns"
            )

    def load(self, memory: dict[str, Any]) -> None:
        """Continue from `memory`."""
        for place in self.places:
            if place.key in memory:
                place.condition.load(memory[place.key])

    def recorded(self) -> dict[str, float]:
        """Return column of the history -> value in the accepted state."""
        return {
            f"{place.surface.tag}.{column}": value
            for place in self.places
            for column, value in zip(
                place.condition.columns, place.condition.recorded(), strict=True
            )
        }


@dataclass(frozen=True)
class SurfaceTangents:
    """Tangents of facets, (F, Af, k, Af, l) each with its surface, and what couples whole
    surfaces.
    """

    local: tuple[tuple[Surface, np.ndarray], ...]
    coupled: tuple[Coupled, ...]

    def add_to(self, K: np.ndarray, chunk: slice, row: int = 0, column: int = 0) -> None:
        """Add those of facets to the tangents (E, A, m, A, n) of a slice of the elements, from
        their components row and column on.
        """
        for surface, tangent in self.local:
            surface.add_tangent(K, chunk, tangent, row, column)
