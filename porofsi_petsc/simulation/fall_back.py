"""What a step that does not converge is tried with before it is cut: another accelerator, then new
tangents.
"""

from ..errors import ConvergenceError
from ..log import logger

# remedy of `coupling.medium.Medium.remedies` -> what the log says of it
WORDING = {"accelerator": "another accelerator", "tangents": "new tangents"}


def tried_by_itself(scene):
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

    def __init__(self, coupling, clock):
        """Take the coupling and the `Clock` that counts the steps saved by a remedy."""
        self._coupling = coupling
        self._clock = clock

    def solve(self, schemes, rates):
        """Solve the next step; raise the first ConvergenceError where no remedy helps
        (collective).
        """
        arguments = schemes, rates, self._clock.t, self._clock.step + 1
        try:
            return self._coupling.step(*arguments)
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
            return self._count(remedy, failure)
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
