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

from ..errors import InputError
from .expressions import Expression


def wrong(text, key=""):
    """Return the error of one entry; key is the dotted path below the table being validated."""
    return PydanticCustomError("wrong", "{text}", {"text": text, "key": key})


def closest(word, known):
    """Return '; did you mean …' or the full choice, to end a sentence about an unknown word."""
    match = [name for name in known if word and name.startswith(word)] or difflib.get_close_matches(word, known, n=1)
    return f"did you mean '{match[0]}'?" if match else f"choose from {', '.join(known)}"


class Table(BaseModel):
    """A frozen table of a scene that refuses keys it does not know."""

    model_config = ConfigDict(extra="forbid", frozen=True, arbitrary_types_allowed=True, populate_by_name=False)

    @model_validator(mode="before")
    @classmethod
    def _know_every_key(cls, data):
        if isinstance(data, dict):
            known = [field.alias or name for name, field in cls.model_fields.items()]
            for key in data:
                if key not in known:
                    raise wrong(f"unknown key '{key}'; {closest(str(key), known)}", str(key))
        return data


def _listed(value):
    return tuple(value) if isinstance(value, list) else value


def _one_or_many(value):
    return (value,) if isinstance(value, str) else value


def _distinct(names):
    repeated = [name for i, name in enumerate(names) if name in names[:i]]
    if repeated:
        raise wrong(f"received '{repeated[0]}' twice, expected distinct names")
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
        if value == word or (isinstance(value, (int, float)) and not isinstance(value, bool) and 0 < value < float("inf")):
            return value if value == word else float(value)
        raise wrong(f"received {value!r}, expected a positive number or '{word}'")

    return check


def _switch(value):
    if value == "auto" or isinstance(value, bool):
        return value
    raise wrong(f"received {value!r}, expected true, false or 'auto'")


def list_of(kind, shortest=0, longest=None):
    """Return the type of a list with entries of one kind, kept as a tuple."""

    def check_length(entries):
        if len(entries) < shortest or (longest and len(entries) > longest):
            expected = f"{shortest} to {longest}" if longest else f"at least {shortest}"
            raise wrong(f"received a list of length {len(entries)}, expected {expected}")
        return entries

    return Annotated[tuple[kind, ...], BeforeValidator(_listed), AfterValidator(check_length)]


Number = Annotated[float, Strict(), Field(allow_inf_nan=False)]
Positive = Annotated[Number, Field(gt=0)]
Flag = Annotated[bool, Strict()]
Count = Annotated[int, Strict(), Field(ge=1)]
Text = Annotated[str, Strict()]
Name = Annotated[str, Strict(), Field(pattern=r"^[A-Za-z_][A-Za-z0-9_\-]*$")]
Tag = Annotated[str, Strict(), Field(min_length=1)]
Tags = Annotated[list_of(Tag, shortest=1), BeforeValidator(_one_or_many), AfterValidator(_distinct)]
Interval = Annotated[tuple[Number, Number], BeforeValidator(_listed)]
Limit = Annotated[Any, PlainValidator(_positive_or("report"))]
Scaling = Annotated[Any, PlainValidator(_positive_or("optimal"))]
Coefficient = Annotated[Any, PlainValidator(_positive_or("auto"))]
Switch = Annotated[Any, PlainValidator(_switch)]
Formula = Annotated[Expression, PlainValidator(_expression), PlainSerializer(lambda expression: expression.source)]


class Vector(Table):
    """Components of a vector as expressions; a component that is absent is not prescribed."""

    x: Formula | None = None
    y: Formula | None = None
    z: Formula | None = None

    def components(self, dim):
        """Return the first dim components, each an Expression or None."""
        return (self.x, self.y, self.z)[:dim]
