"""What a run writes: history, fields and checkpoints in the intervals of the scene."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

from ..output.checkpoint import NAME
from ..output.fields import FieldWriter, Storage
from ..output.history import History
from ..output.lines import LineFile
from ..output.times import Times
from ..output.vtkhdf import VtkhdfWriter

if TYPE_CHECKING:
    from ..output.progress import Progress
    from .simulation import Simulation

WRITERS: dict[str, type[FieldWriter] | type[VtkhdfWriter]]
WRITERS = {"xdmf": FieldWriter, "vtkhdf": VtkhdfWriter}


class Records:
    """The files of a run; every method is collective."""

    def __init__(self, simulation: Simulation, directory: Path) -> None:
        """Take the simulation; `open` starts the files."""
        self._simulation = simulation
        self._directory = directory
        self._output = simulation.scene.output
        self._mesh = simulation.coupling.solid.mesh
        self.progress: Progress  # of who runs
        self._history: History  # by `open`
        self._fields: FieldWriter | VtkhdfWriter | None = None
        self._lines: dict[str, LineFile] = {}
        self._last_checkpoint = time.monotonic()

    @property
    def checkpoint_path(self) -> Path:
        """Return where checkpoints go."""
        return self._directory / NAME

    def open(self, resumed_at: float | None = None) -> None:
        """Start the files, or continue those of a run that was resumed at a time [s]."""
        columns = self._simulation.columns
        comm = self._mesh.comm
        self._times = Times(self._output.fields_interval, self._output.fields_times)
        self._before = self._simulation.time
        if self._output.has_fields:
            storage = Storage(self._output.precision, self._output.compression)
            writer = WRITERS[self._output.format]
            self._fields = writer(self._directory, self._mesh, storage)
        self._history = History(self._directory, columns, comm, resumed_at)
        self._lines = {
            line.name: LineFile(self._directory, line.name, line.quantities, comm, resumed_at)
            for line in self._simulation.scene.line
        }
        if self._fields and resumed_at is not None:
            self._fields.truncate(resumed_at)

    def complete(self) -> None:
        """Write the state of a run that was continued at its end, where its files are in another
        directory.
        """
        simulation = self._simulation
        with simulation.stopwatch.measure("output"):
            if self._history.last != simulation.time:
                self._write_row()
            if self._fields and simulation.steps not in [
                snapshot.step for snapshot in self._fields.snapshots
            ]:
                self._write_fields()
            for name, file in self._lines.items():
                if file.last != simulation.time:
                    self._write_line(name)

    def start(self) -> None:
        """Write the initial state."""
        with self._simulation.stopwatch.measure("output"):
            self._write_row()
            self._write_fields()
            for name in self._lines:
                self._write_line(name)

    def after_step(self, simulation: Simulation) -> None:
        """Write what is due after an accepted step; a callback."""
        output = self._output
        step = simulation.steps
        with simulation.stopwatch.measure("output"):
            if step % output.history_every == 0 or simulation.finished:
                self._write_row()
            if self._fields and self._fields_due():
                self._write_fields()
            self._before = simulation.time
            for line in simulation.scene.line:
                if step % line.every == 0 or simulation.finished:
                    self._write_line(line.name)
            self.progress.update(step, simulation.time, simulation.loop.iterations[-1])
        if self._checkpoint_due():
            self.checkpoint()

    def close(self) -> None:
        """Close the history, the fields and the lines."""
        self._history.close()
        if self._fields:
            self._fields.close()
        for file in self._lines.values():
            file.close()

    def _fields_due(self) -> bool:
        simulation = self._simulation
        every = self._output.fields_every
        return (
            (every is not None and simulation.steps % every == 0)
            or self._times.lie_between(self._before, simulation.time)
            or simulation.finished
        )

    def _checkpoint_due(self) -> bool:
        output = self._output
        simulation = self._simulation
        every = output.checkpoint_every
        due = every is not None and (simulation.steps % every == 0 or simulation.finished)
        if output.checkpoint_minutes:
            late = time.monotonic() - self._last_checkpoint > 60 * output.checkpoint_minutes
            due = self._mesh.comm.bcast(late) or due
        return due

    def checkpoint(self) -> None:
        """Write a checkpoint of the accepted state."""
        self._simulation.checkpoint(self._directory)
        self._last_checkpoint = time.monotonic()

    def _write_row(self) -> None:
        t, *values, iterations = self._simulation.last_row
        self._history.append(t, values, int(iterations))

    def _write_line(self, name: str) -> None:
        columns = self._simulation.lines.values(name)
        self._lines[name].append(self._simulation.time, list(columns.values()))

    def _write_fields(self) -> None:
        simulation = self._simulation
        if self._fields:
            asked = self._output.fields or tuple(simulation.fields)
            fields = {name: simulation.fields[name] for name in asked if name in simulation.fields}
            self._fields.write(simulation.steps, simulation.time, fields)
