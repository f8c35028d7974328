"""Section [mesh]: a graded rectangle, a graded box or a mesh file."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, Field, ValidationInfo, model_validator
from pydantic_core import PydanticCustomError

from ..elements import FAMILIES
from ..errors import shown
from .types import (
    Count,
    Flag,
    Formula,
    Interval,
    ListOf,
    Name,
    Number,
    Positive,
    Table,
    Tag,
    Text,
    distinct,
    wrong,
)

SIDES = {
    2: ("left", "right", "bottom", "top"),
    3: ("left", "right", "front", "back", "bottom", "top"),
}
if TYPE_CHECKING:
    PlaneCells = str
    SolidCells = str
else:
    PlaneCells, SolidCells = (Literal[tuple(FAMILIES[dim])] for dim in (2, 3))

CONDITIONS = ("plane", "box", "cylinder", "formula", "normal")  # of what gets a tag
SECTION = "expected a plane mesh, the section of the body in x = r and y = z; leave it out"


class Axis(Table):
    """Breakpoints [m], cells per segment and the ratio of the last to the first cell of each
    segment.
    """

    points: Annotated[tuple[Number, ...], ListOf(shortest=2)]
    cells: Annotated[tuple[Count, ...], ListOf(shortest=1)]
    ratios: Annotated[tuple[Positive, ...], ListOf()] = ()

    @model_validator(mode="after")
    def _fit_together(self):
        segments = len(self.points) - 1
        if any(b <= a for a, b in zip(self.points, self.points[1:], strict=False)):
            raise wrong(
                f"received {shown(list(self.points))}, expected increasing numbers", "points"
            )
        if len(self.cells) != segments:
            raise wrong(
                f"received {len(self.cells)} entries, expected {segments}, one per segment of"
                " points",
                "cells",
            )
        ratios = self.ratios or (1.0,) * segments
        if len(ratios) != segments:
            raise wrong(
                f"received {len(ratios)} entries, expected {segments}, one per segment of points",
                "ratios",
            )
        return self.model_copy(update={"ratios": ratios})


class Limits(Table):
    """A box along the axes; an absent interval [m] means the whole axis."""

    x: Interval | None = None
    y: Interval | None = None
    z: Interval | None = None

    @model_validator(mode="after")
    def _intervals_increase(self):
        for axis in "xyz":
            interval = getattr(self, axis)
            if interval is not None and interval[0] >= interval[1]:
                raise wrong(f"received {list(interval)}, expected [smaller, larger]", axis)
        return self


class Block(Limits):
    """A named part of a generated mesh; an absent interval [m] means the whole axis."""

    name: Name


class Region(Block):
    """A named volume."""


class Patch(Block):
    """A named part of one side."""

    side: Literal["left", "right", "front", "back", "bottom", "top"]


class Plane(Table):
    """A plane, in two dimensions a line: one coordinate, or a point and the normal."""

    x: Number | None = None
    y: Number | None = None
    z: Number | None = None
    point: Annotated[tuple[Number, ...], ListOf()] = ()
    normal: Annotated[tuple[Number, ...], ListOf()] = ()

    @model_validator(mode="after")
    def _is_one_plane(self):
        given = [axis for axis in "xyz" if getattr(self, axis) is not None]
        both = bool(self.point) and any(self.normal)
        if len(given) + both != 1 or bool(self.point) != bool(self.normal):
            raise wrong("expected one coordinate, such as { x = 0.5 }, or point and normal")
        return self

    def resolved(self, dim: int) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return a point [m] and the normal, (dim,) each."""
        if self.point:
            return self.point, self.normal
        values = [getattr(self, axis) for axis in "xyz"[:dim]]
        point = tuple(value or 0.0 for value in values)
        return point, tuple(float(value is not None) for value in values)


class CylinderOf(Table):
    """A cylinder around an axis, in two dimensions a circle."""

    point: Annotated[tuple[Number, ...], ListOf(shortest=2, longest=3)]
    axis: Annotated[tuple[Number, ...], ListOf()] = ()
    radius: Positive
    surface: Flag = False


class TagOf(Table):
    """A name for boundary facets, or for cells, that meet all conditions given."""

    name: Tag
    cells: Flag = False
    of: Tag | None = None
    plane: Plane | None = None
    box: Limits | None = None
    cylinder: CylinderOf | None = None
    formula: Formula | None = None
    normal: Annotated[tuple[Number, ...], ListOf()] | None = None
    angle: Annotated[Positive, Field(le=90)] = 10.0

    @model_validator(mode="after")
    def _has_a_condition(self):
        if all(getattr(self, key) is None for key in CONDITIONS):
            raise wrong(f"received no condition, expected {', '.join(CONDITIONS[:-1])} or normal")
        if self.cells and (self.normal is not None or self.plane is not None):
            key = "plane" if self.normal is None else "normal"
            raise wrong("received one for cells, expected box, cylinder or formula", key)
        if self.cells and self.name == "all":
            raise wrong("received 'all', expected another name: 'all' are all regions", "name")
        if self.formula is not None and self.formula.depends_on_time:
            raise wrong("received a formula with t, expected one of x, y and z", "formula")
        return self

    def check(self, dim: int) -> None:
        """Raise where a vector has not dim components, or what is plane a z."""
        vectors = {"normal": self.normal}
        if self.plane is not None:
            vectors |= {"plane.point": self.plane.point, "plane.normal": self.plane.normal}
        if self.cylinder is not None:
            if dim == 3 and not any(self.cylinder.axis):
                raise wrong("expected the direction of the axis in a 3-D scene", "cylinder.axis")
            vectors["cylinder.point"] = self.cylinder.point
            vectors["cylinder.axis"] = self.cylinder.axis
        for key, vector in vectors.items():
            expected = 0 if key == "cylinder.axis" and dim == 2 else dim
            if vector and len(vector) != expected:
                raise wrong(f"received {list(vector)}, expected {expected} components", key)
        if self.normal is not None and not any(self.normal):
            raise wrong("received no direction, expected a vector that is not zero", "normal")
        if dim == 2 and self.formula is not None and "z" in self.formula.names:
            raise wrong("received a formula with z in two dimensions, expected x and y", "formula")
        for key in ("plane", "box"):
            if dim == 2 and getattr(getattr(self, key), "z", None) is not None:
                raise wrong("received z in a two-dimensional scene, expected none", f"{key}.z")


