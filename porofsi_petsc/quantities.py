"""Quantities of one's own that [[probe]] records beside those of the package."""

from collections.abc import Mapping
from typing import ClassVar, Literal

import numpy as np

from .registry import Registry

# u, v and vf have a component for each axis
BUILT_IN = tuple(f"{name}_{axis}" for name in ("u", "v", "vf") for axis in "xyz") + ("p", "n_f")


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
