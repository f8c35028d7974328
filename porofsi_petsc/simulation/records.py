"""What a run writes: history, fields and checkpoints in the intervals of the scene."""

import time

import numpy as np

from ..config import scene_to_toml, table_contents
from ..output.checkpoint import write_checkpoint
from ..output.fields import FieldWriter
from ..output.history import History
from .setups import nodes_of
from .sides import check_probes, probes_in

AXES = {"x": 0, "y": 1, "z": 2}


class Records:
    """The files of a run; every method is collective."""

    def __init__(self, scene, directory, coupling, energy, measures, stopwatch):
        """Prepare the probes; `open` starts the files."""
        self._scene, self._directory, self._coupling = scene, directory, coupling
        self._energy, self._measures, self._stopwatch = energy, measures, stopwatch
        self.progress = self._history = self._fields = None
        self._mesh = coupling.solid.mesh
        self._in_solid, self._in_fluid = (probes_in(scene, phase.domain) for phase in (coupling.solid, coupling.fluid))
        check_probes(scene, self._in_fluid, coupling.fluid.domain)
        self._surfaces = [nodes_of(self._mesh, force.on)[: self._mesh.n_owned] for force in scene.force]
        self._last_checkpoint = time.monotonic()

    @property
    def columns(self):
        """Return the columns of the history between t and coupling_iterations."""
        return self._scene.columns

    @property
    def checkpoint_path(self):
        """Return where checkpoints go."""
        return self._directory / "checkpoint.h5"

    def open(self, resumed_at=None):
        """Start the files, or continue those of a run that was resumed at a time [s]."""
        self._fields = FieldWriter(self._directory, self._mesh) if self._scene.output.fields_every else None
        if resumed_at is None:
            self._history = History(self._directory, self.columns, self._mesh.comm)
            return
        self._history = History.resume(self._directory, self.columns, self._mesh.comm, resumed_at)
        if self._fields:
            self._fields.truncate(resumed_at)

    def complete(self, clock, iterations):
        """Write the state of a run that was continued at its end, where its files are in another directory."""
        with self._stopwatch.measure("output"):
            if self._history.last != clock.t:
                self._history.append(clock.t, self._values(), iterations[-1])
            if self._fields and clock.step not in [snapshot.step for snapshot in self._fields.snapshots]:
                self._write_fields(clock)

    def start(self, clock):
        """Write the initial state."""
        with self._stopwatch.measure("output"):
            self._history.append(clock.t, self._values(), 0)
            self._write_fields(clock)

    def after_step(self, clock, iterations, control):
        """Write what is due after an accepted step; iterations are those of all steps."""
        output = self._scene.output
        with self._stopwatch.measure("output"):
            if clock.step % output.history_every == 0 or clock.finished:
                self._history.append(clock.t, self._values(), iterations[-1])
            if self._fields and (clock.step % output.fields_every == 0 or clock.finished):
                self._write_fields(clock)
            self.progress.update(clock.step, clock.t, iterations[-1])
        if self._checkpoint_due(clock):
            self.checkpoint(clock, iterations, control)

    def close(self):
        """Close the history."""
        self._history.close()

    def _checkpoint_due(self, clock):
        output = self._scene.output
        due = bool(output.checkpoint_every) and (clock.step % output.checkpoint_every == 0 or clock.finished)
        if output.checkpoint_minutes:
            late = time.monotonic() - self._last_checkpoint > 60 * output.checkpoint_minutes
            due = self._mesh.comm.bcast(late) or due
        return due

    def checkpoint(self, clock, iterations, control):
        """Write a checkpoint of the accepted state; control : the StepControl or None."""
        with self._stopwatch.measure("output"):
            header = {
                "scene_name": self._scene.name,
                "scene": scene_to_toml(self._scene),
                "tables": table_contents(self._scene),
                "step": clock.step,
                "time": clock.t,
                "clock": clock.state(),
                "coupling": self._coupling.memory(),
                "energy": self._energy.state(),
                "measures": self._measures.state(),
                "iterations": iterations,
                "step_control": control.memory() if control else None,
            }
            arrays = self._coupling.state() | (control.state() if control else {})
            write_checkpoint(self._directory, self._mesh, header, arrays)
        self._last_checkpoint = time.monotonic()

    def _write_fields(self, clock):
        if not self._fields:
            return
        coupling, n = self._coupling, self._mesh.n_owned
        fields = {
            "displacement": coupling.displacement()[:n],
            "pressure": coupling.fluid.p[:n],
            "solid velocity": coupling.velocity()[:n],
            "fluid velocity": coupling.fluid.v[:n],
            "stress": self._measures.stress(coupling.solid.u),
        }
        if self._scene.is_porous:
            fields["porosity"] = self._measures.porosity(coupling.accepted_carrier())
        self._fields.write(clock.step, clock.t, fields)

    def _values(self):
        """Return the values of `columns` at the present time (collective)."""
        force = self._coupling.fluid.force
        mine = np.array([force[surface].sum(axis=0) for surface in self._surfaces]).ravel()
        return self._probe_values() + self._mesh.comm.allreduce(mine).tolist()

    def _probe_values(self):
        values = {}
        fields = self._probe_fields()
        for quantity in {q for probe in self._scene.probe for q in probe.quantities}:
            name, _, axis = quantity.rpartition("_") if quantity != "n_f" else (quantity, "", "")
            column = AXES.get(axis, 0) if quantity != "p" else 0
            values[quantity] = fields[name or quantity][:, column]
        rows = {probe.name: i for i, probe in enumerate(self._scene.probe)}
        return [values[quantity][rows[probe.name]] for probe in self._scene.probe for quantity in probe.quantities]

    def _probe_fields(self):
        """Return the probe values of every recorded field, name -> (n_probes, k)."""
        coupling, fluid = self._coupling, self._coupling.fluid
        wanted = {q if q in ("p", "n_f") else q.rpartition("_")[0] for probe in self._scene.probe for q in probe.quantities}
        arrays = {"u": coupling.displacement(), "v": coupling.velocity(), "vf": fluid.v, "p": fluid.p[:, None]}
        if "n_f" in wanted:
            arrays["n_f"] = self._mesh.halo.extend(self._measures.porosity(coupling.accepted_carrier()))
        of_solid = {"u", "v"}
        return {n: (self._in_solid if n in of_solid else self._in_fluid).evaluate(arrays[n]) for n in sorted(wanted)}
