"""A scene that is solved step by step: what the command line, the studies and the scripts of users
have in common.
"""

from __future__ import annotations

import gc
import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from ..config import Scene, load_scene, scene_to_toml
from ..errors import InputError, PorofsiError, digits
from ..fem.distribute import LocalMesh
from ..linalg.agreement import Agreement
from ..linalg.options import start
from ..linalg.solver import LinearSolver
from ..linalg.stopwatch import Stopwatch
from ..log import logger
from ..output.checkpoint import open_checkpoint
from ..output.files import on_root
from .build import build_coupling, local_mesh
from .builder import materials_of
from .checkpoint import write
from .energy import Energy
from .excavation import (
    remaining_facets,
    remaining_scene,
    require_loads,
    require_plates,
)
from .fields import Fields
from .lines import Lines
from .loop import TimeLoop
from .measures import Measures
from .placement import place, without_placed
from .precice import Partner
from .quantities import Quantities
from .restart import placed_cells, resume
from .stages import Left
from .weight import with_weight

SHORTEST = 1e-9  # step, in those of the scene, that `run` is asked for


class Simulation:
    """A scene between its steps; what is not said to be local is collective over the communicator.

        with Simulation.from_scene("terzaghi") as simulation:
            simulation.run(until=0.5, callbacks=[lambda s: print(s.time, s.history["base.p"][-1])])
            pressure = simulation.fields["pressure"]

    scene : the `Scene`; comm : its ranks; coupling, loop, energy, measures, stopwatch : the parts
    of the solution;
    stage : number of the present stage, 0 of the first; present : its scene, of what is there;
    fields : the nodal `Fields` of the accepted state; quantities : what the history records;
    lines : the values along the lines of the scene;
    callbacks : functions of the simulation that are called in turn after every accepted step; a
    true value ends `run`.
    """

    def __init__(
        self,
        scene: Scene,
        comm: MPI.Comm = MPI.COMM_WORLD,
        stopwatch: Stopwatch | None = None,
        mesh: LocalMesh | None = None,
    ) -> None:
        """Build a scene at t = 0; PETSc has been started with its options (`linalg.options.start`).

        mesh : of the scene, where it has been made already, with its communicator.
        """
        self.scene = scene
        self.comm = mesh.comm if mesh else comm
        self.stopwatch = stopwatch or Stopwatch()
        self.callbacks: list[Callable[[Simulation], object]] = []
        self._of_run: list[Callable[[Simulation], object]] = []
        self._ends = False
        self._stages = scene.stages
        self.stage = 0
        self._is_closed = False
        self._agreement = Agreement(self.comm)
        with self._agreement.required():
            self._build(mesh)

    def _build(self, mesh):
        with self.stopwatch.measure("setup"):
            self._mesh = mesh or local_mesh(self.scene, self.comm)
            if self.places:
                self._mesh = without_placed(self.scene, self._mesh)
            self._stages = with_weight(self._stages, self._there(0)[0], self._mesh)
            require_loads(self.scene, self._mesh)
            require_plates(self.scene, self._mesh)
            self._make_parts()
        self.energy = Energy()
        self.energy.start(*self.coupling.energies())
        self._partner = self._other_program()
        self._make_loop()
        self._rows = [(0.0, *self.quantities.values(0.0), 0)]

    def _make_parts(self):
        """Make coupling and measures of the present stage (collective)."""
        scene, mesh = self._there(self.stage)
        self.present = scene
        self.coupling = build_coupling(scene, mesh, self.stopwatch)
        self.measures = Measures(scene, self.coupling, materials_of(scene, mesh))
        self.lines = Lines(scene, self.coupling, self.measures)
        self.quantities = Quantities(scene, self.coupling, self.measures)
        self.fields = Fields(self.scene, self.coupling, self.measures)

    def _there(self, number):
        """Return scene and mesh of what is there in a stage (collective)."""
        scene = self._stages[number]
        mesh = remaining_facets(scene, self._mesh) if scene.inactive else self._mesh
        return remaining_scene(scene, self._mesh.facets, mesh.facets), mesh

    @property
    def places(self) -> bool:
        """Return whether a stage places regions (local)."""
        return any(stage.active for stage in self.scene.stage)

    @property
    def has_placed(self) -> bool:
        """Return whether a stage up to the present one has (local)."""
        return any(stage.active for stage in self.scene.stage[: self.stage])

    def _make_loop(self):
        scene = self._stages[self.stage]
        self.loop = TimeLoop(
            scene, self.coupling, self.energy, self.measures, self._call_back, self._partner
        )

    def _begin_stage(self, number):
        """Make the parts of another stage, without its state (collective)."""
        for solver in self.solvers.values():
            solver.destroy()
        self.stage = number
        with self.stopwatch.measure("setup"):
            self._make_parts()
        self._make_loop()

    def _next_stage(self):
        """Go on with the next stage from the accepted state (collective)."""
        left = Left(self)
        if regions := self.scene.stage[self.stage].active:
            u = self.coupling.displacement()
            scene, there = self._there(self.stage + 1)
            placed = place(scene, there, regions, u, self.stopwatch)
            self._mesh = replace(self._mesh, placed=placed.cells)
            left.take(placed)
        self._begin_stage(self.stage + 1)
        left.continue_in(self)
        name = self.scene.stage[self.stage - 1].name
        logger.info("stage '%s' begins at t = %g s (step %d)", name, self.time, self.steps)

    def _other_program(self):
        """Return the `Partner` of a participant, None of other scenes."""
        scene = self.scene
        where = str(scene.source_path or "scene")
        return Partner(scene.precice, self.coupling, where) if scene.precice else None

    @classmethod
    def from_scene(
        cls,
        source: str | os.PathLike | Mapping[str, Any] | Scene,
        comm: MPI.Comm = MPI.COMM_WORLD,
        *,
        overrides: Iterable[str] = (),
        petsc_options: Iterable[str] = (),
        restart: str | os.PathLike | None = None,
    ) -> Simulation:
        """Return the simulation of a scene, at t = 0 or as a checkpoint left it.

        source, overrides : as `load_scene` takes them, or a `Scene`; petsc_options : words that win
        over those of the scene;
        restart : a checkpoint file. The option database of PETSc belongs to the process: of two
        simulations at a time the one built last has set it. Raises InputError.
        """
        scene = source if isinstance(source, Scene) else load_scene(source, overrides)
        start(scene.petsc.options, list(petsc_options))
        header = None if restart is None else open_checkpoint(restart, comm)
        simulation = cls(scene, comm)
        if restart is not None and header is not None:
            simulation.resume(Path(restart), header)
        return simulation

    # -- advancing ---------------------------------------------------------------------------------

    def step(self) -> None:
        """Make one accepted step, the next one of [time] or, where that does not converge and may
        be cut, a part of it.

        Raises InputError at the end of the scene and of a closed simulation, ConvergenceError (the
        state is that before the step), LimitError.  An error that one of several ranks has alone
        ends the job.
        """
        self._require_open()
        if self.finished:
            raise InputError(
                f"t = {self.time:g} s is time.end of the scene, expected an earlier time; raise"
                " time.end"
            )
        with self._agreement.required():
            if self.loop.clock.finished:
                self._next_stage()
            self.loop.step()

    def run(
        self, until: float | None = None, callbacks: Iterable[Callable[[Simulation], object]] = ()
    ) -> None:
        """Advance to a time [s], by default time.end of the scene, or until a callback returns a
        true value, on any rank.

        until : the last step is shortened to end there; callbacks : called after those of the
        simulation, for this run alone.  Raises as `step` does, InputError where until is not
        between the present time and time.end, or a step to it would be lost in the digits of time.
        """
        self._require_open()
        end = self._stages[-1].time.end
        with self._agreement.required():
            until = end if until is None else self._reachable(until, end)
            self._of_run = list(callbacks)
            self._ends = False
            try:
                self._advance(until)
                while self.time < until and not self._ends:
                    self._next_stage()
                    self._advance(until)
                if self._partner and self.finished:
                    self._partner.finish()
            finally:
                self._of_run = []

    def _advance(self, until):
        """Advance to a time, or to the end of the stage where that is before it."""
        clock = self.loop.clock
        end = clock.end
        clock.end = min(until, end)
        try:
            self.loop.run(lambda: self._ends)
        finally:
            clock.end = end

    def _reachable(self, until, end):
        """Return until, that of rank 0; raise InputError where no step ends there (collective)."""
        until = self.comm.bcast(until)
        shortest = max(self.loop.clock.smallest_step, SHORTEST * self.loop.clock.nominal)
        if not self.time <= until <= end or 0 < until - self.time < shortest:
            received = f"until: received {digits(until)} s"
            raise InputError(
                f"{received}, expected {digits(self.time)} s, where the simulation is, or a time"
                f" from {digits(self.time + shortest)} s to time.end = {digits(end)} s"
            )
        return until

    def _require_open(self):
        if self._is_closed:
            raise InputError("the simulation is closed, expected an open one; make another one")

    def _call_back(self):
        clock = self.loop.clock
        self.quantities.advance(clock.t)
        if clock.step % self.scene.output.history_every == 0 or clock.finished:
            self._rows.append((clock.t, *self.quantities.values(clock.t), self.loop.iterations[-1]))
        called = [*self.callbacks, *self._of_run]
        if called:
            ends = [bool(callback(self)) for callback in called]  # all of them are called
            self._ends = self.comm.allreduce(any(ends), MPI.LOR)

    # -- looking -----------------------------------------------------------------------------------

    @property
    def time(self) -> float:
        """Return the time of the accepted state [s] (local)."""
        return self.loop.clock.t

    @property
    def steps(self) -> int:
        """Return the number of accepted steps (local)."""
        return self.loop.clock.step

    @property
    def finished(self) -> bool:
        """Return whether time.end is reached, of the last stage (local)."""
        return self.loop.clock.finished and self.stage == len(self._stages) - 1

    @property
    def columns(self) -> list[str]:
        """Return the names of the recorded quantities: those of probes and forces (local)."""
        return self.scene.columns

    @property
    def history(self) -> dict[str, np.ndarray]:
        """Return the recorded quantities over time: t [s], `columns`, coupling_iterations ->
        (rows,) (local).

        There is a row at the start, or where a checkpoint left it, and one every
        output.history_every steps.
        """
        names = ["t", *self.columns, "coupling_iterations"]
        return dict(zip(names, np.array(self._rows, dtype=float).T, strict=True))

    @property
    def last_row(self) -> tuple[float, ...]:
        """Return the last row of the history (local)."""
        return self._rows[-1]

    @property
    def solvers(self) -> dict[str, LinearSolver]:
        """Return the linear solvers by the name of their block: solid, fluid, mesh, monolithic
        (local).
        """
        return {name: block.solver for name, block in self.coupling.blocks.items() if block.solver}

    # -- keeping -----------------------------------------------------------------------------------

    def checkpoint(self, directory: str | os.PathLike) -> Path:
        """Write checkpoint.h5 of the accepted state to a directory, made if need be, and return its
        path.

        Raises PorofsiError when it cannot be written.
        """
        with self._agreement.required():
            folder = Path(self.comm.bcast(directory))
            on_root(self.comm, _make, folder)
            return write(self, folder)

    def resume(self, path: Path, header: dict) -> None:
        """Continue from a checkpoint; header : of `output.checkpoint.open_checkpoint`.  Raises
        InputError.
        """
        if self._partner:
            raise InputError(
                f"{path}: received a checkpoint for a scene with [precice], expected none: the"
                " coupling begins at t = 0; start anew"
            )
        text = scene_to_toml(self.scene)
        number = header.get("stage", 0)
        if number >= len(self._stages):
            raise InputError(
                f"{path}: the checkpoint is in [stage.{number - 1}], the scene has"
                f" {len(self.scene.stage)} stages after the first; restart with those of its run"
            )
        if number:
            if self.places:
                cells = placed_cells(path, header, self._mesh)
                self._mesh = replace(self._mesh, placed=cells)
            self._begin_stage(number)
        parts = self.loop, self.coupling, self.energy, self.measures
        resume(path, header, self.scene, text, *parts, number)
        self.quantities.load(path, header.get("volumes") or {})
        iterations = self.loop.iterations[-1] if self.loop.iterations else 0
        self._rows = [(self.time, *self.quantities.values(self.time), iterations)]

    def close(self) -> None:
        """Free what PETSc holds of the solvers; the fields stay, no step can be made."""
        if self._is_closed:
            return
        self._is_closed = True
        if self._partner:
            self._partner.close()
        for solver in self.solvers.values():
            solver.destroy()
        self._agreement.free()
        gc.collect()  # a medium and its accelerator hold each other

    def __enter__(self) -> Simulation:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def _make(folder):
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as failure:
        raise PorofsiError(f"{folder}: could not be created ({failure.strerror})") from failure
