"""Inlets of a free fluid: the velocity that carries a given flow rate through them."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from ..config import Scene
from ..errors import InputError
from ..fem.distribute import LocalMesh
from ..fem.essential import Essential, Formula
from ..fem.section import Section
from ..materials.porous import PorousMaterial
from .conditions import essentials, is_zero, nodes_of

HARMONICS = 16  # where the scene gives no number
SAMPLES = 1024  # of a period, from which its harmonics are taken
SMALL = 1e-14  # harmonics below this part of the largest flow rate are its round-off
NEAR = 1e-9  # distance of a point from its node, over the size of the inlet
ALONG = 1e-3  # components of a normal below are none


class Harmonic(NamedTuple):
    """A part Re(amplitude e^(iωt)) of a flow rate, with its own profile (n,) beside the mean's."""

    frequency: float
    amplitude: complex
    profile: np.ndarray


@dataclass(frozen=True, eq=False)
class Inlet:
    """A flow Q(t) into the fluid through a `Section`:

        v·n = -φ₀ Q(t) - Σ_k Re[Q_k e^(iω_k t) (φ_k - φ₀)],  ∫ φ dA = 1 of every profile φ:

    that through the facets is Q at every time, however many harmonics there are.

    flow_rate : (t, x (1, d)) -> (1,) [m³/s, in 2-D m²/s]; period : after which it is repeated [s],
    or None; profile : φ₀ (n,) [1/m^(d-1)]
    """

    section: Section
    flow_rate: Formula
    period: float | None
    profile: np.ndarray
    harmonics: tuple[Harmonic, ...] = ()

    def speed(self, t: float) -> np.ndarray:
        """Return -v·n at the nodes of the section at time t, (n,) [m/s]."""
        found = self.profile * flow_at(self.flow_rate, self.period, self.section, t)
        for frequency, amplitude, profile in self.harmonics:
            wave = amplitude * np.exp(1j * frequency * t)
            found = found + (wave * (profile - self.profile)).real
        return found

    @cached_property
    def _nodes(self):
        return cKDTree(self.section.points)

    def values(self, component: int, t: float, x: np.ndarray) -> np.ndarray:
        """Return a component of v at nodes of the section, x (n, d) [m], (n,) [m/s].

        Raises IndexError where x is none of them.
        """
        size = np.ptp(self.section.points, axis=0).max()
        places = self._nodes.query(x, distance_upper_bound=NEAR * size)[1]
        return -self.section.normal[component] * self.speed(t)[places]


@dataclass(frozen=True, eq=False)
class Component:
    """One component of the velocity in an inlet, known at its nodes alone."""

    inlet: Inlet
    component: int
    nodal = True

    def __call__(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return the values at nodes x (n, d) [m], (n,) [m/s]."""
        return self.inlet.values(self.component, t, x)


def flow_at(flow_rate: Formula, period: float | None, section: Section, t: float) -> float:
    """Return a flow rate at time t, or at the same time of the first period."""
    time = t if period is None else t % period
    return float(flow_rate(time, section.points[:1])[0])


def inflows(
    scene: Scene,
    mesh: LocalMesh,
    materials: dict[str, PorousMaterial],
    sticking: np.ndarray,
    scaled: Callable[[Any], Any],
) -> list[Essential]:
    """Return the `Essential`s of all inlets with a given flow rate (collective).

    materials : of every region; sticking : (n_local,) bool, where the fluid sticks to a solid;
    scaled : formula -> formula times the load factor.
    Raises InputError where a profile has no meaning.
    """
    found = []
    for i, boundary in enumerate(scene.boundary):
        if boundary.inflow is None:
            continue
        for tag in boundary.on:
            where = f"{scene.source_path or 'scene'} [boundary.{i}.inflow]: tag '{tag}'"
            section = _section(scene, mesh, tag, 2 * boundary.priority, sticking, where)
            viscosity = _kinematic(mesh, materials, tag)
            inlet = _inlet(boundary.inflow, section, viscosity, scaled, where)
            found += [
                Essential(
                    tag, j, Component(inlet, j), 2 * boundary.priority, f"boundary.{i}.inflow"
                )
                for j in range(mesh.dim)
            ]
    return found


def _section(scene, mesh, tag, precedence, sticking, where):
    """Return the `Section` of a tag with what holds the fluid on its rim (collective)."""
    normal = Section.gathered(mesh, tag, sticking).normal
    walls = [
        entry
        for entry in essentials(scene, "velocity")
        if entry.precedence > precedence and abs(normal[entry.component]) > ALONG
    ]
    held = sticking | nodes_of(mesh, {entry.tag for entry in walls})
    section = Section.gathered(mesh, tag, held)
    if not section.is_plane:
        raise InputError(
            f"{where} has normals that differ by {section.unevenness:.2g}, expected a plane"
            " surface; give the velocity as formulas of position"
        )
    _require_walls_at_rest(mesh, tag, walls, where)
    return section


def _require_walls_at_rest(mesh, tag, walls, where):
    """Refuse a velocity through the inlet that another entry prescribes on its rim (collective)."""
    here = nodes_of(mesh, [tag])
    for entry in walls:
        common = here & nodes_of(mesh, [entry.tag])
        if not is_zero(entry.expression) and mesh.comm.allreduce(int(common.sum())):
            raise InputError(
                f"{where} has nodes on which [{entry.name}] goes before, whose flow would be added"
                " to the given one; expected walls, a velocity of zero, or a lower `priority` there"
            )


def _kinematic(mesh, materials, tag):
    """Return the kinematic viscosities of the fluids behind a tag [m²/s] (collective)."""
    facets = mesh.facets[tag]
    regions = set(mesh.cell_region[facets.cells[facets.owned]].tolist())
    everywhere = set().union(*mesh.comm.allgather(regions))
    behind = [materials[mesh.regions[number]] for number in sorted(everywhere)]
    return {material.viscosity / material.rho_fR for material in behind}


def _inlet(given, section, viscosities, scaled, where):
    """Return the `Inlet` of an entry."""
    flow_rate = scaled(given.flow_rate)
    if section.held.all():
        raise InputError(
            f"{where} is at rest on all its nodes, expected one inside of its rim; take a finer"
            " mesh or elements of order 2"
        )
    if given.profile == "plug":
        return Inlet(section, flow_rate, given.period, section.plug)
    if not section.has_rim:
        raise InputError(
            f"{where} has no wall at its rim, a velocity of zero or a solid, which the profile"
            f" '{given.profile}' needs; take profile = 'plug'"
        )
    steady = Inlet(section, flow_rate, given.period, section.developed)
    if given.profile == "parabolic":
        return steady
    if len(viscosities) > 1:
        raise InputError(
            f"{where} has several fluids behind it, expected one for the profile 'womersley'"
        )
    harmonics = _harmonics(given, steady, viscosities.pop())
    return Inlet(section, flow_rate, given.period, section.developed, tuple(harmonics))


def _harmonics(given, steady, viscosity):
    """Return the `Harmonic`s of a period that are more than round-off."""
    times = np.arange(SAMPLES) * given.period / SAMPLES
    section = steady.section
    samples = np.array([flow_at(steady.flow_rate, given.period, section, t) for t in times])
    amplitudes = 2 / SAMPLES * np.fft.rfft(samples)
    found = []
    for number in range(1, (given.harmonics or HARMONICS) + 1):
        if abs(amplitudes[number]) > SMALL * np.abs(samples).max():
            frequency = 2 * np.pi * number / given.period
            profile = section.oscillating(1j * frequency / viscosity)
            found.append(Harmonic(frequency, amplitudes[number], profile))
    return found
