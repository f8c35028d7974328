"""What a step that does not converge is tried with before it is cut: another accelerator, then new
tangents.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..clock import Scheme
from ..config import Scene
from ..errors import ConvergenceError
from ..log import logger
from ..phases.coupling_data import Rates
from .auto import AnyMedium

if TYPE_CHECKING:
    from .loop import Clock

# remedy of `coupling.medium.Medium.remedies` -> what the log says of it
WORDING = {"accelerator": "another accelerator", "tangents": "new tangents"}


def tried_by_itself(scene: Scene) -> frozenset[str]:
    """Return what a run of the scene tries before it gives up: remedies of its coupling and "step",
    a smaller one.
    """
    choice = {"fall_back": {*WORDING, "step"}, "cut_step": {"step"}, "stop": set()}[
        scene.coupling.on_failure
    ]
    return frozenset(
        choice - ({"step"} if scene.time.scheme == "steady" else set())
    )  # whose step is no time


class FallBack:
    """Solve the steps of a coupling, each first as the scene says, then with the remedies of the
    coupling in turn.

    A remedy serves one step; the next one starts as the scene says, so that a restart needs to know
    of none.
    """

    def __init__(self, coupling: AnyMedium, clock: Clock) -> None:
        """Take the coupling and the `Clock` that counts the steps saved by a remedy."""
        self._coupling = coupling
        self._clock = clock

    def solve(self, schemes: tuple[Scheme, Scheme], rates: Rates) -> None:
        """Solve the next step; raise the first ConvergenceError where no remedy helps
        (collective).
        """
        arguments = schemes, rates, self._clock.t, self._clock.step + 1
        try:
            self._coupling.step(*arguments)
            return
        except ConvergenceError as error:
            failure = error
        for remedy in self._coupling.remedies:
            if remedy not in self._coupling.tried:
                continue
            self._coupling.reset()
            try:
                with self._coupling.remedied(remedy):
                    self._coupling.step(*arguments)
            except ConvergenceError:
                continue
            self._count(remedy, failure)
            return
        raise failure

    def _count(self, remedy, failure):
        counts = self._clock.fall_backs
        if not counts[remedy]:
            logger.info(
                "%s; solved with %s (said once, counted in summary.json)",
                failure.what,
                WORDING[remedy],
            )
        counts[remedy] += 1
