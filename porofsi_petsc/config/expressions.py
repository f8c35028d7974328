"""Numbers, formulas of t, x, y, z and tables over time, checked when a scene is loaded and
evaluated on many points at once.
"""

import ast
import math
import os
import sys
from collections.abc import Callable
from numbers import Real
from typing import Any

import numpy as np
import simpleeval

from ..errors import InputError, digits, shown
from .numbers import LARGEST, RANGE, SMALLEST, in_range
from .tables import table

MAX_LENGTH = 2000
MAX_NODES = 400
VARIABLES = ("t", "x", "y", "z")
FUNCTION = "function"  # key of the source of a function of Python
Evaluate = Callable[[float, np.ndarray], Any]  # (t, x) -> values
CONSTANTS = {"pi": np.float64(math.pi), "e": np.float64(math.e)}


def _erf(values: np.ndarray) -> np.ndarray:
    from scipy.special import erf

    return erf(values)


def _heaviside(values: np.ndarray) -> np.ndarray:
    return np.heaviside(values, 1.0)


def _of_numbers(function: Callable) -> Callable:
    """Return the function of numbers, true 1 and false 0; NumPy adds truth values by "or" and takes
    their sine in 16 bits.
    """

    def evaluate(*values: Any) -> Any:
        return function(*(np.asarray(value, dtype=float) for value in values))

    return evaluate


# name: (function of numbers, number of arguments); heaviside(0) = 1, so a load switched on at t = 0
# acts at t = 0.
FUNCTIONS: dict[str, tuple[Callable, int]] = {
    "sin": (np.sin, 1),
    "cos": (np.cos, 1),
    "tan": (np.tan, 1),
    "exp": (np.exp, 1),
    "log": (np.log, 1),
    "sqrt": (np.sqrt, 1),
    "abs": (np.abs, 1),
    "sinh": (np.sinh, 1),
    "cosh": (np.cosh, 1),
    "tanh": (np.tanh, 1),
    "erf": (_erf, 1),
    "heaviside": (_heaviside, 1),
    "minimum": (np.minimum, 2),
    "maximum": (np.maximum, 2),
    "where": (np.where, 3),
}
ARITHMETIC: dict[type[ast.AST], Callable] = {
    ast.Add: np.add,
    ast.Sub: np.subtract,
    ast.Mult: np.multiply,
    ast.Div: np.divide,
    ast.Mod: np.mod,
    ast.Pow: np.float_power,
    ast.USub: np.negative,
    ast.UAdd: np.positive,
}
COMPARISONS: dict[type[ast.AST], Callable] = {
    ast.Lt: np.less,
    ast.LtE: np.less_equal,
    ast.Gt: np.greater,
    ast.GtE: np.greater_equal,
    ast.Eq: np.equal,
    ast.NotEq: np.not_equal,
}
LOGIC: dict[type[ast.AST], Callable] = {
    ast.BitAnd: np.logical_and,
    ast.BitOr: np.logical_or,
    ast.Invert: np.logical_not,
}
OPERATORS = {
    kind: _of_numbers(function) for kind, function in (ARITHMETIC | COMPARISONS).items()
} | LOGIC
HINTS = {
    ast.BitXor: "write ** for a power",
    ast.BoolOp: "write & and | with each comparison in parentheses",
    ast.Not: "write ~( ) for a negation",
    ast.IfExp: "write where(condition, a, b)",
}
SYMBOLS = {ast.BitAnd: "&", ast.BitOr: "|", ast.Invert: "~"}
SYNTAX = (
    ast.Expr,
    ast.BinOp,
    ast.UnaryOp,
    ast.Compare,
    ast.Call,
    ast.Name,
    ast.Constant,
    ast.Load,
    *OPERATORS,
)


