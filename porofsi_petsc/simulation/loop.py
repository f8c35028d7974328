"""The time loop: steps with cuts, what happens after each of them, and a stop on demand."""

import signal
import time
from collections.abc import Callable
from typing import Any

from mpi4py import MPI

from ..clock import Scheme, Steady, backward_euler, first_order, implicit_second_order, second_order
from ..config import Scene
from ..config.sections import Model, Time
from ..config.steps import RESOLUTION
from ..errors import (
    SMALLER_STEP,
    ConvergenceError,
    IncompatibleData,
    InputError,
    LimitError,
    PorofsiError,
    Stopped,
)
from ..linalg.options import check_options
from ..log import logger
from ..phases.coupling_data import Rates
from ..signals import forget, noted
from .auto import AnyMedium, AutoMedium
from .continuation import Continuation
from .energy import Energy, step_powers
from .fall_back import WORDING, FallBack
from .measures import Measures
from .precice import Partner
from .step_control import StepControl, StepTooLarge

Solve = Callable[[tuple[Scheme, Scheme], Rates], None]  # of the next step
ABSENT_PREFIXES = (
    "mesh_",
)  # a solver that many scenes do not have; its options may stand in a shared options file
# Raised on all ranks together, so that what follows may be collective.
COLLECTIVE = (ConvergenceError, IncompatibleData, LimitError, Stopped)
# Size of the step that finds the accelerations at t = 0, in first steps: its own error of first
# order is this much smaller than what second order in time allows, and u1 - u0 - dt v0 keeps enough
# digits for the coupling tolerance (1e-3 stalls at 4e-9).
START = 1e-2
# a step that ends this close (in steps) to a multiple of the step, or to the end, ends there
SNAP = 1e-9


class Clock:
    """Present time, accepted steps, and the size of the next step."""

    def __init__(self, section: Time) -> None:
        """Start at t = 0 with the [time] section of the scene."""
        self._section = section
        self.t = 0.0
        self.step = 0
        self.cuts = 0
        self.load_parts = 0
        self.nominal = section.step
        # end and size of the parts of a nominal step that was cut
        self.target: float | None = None
        self.substep: float | None = None
        self.halvings = 0  # of that step
        self.end = section.end
        self.fall_backs = dict.fromkeys(WORDING, 0)  # remedy -> steps that converged with it only

    @property
    def finished(self) -> bool:
        """Return whether the end is reached."""
        return self.t >= self.end

    def next_target(self) -> float:
        """Return the end of the next (or the cut) nominal step [s], which may be the end of the
        run.
        """
        if self.target is not None:
            return min(self.target, self.end)
        target = self.t + self.nominal
        multiple = round(target / self.nominal) * self.nominal
        if abs(target - multiple) < SNAP * self.nominal:
            target = multiple
        return self.end if target > self.end - SNAP * self.nominal else target

    def size_to(self, target: float) -> float:
        """Return the step size to the target: the nominal one, to the last digit, wherever it
        fits.
        """
        rest = target - self.t
        return self.nominal if abs(rest - self.nominal) < 2 * SNAP * self.nominal else rest

    def next_size(self) -> float:
        """Return the size of the next step: the nominal one, or a part of one that was cut; the
        nominal one at the end.
        """
        if self.finished:
            return self.nominal
        return min(self.substep or float("inf"), self.size_to(self.next_target()))

    @property
    def smallest_step(self) -> float:
        """Return the size [s] below which a step would be lost in the digits of the time."""
        return RESOLUTION * self.t

    def cut(self, target: float, dt: float) -> None:
        """Go on to the target in parts of size dt."""
        self.cuts = self.cuts + 1
        self.halvings = self.halvings + 1
        self.target = target
        self.substep = dt

    def _forget_cuts(self):
        self.target = self.substep = None
        self.halvings = 0

    def repeat_with(self, dt: float) -> None:
        """Forget the step on the way and go on with nominal steps of size dt."""
        self._forget_cuts()
        self.nominal = dt

    def advance(self, dt: float, target: float) -> None:
        """Count an accepted step of size dt on the way to the target; there the nominal step grows
        for the next one.
        """
        self.t = target if abs(target - self.t - dt) < SNAP * dt else self.t + dt
        self.step += 1
        if self.t >= target:
            self._forget_cuts()
            self.nominal = min(
                self.nominal * self._section.growth,
                max(self._section.max_step or float("inf"), self._section.step),
            )

    def next_schemes(self, model: Model) -> tuple[tuple[Scheme, Scheme], Rates]:
        """Return `schemes` for the next step."""
        return self.schemes(model, self.next_size())

    def schemes(self, model: Model, dt: float) -> tuple[tuple[Scheme, Scheme], Rates]:
        """Return the time schemes of solid and fluid for a step of size dt, and their `Rates`."""
        section = self._section
        solid: Scheme
        fluid: Scheme
        if section.scheme == "steady":
            solid = fluid = Steady(dt)
        elif section.scheme == "backward_euler":
            solid = fluid = backward_euler(dt)
        else:
            fluid = first_order(section.rho_inf, dt)
            solid = second_order(section.rho_inf, dt) if model.solid_inertia else fluid
        return (solid, fluid), _rates(model, solid, fluid)

    def starting_schemes(self, model: Model) -> tuple[tuple[Scheme, Scheme], Rates]:
        """Return the same for the small implicit step from which a consistent start takes its
        accelerations.
        """
        dt = START * self.nominal
        solid = implicit_second_order(dt)
        fluid = backward_euler(dt)
        return (solid, fluid), _rates(model, solid, fluid)

    def state(self) -> dict[str, Any]:
        """Return the numbers a restart needs."""
        names = (
            "t",
            "step",
            "cuts",
            "load_parts",
            "nominal",
            "target",
            "substep",
            "halvings",
            "fall_backs",
        )
        return {name: getattr(self, name) for name in names}

    def load(self, state: dict[str, Any]) -> None:
        """Continue from `state`; a scene without growth keeps its own step size."""
        self.t = state["t"]
        self.step = state["step"]
        self.cuts = state["cuts"]
        self.load_parts = state.get("load_parts", 0)
        self.target = state["target"]
        self.substep = state["substep"]
        self.halvings = state.get("halvings", 0)
        self.fall_backs |= state.get("fall_backs", {})
        if self._section.growth > 1 or self._section.error_tolerance:
            self.nominal = state["nominal"]


