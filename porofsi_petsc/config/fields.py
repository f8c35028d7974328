"""Coefficients of a material: a number, or a formula or table of position."""

from typing import Annotated, Any

import numpy as np
from pydantic import (
    Field,
    PlainSerializer,
    ValidationInfo,
    ValidatorFunctionWrapHandler,
    WrapValidator,
)

from ..errors import InputError, digits
from .expressions import Expression
from .types import Number, Positive, expression

Entry = float | Expression


def _or_formula(value: Any, number: ValidatorFunctionWrapHandler, info: ValidationInfo) -> Entry:
    """Return a number that is one, else an `Expression`; a formula without x, y, z is a number."""
    if not isinstance(value, str | dict | Expression) and not callable(value):
        return number(value)
    found = expression(value, info)
    return number(float(found(0.0, np.zeros((1, 3)))[0])) if found.is_constant else found


def _source(value: Any) -> Any:
    return value.source if isinstance(value, Expression) else value


OR_FORMULA = WrapValidator(_or_formula)
AS_GIVEN = PlainSerializer(_source)
NumberField = Annotated[Number, OR_FORMULA, AS_GIVEN]
PositiveField = Annotated[Positive, OR_FORMULA, AS_GIVEN]
PoissonField = Annotated[Number, Field(gt=-1, lt=0.5), OR_FORMULA, AS_GIVEN]


def values(given: Any, X: np.ndarray) -> Any:
    """Return a number as it is, and what a formula gives at points X (n, d) [m], (n, 1)."""
    return given(0.0, X)[:, None] if isinstance(given, Expression) else given


def require_within(
    given: Any,
    found: Any,
    X: np.ndarray,
    above: float = -np.inf,
    at_least: float = -np.inf,
    below: float = np.inf,
) -> None:
    """Raise InputError where values (n, 1) of a formula at points X (n, d) are out of bounds."""
    if isinstance(given, Expression):
        words = [
            f"{sign} {bound:g}"
            for sign, bound in ((">", above), (">=", at_least), ("<", below))
            if np.isfinite(bound)
        ]
        admissible = (found > above) & (found >= at_least) & (found < below)
        require(admissible, found, f"a number {' and '.join(words)}", given.place, X)


def require(
    admissible: np.ndarray, found: np.ndarray, expected: str, place: str, X: np.ndarray
) -> None:
    """Raise InputError at the first point X (n, d) where the values found (n, 1) are not
    admissible (n, 1).
    """
    if not admissible.all():
        first = int(np.argmin(admissible[:, 0]))
        where = ", ".join(map(digits, X[first]))
        raise InputError(
            f"{place}received {digits(found[first, 0])} at the point ({where}), expected {expected}"
        )
