"""Tests and scripts use what is public of the package and of each other: a private name may change
without a test that changes with it.
"""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FILES = sorted([*ROOT.glob("tests/**/*.py"), *ROOT.glob("scripts/**/*.py")])
OWN = {"self", "cls"}  # a class of the tests has private members of its own
PATCHING = {"setattr", "delattr", "getattr", "object"}  # take a name as text
NAMEDTUPLE = {"_asdict", "_fields", "_make", "_replace"}  # public, of the standard library


def is_private(name):
    return isinstance(name, str) and re.fullmatch(r"_[^\W_]\w*", name) is not None


def private_names(tree):
    """Yield the private names that a file takes of others: attributes, imports, strings that name
    what is patched.
    """
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and getattr(node.value, "id", None) not in OWN:
            yield node.attr
        elif isinstance(node, ast.ImportFrom):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.Call) and _name(node.func) in PATCHING:
            yield from (word.value for word in node.args if isinstance(word, ast.Constant))


def _name(function):
    return getattr(function, "attr", getattr(function, "id", None))


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_private_member_of_others(path):
    found = {*filter(is_private, private_names(ast.parse(path.read_text(encoding="utf-8"))))}
    assert found - NAMEDTUPLE == set()
