"""An outlet into vessels that are not meshed."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..clock import Scheme, at_end
from ..kernels.surface import pressure_load
from ..registry import parameter
from .condition import LowRank, Slope, State, Surface, SurfaceCondition


@dataclass
class Windkessel(SurfaceCondition):
    """Pressure of three elements on an outlet, σ n = -(R_p Q + P) n, C dP/dt = Q - (P - P_d)/R_d, Q
    the flow out of it (Westerhof, Lankhaar & Westerhof 2009).

    Without C it is a resistance R_p + R_d.  The traction along the outlet is zero, which turns the
    flow towards walls without slip: prescribe the velocity along it, zero, where the flow is that
    of a long pipe.  In 2-D Q is that of one metre of thickness.  P follows the fluid's own time
    scheme.
    """

    behind = ("fluid",)
    excludes = {"fluid": ("traction",)}
    wants_flow = True
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
        self._t = 0.0  # of the accepted state [s]
        self._stored = np.array(self.start)  # P there [Pa]
        self._rate = np.zeros(())  # dP/dt there [Pa/s], by the first step
        self._started = False
        self._flow_rate = 0.0  # Q there, and the one of the last collocation level [m³/s]
        self._collocated_flow = 0.0
        self._age: float | None = None  # from that level to the accepted state [s]
        self._slope = self.proximal + self.distal  # dp/dQ

    def begin_step(self, scheme: Scheme, state: State) -> None:
        """Start a step: dP/dt on its collocation level is linear in P there (collective)."""
        self._scheme = scheme
        self._end = state.t + scheme.dt
        if not self._started:
            self._collocated_flow = self._flow(state)
            self._rate = np.array(self._first_rate(self._collocated_flow))
            self._age = 0.0
            self._started = True
        rate1, _ = scheme.rates(self._stored, self._stored, self._rate, self._rate)
        idle = scheme.velocity_level(self._rate, rate1)  # of a P that stays
        self._admittance = self.compliance * scheme.c_v + 1 / self.distal
        self._offset = self.distal_pressure / self.distal - self.compliance * (
            idle - scheme.c_v * self._stored
        )
        self._slope = self.proximal + 1 / self._admittance

    def _first_rate(self, flow):
        """Return dP/dt at the start [Pa/s]; 0 where P follows the flow at once."""
        if not self.compliance:
            return 0.0
        return (flow - (self.start - self.distal_pressure) / self.distal) / self.compliance

    def residual(self, state: State) -> np.ndarray:
        """Return ∮ N_a p n dA, (F, Af, d) [N] (collective)."""
        flow = self._flow(state)
        accepted = state.t == self._t
        stored = self._stored if accepted else self._collocated(flow)
        return float(self.proximal * flow + stored) * self._normals(state)

    def low_rank(self, state: State, slope: Slope) -> LowRank:
        """Return dp/dQ b bᵀ, b = ∮ N_a n dA."""
        return LowRank(self._normals(state), slope.v * self._slope)

    def accept(self, state: State) -> None:
        """Take P and Q to the end of the step (collective)."""
        flow = self._flow(state)
        before = self._stored
        scheme = self._scheme
        ends = np.array(self._collocated_flow), np.array(flow)
        self._flow_rate = float(at_end(scheme, self._age, *ends))
        if self.compliance:
            self._stored = before + (self._collocated(flow) - before) / scheme.alpha_f
        else:
            self._stored = np.array(self.distal_pressure + self.distal * self._flow_rate)
        self._rate, _ = scheme.rates(self._stored, before, self._rate, self._rate)
        self._collocated_flow = flow
        self._age = (1 - scheme.alpha_f) * scheme.dt
        self._t = self._end

    def _collocated(self, flow):
        """Return P on the collocation level for the flow there [Pa]."""
        return (flow + self._offset) / self._admittance

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
            "t": self._t,
            "pressure": float(self._stored),
            "rate": float(self._rate),
            "started": self._started,
            "flow_rate": self._flow_rate,
            "collocated_flow": self._collocated_flow,
            "age": self._age,
            "slope": float(self._slope),
        }

    def load(self, memory: dict[str, Any]) -> None:
        """Continue from `memory`."""
        self._t = memory["t"]
        self._stored = np.array(memory["pressure"])
        self._rate = np.array(memory["rate"])
        self._started = memory["started"]
        self._flow_rate = memory["flow_rate"]
        self._collocated_flow = memory["collocated_flow"]
        self._age = memory["age"]
        self._slope = memory["slope"]

    def recorded(self) -> tuple[float, float]:
        """Return the pressure on the outlet and the flow through it."""
        return float(self.proximal * self._flow_rate + self._stored), self._flow_rate
