"""The quantities of probes and lines at their points."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..config import Scene
from ..errors import InputError, digits
from ..fem.domain import Domain
from ..output.probes import Probes
from ..quantities import OF_STRESS, PLASTIC_STRAIN, QUANTITIES, TENSORS
from .auto import AnyMedium
from .fields import Fields
from .measures import Measures
from .stresses import stress_values

AXES = {"x": 0, "y": 1, "z": 2}
# a point this near to the fluid, in elements, is on the interface: far above the round-off of its
# coordinates
WET = 1e-6


class Place(NamedTuple):
    """A point of the reference configuration [m] and what is asked for there; key : of its entry in
    the scene.
    """

    key: str
    name: str
    at: Sequence[float] | np.ndarray
    quantities: Sequence[str]


class PointValues:
    """The values of quantities at some points in the accepted state, nan at those in regions that
    are not there, or of a fluid that is not.
    """

    def __init__(
        self, scene: Scene, coupling: AnyMedium, measures: Measures, places: Sequence[Place]
    ) -> None:
        """Find the points; raises InputError where one is outside of what it measures
        (collective).
        """
        self._scene = scene
        self._coupling = coupling
        self._measures = measures
        self._mesh = coupling.solid.mesh
        self._asked = {quantity for place in places for quantity in place.quantities}
        self._in_solid, self._in_fluid = (
            _probes_in(phase.domain, places) for phase in (coupling.solid, coupling.fluid)
        )
        self._gone = ~self._in_solid.in_preferred if scene.inactive else None
        of_flow = _Phase("fluid", "solid", coupling.fluid.domain, self._in_fluid)
        of_stress = _Phase("solid", "fluid", coupling.solid.domain, self._in_solid)
        self._is_wet = of_flow.inside() > 1 - WET
        self._dry = self._dry_part()
        if not scene.time.begins:  # else the first stage has looked at the places
            where = scene.source_path or "scene"
            for phase, concerns in ((of_flow, _is_of_flow), (of_stress, OF_STRESS.__contains__)):
                phase.with_absent(scene, places).require(places, concerns, where)

    def _dry_part(self):
        """Return the solids without pores beside the porous media of a scene, whose stress is
        another one on their common surface; None without any (collective).
        """
        solid, fluid = (phase.domain for phase in (self._coupling.solid, self._coupling.fluid))
        dry = set(solid.regions) - set(fluid.regions)
        return Domain(self._mesh, dry) if self._scene.is_porous and dry else None

    def values(self) -> dict[str, np.ndarray]:
        """Return quantity -> values at all points, (n,) (collective)."""
        fields = self._fields()
        values = self._own_values() | self._stress_values()
        for quantity in self._asked - QUANTITIES.keys() - set(OF_STRESS):
            name, _, axis = quantity.rpartition("_") if quantity != "n_f" else (quantity, "", "")
            column = AXES.get(axis, 0) if quantity != "p" else 0
            values[quantity] = fields[name or quantity][:, column]
        for name in filter(_is_of_flow, values):  # none in the dry fill of a pit
            values[name] = np.where(self._is_wet, values[name], np.nan)
        if self._gone is None:
            return values
        return {name: np.where(self._gone, np.nan, found) for name, found in values.items()}

    def _own_values(self):
        """Return the values of registered quantities at all points, name -> (n,)."""
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
        """Return the stresses and strains at all points, name -> (n,): those of the averages
        at nodes.
        """
        found = {}
        if PLASTIC_STRAIN in self._asked:
            nodal = self._mesh.halo.extend(self._measures.plastic_strain())
            found[PLASTIC_STRAIN] = self._in_solid.evaluate(nodal)[:, 0]
        asked = self._asked & set(OF_STRESS) - {PLASTIC_STRAIN}
        if not asked:
            return found
        if self._dry is None:
            return found | stress_values(asked, *self._at_points(asked, None))
        wet, dry = (
            self._at_points(asked, part) for part in (self._coupling.fluid.domain, self._dry)
        )
        stress, strain, borne = (
            np.where(self._is_wet[:, None] if a.ndim == 2 else self._is_wet, a, b)
            for a, b in zip(wet, (*dry[:2], np.zeros_like(dry[2])), strict=True)
        )
        return found | stress_values(asked, stress, strain, borne)

    def _at_points(self, asked, part):
        """Return stress, strain (n, 6) and borne pressure (n,) at all points by the averages over
        the elements of a part of the solid, None for all of it.
        """
        u = self._coupling.solid.u
        zero = np.zeros((self._mesh.n_owned, 6))
        of_strain = asked & set(TENSORS["strain"])
        nodal = [
            self._measures.stress(u, part) if asked - of_strain else zero,
            self._measures.strain(u, part) if of_strain else zero,
        ]
        borne = self._coupling.fluid.borne_pressure
        fields = np.column_stack([self._mesh.halo.extend(np.hstack(nodal)), borne])
        at = self._in_solid.evaluate(fields)
        return at[:, :6], at[:, 6:12], at[:, 12]

    def _fields(self):
        """Return the values of every field that is asked for, name -> (n, k)."""
        coupling = self._coupling
        fluid = self._coupling.fluid
        asked = self._asked - QUANTITIES.keys() - set(OF_STRESS)
        wanted = {q if q in ("p", "n_f") else q.rpartition("_")[0] for q in asked}
        arrays = {
            "u": self._measures.displacement(),
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


def _probes_in(domain: Domain, places: Sequence[Place]) -> Probes:
    """Return the `Probes` of some places, on an interface those of the side of a domain
    (collective).
    """
    points = [(place.name, place.at) for place in places]
    table = f"[[{places[0].key.partition('.')[0]}]]" if places else ""
    return Probes(domain.mesh, points, domain.row_of_cell >= 0, table)


def _is_of_flow(quantity: str) -> bool:
    return quantity in ("p", "n_f") or quantity.startswith("vf_")


class _Phase(NamedTuple):
    """One of the phases, where quantities of its own are looked for."""

    name: str
    other: str
    domain: Domain
    probes: Probes

    def with_absent(self, scene, places):
        """Return the phase with its regions that are placed in a later stage (collective)."""
        absent = [name for name, kind in scene.absent_kinds if kind in (self.name, "porous")]
        if not absent:
            return self
        domain = Domain(self.domain.mesh, {*self.domain.regions, *absent})
        return self._replace(domain=domain, probes=_probes_in(domain, places))

    def inside(self):
        """Return the sum of the shape functions of the phase's nodes at all points, (n,): 1 inside
        of it and on its surface (collective).
        """
        return self.probes.evaluate(self.domain.holds[:, None].astype(float))[:, 0]

    def require(self, places, concerns, where):
        """Raise InputError where a place of quantities that concern the phase is not in it
        (collective).
        """
        inside = self.inside()
        for i, place in enumerate(places):
            asked = [name for name in place.quantities if concerns(name)]
            if asked and inside[i] < 1 - WET:
                point = ", ".join(digits(c) for c in place.at)
                text = (
                    f"received {asked[0]} at ({point}) m in the {self.other}, expected a point of"
                    f" the {self.name}; move the {place.key.partition('.')[0]} or leave it out"
                )
                raise InputError(f"{where} [{place.key}]: {text}")
