"""The nodal fields of the accepted state, each made when it is asked for."""

from collections.abc import Iterator, Mapping

import numpy as np

from ..config import Scene
from ..quantities import FIELDS, PLASTIC_STRAIN
from .auto import AnyMedium
from .measures import Measures


class Fields(Mapping):
    """Name of a field (`Scene.field_names`) -> its values on the nodes of this rank, (n_owned, k);
    getting one is collective.

    k is 1 for a scalar, the dimension for a vector and 6 (xx, xy, xz, yy, yz, zz; around an axis
    rr, rz, 0, zz, 0, θθ) for the effective stress of the solid; beside a solid without pores
    displacement and solid velocity are those of the mesh in the fluid.  What a scene has no phase
    for is no field of it.
    """

    def __init__(self, scene: Scene, coupling: AnyMedium, measures: Measures) -> None:
        """Take what has the accepted state."""
        self._coupling = coupling
        self._measures = measures
        self._names = scene.field_names

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self._names:
            raise KeyError(f"received '{name}', expected one of {', '.join(self._names)}")
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

    @property
    def units(self) -> dict[str, str]:
        """Return the unit of every field."""
        return {name: FIELDS[name] for name in self._names}

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
