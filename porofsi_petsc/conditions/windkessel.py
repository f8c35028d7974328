"""An outlet into vessels that are not meshed."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..clock import Scheme, Steady
from ..kernels.surface import pressure_load
from ..registry import parameter
from .condition import LowRank, Slope, State, Surface, SurfaceCondition

# Time over R_d C below which differences of its exponential have lost digits.
FEW_DIGITS = 1e-4


@dataclass
class Windkessel(SurfaceCondition):
    """Pressure of three elements on an outlet, σ n = -(R_p Q + P) n, C dP/dt = Q - (P - P_d)/R_d, Q
    the flow out of it (Westerhof, Lankhaar & Westerhof 2009).

    Without C it is a resistance R_p + R_d.  The traction along the outlet is zero, which turns the
    flow towards walls without slip: prescribe the velocity along it, zero, where the flow is that
    of a long pipe.  In 2-D Q is that of one metre of thickness.

    P at the end of a step is the exact answer to the flow on the line through those of the last two
    collocation levels, and linear between the ends of steps: of second order, without ringing
    however small R_d C is, and without growth however long the step is beside √(inertance C).
    """

    behind = ("fluid",)
    excludes = {"fluid": ("traction",)}
    wants_normal_motion = True
    columns = {"pressure": "Pa", "flow_rate": "m³/s"}

    proximal: float = parameter("Pa s/m³", "R_p", at_least=0.0, default=0.0, example=0.4)
    distal: float = parameter("Pa s/m³", "R_d", above=0.0, example=2.0)
    compliance: float = parameter("m³/Pa", "C", at_least=0.0, default=0.0, example=0.3)
    distal_pressure: float = parameter("Pa", "P_d", default=0.0, example=0.1)
    start: float = parameter("Pa", "P at t = 0", default=0.0, example=0.2)

    def bind(self, surface: Surface) -> None:
        """Take a rule that is exact for the flow through flat facets."""
        super().bind(surface)
        self._rule = surface.rule(2 * surface.order)
        self._stored = self.start  # P of the accepted state [Pa]
        self._flow_rate = 0.0  # Q of it [m³/s]
        self._earlier: tuple[float, float] | None = (
            None  # time before it [s] and Q of the last collocation level
        )
        self._slope = self.proximal + self.distal  # dp/dQ

    def begin_step(self, scheme: Scheme, state: State) -> None:
        """Start a step: P is linear in Q on the collocation level (collective)."""
        self._flow_before = self._flow(state)
        self._size, self._level = scheme.dt, scheme.alpha_f
        self._is_resistance = isinstance(scheme, Steady) or not self.compliance
        self._slope = self.proximal + self.distal
        if not self._is_resistance:
            self._slope = self.proximal + self._level * self._end_by_flow()

    def residual(self, state: State) -> np.ndarray:
        """Return ∮ N_a p n dA, (F, Af, d) [N] (collective)."""
        if state.accepted:
            return self._pressure * self._normals(state)
        flow = self._flow(state)
        return (self.proximal * flow + self._collocated(flow)) * self._normals(state)

    def low_rank(self, state: State, slope: Slope) -> LowRank:
        """Return dp/dQ b bᵀ, b = ∮ N_a n dA."""
        return LowRank(self._normals(state), slope.v * self._slope)

    def accept(self, state: State) -> None:
        """Take P and Q to the end of the step (collective)."""
        self._flow_rate = self._flow(state)
        if self._is_resistance:
            self._stored = self.distal_pressure + self.distal * self._flow_rate
            return
        flow = self._flow_before + self._level * (self._flow_rate - self._flow_before)
        self._stored = self._end(flow)
        self._earlier = ((1 - self._level) * self._size, flow)

    @property
    def _pressure(self):
        """Return that on the outlet in the accepted state [Pa]."""
        return self.proximal * self._flow_rate + self._stored

    def _collocated(self, flow):
        """Return P on the collocation level, where the flow is `flow`."""
        if self._is_resistance:
            return self.distal_pressure + self.distal * flow
        return self._stored + self._level * (self._end(flow) - self._stored)

    def _end(self, flow):
        """Return P at the end of a step of the flow `flow` on the collocation level."""
        before, earlier = self._earlier or (0.0, self._flow_before)
        since = self._level * self._size
        slope = (flow - earlier) / (since + before)
        first, last = flow - since * slope, flow + (self._size - since) * slope
        of_stored, of_first, of_last = self._weights(self._size)
        rest = of_stored * (self._stored - self.distal_pressure)
        return self.distal_pressure + rest + self.distal * (of_first * first + of_last * last)

    def _end_by_flow(self):
        """Return its derivative by that flow."""
        since = self._level * self._size
        before = self._earlier[0] if self._earlier else 0.0
        _, of_first, of_last = self._weights(self._size)
        last = of_last * (self._size + before) / (since + before)
        return self.distal * (of_first * before / (since + before) + last)

    def _weights(self, size):
        """Return e, φ - e and 1 - φ with e = exp(-x), φ = (1 - e)/x, x the time over R_d C: of P
        and of the first and last flow in its exact answer to one that changes linearly.
        """
        x = size / (self.distal * self.compliance)
        if x < FEW_DIGITS:
            return np.exp(-x), x / 2 - x**2 / 3 + x**3 / 8, x / 2 - x**2 / 6 + x**3 / 24
        e = np.exp(-x)
        mean = -np.expm1(-x) / x
        return e, mean - e, 1 - mean

    def _normals(self, state):
        normal = self.surface.normal(self._rule, state.u)
        return pressure_load(self._rule.N, normal, np.ones(normal.shape[:2]))

    def _flow(self, state):
        """Return ∮ c·n dA, out of the fluid [m³/s] (collective)."""
        flow = (self._normals(state) * self.surface.gather(state.c)).sum(axis=(1, 2))
        return self.surface.sum(flow)

    def memory(self) -> dict[str, Any]:
        """Return what a restart needs."""
        return {
            "pressure": float(self._stored),
            "flow_rate": self._flow_rate,
            "slope": float(self._slope),
            "earlier": self._earlier,
        }

    def load(self, memory: dict[str, Any]) -> None:
        """Continue from `memory`."""
        self._stored = memory["pressure"]
        self._flow_rate = memory["flow_rate"]
        self._slope = memory["slope"]
        self._earlier = memory.get("earlier")  # none in checkpoints of older versions

    def recorded(self) -> tuple[float, float]:
        """Return the pressure on the outlet and the flow through it."""
        return float(self._pressure), self._flow_rate
