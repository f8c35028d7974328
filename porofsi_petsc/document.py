"""docs/laws.md and docs/surface_conditions.md: what is registered, with formulas and parameters."""

import inspect
from collections.abc import Iterator

from .registry import Parameter, Registry, parameters

HEAD = """# Laws

Written by `scripts/run docs registered` from the classes in `porofsi_petsc/materials` (do not edit
by hand). Laws of one's own: [python.md](python.md).
"""
ELASTIC = """## `material.solid.law`

Ψ per reference volume, F = I + H, E = (FᵀF - I)/2, J = det F, I1 = tr FᵀF; λ and μ are those of
small strain. In 2-D plane strain. Parameters beside lambda, mu (or young, poisson) and density:
"""
PERMEABILITY = """## `material.permeability.law`

k/k0 as a function of J; n_s0 is the initial solid fraction, n_f = 1 - n_s0/J. Parameters beside k
or intrinsic:
"""


CONDITIONS = """# Conditions on surfaces

Written by `scripts/run docs registered` from the classes in `porofsi_petsc/conditions` (do not edit
by hand): the keys of `[[boundary]]` beside those of [scene.md](scene.md). A condition is a term of
a balance on the surface; it stands beside what it does not exclude, component by component where
both have components. Formulas are those of time and reference position. Conditions of one's own:
[python.md](python.md).
"""


def laws_document(elastic: Registry, permeability: Registry) -> str:
    """Return the text of docs/laws.md."""
    parts = [HEAD, ELASTIC, _table(elastic), PERMEABILITY, _table(permeability)]
    return "\n".join(parts)


def conditions_document(conditions: Registry) -> str:
    """Return the text of docs/surface_conditions.md."""
    lines = [
        "| key | behind it | what it is | value | excludes | history |",
        "|---|---|---|---|---|---|",
    ]
    lines += [_condition_row(name, condition) for name, condition in conditions.items()]
    return CONDITIONS + "\n" + "\n".join(lines) + "\n"


def _condition_row(name, condition):
    found = parameters(condition)
    value = _value(found["value"]) if set(found) == {"value"} else "table: " + _words(condition)
    columns = [f"`TAG.{column}` [{unit}]" for column, unit in condition.columns.items()]
    cells = (
        f"`{name}`",
        ", ".join(condition.behind),
        _formula(condition),
        value,
        _excluded(condition),
        ", ".join(columns) or "—",
    )
    return f"| {' | '.join(cells)} |"


def _value(entry: Parameter) -> str:
    words = {"number": "number", "formula": "formula", "vector": "table of components"}
    limits = [text for text in _range(entry) if text != "required"]
    return ", ".join([f"{words[entry.kind]}: {entry.meaning} [{entry.unit}]", *limits])


def _excluded(condition):
    found = [f"{', '.join(names)} ({kind})" for kind, names in condition.excludes.items()]
    return "; ".join(found) or "—"


def _table(registry):
    lines = ["| law | formula | parameters |", "|---|---|---|"]
    lines += [f"| `{name}` | {_formula(law)} | {_words(law)} |" for name, law in registry.items()]
    return "\n".join(lines) + "\n"


def _formula(law):
    """Return the first paragraph of the class's documentation."""
    return " ".join(inspect.getdoc(law).partition("\n\n")[0].split())


def _words(law):
    return "; ".join(_words_of(key, entry) for key, entry in parameters(law).items()) or "—"


def _words_of(key: str, entry: Parameter) -> str:
    return f"`{key}`: {entry.meaning} [{entry.unit}], {', '.join(_range(entry))}"


def _range(entry: Parameter) -> Iterator[str]:
    if entry.words:
        yield f"one of {', '.join(entry.words)}"
    if entry.above is not None:
        yield f"above {entry.above:g}"
    if entry.at_least is not None:
        yield f"at least {entry.at_least:g}"
    if entry.at_most is not None:
        yield f"at most {entry.at_most:g}"
    if entry.kind == "vector" and entry.default is not None:
        yield "default none"
    else:
        yield "required" if entry.default is None else f"default {_plain(entry.default)}"


def _plain(default: float | tuple[float, ...]) -> str:
    """Return a number or a list of some as a scene has it."""
    if isinstance(default, tuple):
        return f"[{', '.join(map(_plain, default))}]"
    return f"{default:g}"
