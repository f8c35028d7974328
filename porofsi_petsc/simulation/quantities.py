"""What the history records: fields at probes, and what belongs to surfaces."""

from pathlib import Path

from ..config import Scene
from .auto import AnyMedium
from .builder import materials_of
from .measures import Measures
from .point_values import Place, PointValues
from .surfaces import Surfaces


class Quantities:
    """The values of `Scene.columns` in the accepted state."""

    def __init__(self, scene: Scene, coupling: AnyMedium, measures: Measures) -> None:
        """Find the probes and the surfaces; raises InputError where a probe is outside of what it
        measures (collective).
        """
        self._scene = scene
        self._coupling = coupling
        places = [
            Place(f"probe.{i}", probe.name, probe.at, probe.quantities)
            for i, probe in enumerate(scene.probe)
        ]
        self._probes = PointValues(scene, coupling, measures, places)
        self._surfaces = None
        if scene.surfaces:
            materials = materials_of(scene, coupling.solid.mesh)
            self._surfaces = Surfaces(scene, coupling, materials)

    def values(self, t: float) -> list[float]:
        """Return the values at the present time t [s], one for each column (collective)."""
        surfaces = self._surfaces.at(t) if self._surfaces else []
        return self._probe_values() + surfaces + self._condition_values()

    def _probe_values(self):
        found = self._probes.values()
        return [
            float(found[quantity][i])
            for i, probe in enumerate(self._scene.probe)
            for quantity in probe.quantities
        ]

    def advance(self, t: float) -> None:
        """Take note of an accepted step that ends at t [s] (collective)."""
        if self._surfaces:
            self._surfaces.advance(t)

    def memory(self) -> dict[str, list[float]]:
        """Return what a restart needs."""
        return self._surfaces.memory() if self._surfaces else {}

    def load(self, path: Path, memory: dict[str, list[float]]) -> None:
        """Continue from `memory`, of the checkpoint of a path; raises InputError where it lacks
        something.
        """
        if self._surfaces:
            self._surfaces.load(path, memory)

    def _condition_values(self):
        """Return what conditions on surfaces record, in the order of the scene."""
        coupling = self._coupling
        recorded = coupling.solid.surfaces.recorded() | coupling.fluid.surfaces.recorded()
        return [recorded[column] for column in self._scene.condition_columns]
