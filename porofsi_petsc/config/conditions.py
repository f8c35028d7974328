"""Entries [[boundary]], [body_force] and [initial]: what is prescribed, where, and what excludes
what.
"""

from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import Annotated, Any, Literal

import pydantic
from pydantic import (
    Discriminator,
    Field,
    GetCoreSchemaHandler,
    PlainSerializer,
    PlainValidator,
    Strict,
    ValidationInfo,
    create_model,
    model_validator,
)
from pydantic_core import CoreSchema

from ..conditions import CONDITIONS, SurfaceCondition
from ..conditions.condition import Kind
from ..errors import shown
from ..registry import Parameter, parameters
from .expressions import Expression
from .fields import CellArray
from .types import (
    Axes,
    Count,
    Flag,
    Formula,
    ListOf,
    Number,
    Positive,
    Table,
    Tag,
    Tags,
    Vector,
    expression,
    wrong,
)

VECTORS = ("displacement", "velocity")
MOST_HARMONICS = 400


class Inflow(Table):
    """A flow into a free fluid, Q [m³/s, in 2-D m²/s], with a profile of the inlet's section.

    period : after which Q is repeated [s]; harmonics : of it that have profiles of their own.
    """

    flow_rate: Formula
    profile: Literal["parabolic", "plug", "womersley"] = "parabolic"
    period: Positive | None = None
    harmonics: Annotated[Count, Field(le=MOST_HARMONICS)] | None = None

    @model_validator(mode="after")
    def _of_profile(self):
        used = self.flow_rate.names - {"t"}
        if used and self.flow_rate.function is None:
            raise wrong(
                f"received {shown(self.flow_rate.source)}, expected a function of t alone: the"
                " profile follows from the section",
                "flow_rate",
            )
        if self.profile == "womersley" and self.period is None:
            raise wrong("received nothing, expected the period of a womersley profile", "period")
        if self.profile != "womersley" and self.harmonics is not None:
            raise wrong(
                f"received {self.harmonics} with profile = '{self.profile}', expected none;"
                " leave it out",
                "harmonics",
            )
        return self


class Boundary(Table):
    """Conditions on tagged surfaces; what is absent is free, and impermeable (v_f.n = v_s.n).

    displacement [m], its component along the outward normal [m], components that all nodes have in
    common; velocity of the fluid phase [m/s], flow into a free fluid, pressure [Pa]; no_slip: v_f =
    v_s in all components; priority: which entry holds at a node of several.  Each condition of
    `conditions.CONDITIONS` is one key more, see `boundary_table`.
    """

    on: Tags
    displacement: Vector = Vector()
    normal_displacement: Formula | None = None
    equal_displacement: Axes = ()
    velocity: Vector = Vector()
    inflow: Inflow | None = None
    pressure: Formula | None = None
    no_slip: Flag = False
    priority: Annotated[int, Strict()] = 0

    def given(self) -> list[str]:
        """Return the names of what this entry prescribes, such as 'displacement.x' and
        'pressure'.
        """
        essential = dict(zip(VECTORS, (self.displacement, self.velocity), strict=True))
        names = [name for key, vector in essential.items() for name in _components(key, vector)]
        names += ["normal_displacement"] * (self.normal_displacement is not None)
        names += [f"equal_displacement.{axis}" for axis in self.equal_displacement]
        names += ["inflow"] * (self.inflow is not None)
        names += ["pressure"] * (self.pressure is not None) + ["no_slip"] * self.no_slip
        for key in self.surface_conditions():
            value = getattr(self, key)
            names += _components(key, value) if isinstance(value, Vector) else [key]
        return names

    def surface_conditions(self) -> dict[str, dict[str, Any]]:
        """Return name -> parameters of the conditions on its surfaces; of a vector component ->
        formula.
        """
        found = {}
        for name, condition in CONDITIONS.items():
            value = getattr(self, name)
            if isinstance(value, Vector):
                value = dict(_given_components(value)) or None
            if value is not None and value != _default(condition):
                found[name] = _arguments(value)
        return found


def _given_components(vector):
    values = zip("xyz", (vector.x, vector.y, vector.z), strict=True)
    return [(i, value) for i, (_, value) in enumerate(values) if value is not None]


def _components(name, vector):
    return [f"{name}.{'xyz'[i]}" for i, _ in _given_components(vector)]


def _default(condition):
    """Return the value that says that a condition is not there."""
    only = parameters(condition).get("value")
    return only.default if only else None


def _arguments(value):
    if isinstance(value, Table):
        entries = {name: getattr(value, name) for name in type(value).model_fields}
        return {
            name: dict(_given_components(entry)) if isinstance(entry, Vector) else entry
            for name, entry in entries.items()
        }
    return {"value": value}


def boundary_table() -> type[Boundary]:
    """Return `Boundary` with a key for each condition that is registered now."""
    return _boundary_table(tuple(CONDITIONS.items()))


