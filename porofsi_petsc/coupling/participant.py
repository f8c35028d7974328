"""One side of an interface whose other side another program computes: a fluid that is told how the
interface moves, or a solid that is told which forces act on it.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from ..clock import Scheme
from ..phases.coupling_data import Flow, MeshState, Rates
from .interface import InterfaceCoupling


class Participant(InterfaceCoupling):
    """A phase whose values on the nodes of the interface go to the other program, and the other's
    that come back.

    tells_forces : whether those that go are forces, or displacements
    """

    tells_forces: bool

    def __init__(self, *medium: Any, **scheme: Any) -> None:
        """Take what `InterfaceCoupling` takes, without what the fluid sees."""
        super().__init__(*medium, sees="given", **scheme)
        self._taken = np.zeros_like(self.solid.unknowns)

    def told_at(self, scheme: Scheme) -> float:
        """Return the time after the start of a step for which it takes the other program's values
        [s]; scheme : of the solid.
        """
        raise NotImplementedError

    def take(self, nodes: np.ndarray, values: np.ndarray) -> None:
        """Take the other program's values, (N, d), on owned nodes (N,)."""
        self._taken[nodes] = values

    def start_values(self) -> np.ndarray:
        """Return this program's values at t = 0, (n_owned, d) or longer."""
        raise NotImplementedError

    def answer(self) -> np.ndarray:
        """Return this program's values at the end of the trial step, (n_owned, d) or longer."""
        raise NotImplementedError


class FluidParticipant(Participant):
    """The fluid, told the displacement of its interface [m]; its answer is the force on it [N].

    The velocity of the interface is that of the solid's time scheme, as beside a solid of this
    program. The force at the end of a step is on the line through the last two collocated ones,
    that before the first step zero: with weights α_f and 1 - α_f the sum of the collocated ones is
    the sum of those at the ends, which is the impulse of a sudden start.
    """

    tells_forces = True

    def __init__(self, *medium: Any, **scheme: Any) -> None:
        """Take what `Participant` takes."""
        super().__init__(*medium, **scheme)
        self._is_first = True

    def told_at(self, scheme: Scheme) -> float:
        """Return the size of the step [s]: the mesh is where the solid is at its end."""
        return scheme.dt

    def _begin(self, t: float, rates: Rates, accepted: MeshState) -> None:
        self.solid.unknowns = self._taken
        super()._begin(t, rates, accepted)

    def _with_force(self, force: np.ndarray) -> Flow:
        return replace(self.fluid.flow(), force=np.zeros_like(force))

    def accept(self) -> None:
        """Make the trial states the accepted ones."""
        super().accept()
        self._is_first = False

    def start_values(self) -> np.ndarray:
        """Return no force, (n_owned, d) [N]: that of the fluid is known from its first step on."""
        return np.zeros_like(self.fluid.force)

    def answer(self) -> np.ndarray:
        """Return the force at the end of the trial step, (n_owned, d) [N]."""
        rise = 2 - self.fluid.scheme.alpha_f if self._is_first else 1.0
        return rise * self.fluid.end_interface_force


class SolidParticipant(Participant):
    """The solid, told the forces on its nodes [N]; its answer is their displacement [m].

    The forces are those on the collocation level, between those at the ends of the time window.
    """

    tells_forces = False

    def told_at(self, scheme: Scheme) -> float:
        """Return the time to the collocation level [s]."""
        return scheme.alpha_f * scheme.dt

    def _with_force(self, force: np.ndarray) -> Flow:
        return replace(self.fluid.flow(), force=self._taken)

    def start_values(self) -> np.ndarray:
        """Return the initial displacement, (n_local, d) [m]."""
        return self.solid.u

    def answer(self) -> np.ndarray:
        """Return the displacement at the end of the trial step, (n_local, d) [m]."""
        return self.solid.end_displacement
