"""Tests use what is public of the package, of the scripts and of the tests' own helpers: a private
name may change without a test that changes with it.
"""

import ast
from pathlib import Path

import pytest

TESTS = Path(__file__).resolve().parent
FILES = sorted(TESTS.rglob("*.py"))
OWN = {"self", "cls"}  # a class of the tests has private members of its own
# still: of phases, coupling and the registries
ALLOWED = set(
    "_added _all _begin _columns _flow_terms _free_velocity _laws _mask _matrix _on_solid _p0"
    " _pressure _renew _rows _setup _start _tie _transfer _u1 _update_rates _v1".split()
)


def is_private(name):
    return name.startswith("_") and not name.startswith("__") and name.isidentifier()


def private_names(tree):
    """Yield the private names that a file takes of others: attributes, imports, strings that name
    what is patched.
    """
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and getattr(node.value, "id", None) not in OWN:
            yield node.attr
        elif isinstance(node, ast.ImportFrom):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value != "_":
            yield node.value


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(TESTS)))
def test_no_private_member_of_others(path):
    found = {*filter(is_private, private_names(ast.parse(path.read_text(encoding="utf-8"))))}
    assert found - ALLOWED == set()
