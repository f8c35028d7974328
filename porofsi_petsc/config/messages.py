"""Turn the schema library's errors into sentences: file, key, received, expected."""

from pathlib import Path
from typing import Any

from pydantic import ValidationError

from ..errors import WIDTH, shown

MAX_SENTENCES = 10
EXPECTED = {
    "float_type": "a number",
    "int_type": "a whole number",
    "bool_type": "true or false",
    "string_type": "text in quotes",
    "string_too_short": "text that is not empty",
    "string_too_long": "text of at most {max_length} characters",
    "string_unicode": "text in UTF-8",
    "string_pattern_mismatch": "a name of letters, digits, _ and -, that starts with a letter or _",
    "finite_number": "a finite number",
    "tuple_type": "a list",
    "dict_type": "a table",
    "model_type": "a table",
    "model_attributes_type": "a table",
    "greater_than": "a number > {gt:.10g}",
    "greater_than_equal": "a number >= {ge:.10g}",
    "less_than": "a number < {lt:.10g}",
    "less_than_equal": "a number <= {le:.10g}",
}


def sentences(where: str | Path, error: ValidationError, tables: dict[str, Any]) -> str:
    """Return one line per error of a pydantic ValidationError, at most ten.

    where : the file; tables : the raw input, which tells real keys from the library's own path
    entries.
    """
    errors = error.errors(include_url=False)
    lines = [f"{where} {_sentence(entry, tables)}" for entry in errors[:MAX_SENTENCES]]
    if len(errors) > MAX_SENTENCES:
        lines.append(f"{where}: and {len(errors) - MAX_SENTENCES} more errors")
    return "\n".join(lines)


def _sentence(entry: Any, tables: dict[str, Any]) -> str:
    key = _key(entry, tables)
    text = text_of(entry)
    return f"[{key}]: {text}" if key else f"[scene]: {text}"


def _key(entry: Any, tables: dict[str, Any]) -> str:
    parts = _real_parts(entry["loc"], tables, keep_last=entry["type"] == "missing")
    context = entry.get("ctx", {})
    if entry["type"].startswith("union_tag"):
        parts.append(context["discriminator"].strip("'"))
    return ".".join([*parts, *map(_part, filter(None, [context.get("key")]))])


def _real_parts(location: tuple, data: Any, keep_last: bool) -> list[str]:
    parts = []
    for i, part in enumerate(location):
        if isinstance(data, dict) and part in data:
            data = data[part]
        elif isinstance(data, (list, tuple)) and isinstance(part, int) and part < len(data):
            data = data[part]
        elif not (keep_last and i == len(location) - 1):
            continue
        parts.append(_part(part))
    return parts


def _part(key: object) -> str:
    """Return a part of a dotted key as it is written, or in quotes where it would not fit into a
    line.
    """
    text = str(key)
    return text if text.isprintable() and len(text) <= WIDTH else shown(text)


def text_of(entry: Any) -> str:
    """Return what one error says, without its key."""
    kind = entry["type"]
    context = entry.get("ctx", {})
    if kind == "wrong":
        return context["text"]
    if kind in ("missing", "union_tag_not_found"):
        return "received nothing, expected this key, which has no default"
    if kind == "union_tag_invalid":
        return (
            f"received {shown(context['tag'])}, expected one of"
            f" {context['expected_tags'].replace(chr(39), '')}"
        )
    value = entry["input"]
    value = list(value) if isinstance(value, tuple) else value
    return f"received {shown(value)}, expected {_expected(kind, context, entry['msg'])}"


def _expected(kind: str, context: dict[str, Any], message: str) -> str:
    if kind == "literal_error":
        choices = context["expected"].replace("'", "").replace(" or ", ", ")
        return f"one of {choices}"
    return EXPECTED[kind].format(**context) if kind in EXPECTED else message