def _rates(model, solid, fluid):
    return Rates(fluid.c_v if model.fluid_inertia else 0.0, solid.c_v, solid.c_a)


class StopRequest:
    """A noted signal or the time limit asks for an end; all ranks agree after each step."""

    def __init__(self, comm: MPI.Comm, max_time: float | None, advice: str) -> None:
        """Let the time limit [s], None for none, begin; advice : how to go on after the stop."""
        self._comm = comm
        self._advice = advice
        self._deadline = time.monotonic() + max_time if max_time else None

    def __call__(self, clock: Clock, finished: bool) -> None:
        """Raise Stopped where the run must stop before its end (collective)."""
        reason = self._reason()
        if reason and not finished:
            raise Stopped(
                f"stopped by {reason} at t = {clock.t:g} s (step {clock.step}); {self._advice}"
            )

    def _reason(self):
        """Return why the run must stop, or an empty string (collective)."""
        late = self._deadline is not None and time.monotonic() > self._deadline
        received = self._comm.allreduce(noted(), MPI.MAX)
        late = self._comm.allreduce(late, MPI.LOR)
        if received:
            forget()
            return f"signal {signal.Signals(received).name}"
        return "the time limit --max-time" if late else ""


class TimeLoop:
    """Advance a coupling from step to step."""

    def __init__(
        self,
        scene: Scene,
        coupling: AnyMedium,
        energy: Energy,
        measures: Measures,
        after_step: Callable = lambda: None,
        partner: Partner | None = None,
    ) -> None:
        """Take what is advanced and what measures it; after_step is called after every accepted
        step (collective).

        partner : the other program of a run that two of them solve
        """
        self._scene = scene
        self._coupling = coupling
        self._energy = energy
        self._measures = measures
        self._after_step = after_step
        self._has_stepped = False
        self.clock = Clock(scene.time)
        self.control = (
            StepControl(scene.time, coupling.solid.mesh.comm)
            if scene.time.error_tolerance
            else None
        )
        self.auto = coupling if isinstance(coupling, AutoMedium) else None
        self._solve: Solve = FallBack(coupling, self.clock).solve
        if coupling.load_factor and scene.coupling.on_failure != "stop":
            self._solve = Continuation(coupling, self.clock, self._solve).solve
        if partner:
            self._solve = partner.solving(self._solve)
        self.iterations: list[int] = []

    @property
    def model(self) -> Model:
        """Return the [model] as it is solved now."""
        return self.auto.scene.model if self.auto else self._scene.model

    @property
    def shared_errors(self) -> tuple[type[PorofsiError], ...]:
        """Return the errors that all ranks raise together: on one rank any InputError of an
        expression is among them.
        """
        return COLLECTIVE if self._coupling.solid.mesh.comm.size > 1 else (*COLLECTIVE, InputError)

    def run(self, stop: Callable[[], bool] = lambda: False) -> None:
        """Advance to the end of the clock, or until stop(), asked after every step, is true
        (collective).
        """
        if self.clock.finished:  # continued at the end
            self._require_limits()
        while not self.clock.finished:
            self.step()
            if stop():
                return

    def step(self) -> None:
        """Make the next accepted step: the nominal one, or a part of it when the coupling fails and
        the scene allows cuts.

        Raises an error of `shared_errors`; the accepted state is then that before the step, with a
        LimitError that after it (collective).
        """
        clock = self.clock
        number = self.clock.step
        if self._scene.time.consistent_start and number == 0:
            self._coupling.start(*clock.starting_schemes(self.model))
        while clock.step == number:
            dt = clock.next_size()
            target = clock.next_target()
            try:
                self._advance(dt, target)
            except ConvergenceError as error:
                self._cut(dt, target, error)
            except StepTooLarge as rejected:
                self._coupling.reset()
                clock.repeat_with(rejected.size)
        self._after_step()
        self._require_limits()

    def _require_limits(self):
        """Raise LimitError where what is left out, or at the end what was added, is too large."""
        t = self.clock.t
        self._measures.require_limits(t)
        bound = self._scene.limits.stabilization
        share = self._energy.stabilization_share
        if not self._is_stabilized or bound == "report" or share <= bound:
            return
        raise LimitError(
            f"[limits] stabilization: at t = {t:g} s the stabilization of the flow has taken"
            f" {share:.3g} > {bound:g} of the work of all loads, and pressure or flow are wrong by"
            " a part of it; refine the mesh where the flow changes, take elements of order 2"
            ' (mesh.order = 2), or set limits.stabilization to a larger bound or to "report"'
        )

    @property
    def _is_stabilized(self):
        """Return whether a free fluid is at its end, before which a sum over time says little."""
        return self.clock.finished and not self._scene.is_porous and self._scene.phases[1]

    def _cut(self, dt, target, error):
        """Ask the clock for half the step; raise the error of the last attempt where it may not be
        halved any more.
        """
        most = self._scene.coupling.max_cuts if "step" in self._coupling.tried else 0
        if not most:
            raise error
        if self.clock.halvings == most or dt / 2 < self.clock.smallest_step:
            raise self._given_up(error, dt) from error
        self.clock.cut(target, dt / 2)
        self._coupling.reset()
        logger.info("step cut to %g s at t = %g s: %s", dt / 2, self.clock.t, error)

    def _given_up(self, error, dt):
        """Return the error of a step that failed in every size down to dt."""
        advice = self._coupling.advice if error.advice == SMALLER_STEP else error.advice
        return ConvergenceError(f"{error.what}, the step cut to {dt:g} s", advice)

    def _advance(self, dt, target):
        """Solve and accept a step of size dt on the way to the target."""
        clock = self.clock
        coupling = self._coupling
        schemes, rates = clock.schemes(self.model, dt)
        self._solve(schemes, rates)
        sizes = self._measures.neglected_sizes(coupling, dt)
        if self.auto and self.auto.switch(self._measures.omissions, sizes, clock):
            self._measures.remodel(self.auto.scene)
            self._energy.remodel(*coupling.energies())
            return self._advance(dt, target)
        powers = step_powers(*coupling.residuals, *coupling.collocated())
        size = (
            self.control.next_size(dt, self._trial(dt, schemes), clock.smallest_step)
            if self.control
            else None
        )
        coupling.accept()
        clock.advance(dt, target)
        if size is not None and clock.target is None:
            clock.repeat_with(size)
        self.iterations.append(coupling.iterations)
        self._require_options_used()
        self._energy.add_step(dt, powers, *coupling.energies())
        self._measures.watch_pressure(coupling.fluid.p)
        self._measures.watch_neglected(sizes, dt, clock)
        self._measures.watch_volume(dt)
        self._measures.compare(clock, coupling.solid, coupling.fluid)

    def _require_options_used(self):
        """Refuse PETSc options that nothing has asked for by the end of the first step."""
        if not self._has_stepped:
            check_options(self._coupling.solid.mesh.comm, exempt_prefixes=ABSENT_PREFIXES)
        self._has_stepped = True

    def _trial(self, dt, schemes):
        """Return what the step control looks at: the trial displacement and pressure with their
        times.
        """
        solid = self._coupling.solid
        fluid = self._coupling.fluid
        t = self.clock.t
        n = solid.mesh.n_owned
        return {
            "u": (t + dt, solid.unknowns),
            "p": (t + schemes[1].alpha_f * dt, fluid.flow().pressure[:n]),
        }
