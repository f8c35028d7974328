"""The volumes that have left through surfaces since the start."""

from typing import Protocol

import numpy as np

from ..clock import FirstOrder, Scheme, SecondOrder


class Volumes(Protocol):
    """The volumes through some surfaces."""

    values: np.ndarray  # (surfaces,) [m³]

    def add(self, scheme: Scheme, rates: np.ndarray) -> None:
        """Add a step of the solid's scheme with rates (surfaces,) [m³/s]."""

    def state(self) -> list[list[float]]:
        """Return what a restart needs."""

    def load(self, state: list[list[float]]) -> None:
        """Continue from `state`."""


class SeepageVolumes:
    """Those of pore fluid, from the rates at which the volume balance holds, on the collocation
    level.

    A volume follows from its rate as the displacement of the skeleton from its velocity, by the
    same scheme from rest: what has left is what the pores have lost.
    """

    def __init__(self, count: int) -> None:
        """Start with none."""
        self.values, self._rate, self._change = (np.zeros(count) for _ in range(3))

    def add(self, scheme: Scheme, rates: np.ndarray) -> None:
        """Add a step; see `Volumes.add`."""
        dt = scheme.dt
        if isinstance(scheme, SecondOrder):
            end = self._rate + (rates - self._rate) / scheme.alpha_f
            change = (end - self._rate) / (scheme.gamma * dt)
            change -= (1 / scheme.gamma - 1) * self._change
            half = (0.5 - scheme.beta) * self._change + scheme.beta * change
            moved = dt * self._rate + dt**2 * half
        else:
            assert isinstance(scheme, FirstOrder)  # a steady run has no volumes
            end = self._rate + (rates - self._rate) / scheme.alpha_m
            change = self._change
            moved = dt * ((1 - scheme.gamma) * self._rate + scheme.gamma * end)
        self.values = self.values + moved
        self._rate = end
        self._change = change

    def state(self) -> list[list[float]]:
        """Return what a restart needs."""
        return [part.tolist() for part in (self.values, self._rate, self._change)]

    def load(self, state: list[list[float]]) -> None:
        """Continue from `state`."""
        self.values, self._rate, self._change = (np.array(part) for part in state)


class FlowVolumes:
    """Those of free fluids: the trapezoidal rule over the rates at the ends of the steps."""

    def __init__(self, rates: np.ndarray) -> None:
        """Start with none, and the rates at t = 0, (surfaces,) [m³/s]."""
        self.values = 0.0 * rates
        self._rates = rates

    def add(self, scheme: Scheme, rates: np.ndarray) -> None:
        """Add a step; see `Volumes.add`."""
        self.values = self.values + 0.5 * scheme.dt * (self._rates + rates)
        self._rates = rates

    def state(self) -> list[list[float]]:
        """Return what a restart needs."""
        return [self.values.tolist(), self._rates.tolist()]

    def load(self, state: list[list[float]]) -> None:
        """Continue from `state`."""
        self.values, self._rates = (np.array(part) for part in state)
