"""docs/laws.md: every law of the registries with its formula and its parameters."""

import inspect
from collections.abc import Iterator

from .law import Parameter, Registry, parameters

HEAD = """# Laws

Written by `scripts/write_laws.py` from the classes in `porofsi_petsc/materials` (do not edit by
hand). Laws of one's own: [python.md](python.md).
"""
ELASTIC = """## `material.solid.law`

Ψ per reference volume, F = I + H, E = (FᵀF - I)/2, J = det F, I1 = tr FᵀF; λ and μ are those of
small strain. In 2-D plane strain. Parameters beside lambda, mu (or young, poisson) and density:
"""
PERMEABILITY = """## `material.permeability.law`

k/k0 as a function of J; n_s0 is the initial solid fraction, n_f = 1 - n_s0/J. Parameters beside k
or intrinsic:
"""


def laws_document(elastic: Registry, permeability: Registry) -> str:
    """Return the text of docs/laws.md."""
    parts = [HEAD, ELASTIC, _table(elastic), PERMEABILITY, _table(permeability)]
    return "\n".join(parts)


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
    if entry.above is not None:
        yield f"above {entry.above:g}"
    if entry.at_most is not None:
        yield f"at most {entry.at_most:g}"
    yield "required" if entry.default is None else f"default {entry.default:g}"