class Expression:
    """A scalar function of time and position.

    value : a number; a formula such as "1e5*sin(25*pi*t)" (names t x y z pi e, the functions of
        `FUNCTIONS`, comparisons, which count as 1 and 0 where a number is wanted, and & | ~ between
        comparisons); {"table": "load.csv", "column": "force"}: linear between the rows, constant
        beyond the ends, the first column is t, the column defaults to the second, and with "over":
        ["t", "y"] the first columns are these coordinates; or a function of Python, (t, X) ->
        values, for t [s] and points X (n, d) [m], n may be 0: an array (n,) or one number.
    folder : where a relative table path starts.
    content : hash of the numbers of a table, None for what is not one.
    Raises InputError when the value is none of these, or the formula fails in a trial at one point.
    """

    def __init__(
        self,
        value: float | str | dict[str, str] | Callable,
        folder: str | os.PathLike[str] | None = None,
    ) -> None:
        self.names: frozenset[str] = frozenset()
        self.content: str | None = None
        self.key: str | None = None
        self.function: Callable | None = None
        self.source: float | str | dict[str, str]
        self._evaluate: Evaluate
        if isinstance(value, dict) and FUNCTION in value:
            advice = "give it to load_scene in Python, in a table of the scene"
            raise InputError(
                f"received the function {shown(value[FUNCTION])} of Python, which no file can hold;"
                f" {advice}"
            )
        if isinstance(value, dict):
            self.source, self.content, self.names, self._evaluate = table(value, folder)
        elif callable(value):
            self.function = value
            self._evaluate = _called(value)
            self.source = {FUNCTION: _name_of(value)}
            self.names = frozenset(VARIABLES[:3])  # z too where there is one
        elif isinstance(value, str):
            self.source = value
            self.names, self._evaluate = _formula(value)
        elif isinstance(value, Real) and not isinstance(value, bool):
            self.source = number = self._number(value)
            self._evaluate = lambda t, x: np.float64(number)
        else:
            raise InputError(
                f"received {shown(value)}, expected a number, a formula in quotes or {{ table ="
                ' "file.csv" }'
            )
        if self.is_constant:
            self._number(float(self(0.0, np.zeros((1, 3)))[0]))

    @staticmethod
    def _number(value: float) -> float:
        if not in_range(
            value
        ):  # before float, which overflows for a whole number of 309 digits; so is NaN
            raise InputError(f"received {shown(value)}, expected a finite number, 0 or {RANGE}")
        return float(value)

    @property
    def is_constant(self) -> bool:
        """Tell whether the value depends on neither time nor position."""
        return not self.names

    @property
    def depends_on_time(self) -> bool:
        """Tell whether the value changes with time."""
        return "t" in self.names

    def __call__(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return the values, (n,), at time t [s] and points x, (n, d) [m]; raise InputError where
        one is not finite or huge.
        """
        values = np.empty(len(x))
        try:
            values[:] = self._evaluate(t, x)
        except InputError as error:
            raise InputError(f"{self.place}{error}") from None
        usable = np.abs(values) <= LARGEST  # NaN is not
        if not usable.all():
            first = int(np.argmin(usable))
            where = (
                ""
                if self.is_constant
                else f" at t = {digits(t)} s, point ({', '.join(map(digits, x[first]))})"
            )
            received = (
                f"{self.place}expression {shown(self.source)}: received {values[first]:g}{where}"
            )
            raise InputError(f"{received}, expected a finite number of at most {LARGEST:g}")
        if not self.is_constant:  # else refused where it is made
            # the norm of such a load vanishes, which is not zero
            values[np.abs(values) < SMALLEST] = 0.0
        return values

    @property
    def place(self) -> str:
        """Return the key of the scene that holds the expression, to begin a sentence with; empty
        where it is not known.
        """
        return f"[{self.key}]: " if self.key else ""

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, Expression)
            and self.source == other.source
            and self.function is other.function
        )

    def __hash__(self) -> int:
        return hash(str(self.source))

    def __repr__(self) -> str:
        return f"Expression({self.source!r})"


def _name_of(function: Callable) -> str:
    """Return the name of a function of Python, by which a restart compares it."""
    name = getattr(function, "__qualname__", None) or getattr(function, "__name__", None)
    return f"{getattr(function, '__module__', None) or ''}.{name or type(function).__name__}"


def _called(function: Callable) -> Evaluate:
    """Return the function of (t, x) that gives what a function of Python returns for a copy of x.

    It raises InputError where that is not one real number for each point, or for all.
    """

    def evaluate(t: float, x: np.ndarray) -> Any:
        values = np.ma.filled(np.ma.asarray(function(t, x.copy())), np.nan)
        if values.dtype.kind not in "iuf" or values.shape not in ((), (len(x),)):
            kind = f"values of {values.dtype} of shape {values.shape} for {len(x)} points"
            raise InputError(
                f"function {_name_of(function)}: received {kind}, expected real numbers of shape"
                f" ({len(x)},) or one"
            )
        return values

    return evaluate


def _formula(text: str) -> tuple[frozenset[str], Evaluate]:
    """Return the variables of the formula and a function of (t, x) that evaluates its parsed
    tree.
    """
    tree = _parse(text)
    names = _check(tree, text)
    evaluator = simpleeval.SimpleEval(
        operators=OPERATORS, functions={name: _of_numbers(f) for name, (f, _) in FUNCTIONS.items()}
    )
    evaluator.nodes[ast.Constant] = lambda node: np.float64(node.value)

    def evaluate(t: float, x: np.ndarray) -> Any:
        evaluator.names = (
            CONSTANTS
            | {"t": np.float64(t)}
            | {name: x[:, i] for i, name in enumerate("xyz"[: x.shape[1]])}
        )
        try:
            with np.errstate(all="ignore"):
                return evaluator.eval(text, previously_parsed=tree)
        except (simpleeval.InvalidExpression, TypeError, ValueError, RecursionError) as error:
            raise InputError(f"expression {shown(text)} cannot be evaluated: {error}") from None

    evaluate(0.0, np.full((1, 3), 0.5))
    return names, evaluate


def _parse(text: str) -> ast.stmt:
    if len(text) > MAX_LENGTH:
        raise InputError(
            f"expression of {len(text)} characters, expected at most {MAX_LENGTH}; use a table"
        )
    try:
        body = ast.parse(text.strip()).body
    except SyntaxError as error:
        raise InputError(
            f"expression {shown(text)} is not a formula: {error.msg} at character {error.offset}"
        ) from None
    except (ValueError, RecursionError, MemoryError):
        raise InputError(
            f"expression {shown(text)} is not a formula: too deeply nested or with null characters"
        ) from None
    if len(body) != 1:
        raise InputError(f"expression {shown(text)}: received {len(body)} formulas, expected one")
    return body[0]


def _check(tree: Any, text: str) -> frozenset[str]:
    """Return the variables used; refuse what is no arithmetic on arrays before anything is
    evaluated.
    """
    nodes = list(ast.walk(tree))
    if len(nodes) > MAX_NODES:
        raise InputError(
            f"expression {shown(text)} has {len(nodes)} terms, expected at most {MAX_NODES}; use a"
            " table"
        )
    called = set()
    for node in nodes:
        if not isinstance(node, SYNTAX):
            hint = HINTS.get(type(node), "use + - * / % **, comparisons, & | ~ and functions")
            raise InputError(
                f"expression {shown(text)}: {type(node).__name__} is not allowed; {hint}"
            )
        if isinstance(node, ast.Constant):
            _check_constant(node, text)
        if isinstance(node, ast.Compare) and len(node.ops) > 1:
            raise InputError(
                f"expression {shown(text)}: a chain of comparisons is not allowed; write (a < b) &"
                " (b < c)"
            )
        if isinstance(node, ast.Call):
            called.add(_check_call(node, text))
        _check_logic(node, text)
    if _is_truth(tree.value):
        received = "received a true/false value, expected a number"
        raise InputError(f"expression {shown(text)}: {received}; write where(condition, 1, 0)")
    used = {node.id for node in nodes if isinstance(node, ast.Name) and node not in called}
    unknown = sorted(used - set(VARIABLES) - set(CONSTANTS))
    if unknown:
        choices = ", ".join([*VARIABLES, *CONSTANTS])
        raise InputError(
            f"expression {shown(text)}: unknown name {shown(unknown[0])}; choose from {choices}"
        )
    return frozenset(used & set(VARIABLES))


def _check_constant(node: Any, text: str) -> None:
    if type(node.value) not in (int, float):
        raise InputError(
            f"expression {shown(text)}: received {shown(node.value)}, expected a number"
        )
    if (
        node.value > sys.float_info.max
    ):  # an integer of 309 digits has no double, 1e309 is infinite already
        raise InputError(
            f"expression {shown(text)}: received {shown(node.value)}, expected at most"
            f" {sys.float_info.max:.1e}"
        )


def _check_logic(node: ast.AST, text: str) -> None:
    """Raise InputError where & | ~ stand beside a number: they bind closer than < and >, so that t
    > 1 & x is t > (1 & x).
    """
    operator = type(getattr(node, "op", None))
    operands = {ast.BinOp: ("left", "right"), ast.UnaryOp: ("operand",)}.get(type(node), ())
    if operator in LOGIC and not all(_is_truth(getattr(node, name)) for name in operands):
        advice = "write comparisons in parentheses beside it, such as (a < b) & (b < c)"
        raise InputError(
            f"expression {shown(text)}: received a number beside {SYMBOLS[operator]}; {advice}"
        )


def _is_truth(node: ast.AST) -> bool:
    """Return whether a part of a formula is true or false, not a number."""
    return isinstance(node, ast.Compare) or type(getattr(node, "op", None)) in LOGIC


def _check_call(node: ast.Call, text: str) -> ast.expr:
    name = getattr(node.func, "id", None)
    if name not in FUNCTIONS:
        raise InputError(
            f"expression {shown(text)}: unknown function {shown(name)}; choose from"
            f" {', '.join(FUNCTIONS)}"
        )
    arity = FUNCTIONS[name][1]
    if node.keywords or len(node.args) != arity:
        raise InputError(
            f"expression {shown(text)}: {name} received {len(node.args)} arguments, expected"
            f" {arity}"
        )
    return node.func