@lru_cache(maxsize=1)
def _boundary_table(conditions):
    """Return the one table of a scene and of its stages."""
    keys: dict[str, Any] = {name: _key(name, of) for name, of in conditions}
    return create_model("Boundary", __base__=Boundary, **keys)


class WithConditions:
    """The annotation of an entry [[boundary]]: its table is `boundary_table`, as it is when the
    schema is made.
    """

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """Return the schema of the table."""
        return handler.generate_schema(boundary_table())


def _key(name: str, condition: type) -> tuple:
    """Return type and default of the key of a condition."""
    found = parameters(condition)
    if set(found) == {"value"}:
        return _value_key(found["value"])
    fields: dict[str, Any] = {key: _entry(entry) for key, entry in found.items()}
    return create_model(f"Boundary{condition.__name__}", __base__=Table, **fields) | None, None


def _value_key(entry: Parameter) -> tuple:
    kind = _kind(entry)
    if entry.kind == "vector":
        return kind, Vector()
    return (kind | None, None) if entry.default is None else (kind, entry.default)


def _entry(entry: Parameter) -> tuple:
    default = Vector() if entry.default == {} else entry.default
    return _kind(entry), ... if default is None else default


def _kind(entry: Parameter) -> Any:
    number = Annotated[Number, Field(gt=entry.above, ge=entry.at_least, le=entry.at_most)]
    return {"number": number, "formula": Formula, "vector": Vector}[entry.kind]


class Tie(Table):
    """Two surfaces whose nodes lie opposite each other and have components of u in common."""

    first: Tag
    second: Tag
    components: Axes = ()

    def axes(self, dim: int) -> tuple[int, ...]:
        """Return the numbers of the components, all of them where none is named."""
        return tuple(map("xyz".index, self.components)) or tuple(range(dim))


class BodyForce(Table):
    """Acceleration b [m/s^2] that acts on each phase, times its partial density."""

    solid: Vector = Vector()
    fluid: Vector = Vector()


class RegionalForce(BodyForce):
    """The same on some regions, or on "all"; several on one region add up."""

    on: Tags


def _form(value):
    """Return how body forces are given."""
    return "list" if isinstance(value, (list, tuple)) else "table"


BodyForces = Annotated[
    Annotated[BodyForce, pydantic.Tag("table")]
    | Annotated[tuple[RegionalForce, ...], ListOf(shortest=1), pydantic.Tag("list")],
    Discriminator(_form),
]


STRESSES = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}


WEIGHT = "weight"  # instead of a formula: what stands above


def _weight_or_formula(value: Any, info: ValidationInfo) -> Any:
    return value if value == WEIGHT else expression(value, info)


VerticalStress = Annotated[
    Any,
    PlainValidator(_weight_or_formula),
    PlainSerializer(lambda given: getattr(given, "source", given)),
]


class InitialStress(Table):
    """Effective stress that is there without strain [Pa], tension positive: its components, or the
    vertical one, a formula or that of the weight above, with k0 times that across.
    """

    xx: Formula | None = None
    yy: Formula | None = None
    zz: Formula | None = None
    xy: Formula | None = None
    xz: Formula | None = None
    yz: Formula | None = None
    vertical: VerticalStress | None = None
    k0: Annotated[Number, Field(ge=0)] | None = None

    @model_validator(mode="after")
    def _one_way(self):
        given = next((name for name in STRESSES if getattr(self, name) is not None), None)
        if given and (self.vertical or self.k0 is not None):
            raise wrong("received it beside vertical or k0, expected one of the two ways", given)
        if (self.vertical is None) != (self.k0 is None):
            key = "vertical" if self.vertical is None else "k0"
            raise wrong("received nothing, expected vertical and k0 together", key)
        return self

    def components(self, dim: int) -> dict[tuple[int, int], tuple[float, Expression]]:
        """Return component -> factor and formula of what is given; the last axis of the plane or of
        space is the vertical one.
        """
        if self.vertical is None:
            given = {pair: getattr(self, name) for name, pair in STRESSES.items()}
            return {pair: (1.0, entry) for pair, entry in given.items() if entry is not None}
        assert self.k0 is not None  # by `_one_way`
        factors = {i: self.k0 if i != dim - 1 else 1.0 for i in range(3)}
        return {(i, i): (factor, self.vertical) for i, factor in factors.items()}


class Initial(Table):
    """State at t = 0: displacement [m], velocities [m/s] and pressure [Pa]; zero where absent."""

    displacement: Vector = Vector()
    solid_velocity: Vector = Vector()
    fluid_velocity: Vector = Vector()
    pressure: Formula | None = None
    stress: InitialStress = InitialStress()


