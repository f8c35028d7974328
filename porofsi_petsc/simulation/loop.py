"""The time loop: steps with cuts, what happens after each of them, and a stop on demand."""

import signal
import time
from collections.abc import Callable

from mpi4py import MPI

from ..clock import Steady, backward_euler, first_order, implicit_second_order, second_order
from ..config.steps import RESOLUTION
from ..errors import SMALLER_STEP, ConvergenceError, IncompatibleData, InputError, LimitError, Stopped
from ..linalg.options import check_options
from ..log import logger
from ..phases.transfer import Rates
from ..signals import forget, noted
from .auto import auto_terms
from .continuation import Continuation
from .energy import step_powers
from .fall_back import WORDING, FallBack
from .step_control import StepControl, StepTooLarge

ABSENT_PREFIXES = ("mesh_",)  # a solver that many scenes do not have; its options may stand in a shared options file
# Raised on all ranks together, so that what follows may be collective.
COLLECTIVE = (ConvergenceError, IncompatibleData, LimitError, Stopped)
# Size of the step that finds the accelerations at t = 0, in first steps: its own error of first order is this much smaller than
# what second order in time allows, and u1 - u0 - dt v0 keeps enough digits for the coupling tolerance (1e-3 stalls at 4e-9).
START = 1e-2
SNAP = 1e-9  # a step that ends this close (in steps) to a multiple of the step, or to the end, ends there


class Clock:
    """Present time, accepted steps, and the size of the next step."""

    def __init__(self, section):
        """Start at t = 0 with the [time] section of the scene."""
        self._section = section
        self.t, self.step, self.cuts, self.load_parts, self.nominal = 0.0, 0, 0, 0, section.step
        self.target = self.substep = None  # end and size of the parts of a nominal step that was cut
        self.fall_backs = dict.fromkeys(WORDING, 0)  # remedy -> steps that converged with it only

    @property
    def finished(self):
        """Return whether the end is reached."""
        return self.t >= self._section.end

    def next_target(self):
        """Return the end of the next (or the cut) nominal step [s], which may be the end of the run."""
        end = self._section.end
        if self.target is not None:
            return min(self.target, end)
        target = self.t + self.nominal
        multiple = round(target / self.nominal) * self.nominal
        if abs(target - multiple) < SNAP * self.nominal:
            target = multiple
        return end if target > end - SNAP * self.nominal else target

    def size_to(self, target):
        """Return the step size to the target: the nominal one, to the last digit, wherever it fits."""
        rest = target - self.t
        return self.nominal if abs(rest - self.nominal) < 2 * SNAP * self.nominal else rest

    def next_size(self):
        """Return the size of the next step: the nominal one, or a part of one that was cut; the nominal one at the end."""
        if self.finished:
            return self.nominal
        return min(self.substep or float("inf"), self.size_to(self.next_target()))

    @property
    def smallest_step(self):
        """Return the size [s] below which a step would be lost in the digits of the time."""
        return RESOLUTION * self.t

    def cut(self, target, dt):
        """Go on to the target in parts of size dt."""
        self.cuts, self.target, self.substep = self.cuts + 1, target, dt

    def repeat_with(self, dt):
        """Forget the step on the way and go on with nominal steps of size dt."""
        self.nominal, self.target, self.substep = dt, None, None

    def advance(self, dt, target):
        """Count an accepted step of size dt on the way to the target; there the nominal step grows for the next one."""
        self.t = target if abs(target - self.t - dt) < SNAP * dt else self.t + dt
        self.step += 1
        if self.t >= target:
            self.target = self.substep = None
            self.nominal = min(
                self.nominal * self._section.growth, max(self._section.max_step or float("inf"), self._section.step)
            )

    def next_schemes(self, model):
        """Return `schemes` for the next step."""
        return self.schemes(model, self.next_size())

    def schemes(self, model, dt):
        """Return the time schemes of solid and fluid for a step of size dt, and their `Rates`."""
        section = self._section
        if section.scheme != "generalized_alpha":
            solid = fluid = {"backward_euler": backward_euler, "steady": Steady}[section.scheme](dt)
        else:
            fluid = first_order(section.rho_inf, dt)
            solid = second_order(section.rho_inf, dt) if model.solid_inertia else fluid
        return (solid, fluid), _rates(model, solid, fluid)

    def starting_schemes(self, model):
        """Return the same for the small implicit step from which a consistent start takes its accelerations."""
        dt = START * self.nominal
        solid, fluid = implicit_second_order(dt), backward_euler(dt)
        return (solid, fluid), _rates(model, solid, fluid)

    def state(self):
        """Return the numbers a restart needs."""
        names = ("t", "step", "cuts", "load_parts", "nominal", "target", "substep", "fall_backs")
        return {name: getattr(self, name) for name in names}

    def load(self, state):
        """Continue from `state`; a scene without growth keeps its own step size."""
        self.t, self.step, self.cuts, self.load_parts = state["t"], state["step"], state["cuts"], state.get("load_parts", 0)
        self.target, self.substep = state["target"], state["substep"]
        self.fall_backs |= state.get("fall_backs", {})
        if self._section.growth > 1 or self._section.error_tolerance:
            self.nominal = state["nominal"]


def _rates(model, solid, fluid):
    return Rates(fluid.c_v if model.fluid_inertia else 0.0, solid.c_v, solid.c_a)


