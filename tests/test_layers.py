"""A file imports only from lower layers, or from its own folder (docs/architecture.md)."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parent.parent / "porofsi_petsc"
LAYER = {
    "__init__": 7,
    "__main__": 8,
    "commands": 7,
    "studies": 6,
    "simulation": 5,
    "coupling": 4,
    "output": 4,
    "phases": 3,
    "fem": 2,
    "linalg": 2,
}
LAYER |= {"fem": 2, "linalg": 2, "mesh": 1, "kernels": 1, "materials": 1, "elements": 1, "exact": 1}
LAYER |= {
    "config": 3,
    "accelerators": 1,
    "quantities": 1,
    "conditions": 2,
    "registry": 0,
    "document": 0,
    "clock": 0,
    "errors": 0,
    "log": 0,
    "signals": 0,
    "streams": 0,
    "tensors": 0,
    "compiled": 0,
}
# Siblings that may be used inside the same layer: errors, registry and compiled everywhere,
# elements by the other pure folders.
SHARED = {"errors", "registry", "elements", "tensors", "compiled"}
ONLY_IN = {
    "numba": {"compiled"},
    "h5py": {"mesh", "output"},
    "meshio": {"mesh", "output"},
    "pydantic": {"config"},
    "click": {"commands"},
    "matplotlib": {"output"},
}
NEVER_IN = {
    "petsc4py": {0, 1},
    "mpi4py": {0, 1},
}  # nor in config, which many commands need before they start PETSc
FILES = sorted(PACKAGE.rglob("*.py"))


def folder(path):
    """Return the first part of a file's place in the package: a folder or a module at the top."""
    return path.relative_to(PACKAGE).with_suffix("").parts[0]


def imports(path):
    """Return absolute dotted names of everything a file imports, wherever the statement stands."""
    here = ("porofsi_petsc", *path.relative_to(PACKAGE).with_suffix("").parts)
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(here[: len(here) - node.level]) if node.level else ""
            start = ".".join(filter(None, [base, node.module]))
            yield from (f"{start}.{alias.name}" for alias in node.names)


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_point_downwards(path):
    own = folder(path)
    for name in imports(path):
        parts = name.split(".")
        if parts[0] == "porofsi_petsc" and parts[1] in LAYER and parts[1] != own:
            assert LAYER[parts[1]] < LAYER[own] or (
                parts[1] in SHARED and LAYER[parts[1]] == LAYER[own]
            ), name
        assert own in ONLY_IN.get(parts[0], {own}), name
        assert LAYER[own] not in NEVER_IN.get(parts[0], set()), name
        assert own != "config" or parts[0] not in NEVER_IN, name


def test_every_file_has_a_layer():
    assert {folder(path) for path in FILES} <= set(LAYER)
