"""The vertical stress of ground at rest: the weight of the horizontal layers above, with the
pressure of the water in them.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from mpi4py import MPI

from ..config import Scene
from ..config.conditions import WEIGHT
from ..errors import InputError, digits
from ..fem.distribute import LocalMesh
from .auto import at_start
from .builder import materials_of

SAME = 1e-9  # of heights over that of the ground, of weights over the largest


class Weight(NamedTuple):
    """σ_v(z) = α p - ∫_z γ dz' of layers with the unit weight γ, to the top of the ground.

    levels : (n + 1,) ascending heights between layers [m]; borne : (n + 1,) what is above them
    [Pa]; alpha : (n,) Biot's coefficient of the layers, 0 of those without pores; pressure : p of
    the position [Pa], None for 0
    """

    levels: np.ndarray
    borne: np.ndarray
    alpha: np.ndarray
    pressure: Callable[[float, np.ndarray], np.ndarray] | None

    def __call__(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return σ_v at points x (n, d), (n,) [Pa]."""
        z = x[:, -1]
        stress = -np.interp(z, self.levels, self.borne)
        if self.pressure is None:
            return stress
        layer = np.searchsorted(self.levels, z) - 1
        return stress + self.alpha[layer.clip(0, len(self.alpha) - 1)] * self.pressure(0.0, x)


class _Layer(NamedTuple):
    """A region: its lowest and highest point [m], γ [N/m³] and α [-]."""

    region: str
    low: float
    high: float
    weight: float
    alpha: float


def with_weight(scenes: tuple[Scene, ...], first: Scene, mesh: LocalMesh) -> tuple[Scene, ...]:
    """Return the scenes of all stages with the stress by weight where they ask for it, that of what
    is there in the first stage (collective).

    Raises InputError where the ground has not one unit weight at a height.
    """
    if first.initial.stress.vertical != WEIGHT:
        return scenes
    where = f"{first.source_path or 'scene'} [initial.stress.vertical]"
    layers = [_layer(first, mesh, region, where) for region in _there(first, mesh)]
    weight = _of(layers, first.initial.pressure, where)
    stress = first.initial.stress.model_copy(update={"vertical": weight})
    initial = first.initial.model_copy(update={"stress": stress})
    return tuple(scene.model_copy(update={"initial": initial}) for scene in scenes)


def _there(scene, mesh):
    return [region for region in mesh.regions if region not in scene.inactive]


def _layer(scene, mesh, region, where):
    """Return the `_Layer` of a region (collective)."""
    material = materials_of(at_start(scene), mesh)[region]
    fluid = (1 - material.n_s0) * material.rho_fR if material.has_pores else 0.0
    if np.ndim(material.rho_s) or np.ndim(fluid):
        raise InputError(
            f"{where}: received '{WEIGHT}' with a density or porosity of '{region}' that is a"
            " field, expected numbers; give the stress as a formula"
        )
    body = {name: _vertical(scene, name, region, where) for name in ("solid", "fluid")}
    z = mesh.X[mesh.cells[mesh.cell_region == mesh.regions.index(region)], -1]
    low = mesh.comm.allreduce(float(z.min(initial=np.inf)), MPI.MIN)
    high = mesh.comm.allreduce(float(z.max(initial=-np.inf)), MPI.MAX)
    weight = -(material.rho_s * body["solid"] + fluid * body["fluid"])
    alpha = material.biot if material.has_pores else 0.0
    return _Layer(region, low, high, float(weight), alpha)


def _vertical(scene, phase, region, where):
    """Return the vertical component of the body force on a phase in a region [m/s²]."""
    total = 0.0
    for force in scene.body_forces:
        given = getattr(getattr(force, phase), "xyz"[scene.dim - 1])
        if given is None or not (force.on == ("all",) or region in force.on):
            continue
        if not given.is_constant:
            raise InputError(
                f"{where}: received '{WEIGHT}' with a body force that is a formula, expected"
                " numbers; give the stress as a formula"
            )
        total += float(given(0.0, np.zeros((1, 3)))[0])
    return total


def _of(layers, pressure, where):
    """Return the `Weight` of layers."""
    heights = np.unique([z for layer in layers for z in (layer.low, layer.high)])
    near = SAME * (heights[-1] - heights[0])
    levels = heights[np.append(True, np.diff(heights) > near)]
    middles = (levels[1:] + levels[:-1]) / 2
    found = [_at(z, layers, where) for z in middles]
    weights, alpha = (
        np.array([getattr(one, name) for one in found]) for name in _Layer._fields[3:]
    )
    shares = weights * np.diff(levels)
    borne = np.append(np.cumsum(shares[::-1])[::-1], 0.0)
    return Weight(levels, borne, alpha, pressure)


def _at(z, layers, where):
    """Return a layer at a height; raises InputError where others differ from it."""
    here = [layer for layer in layers if layer.low < z < layer.high]
    if not here:
        return _Layer("", z, z, 0.0, 0.0)
    largest = max(abs(layer.weight) for layer in layers)
    for other in here[1:]:
        if abs(other.weight - here[0].weight) > SAME * largest or other.alpha != here[0].alpha:
            raise InputError(
                f"{where}: received '{WEIGHT}' with '{here[0].region}' and '{other.region}' at the"
                f" same height {digits(z)} m, of {digits(here[0].weight)} and"
                f" {digits(other.weight)} N/m³, or with and without pores; expected horizontal"
                " layers of one unit weight each; give the stress as a formula"
            )
    return here[0]
