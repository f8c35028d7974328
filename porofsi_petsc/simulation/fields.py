"""The nodal fields of the accepted state, each made when it is asked for."""

from collections.abc import Iterator, Mapping

import numpy as np

from ..config import Scene
from ..quantities import DERIVED_FIELDS, FIELDS, PLASTIC_STRAIN
from .auto import AnyMedium
from .measures import Measures
from .stresses import invariants, total_stress

OF_STRESS = {
    "mean effective stress": ("mean_effective_stress",),
    "von Mises stress": ("von_mises",),
    "principal stresses": ("principal_1", "principal_2", "principal_3"),
}


class Fields(Mapping):
    """Name of a field (`Scene.field_names`) -> its values on the nodes of this rank, (n_owned, k);
    getting one is collective.

    k is 1 for a scalar, the dimension for a vector and 6 (xx, xy, xz, yy, yz, zz; around an axis
    rr, rz, 0, zz, 0, θθ) for the effective stress of the solid; beside a solid without pores
    displacement and solid velocity are those of the mesh in the fluid.  What a scene has no phase
    for is no field of it.  `Scene.derived_field_names` are not counted, and made when asked for.
    """

    def __init__(self, scene: Scene, coupling: AnyMedium, measures: Measures) -> None:
        """Take what has the accepted state."""
        self._coupling = coupling
        self._measures = measures
        self._names = scene.field_names
        self._derived = scene.derived_field_names

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    def __contains__(self, name: object) -> bool:
        return name in self._names or name in self._derived

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self:
            known = ", ".join((*self._names, *self._derived))
            raise KeyError(f"received '{name}', expected one of {known}")
        if name in self._derived:
            return self._made(name)
        coupling = self._coupling
        n = self._coupling.solid.mesh.n_owned
        if name == "stress":
            return self._measures.stress(coupling.solid.u)
        if name == PLASTIC_STRAIN:
            return self._measures.plastic_strain()
        if name == "porosity":
            return self._measures.porosity(coupling.accepted_mesh_state())
        nodal = {
            "displacement": self._measures.displacement,
            "pressure": lambda: coupling.fluid.p[:, None],
            "solid velocity": coupling.velocity,
            "fluid velocity": lambda: coupling.fluid.v,
        }
        return nodal[name]()[:n].copy()

    def _made(self, name):
        """Return a derived field."""
        if name == "total stress":
            return self._total_stress()
        if name == "strain":
            return self._measures.strain(self._coupling.solid.u)
        if name == "Darcy velocity":
            return self["porosity"] * (self["fluid velocity"] - self["solid velocity"])
        if name == "vorticity":
            mesh_state = self._coupling.accepted_mesh_state()
            return self._measures.vorticity(self._coupling.fluid.v, mesh_state)
        stress = self["stress"]
        if name == "effective stress":
            return stress
        return np.column_stack([invariants(stress)[key] for key in OF_STRESS[name]])

    def _total_stress(self):
        """Return σ_E - α p I; on the surface of solids without pores that of the porous medium."""
        solid = self._coupling.solid
        fluid = self._coupling.fluid
        n = solid.mesh.n_owned
        stress = self._measures.stress(solid.u)
        if set(solid.domain.regions) != set(fluid.domain.regions):
            wet = self._measures.stress(solid.u, fluid.domain)
            stress = np.where(fluid.domain.holds[:n, None], wet, stress)
        borne = np.where(fluid.domain.holds, fluid.borne_pressure, 0.0)
        return total_stress(stress, borne[:n])

    @property
    def units(self) -> dict[str, str]:
        """Return the unit of every field, and of what is made of them."""
        known = FIELDS | DERIVED_FIELDS
        return {name: known[name] for name in (*self._names, *self._derived)}

    @property
    def points(self) -> np.ndarray:
        """Return the reference positions of the nodes of this rank, (n_owned, d) [m]."""
        mesh = self._coupling.solid.mesh
        return mesh.X[: mesh.n_owned].copy()

    def gathered(self, name: str) -> np.ndarray | None:
        """Return a field, or "points", in the order of the mesh file, (N, k), on rank 0, None on
        the others (collective).
        """
        mesh = self._coupling.solid.mesh
        slabs = mesh.comm.gather(
            mesh.order.to_slab(self.points if name == "points" else self[name])
        )
        return None if slabs is None else np.concatenate(slabs)
