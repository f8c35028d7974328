"""Errors of a run against the exact solution of its scene, or against another run."""

import math
from collections.abc import Sequence

import numpy as np

from ..config import Scene
from ..output.probes import Probes
from ..simulation.auto import AnyMedium
from ..simulation.build import serial_mesh
from ..simulation.reference import Comparison
from .trial import Watch

LARGEST_SAMPLE = 400  # points


class Errors:
    """Largest errors against the exact solution over the times of [reference]."""

    def __init__(self, scene: Scene) -> None:
        """Take the scene."""
        self._scene = scene

    def begin(self, coupling: AnyMedium) -> Watch:
        """Return the function that looks at a step."""
        self._comparison = Comparison(self._scene, coupling.solid.domain)
        return lambda clock, coupling, energy: self._comparison.after_step(
            clock, coupling.solid.u, coupling.fluid.p
        )

    @property
    def error_u(self) -> float | None:
        """Return the error of u, None where the solution has none."""
        found = [record["u"] for record in self._comparison.records]
        return None if None in found else max(found)

    @property
    def error_p(self) -> float:
        """Return the error of p."""
        return max(record["p"] for record in self._comparison.records)


class Samples:
    """Displacement and pressure at points and times, linear between steps; `values` (times, points,
    d + 1).
    """

    def __init__(
        self,
        points: np.ndarray,
        times: Sequence[float],
        reference: Sequence[np.ndarray] | None = None,
    ) -> None:
        """Take points (n, d), increasing times [s] and the values of a run to compare with."""
        self._points = points
        self._times = times
        self._reference = reference
        self.values: list[np.ndarray] = []

    def begin(self, coupling: AnyMedium) -> Watch:
        """Return the function that looks at a step."""
        self._probes = Probes(
            coupling.solid.mesh, [(f"sample {i}", point) for i, point in enumerate(self._points)]
        )
        self._before = 0.0, self._at_points(coupling)
        return self._look

    def _at_points(self, coupling):
        return self._probes.evaluate(np.column_stack([coupling.solid.u, coupling.fluid.p]))

    def _look(self, clock, coupling, energy):
        (t0, before), now = self._before, self._at_points(coupling)
        for t in self._times[len(self.values) :]:
            if t <= clock.t * (1 + 1e-12):
                share = (t - t0) / (clock.t - t0)
                self.values.append((1 - share) * before + share * now)
        self._before = clock.t, now

    def _distance(self, columns):
        found = np.array(self.values)[..., columns]
        exact = np.array(self._reference)[..., columns]
        return float(np.linalg.norm(found - exact) / np.linalg.norm(exact))

    @property
    def error_u(self) -> float:
        """Return the distance of u from that of the reference over the latter's norm."""
        return self._distance(slice(0, -1))

    @property
    def error_p(self) -> float:
        """Return the same for p."""
        return self._distance(slice(-1, None))


def sample_points(scene: Scene) -> np.ndarray:
    """Return up to 400 nodes of the scene's mesh, (n, d)."""
    points = serial_mesh(scene).points
    return points[:: math.ceil(len(points) / LARGEST_SAMPLE)]


def quarters(scene: Scene) -> list[float]:
    """Return the ends of the quarters of the run [s]."""
    return [scene.time.end * i / 4 for i in (1, 2, 3, 4)]
