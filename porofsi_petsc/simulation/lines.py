"""The [[line]] entries of a scene: quantities along straight lines."""

import numpy as np

from ..config import Scene
from .auto import AnyMedium
from .measures import Measures
from .point_values import Place, PointValues


class Lines:
    """The values on the lines in the accepted state."""

    def __init__(self, scene: Scene, coupling: AnyMedium, measures: Measures) -> None:
        """Find the points; raises InputError where one is outside of what it measures
        (collective).
        """
        self._entries = {line.name: line for line in scene.line}
        self._lengths = {}
        self._points = {}
        for i, line in enumerate(scene.line):
            ends = np.array([line.start, line.to])
            part = np.linspace(0.0, 1.0, line.points)[:, None]
            self._lengths[line.name] = part[:, 0] * np.linalg.norm(ends[1] - ends[0])
            points = (1 - part) * ends[0] + part * ends[1]
            places = [Place(f"line.{i}", line.name, at, line.quantities) for at in points]
            self._points[line.name] = PointValues(scene, coupling, measures, places)

    def values(self, name: str) -> dict[str, np.ndarray]:
        """Return s [m], the distance from the first point, and every quantity of a line, name ->
        (points,) (collective).
        """
        found = self._points[name].values()
        return {"s": self._lengths[name]} | {
            quantity: found[quantity] for quantity in self._entries[name].quantities
        }