class StopRequest:
    """A noted signal or the time limit asks for a checkpoint and an end; all ranks agree after each step."""

    def __init__(self, comm, max_time):
        """Let the time limit [s], None for none, begin."""
        self._comm, self._deadline = comm, time.monotonic() + max_time if max_time else None

    def reason(self):
        """Return why the run must stop, or an empty string (collective)."""
        late = self._deadline is not None and time.monotonic() > self._deadline
        received, late = self._comm.allreduce(noted(), MPI.MAX), self._comm.allreduce(late, MPI.LOR)
        if received:
            forget()
            return f"signal {signal.Signals(received).name}"
        return "the time limit --max-time" if late else ""


class TimeLoop:
    """Advance a coupling to the end of the scene; `records` are told of every accepted step."""

    def __init__(self, scene, coupling, energy, measures, records, on_first_step: Callable = lambda: None):
        """Take what is advanced and what looks at it; on_first_step is called when a step has passed all checks (collective)."""
        self._on_first_step: Callable | None = on_first_step
        self._scene, self._coupling, self._energy, self._measures, self._records = scene, coupling, energy, measures, records
        self.clock = Clock(scene.time)
        self.control = StepControl(scene.time, coupling.solid.mesh.comm) if scene.time.error_tolerance else None
        self.auto = coupling if auto_terms(scene.model) else None
        self._solve = FallBack(coupling, self.clock).solve
        if coupling.load_factor and scene.coupling.on_failure != "stop":
            self._solve = Continuation(coupling, self.clock, self._solve).solve
        self.iterations = []

    @property
    def model(self):
        """Return the [model] as it is solved now."""
        return self.auto.scene.model if self.auto else self._scene.model

    @property
    def shared_errors(self):
        """Return the errors that all ranks raise together: on one rank any InputError of an expression is among them."""
        return COLLECTIVE if self._coupling.solid.mesh.comm.size > 1 else (*COLLECTIVE, InputError)

    def run(self, stop):
        """Advance to the end; raises an error of `shared_errors` after a checkpoint, others at once."""
        if self.clock.finished:  # continued at the end
            self._measures.require_limits(self.clock.t)
        try:
            if self._scene.time.consistent_start and self.clock.step == 0:
                self._coupling.start(*self.clock.starting_schemes(self.model))
            while not self.clock.finished:
                try:
                    self._advance(self.clock.next_target())
                except StepTooLarge as rejected:
                    self._coupling.reset()
                    self.clock.repeat_with(rejected.size)
                    continue
                reason = stop.reason()
                if reason and not self.clock.finished:
                    where = f"t = {self.clock.t:g} s (step {self.clock.step})"
                    raise Stopped(f"stopped by {reason} at {where}; restart from {self._records.checkpoint_path}")
        except self.shared_errors:
            self._records.checkpoint(self.clock, self.iterations, self.control)
            raise

    def _advance(self, target):
        """Reach the target in one step, or in smaller ones when the coupling fails and the scene allows it."""
        halvings, dt = 0, self.clock.next_size()
        most = self._scene.coupling.max_cuts if "step" in self._coupling.tried else 0
        while self.clock.t < target:
            try:
                self._step(min(dt, self.clock.size_to(target)), target)
            except ConvergenceError as error:
                if not most:
                    raise
                if halvings == most or dt / 2 < self.clock.smallest_step:
                    raise self._given_up(error, dt) from error
                halvings, dt = halvings + 1, dt / 2
                self.clock.cut(target, dt)
                self._coupling.reset()
                logger.info("step cut to %g s at t = %g s: %s", dt, self.clock.t, error)

    def _given_up(self, error, dt):
        """Return the error of a step that failed in every size down to dt."""
        advice = self._coupling.advice if error.advice == SMALLER_STEP else error.advice
        return ConvergenceError(f"{error.what}, the step cut to {dt:g} s", advice)

    def _step(self, dt, target):
        clock, coupling = self.clock, self._coupling
        schemes, rates = clock.schemes(self.model, dt)
        self._solve(schemes, rates)
        sizes = self._measures.neglected_sizes(coupling, dt)
        if self.auto and self.auto.switch(self._measures.omissions, sizes, clock):
            self._measures.remodel(self.auto.scene)
            self._energy.remodel(*coupling.energies())
            return self._step(dt, target)
        powers = step_powers(*coupling.residuals, *coupling.collocated())
        size = self.control.next_size(dt, self._trial(dt, schemes), clock.smallest_step) if self.control else None
        coupling.accept()
        clock.advance(dt, target)
        if size is not None and clock.target is None:
            clock.repeat_with(size)
        self.iterations.append(coupling.iterations)
        if self._on_first_step:
            check_options(exempt_prefixes=ABSENT_PREFIXES)
        self._energy.add_step(dt, powers, *coupling.energies())
        self._measures.watch_pressure(coupling.fluid.p)
        self._measures.watch_neglected(sizes)
        self._measures.compare(clock, coupling.solid, coupling.fluid)
        self._records.after_step(clock, self.iterations, self.control)
        if self._on_first_step:
            self._on_first_step()
            self._on_first_step = None
        self._measures.require_limits(clock.t)

    def _trial(self, dt, schemes):
        """Return what the step control looks at: the trial displacement and pressure with their times."""
        solid, fluid = self._coupling.solid, self._coupling.fluid
        t, n = self.clock.t, solid.mesh.n_owned
        return {"u": (t + dt, solid.unknowns), "p": (t + schemes[1].alpha_f * dt, fluid.flow().pressure[:n])}
