"""The axes along which the directions of a material are given: those of a cylinder, or formulas of
position.
"""

from typing import Annotated, Any

import numpy as np
from pydantic import model_validator

from .fields import FIELD, Cells, NumberField, require, values
from .types import ListOf, Number, Table, wrong

Direction = Annotated[tuple[Number, ...], ListOf(3, 3)]
SMALLEST = 1e-9  # sine of two directions, distance from a line over that from a point on it


class DirectionField(Table):
    """A vector of any length but 0, by formulas of position."""

    x: NumberField = 0.0
    y: NumberField = 0.0
    z: NumberField = 0.0

    def at(self, cells: Cells) -> np.ndarray:
        """Return it in cells, (n, 3)."""
        n = len(cells.X)
        found = [np.broadcast_to(values(c, cells), (n, 1)) for c in (self.x, self.y, self.z)]
        return np.hstack(found)


class Orientation(Table):
    """Orthonormal axes: r, θ and z of a cylinder around a line through `center` along `along`; or
    the first and second one by formulas, the second made normal to the first, and the third across
    both.
    """

    center: Annotated[tuple[Number, ...], ListOf(2, 3)] | None = None
    along: Direction | None = None
    first: DirectionField | None = None
    second: DirectionField | None = None

    @model_validator(mode="after")
    def _is_one(self):
        if (self.center is None) == (self.first is None):
            raise wrong("expected exactly one of center (of a cylinder) and first (formulas)")
        for name, other in (("along", "center"), ("second", "first")):
            if getattr(self, name) is not None and getattr(self, other) is None:
                raise wrong(f"received it without {other}; leave it out", name)
        if self.along is not None and not any(self.along):
            raise wrong("received a direction of length 0, expected another", "along")
        return self

    def check(self, dim: int, key: str) -> None:
        """Refuse what is of another dimension."""
        if self.center and len(self.center) != dim:
            raise wrong(f"received {len(self.center)} numbers, expected {dim}", f"{key}.center")
        for name, other in (("along", "center"), ("second", "first")):
            given = getattr(self, name) is not None
            if dim == 2 and given:
                raise wrong(
                    "received it in a two-dimensional scene, where the third axis is across the"
                    " plane; leave it out",
                    f"{key}.{name}",
                )
            if dim == 3 and getattr(self, other) is not None and not given:
                text = f"received nothing beside {other}, expected a direction"
                raise wrong(text, f"{key}.{name}")
        if dim == 2 and self.first and self.first.z != 0:
            raise wrong("received it in a two-dimensional scene; leave it out", f"{key}.first.z")

    @property
    def fields(self) -> dict[str, Any]:
        """Return key -> formula or array of the components that are fields."""
        found = {
            f"{name}.{axis}": getattr(vector, axis)
            for name in ("first", "second")
            if (vector := getattr(self, name))
            for axis in ("x", "y", "z")
        }
        return {key: entry for key, entry in found.items() if isinstance(entry, FIELD)}

    def at(self, cells: Cells) -> np.ndarray:
        """Return the axes of cells, or of points, as rows, (n, 3, 3): on the line of a cylinder any
        around it, NaN where formulas give none.
        """
        first, third = self._first_and_third(cells)
        with np.errstate(invalid="ignore"):
            first, third = (v / np.linalg.norm(v, axis=1)[:, None] for v in (first, third))
        if self.center is not None:
            on_line = np.isnan(first[:, 0])
            least = np.eye(3)[np.argmin(np.abs(third[:1]), axis=1)]
            across = np.cross(third[on_line], least)
            first[on_line] = across / np.linalg.norm(across, axis=1)[:, None]
        return np.stack([first, np.cross(third, first), third], axis=1)

    def require_in(self, cells: Cells, place: str) -> None:
        """Raise InputError, with the key of the scene to begin with, where cells have no axes."""
        first, third = (np.linalg.norm(v, axis=1)[:, None] for v in self._first_and_third(cells))
        if self.center is not None:
            expected = "a distance from the line of centers above 0"
            require(first > 0, first, expected, f"{place}.center: ", cells)
        else:
            require(first > 0, first, "a length above 0", f"{place}.first: ", cells)
            expected = "a vector product with the first direction above 0"
            require(third > SMALLEST * first, third, expected, f"{place}.second: ", cells)

    def _first_and_third(self, cells):
        """Return vectors along the first and the third axis, (n, 3)."""
        n, d = cells.X.shape
        z = np.tile([0.0, 0.0, 1.0], (n, 1))
        if self.first is not None:
            first = self.first.at(cells)
            return first, z if self.second is None else np.cross(first, self.second.at(cells))
        third = z if self.along is None else np.tile(self.along, (n, 1))
        arm = np.zeros((n, 3))
        arm[:, :d] = cells.X - self.center
        arm -= (arm * third).sum(axis=1)[:, None] * third / (third**2).sum(axis=1)[:, None]
        size = np.abs(arm).sum(axis=1, keepdims=True)
        reach = np.abs(cells.X - self.center).sum(axis=1, keepdims=True)
        return np.where(size > SMALLEST * reach, arm, 0.0), third
