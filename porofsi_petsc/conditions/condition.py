"""What every condition on a surface has: what a scene says of it, its part in the balances, its
state.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, NamedTuple, Protocol

import numpy as np

from ..clock import Scheme

Kind = Literal["porous", "solid", "fluid"]  # of the material behind a surface


class Surface(Protocol):
    """The facets of one tag on a rank, F of them, with Af nodes each."""

    nodes: np.ndarray  # (F, Af)
    order: int  # of the shape functions

    @property
    def depth(self) -> np.ndarray:
        """Return the volume of the elements behind the facets over the areas of these, (F,) [m]."""

    @property
    def X(self) -> np.ndarray:
        """Return the reference positions of the nodes, (F, Af, d) [m]."""

    def rule(self, degree: int) -> Any:
        """Return the rule that is exact for polynomials of a degree: N (Q, Af), dN (Q', Af, d - 1),
        weights (Q,).
        """

    def gather(self, field: np.ndarray) -> np.ndarray:
        """Return the values of a nodal field (n_local, ...) on the facets, (F, Af, ...)."""

    def displacement(self, u: np.ndarray) -> np.ndarray:
        """Return the displacement on the facets, (F, Af, d) [m], from where the cells behind them
        are at rest: u (n_local, d), which counts from the start, less that of their placing.
        """

    def normal(self, rule: Any, u: np.ndarray | None = None) -> np.ndarray:
        """Return the outward normals times dA at the points of a rule, (F, Q, d) [m^(d-1)], where
        a displacement u (n_local, d) [m] has taken the surface; in the reference without.
        """

    def normal_by_positions(self, rule: Any, u: np.ndarray) -> np.ndarray:
        """Return the derivative of `normal` (component i) by the positions x_bj of the nodes, (F,
        Q, b, i, j) [m^(d-2)].
        """

    def of_material(self, name: str) -> np.ndarray:
        """Return an attribute of the `PorousMaterial` behind the facets, (F, 1)."""

    def sum(self, values: np.ndarray) -> float:
        """Return the sum of values (F,) over the facets of all ranks (collective)."""


class State(NamedTuple):
    """What a condition sees at one time t [s]: on the collocation level where a step is solved, or,
    accepted, at its end.

    Nodal fields with ghosts: u (n_local, d) [m] of the solid or of the fluid's mesh; v (n_local, d)
    [m/s] of the phase; c (n_local, d) [m/s] of a fluid relative to its mesh; p (n_local,) [Pa] of a
    fluid, or of that in the pores of a skeleton; v_s (n_local, d) [m/s] of the skeleton around a
    pore fluid.
    """

    t: float
    u: np.ndarray
    v: np.ndarray
    c: np.ndarray | None = None
    p: np.ndarray | None = None
    accepted: bool = False
    v_s: np.ndarray | None = None


class Slope(NamedTuple):
    """How u [m] and v [m/s] of a node follow the unknown of its phase: 1, c_v [1/s] where it is u
    of a solid; 0, 1 where it is v of a fluid.
    """

    u: float
    v: float


class LowRank(NamedTuple):
    """A part b C bᵀ of a tangent that couples all nodes of a surface: b on the facets, (F, Af, k),
    and C.
    """

    vectors: np.ndarray
    factor: float


@dataclass
class SurfaceCondition:
    """A term of the residual of one phase on one tagged surface; each surface has its own object.

    A new one: a subclass with `residual`, its parameters as `registry.parameter` fields, what
    follows here, and a line of the registry.  Its fields are the keys of a table that has its name
    in [[boundary]]; a single field `value` is what the name itself is given.

    balance : of which the residual is, "momentum" [N] or "volume" [m³/s]; behind : the kinds of
    material it may be on; excludes : kind -> what may not be prescribed on the surface beside it,
    "displacement", "velocity" or "traction" component by component where it has components itself;
    columns : what the history records of a surface -> unit; otherwise : what to do where another
    material is behind the surface; dead : whether the residual depends on the time alone;
    wants_normal_motion : whether a prescribed normal displacement, or velocity of a fluid, would
    leave it without effect; follows : whether its load on a solid goes with the surface, so that
    its tangent changes with the motion and need not be symmetric; holds : which displacements of
    the surface it resists, as a spring does, so that nothing else has to hold a body without
    inertia against them, "normal" and "tangential"; carries_pressure : whether the pore pressure is
    part of its traction, so that it does not set the level of p; unilateral : whether it has an
    `active` set, (F, Q) bool of a state, with which its tangent changes; beside : conditions of
    other balances that come with it, made of the parameters that they have in common
    """

    balance: ClassVar[Literal["momentum", "volume"]] = "momentum"
    behind: ClassVar[tuple[Kind, ...]] = ()
    excludes: ClassVar[Mapping[Kind, tuple[str, ...]]] = {}
    columns: ClassVar[Mapping[str, str]] = {}
    otherwise: ClassVar[str] = "leave it out"
    dead: ClassVar[bool] = False
    wants_normal_motion: ClassVar[bool] = False
    follows: ClassVar[bool] = False
    holds: ClassVar[Collection[str]] = ()
    carries_pressure: ClassVar[bool] = False
    unilateral: ClassVar[bool] = False
    beside: "ClassVar[tuple[type[SurfaceCondition], ...]]" = ()

    def bind(self, surface: Surface) -> None:
        """Take the surface, once, before the first step (collective)."""
        self.surface = surface

    def begin_step(self, scheme: Scheme, state: State) -> None:
        """Start a step from the accepted state (collective)."""

    def residual(self, state: State) -> np.ndarray:
        """Return what the surface adds to the residual of the balance, internal minus external,
        (F, Af, k) [N or m³/s] (collective).
        """
        raise NotImplementedError

    def tangent(self, state: State, slope: Slope) -> np.ndarray | None:
        """Return the derivative of the residual on a facet by the unknown of its nodes, of the
        volume balance by p, (F, Af, k, Af, k), None where it is zero.

        What else the residual depends on is left out: the iteration sees it.
        """
        return None

    def active(self, state: State) -> np.ndarray:
        """Return where a `unilateral` condition acts, (F, Q) bool."""
        raise NotImplementedError

    def exchange(self, state: State, slope: Slope) -> np.ndarray | None:
        """Return the derivative on a facet by the unknown of the other phase of a porous medium: of
        the balance of the skeleton by p, (F, Af, d, Af, 1), of the volume balance by the motion of
        the skeleton, (F, Af, 1, Af, d); None where it is zero, or left to the iteration.

        The monolithic schemes want it where it is not small.
        """
        return None

    def low_rank(self, state: State, slope: Slope) -> LowRank | None:
        """Return what couples all nodes of the surface in the same derivative, None where nothing
        does (collective).
        """
        return None

    def accept(self, state: State) -> None:
        """Make the trial step, which ends with this state, the accepted one (collective)."""

    def memory(self) -> dict[str, Any]:
        """Return what a restart needs, with a JSON form."""
        return {}

    def load(self, memory: dict[str, Any]) -> None:
        """Continue from `memory`."""

    def recorded(self) -> tuple[float, ...]:
        """Return the values of `columns` in the accepted state, the same on every rank."""
        return ()
