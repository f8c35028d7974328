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
        # true and false are 1 and 0 wherever a number is wanted, as in Python
        ("(t >= 0) + (t >= 0)", [2, 2, 2]),
        ("(x > 1) - (y > 0)", [-1, 0, 1]),
        ("-(x > 1)", [0, -1, -1]),
        ("(x > 1) * (y > 0)", [0, 1, 0]),
        ("(t >= 0) / 4 + (t >= 0) % 2 + 3**(x > 1)", [2.25, 4.25, 4.25]),
        ("where((x > 1) == (y > 0), 5, 6)", [6, 5, 6]),
        ("where((x > 1) >= (y > 0), 5, 6)", [6, 5, 5]),
        ("where(x, 5, 6)", [6, 5, 5]),
        (
            "sin(t >= 0)",
            [0.8414709848078965] * 3,
        ),  # in double precision: NumPy takes the sine of a truth value in 16 bits
        ("minimum(x > 1, y > 0) + maximum(x > 1, y > 0) + abs(x > 1)", [1, 3, 2]),
        ("where(x > 1, y > 0, t < 1) + 0", [1, 1, 0]),
        ("-7 % 3 + 7 % -3", [0, 0, 0]),  # signs as in Python: 2 and -2
        ("-2**2", [-4, -4, -4]),
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
        ("1" + "0" * 400, "expected at most 1.8e+308"),
        ("1e309 - 1e309", "expected at most 1.8e+308"),
        ("t > 1 & x", "a number beside &"),
        ("where(t > 0 | x, 1, 2)", "a number beside |"),
        ("where(~x, 1, 2)", "a number beside ~"),
        ("(t > 1)*(x > 1) & (y > 1)", "a number beside &"),
        ("(t > 1) & (x > 1)", "true/false"),
        ("7 // 2", "FloorDiv is not allowed"),
        ("x" * 1999, "unknown name 'xxx"),
        (10**400, "a size from 1e-40 to 1e+40"),
        (1e-160, "a size from 1e-40 to 1e+40"),
        ("1e-160", "a size from 1e-40 to 1e+40"),
        ("1e41", "at most 1e+40"),
        ({"tabel": "a.csv"}, "table = "),
        ({"table": "/dev/zero"}, "a device or pipe, expected a file"),
        ({"table": "/"}, "a directory, expected a file"),
        ({"table": "a\x00b"}, "null"),
        ({"table": "a" * 5000}, "cannot be read"),
        ({"table": "nowhere.csv"}, "no such file"),
    ],
)
def test_refusals(value, fragment):
    with pytest.raises(InputError, match=".*") as caught:
        Expression(value)
    assert fragment in str(caught.value)
    assert len(str(caught.value)) < 400 and str(caught.value).isprintable()


@pytest.mark.parametrize(
    "text", ["1/x", "x**0.5 - (x - 1)**0.5", "x % (t - 2)", "log(x)", "exp(1000*t)"]
)
def test_what_is_not_finite_is_never_computed_on(text):
    with pytest.raises(
        InputError, match=r"at t = 2 s, point \(0, 1\), expected a finite number of at most 1e\+40"
    ):
        Expression(text)(2.0, X)


def test_values_too_small_for_the_norm_of_a_load_are_zero():
    assert Expression("1e-200*x + 0")(0.0, X).tolist() == [0, 0, 0]
    assert Expression("exp(-50*x)")(0.0, X).tolist() == [1, 0, 0]  # e^-100 = 4e-44


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
    assert Expression({"table": "load.csv", "column": "other"}, tmp_path)(3.0, X).tolist() == [
        6,
        6,
        6,
    ]
    assert Expression(table.source) == table


@pytest.mark.parametrize(
    "content, entry, fragment",
    [
        ("t,a\n0,1\n\n0,2\n", {}, "line 4: received 0 after 0, expected strictly increasing times"),
        ("t,a\n", {}, "received no row of numbers"),
        ("t,a\n0,b\n", {}, "line 2, column 2: received 'b', expected a number"),
        ("t,a\n0\n", {}, "line 2 has 1 columns, expected 2"),
        ("t,a\n0,1\n", {"column": "b"}, "no column 'b'; choose from a"),
        ("0,1\n", {"column": "b"}, "it has no header"),
        (
            "0,0,-3000,0\n1,0,-3000,0\n",
            {},
            "received 4 columns without a header",
        ),  # decimal commas: no load at all
        ("t,f\n0,0,-3000,0\n", {}, "line 2 has 4 columns, expected 2"),
        ("0,1,2\n1,2,3\n", {}, "received 3 columns without a header"),
        ("0;1\n1;2\n", {}, "line 1 has semicolons"),
        ("t;f\n0;1,5\n", {}, "line 1 has semicolons"),
        ("0\t1\n", {}, "line 1 has tabs"),
        ("0,1\n1,2,3\n", {}, "line 2 has 3 columns, expected 2"),
        ("0,nan\n", {}, "line 1, column 2: received 'nan', expected a number"),
        ("0,1e300\n", {}, "received '1e300', expected a number of at most 1e+40"),
        ("0,1e-200\n", {}, "the largest value is 1e-200"),
        ("# only a comment\n", {}, "received no row of numbers"),
        ("0," + "7" * 100_000 + "\n", {}, "received '777"),
        (b"0,1\n1,\xe9\n", {}, "byte 0xe9 in line 2 is not UTF-8"),
    ],
)
def test_wrong_tables(tmp_path, content, entry, fragment):
    (tmp_path / "a.csv").write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InputError) as caught:
        Expression({"table": "a.csv", **entry}, tmp_path)
    assert fragment in str(caught.value) and len(str(caught.value)) < 400


def test_a_table_may_begin_with_a_byte_order_mark_and_end_lines_as_windows_does(tmp_path):
    (tmp_path / "a.csv").write_bytes(b"\xef\xbb\xbft,f\r\n0,1\r\n2,5\r\n")
    assert Expression({"table": "a.csv"}, tmp_path)(1.0, X[:1]) == [3.0]
