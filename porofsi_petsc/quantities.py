"""What [[probe]] and [[surface]] record and what fields are written: the names of the package, and
quantities of one's own at probes.
"""

from collections.abc import Mapping
from typing import ClassVar, Literal, NamedTuple

import numpy as np

from .registry import Registry

TENSOR = ("xx", "xy", "xz", "yy", "yz", "zz")  # components of a symmetric tensor in their order
# of the stress and the strain of a solid: tensors, and what is made of the effective stress
TENSORS = {
    name: tuple(f"{name}_{pair}" for pair in TENSOR) for name in ("stress", "total", "strain")
}
INVARIANTS = (
    "mean_effective_stress",
    "von_mises",
    "principal_1",
    "principal_2",
    "principal_3",
)
PLASTIC_STRAIN = "plastic_strain"  # the accumulated one of a plastic law, field and quantity
OF_STRESS = (*TENSORS["stress"], *TENSORS["total"], *TENSORS["strain"], *INVARIANTS, PLASTIC_STRAIN)
# u, v and vf have a component for each axis
BUILT_IN = (
    *(f"{name}_{axis}" for name in ("u", "v", "vf") for axis in "xyz"),
    "p",
    "n_f",
    *OF_STRESS,
)


# Nodal fields that are written by default, where the scene has them -> unit.
FIELDS = {
    "displacement": "m",
    "pressure": "Pa",
    "solid velocity": "m/s",
    "fluid velocity": "m/s",
    "stress": "Pa",
    "porosity": "1",
    PLASTIC_STRAIN: "1",
}
# What is made of them where it is asked for -> unit.
DERIVED_FIELDS = {
    "effective stress": "Pa",
    "total stress": "Pa",
    "strain": "1",
    "mean effective stress": "Pa",
    "von Mises stress": "Pa",
    "principal stresses": "Pa",
    "Darcy velocity": "m/s",
    "vorticity": "1/s",
}


class SurfaceQuantity(NamedTuple):
    """What a surface may record.

    symbol : of the column, with a component for each axis where it is a vector; unit : in 2-D per
    metre of thickness where it is an integral; behind : the kinds of material it may be on
    """

    symbol: str
    unit: str
    behind: tuple[str, ...]
    vector: bool = False

    def columns(self, dim: int) -> list[str]:
        """Return the columns in a space of a dimension, without the name of the surface."""
        return [f"{self.symbol}_{axis}" for axis in "xyz"[:dim]] if self.vector else [self.symbol]


SURFACES = {
    "force": SurfaceQuantity("f", "N", ("porous", "solid", "fluid"), vector=True),
    "skeleton_force": SurfaceQuantity("fs", "N", ("porous",), vector=True),
    "pore_force": SurfaceQuantity("fp", "N", ("porous",), vector=True),
    "flow_rate": SurfaceQuantity("flow_rate", "m³/s", ("porous", "fluid")),
    "volume": SurfaceQuantity("volume", "m³", ("porous", "fluid")),
    "area": SurfaceQuantity("area", "m²", ("porous", "solid", "fluid")),
    "pressure": SurfaceQuantity("pressure", "Pa", ("porous", "fluid")),
    "wall_shear": SurfaceQuantity("wall_shear", "Pa", ("fluid",)),
    "wall_shear_max": SurfaceQuantity("wall_shear_max", "Pa", ("fluid",)),
}


class ProbeQuantity:
    """A number at every node, made of the fields of the accepted state; a probe takes it at its
    point.

    unit : as it is written in documents; behind : in which phase a probe looks for its point
    """

    unit: ClassVar[str] = "-"
    behind: ClassVar[Literal["solid", "fluid"]] = "solid"

    def values(self, fields: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return the numbers of the nodes of this rank, (n_owned,), from fields (n_owned, k) by
        name, which `Simulation.fields` has (collective).
        """
        raise NotImplementedError


QUANTITIES = Registry("probe quantity", "porofsi_petsc.quantities", {}, reserved=BUILT_IN)
