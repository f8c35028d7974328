"""Some steps of a scene with PETSc options, timed: what the benches of solvers and of the
coupling's start share.
"""

import time
from contextlib import contextmanager
from dataclasses import dataclass, field

from porofsi_petsc import Simulation


@dataclass
class Steps:
    """The coupling, the sweeps of every step, and the CPU seconds of all of them on this rank,
    without the start.
    """

    coupling: object
    sweeps: list = field(default_factory=list)
    seconds: float = 0.0

    @property
    def solvers(self):
        """Return the `LinearSolver` of every block that has one, by name."""
        return {name: block.solver for name, block in self.coupling.blocks.items() if block.solver}


@contextmanager
def some_steps(scene, count, words=()):
    """Do `count` steps of a scene and lend them as `Steps`; the solvers are freed afterwards
    (collective).

    words : PETSc options, like those of the command line; ConvergenceError where a step fails.
    """
    with Simulation.from_scene(scene, petsc_options=words) as simulation:
        done = Steps(simulation.coupling)
        schemes = simulation.loop.clock.schemes(scene.model, scene.time.step)
        start = time.process_time()
        for step in range(count):
            done.coupling.step(*schemes, step * scene.time.step, step + 1)
            done.coupling.accept()
            done.sweeps.append(done.coupling.iterations)
        done.seconds = time.process_time() - start
        yield done
