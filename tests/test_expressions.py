"""Expressions: values on many points, what is refused, tables over time."""

import numpy as np
import pytest

from porofsi_petsc.config import Expression
from porofsi_petsc.errors import InputError

X = np.array([[0.0, 1.0], [2.0, 3.0], [4.0, -5.0]])


@pytest.mark.parametrize(
    "text, expected",
    [
        ("3", [3, 3, 3]),
        ("-2e-1", [-0.2, -0.2, -0.2]),
        ("x + 2*y", [2, 8, -6]),
        ("where((x > 1) & (y < 0), 1, -1)", [-1, -1, 1]),
        ("where(~(x > 1) | (y < 0), t, 0)", [0.5, 0, 0.5]),
        ("maximum(x, abs(y))", [1, 3, 5]),
        ("heaviside(t - 0.5)*exp(0)", [1, 1, 1]),
        ("2**-1 + erf(0)", [0.5, 0.5, 0.5]),
        ("sin(pi*t) + log(e)", [2, 2, 2]),
        ("where(x > 0, 1/x, 0)", [0, 0.5, 0.25]),
    ],
)
def test_values(text, expected):
    values = Expression(text)(0.5, X)
    assert values.shape == (3,) and values.dtype == float
    assert values == pytest.approx(expected, abs=1e-15)


def test_number_is_constant_and_formula_tells_what_it_depends_on():
    assert Expression(2).is_constant and Expression("pi/2").is_constant
    assert Expression("x").is_constant is False and Expression("x").depends_on_time is False
    assert Expression("t*y").depends_on_time and Expression("t*y").names == {"t", "y"}


def test_result_does_not_alias_the_points():
    values = Expression("x")(0.0, X)
    values[:] = 7
    assert X[1, 0] == 2


def test_no_points_give_no_values():
    assert Expression("x*t")(1.0, np.empty((0, 2))).shape == (0,)


@pytest.mark.parametrize(
    "value, fragment",
    [
        (True, "expected a number"),
        ([1], "expected a number"),
        ("", "expected one"),
        ("1; 2", "expected one"),
        ("1 +", "not a formula"),
        ("q + 1", "unknown name 'q'"),
        ("sin", "unknown name 'sin'"),
        ("foo(x)", "unknown function 'foo'"),
        ("sin(x, x)", "received 2 arguments, expected 1"),
        ("where(x > 0)", "received 1 arguments, expected 3"),
        ("x ^ 2", "write ** for a power"),
        ("t < 1 and x < 1", "write & and |"),
        ("0 < x < 1", "chain of comparisons"),
        ("1 if t < 1 else 0", "write where"),
        ("t < 1", "true/false"),
        ("'abc'", "expected a number"),
        ("x.__class__", "Attribute is not allowed"),
        ("[x for x in y]", "is not allowed"),
        ("(lambda: 1)()", "unknown function"),
        ("__import__('os')", "unknown function"),
        ("x = 3", "is not allowed"),
        ("1/0", "expected a finite number"),
        ("9**9**9**9", "expected a finite number"),
        ("+".join(["x"] * 1100), "at most 2000"),
        ("+".join(["x"] * 300), "terms, expected at most 400"),
        ("-" * 1999 + "x", "terms, expected at most 400"),
        (float("nan"), "expected a finite number"),
        ({"tabel": "a.csv"}, "table = "),
        ({"table": "nowhere.csv"}, "No such file"),
    ],
)
def test_refusals(value, fragment):
    with pytest.raises(InputError, match=".*") as caught:
        Expression(value)
    assert fragment in str(caught.value)


def test_non_finite_value_names_time_and_point():
    with pytest.raises(InputError, match=r"'1/x': received inf at t = 2 s, point \(0, 1\)"):
        Expression("1/x")(2.0, X)


def test_variable_beyond_the_dimension():
    with pytest.raises(InputError, match="'z' is not defined"):
        Expression("z")(0.0, X)


def test_table_interpolates_and_stays_constant_beyond_its_ends(tmp_path):
    (tmp_path / "load.csv").write_text("# test\nt, force, other\n0, 0, 5\n1, 10, 5\n3, 20, 6\n")
    table = Expression({"table": "load.csv"}, tmp_path)
    assert [table(t, X[:1])[0] for t in (-1, 0.5, 2, 9)] == [0, 5, 15, 20]
    assert table.depends_on_time and not table.is_constant
    assert Expression({"table": "load.csv", "column": "other"}, tmp_path)(3.0, X).tolist() == [6, 6, 6]
    assert Expression(table.source) == table


@pytest.mark.parametrize(
    "content, entry, fragment",
    [
        ("t,a\n0,1\n0,2\n", {}, "strictly increasing"),
        ("t,a\n", {}, "at least one row"),
        ("t,a\n0,b\n", {}, "expected numbers in column 2"),
        ("t,a\n0\n", {}, "expected numbers in column 2"),
        ("t,a\n0,1\n", {"column": "b"}, "no column 'b'; choose from a"),
        ("0,1\n", {"column": "b"}, "it has no header"),
    ],
)
def test_wrong_tables(tmp_path, content, entry, fragment):
    (tmp_path / "a.csv").write_text(content)
    with pytest.raises(InputError) as caught:
        Expression({"table": "a.csv", **entry}, tmp_path)
    assert fragment in str(caught.value)
