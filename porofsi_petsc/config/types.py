"""The strict table every section of a scene derives from, and the types of its entries."""

import difflib
from typing import Annotated, Any

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainSerializer,
    PlainValidator,
    Strict,
    ValidationInfo,
    model_validator,
)
from pydantic_core import PydanticCustomError

from ..errors import InputError, listed, shown
from .expressions import Expression
from .numbers import RANGE, in_range

MOST = 2**31 - 1  # of what is counted: the integers of PETSc's usual builds
LONGEST_NAME = 100


def wrong(text, key=""):
    """Return the error of one entry; key is the dotted path below the table being validated."""
    return PydanticCustomError("wrong", "{text}", {"text": text, "key": key})


def similar(word, known):
    """Return the known word that an unknown one may stand for, None where there is none."""
    word = word[:LONGEST_NAME]
    match = [name for name in known if word and name.startswith(word)] or difflib.get_close_matches(
        word, known, n=1
    )
    return match[0] if match else None


def closest(word, known):
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
    def _know_every_key(cls, data):
        if isinstance(data, dict):
            known = [field.alias or name for name, field in cls.model_fields.items()]
            for key in data:
                if key not in known:
                    raise wrong(f"unknown key {shown(key)}; {closest(str(key), known)}", str(key))
        return data


def _listed(value):
    return tuple(value) if isinstance(value, list) else value


def _one_or_many(value):
    return (value,) if isinstance(value, str) else value


def _one_line(text):
    if not text.isprintable():
        raise wrong(f"received {shown(text)}, expected a name of characters that can be printed")
    return text


def _distinct(names):
    repeated = [name for i, name in enumerate(names) if name in names[:i]]
    if repeated:
        raise wrong(f"received {shown(repeated[0])} twice, expected distinct names")
    return names


def _expression(value, info: ValidationInfo):
    if isinstance(value, Expression):
        return value
    try:
        return Expression(value, (info.context or {}).get("folder"))
    except InputError as error:
        raise wrong(str(error)) from None


def _positive_or(word):
    """Return the check of a positive number or one word."""

    def check(value):
        if value == word:
            return value
        if isinstance(value, (int, float)) and not isinstance(value, bool) and value > 0:
            return float(_in_range(value))
        raise wrong(f"received {shown(value)}, expected a positive number or '{word}'")

    return check


def _in_range(value):
    if not in_range(value):
        raise wrong(f"received {shown(value)}, expected 0 or {RANGE}")
    return value


def _switch(value):
    if value == "auto" or isinstance(value, bool):
        return value
    raise wrong(f"received {shown(value)}, expected true, false or 'auto'")


def list_of(kind, shortest=0, longest=None):
    """Return the type of a list with entries of one kind, kept as a tuple."""

    def check_length(entries):
        if len(entries) < shortest or (longest and len(entries) > longest):
            expected = f"{shortest} to {longest}" if longest else f"at least {shortest}"
            raise wrong(f"received a list of length {len(entries)}, expected {expected}")
        return entries

    return Annotated[tuple[kind, ...], BeforeValidator(_listed), AfterValidator(check_length)]


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
Tags = Annotated[list_of(Tag, shortest=1), BeforeValidator(_one_or_many), AfterValidator(_distinct)]
Interval = Annotated[tuple[Number, Number], BeforeValidator(_listed)]
Limit = Annotated[Any, PlainValidator(_positive_or("report"))]
Scaling = Annotated[Any, PlainValidator(_positive_or("optimal"))]
Coefficient = Annotated[Any, PlainValidator(_positive_or("auto"))]
Switch = Annotated[Any, PlainValidator(_switch)]
Formula = Annotated[
    Expression, PlainValidator(_expression), PlainSerializer(lambda expression: expression.source)
]


class Vector(Table):
    """Components of a vector as expressions; a component that is absent is not prescribed."""

    x: Formula | None = None
    y: Formula | None = None
    z: Formula | None = None

    def components(self, dim):
        """Return the first dim components, each an Expression or None."""
        return (self.x, self.y, self.z)[:dim]
