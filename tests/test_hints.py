"""Every public function and method says of what type its arguments and its result are."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parent.parent / "porofsi_petsc"
FILES = sorted(PACKAGE.rglob("*.py"))


def public_functions(node, in_class=False):
    """Yield (function, whether it is a method) of a module or a class, with the special methods."""
    for child in ast.iter_child_nodes(node):
        special = getattr(child, "name", "").startswith("__")
        if isinstance(child, ast.If):
            yield from public_functions(child, in_class)
        elif not special and getattr(child, "name", "_").startswith("_"):
            continue
        elif isinstance(child, ast.ClassDef):
            yield from public_functions(child, in_class=True)
        elif isinstance(child, ast.FunctionDef):
            yield child, in_class


def bare(function, is_method):
    """Return what of a function has no hint: its arguments but for self, and "return"."""
    given = function.args
    named = [*given.posonlyargs, *given.args, *given.kwonlyargs]
    static = any(getattr(d, "id", None) == "staticmethod" for d in function.decorator_list)
    named = named[1:] if is_method and not static else named
    found = [a.arg for a in (*named, given.vararg, given.kwarg) if a and a.annotation is None]
    return found + ["return"] * (function.returns is None)


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_public_functions_have_hints(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    without = {f.name: bare(f, m) for f, m in public_functions(tree) if bare(f, m)}
    assert not without
