"""What the history records of the surfaces of a scene: forces, flows and means over them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from ..config import Scene
from ..errors import InputError
from ..fem.boundary import has_facets
from ..fem.domain import Domain
from ..fem.surface_integrals import SurfaceIntegrals
from ..materials.porous import PorousMaterial
from .auto import AnyMedium
from .forces import Forces, InterfaceForces, PorousFlows, PorousForces
from .volumes import FlowVolumes, SeepageVolumes, Volumes


class Surfaces:
    """The values of the [[force]] and [[surface]] entries of a scene in the accepted state.

    volumes : what has flown through those with the quantity volume, None without any
    """

    def __init__(
        self, scene: Scene, coupling: AnyMedium, materials: dict[str, PorousMaterial]
    ) -> None:
        """Find the surfaces (collective)."""
        self._coupling: Any = coupling
        self._comm = coupling.solid.mesh.comm
        self._porous = scene.is_porous
        self._entries = scene.surfaces
        self._integrals = [
            SurfaceIntegrals(self._domain(entry.on), entry.on) for entry in self._entries
        ]
        self._viscosity = _of_elements(
            coupling.fluid.domain, {name: m.viscosity for name, m in materials.items()}
        )
        self._force_rows, on = self._having({"force", "skeleton_force"})
        self._forces: Forces | None = None
        if on:
            of_kind: Any = PorousForces if self._porous else InterfaceForces
            self._forces = of_kind(coupling, on)
        self._flow_rows, on = self._having({"flow_rate", "volume"})
        self._seepage = PorousFlows(self._coupling, on) if on and self._porous else None
        self._volume_rows = self._having({"volume"})[0]
        self.volumes = self._new_volumes()

    def _domain(self, tags):
        fluid = self._coupling.fluid.domain
        return fluid if has_facets(fluid, tags) else self._coupling.solid.domain

    def _having(self, quantities):
        """Return entry -> row among those with one of some quantities, and their tags."""
        found = [i for i, entry in enumerate(self._entries) if quantities & set(entry.quantities)]
        return {i: row for row, i in enumerate(found)}, [self._entries[i].on for i in found]

    def _new_volumes(self) -> Volumes | None:
        if not self._volume_rows:
            return None
        if self._porous:
            return SeepageVolumes(len(self._volume_rows))
        return FlowVolumes(self._rates_of_volumes(0.0))

    def _rates_of_volumes(self, t):
        rates = self._rates(t, collocated=True)
        return rates[[self._flow_rows[i] for i in self._volume_rows]]

    def memory(self) -> dict[str, list[float]]:
        """Return what a restart needs, by the name of the surface."""
        if self.volumes is None:
            return {}
        parts = np.transpose(self.volumes.state()).tolist()
        return {self._entries[i].name: parts[row] for i, row in self._volume_rows.items()}

    def load(self, path: Path, memory: dict[str, list[float]]) -> None:
        """Continue from `memory`, of the checkpoint of a path; raises InputError where it has no
        volume of a surface.
        """
        if self.volumes is None:
            return
        names = [self._entries[i].name for i in self._volume_rows]
        missing = [name for name in names if name not in memory]
        if missing:
            raise InputError(
                f"{path}: received the quantity 'volume' of '{missing[0]}', which the run of the"
                " checkpoint had not, expected its own; leave it out, or start anew"
            )
        self.volumes.load(np.transpose([memory[name] for name in names]).tolist())

    def advance(self, t: float) -> None:
        """Add what has flown through the surfaces in the step that ends at t [s] (collective)."""
        if self.volumes:
            scheme = self._coupling.solid.scheme
            self.volumes.add(scheme, self._rates_of_volumes(t))

    def at(self, t: float) -> list[float]:
        """Return the values at the present time t [s], in the order of the columns (collective)."""
        values: dict[str, Callable[[int], Any]] = {
            "force": self._force,
            "skeleton_force": self._skeleton_force,
            "pore_force": self._pore_force,
            "flow_rate": lambda i: self._rates_now[self._flow_rows[i]],
            "volume": self._volume,
            "area": self._area,
            "pressure": self._mean_pressure,
            "wall_shear": lambda i: self._shear(i)[0],
            "wall_shear_max": lambda i: self._shear(i)[1],
        }
        self._found = self._sum(self._forces.at(t)) if self._forces else np.zeros((0, 0))
        self._rates_now = self._rates(t) if self._flow_rows else np.zeros(0)
        return [
            float(value)
            for i, entry in enumerate(self._entries)
            for name in entry.quantities
            for value in np.atleast_1d(values[name](i))
        ]

    # -- of one entry ------------------------------------------------------------------------------

    def _force(self, i):
        return self._found[self._force_rows[i]]

    def _skeleton_force(self, i):
        """Return the force without that of the pore pressure; zero as long as the former is not
        known.
        """
        return self._force(i) - self._pore_force(i) if self._found.any() else 0 * self._force(i)

    def _pore_force(self, i):
        borne = self._coupling.fluid.borne_pressure
        return self._sum(self._integrals[i].normal(self._positions, borne))

    def _volume(self, i):
        assert self.volumes is not None  # of an entry with it
        return self.volumes.values[self._volume_rows[i]]

    def _area(self, i):
        return self._sum(np.array(self._integrals[i].area(self._positions)))

    def _mean_pressure(self, i):
        p = self._coupling.fluid.p
        return self._sum(np.array(self._integrals[i].scalar(self._positions, p))) / self._area(i)

    def _shear(self, i):
        """Return mean and maximum of the shear on a wall [Pa]."""
        v = self._coupling.fluid.v
        total, largest = self._integrals[i].shear(self._positions, v, self._viscosity)
        mean = self._sum(np.array(total)) / self._area(i)
        return mean, self._comm.allreduce(largest, MPI.MAX)

    # -- of all of them ----------------------------------------------------------------------------

    def _rates(self, t, collocated=False):
        """Return the flow rates at a time t [s], (entries with one,), of a porous medium where
        its volume balance holds, if asked for (collective).
        """
        if self._seepage:
            return self._sum(self._seepage.at(t, collocated))
        state = self._coupling.accepted_mesh_state()
        c = self._coupling.fluid.v - state.mesh_velocity
        x = self._positions
        return self._sum(np.array([self._integrals[i].flow(x, c) for i in self._flow_rows]))

    @property
    def _positions(self):
        """Return where the nodes of the mesh are, (n_local, d) [m]."""
        state = self._coupling.accepted_mesh_state()
        return self._coupling.solid.mesh.X + (state.displacement if state.moving_mesh else 0.0)

    def _sum(self, mine):
        return self._comm.allreduce(mine)


def _of_elements(domain: Domain, values: dict[str, float]) -> np.ndarray:
    """Return what every element of a domain has, (E,), from region -> value."""
    found = np.zeros(domain.n_cells)
    for region, span in domain.region_slices.items():
        found[span] = values[region]
    return found
