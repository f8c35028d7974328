"""What the history records: fields at probes, and what belongs to surfaces."""

from typing import Any

import numpy as np

from ..config import Scene
from ..errors import InputError
from ..quantities import OF_STRESS, QUANTITIES, TENSORS
from .auto import AnyMedium
from .builder import materials_of
from .fields import Fields
from .measures import Measures
from .sides import check_probes, probes_in
from .stresses import stress_values
from .surfaces import Surfaces

AXES = {"x": 0, "y": 1, "z": 2}


class Quantities:
    """The values of `Scene.columns` in the accepted state."""

    def __init__(self, scene: Scene, coupling: AnyMedium, measures: Measures) -> None:
        """Find the probes and the surfaces; raises InputError where a probe is outside of what it
        measures (collective).
        """
        self._scene = scene
        self._coupling = coupling
        self._measures = measures
        self._mesh = coupling.solid.mesh
        self._in_solid, self._in_fluid = (
            probes_in(scene, phase.domain) for phase in (coupling.solid, coupling.fluid)
        )
        check_probes(scene, coupling, self._in_solid, self._in_fluid)
        self._surfaces = None
        if scene.surfaces:
            self._surfaces = Surfaces(scene, coupling, materials_of(scene, self._mesh))

    def values(self, t: float) -> list[float]:
        """Return the values at the present time t [s], one for each column (collective)."""
        surfaces = self._surfaces.at(t) if self._surfaces else []
        return self._probe_values() + surfaces + self._condition_values()

    def advance(self, t: float) -> None:
        """Take note of an accepted step that ends at t [s] (collective)."""
        if self._surfaces:
            self._surfaces.advance(t)

    def memory(self) -> dict[str, Any]:
        """Return what a restart needs."""
        volumes = self._surfaces.volumes if self._surfaces else None
        return {"volumes": volumes.state()} if volumes else {}

    def load(self, memory: dict[str, Any]) -> None:
        """Continue from `memory`."""
        volumes = self._surfaces.volumes if self._surfaces else None
        if volumes:
            volumes.load(memory["volumes"])

    def _condition_values(self):
        """Return what conditions on surfaces record, in the order of the scene."""
        coupling = self._coupling
        recorded = coupling.solid.surfaces.recorded() | coupling.fluid.surfaces.recorded()
        return [recorded[column] for column in self._scene.condition_columns]

    def _probe_values(self):
        fields = self._probe_fields()
        values = self._own_values() | self._stress_values()
        for quantity in self._asked - QUANTITIES.keys() - set(OF_STRESS):
            name, _, axis = quantity.rpartition("_") if quantity != "n_f" else (quantity, "", "")
            column = AXES.get(axis, 0) if quantity != "p" else 0
            values[quantity] = fields[name or quantity][:, column]
        rows = {probe.name: i for i, probe in enumerate(self._scene.probe)}
        return [
            values[quantity][rows[probe.name]]
            for probe in self._scene.probe
            for quantity in probe.quantities
        ]

    @property
    def _asked(self):
        """Return the quantities of all probes."""
        return {quantity for probe in self._scene.probe for quantity in probe.quantities}

    def _own_values(self):
        """Return the values of registered quantities at all probes, name -> (n_probes,)."""
        places = {"solid": self._in_solid, "fluid": self._in_fluid}
        fields = Fields(self._scene, self._coupling, self._measures)
        found = {}
        for name in sorted(self._asked & QUANTITIES.keys()):
            quantity = QUANTITIES[name]()
            values = np.asarray(quantity.values(fields), dtype=float)
            if values.shape != (self._mesh.n_owned,):
                raise InputError(
                    f"probe quantity '{name}': received values of shape {values.shape}, expected"
                    f" ({self._mesh.n_owned},), a number for each node"
                )
            nodal = self._mesh.halo.extend(values[:, None])
            found[name] = places[quantity.behind].evaluate(nodal)[:, 0]
            if not np.isfinite(found[name]).all():
                raise InputError(
                    f"probe quantity '{name}': received a value that is not finite at a probe,"
                    " expected numbers"
                )
        return found

    def _stress_values(self):
        """Return the stresses and strains at all probes, name -> (n_probes,): those of the averages
        at nodes.
        """
        asked = self._asked & set(OF_STRESS)
        if not asked:
            return {}
        u = self._coupling.solid.u
        zero = np.zeros((self._mesh.n_owned, 6))
        of_strain = asked & set(TENSORS["strain"])
        nodal = [
            self._measures.stress(u) if asked - of_strain else zero,
            self._measures.strain(u) if of_strain else zero,
        ]
        fields = np.column_stack([self._mesh.halo.extend(np.hstack(nodal)), self._coupling.fluid.p])
        at = self._in_solid.evaluate(fields)
        return stress_values(asked, at[:, :6], at[:, 6:12], at[:, 12])

    def _probe_fields(self):
        """Return the probe values of every recorded field, name -> (n_probes, k)."""
        coupling = self._coupling
        fluid = self._coupling.fluid
        asked = self._asked - QUANTITIES.keys() - set(OF_STRESS)
        wanted = {q if q in ("p", "n_f") else q.rpartition("_")[0] for q in asked}
        arrays = {
            "u": coupling.displacement(),
            "v": coupling.velocity(),
            "vf": fluid.v,
            "p": fluid.p[:, None],
        }
        if "n_f" in wanted:
            arrays["n_f"] = self._mesh.halo.extend(
                self._measures.porosity(coupling.accepted_mesh_state())
            )
        of_solid = {"u", "v"}
        return {
            n: (self._in_solid if n in of_solid else self._in_fluid).evaluate(arrays[n])
            for n in sorted(wanted)
        }
