"""The strict table every section of a scene derives from, and the types of its entries."""

import difflib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, get_args

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    PlainSerializer,
    PlainValidator,
    Strict,
    ValidationInfo,
    model_validator,
)
from pydantic_core import PydanticCustomError, core_schema

from ..errors import InputError, listed, shown
from .expressions import Expression
from .numbers import RANGE, in_range

MOST = 2**31 - 1  # of what is counted: the integers of PETSc's usual builds
LONGEST_NAME = 100


def wrong(text: str, key: str = "") -> PydanticCustomError:
    """Return the error of one entry; key is the dotted path below the table being validated."""
    return PydanticCustomError("wrong", "{text}", {"text": text, "key": key})


def similar(word: str, known: Sequence[str]) -> str | None:
    """Return the known word that an unknown one may stand for, None where there is none."""
    word = word[:LONGEST_NAME]
    match = [name for name in known if word and name.startswith(word)] or difflib.get_close_matches(
        word, known, n=1
    )
    return match[0] if match else None


def closest(word: str, known: Sequence[str]) -> str:
    """Return 'did you mean …?' or the full choice, to end a sentence about an unknown word."""
    match = similar(word, known)
    return f"did you mean '{match}'?" if match else f"choose from {listed(known)}"


class Table(BaseModel):
    """A frozen table of a scene that refuses keys it does not know."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, arbitrary_types_allowed=True, populate_by_name=False
    )

    @model_validator(mode="before")
    @classmethod
    def _know_every_key(cls, data: Any) -> Any:
        if isinstance(data, dict):
            known = [field.alias or name for name, field in cls.model_fields.items()]
            for key in data:
                if key not in known:
                    raise wrong(f"unknown key {shown(key)}; {closest(str(key), known)}", str(key))
        return data


def _listed(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


def _several_tables(value: Any) -> Any:
    if isinstance(value, dict):
        raise wrong(
            "received one table, expected a list of them; write the name in two pairs of brackets,"
            " [[…]]"
        )
    return _listed(value)


def _one_or_many(value: Any) -> Any:
    return (value,) if isinstance(value, str) else value


def _one_line(text: str) -> str:
    if not text.isprintable():
        raise wrong(f"received {shown(text)}, expected a name of characters that can be printed")
    return text


def distinct(names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names; raise where one is there twice."""
    repeated = [name for i, name in enumerate(names) if name in names[:i]]
    if repeated:
        raise wrong(f"received {shown(repeated[0])} twice, expected distinct names")
    return names


def expression(value: Any, info: ValidationInfo) -> Expression:
    """Return the `Expression` of an entry."""
    if isinstance(value, Expression):
        return value
    try:
        return Expression(value, (info.context or {}).get("folder"))
    except InputError as error:
        raise wrong(str(error)) from None


def _positive_or(word: str) -> Callable[[Any], Any]:
    """Return the check of a positive number or one word."""

    def check(value: Any) -> Any:
        if value == word:
            return value
        if isinstance(value, (int, float)) and not isinstance(value, bool) and value > 0:
            return float(_in_range(value))
        raise wrong(f"received {shown(value)}, expected a positive number or '{word}'")

    return check


def _in_range(value: float) -> float:
    if not in_range(value):
        raise wrong(f"received {shown(value)}, expected 0 or {RANGE}")
    return value


class OneOf:
    """The annotation of a name: one of some words, or of what a registry or a table has when a
    scene is read.
    """

    def __init__(self, registry: Mapping[str, Any], *words: str) -> None:
        """Take the registry and the words."""
        self._registry = registry
        self._words = words

    @property
    def names(self) -> tuple[str, ...]:
        """Return what may be chosen now."""
        return (*self._words, *self._registry)

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        """Return the schema of the name."""
        return core_schema.no_info_after_validator_function(self._check, handler(source))

    def _check(self, name: str) -> str:
        if name not in self.names:
            raise wrong(f"received {shown(name)}, expected one of {listed(self.names)}")
        return name


def _switch(value: Any) -> Any:
    if value == "auto" or isinstance(value, bool):
        return value
    raise wrong(f"received {shown(value)}, expected true, false or 'auto'")


@dataclass(frozen=True)
class ListOf:
    """The annotation of a tuple that is written as a list, of some length."""

    shortest: int = 0
    longest: int | None = None

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        """Return the schema of the tuple that takes a list and looks at its length."""
        entry = get_args(source)[0]
        entry = getattr(entry, "__origin__", entry)  # without what is annotated
        of_tables = isinstance(entry, type) and issubclass(entry, Table)
        before = _several_tables if of_tables else _listed
        entries = core_schema.no_info_before_validator_function(before, handler(source))
        return core_schema.no_info_after_validator_function(self._check, entries)

    def _check(self, entries: tuple) -> tuple:
        if len(entries) < self.shortest or (self.longest and len(entries) > self.longest):
            most = f"{self.shortest}"
            if self.longest != self.shortest:
                most = f"{self.shortest} to {self.longest}"
            expected = most if self.longest else f"at least {self.shortest}"
            raise wrong(f"received a list of length {len(entries)}, expected {expected}")
        return entries


Number = Annotated[float, Strict(), Field(allow_inf_nan=False), AfterValidator(_in_range)]
Positive = Annotated[Number, Field(gt=0)]
Flag = Annotated[bool, Strict()]
Count = Annotated[int, Strict(), Field(ge=1, le=MOST)]
Text = Annotated[str, Strict()]
Name = Annotated[
    str, Strict(), Field(pattern=r"^[A-Za-z_][A-Za-z0-9_\-]*$", max_length=LONGEST_NAME)
]
Tag = Annotated[
    str, Strict(), Field(min_length=1, max_length=LONGEST_NAME), AfterValidator(_one_line)
]
Tags = Annotated[
    tuple[Tag, ...], ListOf(shortest=1), BeforeValidator(_one_or_many), AfterValidator(distinct)
]
Axes = Annotated[
    tuple[Literal["x", "y", "z"], ...],
    ListOf(),
    BeforeValidator(_one_or_many),
    AfterValidator(distinct),
]
Interval = Annotated[tuple[Number, Number], BeforeValidator(_listed)]
Limit = Annotated[Any, PlainValidator(_positive_or("report"))]
Scaling = Annotated[Any, PlainValidator(_positive_or("optimal"))]
Coefficient = Annotated[Any, PlainValidator(_positive_or("auto"))]
Switch = Annotated[Any, PlainValidator(_switch)]
Formula = Annotated[
    Expression, PlainValidator(expression), PlainSerializer(lambda expression: expression.source)
]


class Vector(Table):
    """Components of a vector as expressions; a component that is absent is not prescribed."""

    x: Formula | None = None
    y: Formula | None = None
    z: Formula | None = None

    def components(self, dim: int) -> tuple[Expression | None, ...]:
        """Return the first dim components, each an Expression or None."""
        return (self.x, self.y, self.z)[:dim]
