"""The serial mesh: points, cells, regions and tagged facets in the natural numbering."""

import hashlib
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ..elements import Element


@dataclass(frozen=True, eq=False)
class Mesh:
    """A mesh of one element with one region per cell and named facet groups.

    points : (N, d) coordinates [m].  cells : (E, A) nodes, positively oriented, VTK node order.
    cell_region : (E,) index into `regions`.  facets : tag -> (F, Af) nodes, outward from the
    (first) adjacent cell.  inner : region -> (F, Af) nodes of the facets that other regions have
    toward it, outward from these, as far as one asks for them.  values : name -> (E,) numbers of
    cells that a file gives.  notes : sentences on what the file has and the mesh does not.
    derived : tags that follow from the regions, which make no other mesh.
    """

    points: np.ndarray
    cells: np.ndarray
    element: Element
    regions: tuple[str, ...]
    cell_region: np.ndarray
    facets: dict[str, np.ndarray]
    notes: tuple[str, ...] = ()
    values: dict[str, np.ndarray] = field(default_factory=dict)
    derived: tuple[str, ...] = ()
    inner: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def dim(self) -> int:
        """Return the space dimension."""
        return self.element.dim

    @cached_property
    def hash(self) -> str:
        """Return 16 hexadecimal digits of the SHA-256 over points, cells, tagged facets and
        values.
        """
        kind = f"{self.element.name} around an axis" if self.element.axisymmetric else ""
        digest = hashlib.sha256((kind or self.element.name).encode())
        for array in (self.points, self.cells, self.cell_region):
            digest.update(np.ascontiguousarray(array).tobytes())
        for tag in sorted(set(self.facets) - set(self.derived)):
            digest.update(tag.encode())
            digest.update(np.ascontiguousarray(self.facets[tag]).tobytes())
        for name in sorted(self.values):
            digest.update(name.encode())
            digest.update(np.ascontiguousarray(self.values[name]).tobytes())
        return digest.hexdigest()[:16]
