"""Change single operators and constants of formulas and see whether the tests notice: a sample of
mutants, seeded.

Every mutant is the package with one change in one of the files below; the tests named beside the
file run on it until one fails. The table has a line for each mutant; what survives is a formula
that no test judges, or a change that changes nothing.
"""

import argparse
import ast
import copy
import csv
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import command_line

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = "porofsi_petsc"
LAWS = ("linear", "saint_venant_kirchhoff", "neo_hookean", "points", "strain")
OF_LAWS = ["test_kernels.py", "test_exact.py", "-k", "stress or law or strain or confined"]
TARGETS = {
    "materials/permeability.py": ["test_permeability.py"],
    "materials/porous.py": ["test_permeability.py", "test_porous_flag.py"],
    **dict.fromkeys((f"materials/{name}.py" for name in LAWS), OF_LAWS),
    "kernels/stabilization.py": ["test_stabilization.py"],
    "simulation/measures.py": ["test_measures.py", "test_auto_model.py"],
}
OPERATORS = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.MatMult: ast.Mult,
}
COMPARISONS = {
    ast.Lt: ast.GtE,
    ast.LtE: ast.Gt,
    ast.Gt: ast.LtE,
    ast.GtE: ast.Lt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
}
CALLS = {"maximum": "minimum", "minimum": "maximum", "max": "min", "min": "max"}
TIMEOUT = 900  # [s] of the tests of one mutant


@dataclass(frozen=True)
class Mutant:
    """One change: the file below the package, its line, what stood there and what stands there now,
    and the new source.
    """

    file: str
    line: int
    before: str
    after: str
    source: str


def main() -> None:
    """Make the sample, test it and write the table; exit 1 when there are survivors."""
    options = _arguments()
    mutants = sample(options.count, options.seed)
    with tempfile.TemporaryDirectory() as folder:
        rows = [row(mutant, killed(mutant, Path(folder))) for mutant in mutants]
    with open(options.output, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, rows[0], lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    survivors = [line for line in rows if line["killed"] == "no"]
    print(f"{len(rows)} mutants, {len(survivors)} survived")
    sys.exit(1 if survivors else 0)


def _arguments() -> argparse.Namespace:
    parser = command_line.parser("study mutants", __doc__)
    parser.add_argument("--count", type=int, default=64)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--output", default=ROOT / "docs/studies/mutants.csv")
    return parser.parse_args()


def sample(count: int, seed: int) -> list[Mutant]:
    """Return a sample with the same number from every file (where it has so many)."""
    rng = random.Random(seed)
    share = -(-count // len(TARGETS))
    chosen = []
    for file in TARGETS:
        found = list(mutants_of(file, (ROOT / PACKAGE / file).read_text(encoding="utf-8")))
        chosen += rng.sample(found, min(share, len(found)))
    return chosen[:count] if len(chosen) > count else chosen


def mutants_of(file: str, source: str) -> Iterator[Mutant]:
    """Yield all mutants of a source."""
    tree = ast.parse(source)
    for number, node in enumerate(ast.walk(tree)):
        for change in changes_of(node):
            changed = copy.deepcopy(tree)
            target = _node(changed, number)
            change(target)
            before = ast.unparse(node)
            after = ast.unparse(target)
            yield Mutant(file, node.lineno, before, after, ast.unparse(changed))


def _node(tree: ast.AST, number: int) -> ast.AST:
    return next(node for i, node in enumerate(ast.walk(tree)) if i == number)


def changes_of(node: ast.AST) -> list:
    """Return functions that change a node in place."""
    if isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
        sides = [side for side in ("left", "right") if _is_whole_number(getattr(node, side))]
        return [_swap_operator, *(partial(_count_up, side=side) for side in sides)]
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
        return [lambda n: setattr(n, "right", ast.BinOp(n.right, ast.Mult(), ast.Constant(2)))]
    if isinstance(node, ast.Compare) and type(node.ops[0]) in COMPARISONS:
        return [lambda n: n.ops.__setitem__(0, COMPARISONS[type(n.ops[0])]())]
    if isinstance(node, ast.Call) and getattr(node.func, "attr", None) in CALLS:
        return [lambda n: setattr(n.func, "attr", CALLS[n.func.attr])]
    if isinstance(node, ast.Constant) and type(node.value) is float:
        return [lambda n: setattr(n, "value", 2 * n.value or 1.0)]
    return []


def _is_whole_number(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and type(node.value) is int


def _swap_operator(node: ast.BinOp) -> None:
    node.op = OPERATORS[type(node.op)]()


def _count_up(node: ast.BinOp, side: str) -> None:
    setattr(node, side, ast.Constant(getattr(node, side).value + 1))


def killed(mutant: Mutant, folder: Path) -> bool:
    """Return whether a test fails on the mutant (one that never ends is killed, too)."""
    copy_of = folder / "copy"
    shutil.rmtree(copy_of, ignore_errors=True)
    for name in (PACKAGE, "tests", "scripts", "configs"):
        shutil.copytree(ROOT / name, copy_of / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", copy_of)
    (copy_of / PACKAGE / mutant.file).write_text(mutant.source, encoding="utf-8")
    environment = os.environ | {"PYTHONPATH": str(copy_of), "PYTHONDONTWRITEBYTECODE": "1"}
    if "compiled import" in mutant.source:  # machine code of its own
        environment["NUMBA_CACHE_DIR"] = str(copy_of / "cache")
    tests = [f"tests/{word}" if word.endswith(".py") else word for word in TARGETS[mutant.file]]
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *tests]
    try:
        result = subprocess.run(
            command, cwd=copy_of, env=environment, capture_output=True, text=True, timeout=TIMEOUT
        )
    except subprocess.TimeoutExpired:
        return True
    return result.returncode != 0


def row(mutant: Mutant, is_killed: bool) -> dict[str, str | int]:
    """Return the line of the table and print it."""
    line = {
        "file": mutant.file,
        "line": mutant.line,
        "before": mutant.before,
        "after": mutant.after,
    }
    line["killed"] = "yes" if is_killed else "no"
    print(*line.values(), sep=" | ", flush=True)
    return line


if __name__ == "__main__":
    main()
