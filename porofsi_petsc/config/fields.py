"""Coefficients of a material: a number, a formula or table of position, or an array of the mesh
file.
"""

from collections.abc import Mapping
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import (
    Field,
    PlainSerializer,
    PrivateAttr,
    ValidationInfo,
    ValidatorFunctionWrapHandler,
    WrapValidator,
)

from ..errors import InputError, digits
from .expressions import Expression
from .types import Number, Positive, Table, Text, expression


class CellArray(Table):
    """An array over the cells of the mesh file, in which it has the name `cell`, times a factor."""

    cell: Text
    factor: Number = 1.0

    _key: str = PrivateAttr("")

    @property
    def place(self) -> str:
        """Return the key of the scene that holds it, to begin a sentence with."""
        return f"[{self._key}]: " if self._key else ""


class Cells(NamedTuple):
    """The centres X (n, d) [m] of cells and the arrays of a mesh file over them, name -> (n,)."""

    X: np.ndarray
    values: Mapping[str, np.ndarray]

    @classmethod
    def none(cls) -> "Cells":
        """Return no cells, for which every number is itself."""
        return cls(np.zeros((0, 1)), {})


FIELD = Expression, CellArray
Entry = float | Expression | CellArray


def _or_formula(value: Any, number: ValidatorFunctionWrapHandler, info: ValidationInfo) -> Entry:
    """Return a number that is one, a `CellArray` of a table with `cell`, else an `Expression`; a
    formula without x, y, z is a number.
    """
    if isinstance(value, CellArray) or (isinstance(value, dict) and "cell" in value):
        return CellArray.model_validate(value)
    if not isinstance(value, str | dict | Expression) and not callable(value):
        return number(value)
    found = expression(value, info)
    return number(float(found(0.0, np.zeros((1, 3)))[0])) if found.is_constant else found


def _source(value: Any) -> Any:
    if isinstance(value, CellArray):
        return value.model_dump(exclude_defaults=True)
    return value.source if isinstance(value, Expression) else value


OR_FORMULA = WrapValidator(_or_formula)
AS_GIVEN = PlainSerializer(_source)
NumberField = Annotated[Number, OR_FORMULA, AS_GIVEN]
PositiveField = Annotated[Positive, OR_FORMULA, AS_GIVEN]
PoissonField = Annotated[Number, Field(gt=-1, lt=0.5), OR_FORMULA, AS_GIVEN]


def values(given: Any, cells: Cells) -> Any:
    """Return a number as it is, and what a formula or an array of the mesh file gives in cells, (n,
    1).
    """
    if isinstance(given, CellArray):
        return given.factor * cells.values[given.cell][:, None]
    return given(0.0, cells.X)[:, None] if isinstance(given, Expression) else given


def require_within(
    given: Any,
    found: Any,
    cells: Cells,
    above: float = -np.inf,
    at_least: float = -np.inf,
    below: float = np.inf,
) -> None:
    """Raise InputError where values (n, 1) of a field in cells are out of bounds."""
    if isinstance(given, FIELD):
        words = [
            f"{sign} {bound:g}"
            for sign, bound in ((">", above), (">=", at_least), ("<", below))
            if np.isfinite(bound)
        ]
        admissible = (found > above) & (found >= at_least) & (found < below)
        require(admissible, found, f"a number {' and '.join(words)}", given.place, cells)


def require(
    admissible: np.ndarray, found: np.ndarray, expected: str, place: str, cells: Cells
) -> None:
    """Raise InputError in the first of some cells where the values found (n, 1) are not
    admissible (n, 1).
    """
    if not admissible.all():
        first = int(np.argmin(admissible[:, 0]))
        where = ", ".join(map(digits, cells.X[first]))
        raise InputError(
            f"{place}received {digits(found[first, 0])} at the point ({where}), expected {expected}"
        )