class Meshed(Table):
    """What all meshes share."""

    tag: Annotated[tuple[TagOf, ...], ListOf()] = ()
    keep: Annotated[tuple[Tag, ...], ListOf(), AfterValidator(distinct)] = ()

    @model_validator(mode="after")
    def _tags_fit(self):
        for i, tag in enumerate(self.tag):
            try:
                tag.check(self.dim)
            except PydanticCustomError as error:
                context = error.context or {}
                raise wrong(context["text"], f"tag.{i}.{context['key']}") from None
        return self


class Generated(Meshed):
    """What the built-in meshes share."""

    order: Literal[1, 2] = 1
    patches: Annotated[tuple[Patch, ...], ListOf()] = ()
    regions: Annotated[tuple[Region, ...], ListOf()] = ()

    @model_validator(mode="after")
    def _parts_fit(self):
        for kind, parts, taken in (
            ("patches", self.patches, list(SIDES[self.dim])),
            ("regions", self.regions, ["all"]),
        ):
            for i, part in enumerate(parts):
                self._check_part(f"{kind}.{i}", part, taken)
                taken.append(part.name)
        return self

    def _check_part(self, key, part, taken):
        if part.name in taken:
            raise wrong(f"received '{part.name}' again, expected a name of its own", f"{key}.name")
        if getattr(part, "side", "top") not in SIDES[self.dim]:
            raise wrong(
                f"received {shown(part.side)}, expected one of {', '.join(SIDES[self.dim])}",
                f"{key}.side",
            )
        for axis in "xyz":
            interval = getattr(part, axis)
            if interval is None:
                continue
            if axis == "z" and self.dim == 2:
                raise wrong(
                    "received an interval in a two-dimensional scene, expected none", f"{key}.z"
                )
            points = getattr(self, axis).points
            if interval[0] < points[0] or interval[1] > points[-1]:
                raise wrong(
                    f"received {list(interval)}, expected a part of [{points[0]}, {points[-1]}]",
                    f"{key}.{axis}",
                )


class Rectangle(Generated):
    """A graded rectangle of triangles or quadrilaterals; axisymmetric: x is the distance from the
    axis.
    """

    kind: Literal["rectangle"]
    axisymmetric: Flag = False
    x: Axis
    y: Axis
    cell_type: PlaneCells = "triangle"
    diagonal: Literal["right", "left", "alternating"] = "right"

    @model_validator(mode="after")
    def _diagonals_are_of_triangles(self):
        if self.cell_type != "triangle" and self.diagonal != "right":
            raise wrong(
                f"received {shown(self.diagonal)} with cell_type = {shown(self.cell_type)}, which"
                " cuts no grid cells; leave it out",
                "diagonal",
            )
        return self

    @property
    def dim(self) -> int:
        """Return 2."""
        return 2


class Box(Generated):
    """A graded box of tetrahedra or hexahedra."""

    kind: Literal["box"]
    x: Axis
    y: Axis
    z: Axis
    cell_type: SolidCells = "tetrahedron"

    axisymmetric: ClassVar[bool] = False

    @model_validator(mode="before")
    @classmethod
    def _is_no_section(cls, data: Any) -> Any:
        if isinstance(data, dict) and "axisymmetric" in data:
            received = shown(data["axisymmetric"])
            raise wrong(f"received {received} in three dimensions, {SECTION}", "axisymmetric")
        return data

    @property
    def dim(self) -> int:
        """Return 3."""
        return 3


def _from_scene(path: str, info: ValidationInfo) -> str:
    try:
        return str(Path((info.context or {}).get("folder", "."), path).resolve())
    except (OSError, ValueError, RuntimeError) as error:  # a null character, links in a circle
        raise wrong(f"received {shown(path)}, expected the name of a file ({error})") from None


FileName = Annotated[Text, Field(min_length=1, max_length=1000), AfterValidator(_from_scene)]


class MeshFile(Meshed):
    """A mesh file; a relative path starts at the scene's folder."""

    kind: Literal["file"]
    path: FileName
    facets: FileName | None = None
    dim: Literal[2, 3]
    axisymmetric: Flag = False
    scale: Positive = 1.0
    array: Tag | None = None
    groups: Annotated[tuple[Tag, ...], ListOf(), AfterValidator(distinct)] = ()

    @model_validator(mode="after")
    def _sections_are_plane(self):
        if self.axisymmetric and self.dim == 3:
            raise wrong(f"received true in three dimensions, {SECTION}", "axisymmetric")
        return self


MeshSection = Annotated[Rectangle | Box | MeshFile, Field(discriminator="kind")]
