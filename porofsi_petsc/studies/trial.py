"""One run of a scene for a study: its numbers in memory, no files, failures as text."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from mpi4py import MPI

from ..config import Scene
from ..errors import PorofsiError
from ..linalg.options import start
from ..linalg.stopwatch import Stopwatch
from ..simulation.auto import AnyMedium
from ..simulation.energy import Energy
from ..simulation.loop import Clock
from ..simulation.simulation import Simulation

# looks at an accepted step
Watch = Callable[[Clock, AnyMedium, Energy], None]


@dataclass
class Outcome:
    """What a run did: the message of its failure ("" when it reached the end), coupling iterations
    per step.

    cuts : steps repeated with a smaller size; oscillation : `Measures.oscillation_indicator`;
    energy_error : relative error of the energy balance; unknowns : of all fields; seconds : wall
    time with set-up, without what the watch took; t : reached [s]
    """

    failure: str = ""
    iterations: list = field(default_factory=list)
    cuts: int = 0
    oscillation: float = 0.0
    energy_error: float = 0.0
    unknowns: int = 0
    seconds: float = 0.0
    t: float = 0.0

    @property
    def mean(self) -> float:
        """Return the mean number of coupling iterations of a step, NaN when no step was
        accepted.
        """
        return float(np.mean(self.iterations)) if self.iterations else float("nan")

    @property
    def largest(self) -> int:
        """Return the largest number of coupling iterations of a step, 0 when no step was
        accepted.
        """
        return max(self.iterations, default=0)


def attempt(scene: Scene, watcher: Callable[[AnyMedium], Watch] | None = None) -> Outcome:
    """Run a scene to its end or its failure and return the `Outcome`.

    watcher : coupling -> function of (clock, coupling, energy), called after every accepted step.
    """
    start(scene.petsc.options)
    stopwatch = Stopwatch()
    outcome = Outcome()
    unjudged = scene.model_copy(
        update={"reference": None}
    )  # a watch compares with the reference, outside of the measured time
    try:
        with Simulation(unjudged, MPI.COMM_SELF, stopwatch) as simulation:
            _advance(simulation, watcher, outcome)
    except PorofsiError as error:
        outcome.failure = str(error)
        if not outcome.unknowns:  # it was not even built
            return outcome
    outcome.seconds = stopwatch.total - stopwatch.seconds["watch"]
    return outcome


def _advance(simulation, watcher, outcome):
    """Run to the end; the outcome is complete up to the last accepted step however that ends."""
    coupling = simulation.coupling
    loop = simulation.loop
    energy = simulation.energy
    domain = coupling.solid.domain
    measure = simulation.stopwatch.measure
    with measure("watch"):
        watch = watcher(coupling) if watcher else lambda clock, coupling, energy: None

    def watched(simulation):
        with measure("watch"):
            watch(loop.clock, coupling, energy)

    outcome.unknowns = domain.mesh.n_global * (2 * domain.dim + 1)
    try:
        simulation.run(callbacks=[watched])
    finally:
        outcome.iterations = loop.iterations
        outcome.cuts = loop.clock.cuts
        outcome.t = loop.clock.t
        outcome.oscillation = simulation.measures.oscillation_indicator
        outcome.energy_error = energy.report()["balance_error_relative"]
