"""The exact flow of a scene and the distance of the computed velocity and pressure from it."""

from collections.abc import Callable

import numpy as np

from ..config import Scene
from ..exact import EthierSteinman, Kovasznay, TaylorGreen, WomersleyChannel, WomersleyPipe
from ..fem.domain import Domain
from .reference import Comparison

FLOWS: dict[str, Callable] = {
    "kovasznay": Kovasznay,
    "taylor_green": TaylorGreen,
    "ethier_steinman": EthierSteinman,
    "womersley_channel": WomersleyChannel,
    "womersley_pipe": WomersleyPipe,
}


class FlowComparison(Comparison):
    """Errors of a free fluid against a flow of `exact.flows`, over the whole mesh.

    That of the velocity is taken over the exact one, that of the pressure, whose level does not
    count, over ρU² and √volume.
    """

    def __init__(self, scene: Scene, domain: Domain) -> None:
        """Prepare the quadrature over the owned elements of the fluid's domain (collective)."""
        section = scene.reference
        fluid = scene.material[0].fluid
        assert section and fluid  # `Scene` refuses flows without
        given = [fluid.density, fluid.viscosity, section.speed, section.length]
        if section.frequency is not None:
            given.append(section.frequency)
        self._exact = FLOWS[section.solution](*given)
        self._prepare(scene, domain)

    def _errors(self, t, v, p):
        exact = self._exact.velocity(t, self._points)
        wrong = self._at_points(p[:, None])[:, 0] - self._exact.pressure(t, self._points)
        volume = self._norm(np.ones(len(wrong))) ** 2
        level = self._domain.mesh.comm.allreduce(float(wrong @ self._dV.ravel())) / volume
        size = self._exact.density * self._exact.speed**2 * np.sqrt(volume)
        return {
            "v": self._norm(self._at_points(v) - exact) / self._norm(exact),
            "p": self._norm(wrong - level) / size,
        }

    def _profile(self, t, v, p):
        return {}

    def table(self) -> dict[str, np.ndarray]:
        """Return the errors as a history: t and error.v, error.p, each (records,)."""
        return self._columns({"t": "at", "error.v": "v", "error.p": "p"})