def check_boundaries(boundaries: Sequence[Boundary], brinkman: bool, porous: bool) -> None:
    """Refuse a quantity prescribed twice on a tag, or beside one that excludes it.

    Without porous materials the phase behind a surface decides what excludes what; see
    `simulation.sides`.
    """
    taken: dict[tuple[str, str], int] = {}
    for i, boundary in enumerate(boundaries):
        if boundary.no_slip and not brinkman:
            raise wrong(
                "received true, expected false without model.viscosity = true (Darcy)",
                f"boundary.{i}.no_slip",
            )
        if porous:
            _require_porous(boundary, f"boundary.{i}")
        for tag in boundary.on:
            for quantity in boundary.given():
                for other in (quantity, *(excluded_by(quantity, "porous") if porous else ())):
                    if (tag, other) in taken:
                        first = f"boundary.{taken[tag, other]}.{other}"
                        text = (
                            f"tag '{tag}' has {first} already, which excludes {quantity}; remove"
                            " one of the two"
                        )
                        raise wrong(text, f"boundary.{i}.{quantity}")
                taken[tag, quantity] = i


def _require_porous(boundary: Boundary, key: str) -> None:
    """Refuse a condition that no surface of a porous medium has."""
    if boundary.inflow is not None:
        raise wrong(
            "received one with porous materials, expected a surface of a free fluid; prescribe a"
            " flux",
            f"{key}.inflow",
        )
    for name in boundary.surface_conditions():
        condition: type[SurfaceCondition] = CONDITIONS[name]
        if "porous" not in condition.behind:
            raise wrong(
                f"received one with porous materials, expected a surface of a {named(condition)};"
                f" {condition.otherwise}",
                f"{key}.{name}",
            )


def named(condition: type[SurfaceCondition]) -> str:
    """Return what may be behind a condition, in words."""
    words = {"porous": "porous medium", "solid": "solid", "fluid": "free fluid"}
    return " or ".join(words[kind] for kind in condition.behind)


def excluded_by(quantity: str, kind: Kind) -> list[str]:
    """Return what may not stand beside a quantity, such as 'displacement.x', on a surface of a
    kind of material; itself not included.
    """
    return [
        other
        for pair in _exclusions(kind)
        for one, other in (pair, pair[::-1])
        if one == quantity and other != quantity
    ]


def _exclusions(kind: Kind) -> Iterator[tuple[str, str]]:
    """Yield the pairs of quantities that exclude each other."""
    for axis in "xyz":
        yield "normal_displacement", f"displacement.{axis}"
        yield "normal_displacement", f"equal_displacement.{axis}"
        yield f"equal_displacement.{axis}", f"displacement.{axis}"
    if kind == "porous":
        yield from ((f"velocity.{c}", "no_slip") for c in "xyz")
        yield "pressure", "no_slip"
    if kind == "fluid":
        yield from (("inflow", f"{name}.{c}") for name in ("velocity", "traction") for c in "xyz")
    condition: type[SurfaceCondition]
    for name, condition in CONDITIONS.items():
        vector = "value" in (found := parameters(condition)) and found["value"].kind == "vector"
        for other in condition.excludes.get(kind, ()):
            if not _has_components(other):
                yield name, other
            elif vector:
                yield from ((f"{name}.{c}", f"{other}.{c}") for c in "xyz")
            else:
                yield from ((name, f"{other}.{c}") for c in "xyz")


def _has_components(quantity):
    if quantity in CONDITIONS:
        only = parameters(CONDITIONS[quantity]).get("value")
        return only is not None and only.kind == "vector"
    return quantity in VECTORS


def check_axes(axes: Sequence[str], dim: int, key: str) -> None:
    """Refuse the axis z in two dimensions."""
    if dim == 2 and "z" in axes:
        raise wrong("received 'z' in a two-dimensional scene, expected only 'x' and 'y'", key)


def check_expressions(section: Table, dim: int, key: str, position_only: bool = False) -> None:
    """Refuse components and variables beyond the dimension, and t where only the position is known;
    tell each its key.
    """
    for name in type(section).model_fields:
        value = getattr(section, name)
        if isinstance(value, Vector):
            if dim == 2 and value.z is not None:
                raise wrong(
                    "received a component in a two-dimensional scene, expected only x and y",
                    f"{key}.{name}.z",
                )
            check_expressions(value, dim, f"{key}.{name}", position_only)
        elif isinstance(value, CellArray):
            value._key = f"{key}.{type(section).model_fields[name].alias or name}"
        elif isinstance(value, Table):
            check_expressions(value, dim, f"{key}.{name}", position_only)
        elif hasattr(value, "names"):
            name = type(section).model_fields[name].alias or name
            value.key = f"{key}.{name}"
            if dim == 2 and "z" in value.names:
                raise wrong(
                    f"received {shown(value.source)} in a two-dimensional scene, expected no z",
                    f"{key}.{name}",
                )
            if (
                position_only and value.depends_on_time and value.function is None
            ):  # a function gets t = 0
                raise wrong(
                    f"received {shown(value.source)}, expected a function of position only",
                    f"{key}.{name}",
                )
