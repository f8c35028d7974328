"""One side of an interface whose other side another program computes: a fluid that is told how the
interface moves, or a solid that is told which forces act on it.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from ..phases.coupling_data import Flow, MeshState, Rates
from .interface import InterfaceCoupling


class Participant(InterfaceCoupling):
    """A phase and the nodes of the interface that this rank owns, whose values go to and come from
    the other program.
    """

    def __init__(self, *medium: Any, nodes: np.ndarray, **scheme: Any) -> None:
        """Take what `InterfaceCoupling` takes, without what the fluid sees, and the nodes (N,)."""
        super().__init__(*medium, sees="given", **scheme)
        self.nodes = nodes
        self._taken = np.zeros_like(self.solid.unknowns)

    def take(self, values: np.ndarray) -> None:
        """Take the other program's values at the end of the step, (N, d)."""
        self._taken[self.nodes] = values

    def answer(self) -> np.ndarray:
        """Return this program's values at the end of the trial step, (N, d)."""
        raise NotImplementedError


class FluidParticipant(Participant):
    """The fluid, told the displacement of its interface [m]; its answer is the force on it [N].

    The velocity of the interface is that of the solid's time scheme, as beside a solid of this
    program.
    """

    def _begin(self, t: float, rates: Rates, accepted: MeshState) -> None:
        self.solid.unknowns = self._taken
        super()._begin(t, rates, accepted)

    def _with_force(self, force: np.ndarray) -> Flow:
        return replace(self.fluid.flow(), force=np.zeros_like(force))

    def answer(self) -> np.ndarray:
        """Return the force on the interface at the end of the trial step, (N, d) [N]."""
        return self.fluid.end_interface_force[self.nodes]


class SolidParticipant(Participant):
    """The solid, told the forces on its nodes [N]; its answer is their displacement [m].

    The force on the collocation level lies between those at the ends of the step; in the first step
    it is that at its end.
    """

    def __init__(self, *medium: Any, **scheme: Any) -> None:
        """Take what `Participant` takes."""
        super().__init__(*medium, **scheme)
        self._before: np.ndarray | None = None

    def _with_force(self, force: np.ndarray) -> Flow:
        level = self._taken
        if self._before is not None:
            level = self._before + self.solid.scheme.alpha_f * (self._taken - self._before)
        return replace(self.fluid.flow(), force=level)

    def accept(self) -> None:
        """Make the trial states, and the force, the accepted ones."""
        super().accept()
        self._before = self._taken.copy()

    def answer(self) -> np.ndarray:
        """Return the displacement of the interface at the end of the trial step, (N, d) [m]."""
        return self.solid.end_displacement[self.nodes]
