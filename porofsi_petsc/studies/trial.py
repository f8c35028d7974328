"""One run of a scene for a study: its numbers in memory, no files, failures as text."""

import gc
from dataclasses import dataclass, field

import numpy as np
from mpi4py import MPI

from ..errors import PorofsiError
from ..linalg.options import start
from ..linalg.stopwatch import Stopwatch
from ..simulation.build import build_coupling, local_mesh
from ..simulation.energy import Energy
from ..simulation.loop import TimeLoop
from ..simulation.measures import Measures
from ..simulation.setups import materials_of


@dataclass
class Outcome:
    """What a run did: the message of its failure ("" when it reached the end), coupling iterations per step.

    cuts : steps repeated with a smaller size; oscillation : `Measures.oscillation_indicator`; energy_error : relative error of
    the energy balance; unknowns : of all fields; seconds : wall time with set-up, without what the watch took; t : reached [s]
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
    def mean(self):
        """Return the mean number of coupling iterations of a step, NaN when no step was accepted."""
        return float(np.mean(self.iterations)) if self.iterations else float("nan")

    @property
    def largest(self):
        """Return the largest number of coupling iterations of a step, 0 when no step was accepted."""
        return max(self.iterations, default=0)


class _Watched:
    """What a `TimeLoop` asks of its records and of its stop: here a watch is called after every step, and nothing is written."""

    checkpoint_path = "no checkpoint"

    def __init__(self, watch, coupling, energy, stopwatch):
        self._watch, self._coupling, self._energy, self._stopwatch = watch, coupling, energy, stopwatch

    def after_step(self, clock, iterations, control):
        with self._stopwatch.measure("watch"):
            self._watch(clock, self._coupling, self._energy)

    def checkpoint(self, clock, iterations, control):
        """Keep nothing."""

    def reason(self):
        """Never ask for a stop."""
        return ""


def attempt(scene, watcher=None):
    """Run a scene to its end or its failure and return the `Outcome`.

    watcher : coupling -> function of (clock, coupling, energy), called after every accepted step.
    """
    start(scene.petsc.options)
    stopwatch, outcome = Stopwatch(), Outcome()
    try:
        coupling = _built(scene, stopwatch)
    except PorofsiError as error:
        return Outcome(failure=str(error))
    try:
        _advance(scene, coupling, watcher, stopwatch, outcome)
    except PorofsiError as error:
        outcome.failure = str(error)
    finally:
        _release(coupling)
    outcome.seconds = stopwatch.total - stopwatch.seconds["watch"]
    return outcome


def _built(scene, stopwatch):
    return build_coupling(scene, local_mesh(scene, MPI.COMM_SELF), stopwatch)


def _advance(scene, coupling, watcher, stopwatch, outcome):
    """Run the time loop; the outcome is complete up to the last accepted step however the loop ends."""
    domain, energy = coupling.solid.domain, Energy()
    unjudged = scene.model_copy(update={"reference": None})  # a watch compares with the reference, outside of the measured time
    measures = Measures(unjudged, coupling, materials_of(scene, domain.mesh))
    with stopwatch.measure("watch"):
        watch = watcher(coupling) if watcher else lambda clock, coupling, energy: None
    watched = _Watched(watch, coupling, energy, stopwatch)
    energy.start(*coupling.energies())
    loop = TimeLoop(scene, coupling, energy, measures, watched)
    outcome.unknowns = domain.mesh.n_global * (2 * domain.dim + 1)
    try:
        loop.run(watched)
    finally:
        outcome.iterations, outcome.cuts, outcome.t = loop.iterations, loop.clock.cuts, loop.clock.t
        outcome.oscillation = measures.oscillation_indicator
        outcome.energy_error = energy.report()["balance_error_relative"]


def _release(coupling):
    for block in coupling.blocks.values():
        if block.solver:
            block.solver.destroy()
    gc.collect()  # a medium and its accelerator hold each other: 1800 cases of the coupling study kept 2.6 GB
