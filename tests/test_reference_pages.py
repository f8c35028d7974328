"""The reference pages that are written by hand name what there is."""

import re
from pathlib import Path

import click

from porofsi_petsc.commands import cli
from porofsi_petsc.errors import PorofsiError

DOCS = Path(__file__).resolve().parents[1] / "docs"


def test_the_page_of_the_command_line_has_every_command_and_option_of_a_run():
    text = (DOCS / "command_line.md").read_text(encoding="utf-8")
    assert all(f"`porofsi {name}" in text for name in cli.commands)
    options = [entry for entry in cli.commands["run"].params if isinstance(entry, click.Option)]
    assert all(f"| `{option.opts[0]}" in text for option in options)


def test_the_page_of_the_command_line_has_every_exit_code():
    text = (DOCS / "command_line.md").read_text(encoding="utf-8")
    table = text.partition("## Exit codes")[2].partition("## ")[0]
    raised, kinds = {0}, [PorofsiError]
    while kinds:
        kind = kinds.pop()
        raised.add(kind.exit_code)
        kinds += kind.__subclasses__()
    assert {int(code) for code in re.findall(r"^\| (\d) ", table, re.MULTILINE)} == raised


def test_the_keys_of_the_symbols_are_keys_of_a_scene():
    pages = ("scene.md", "laws.md", "surface_conditions.md")
    documented = "\n".join((DOCS / page).read_text(encoding="utf-8") for page in pages)
    symbols = (DOCS / "symbols.md").read_text(encoding="utf-8")
    keys = re.findall(r"`([\w.]+)`", symbols)
    assert len(keys) > 40
    for key in keys:
        assert re.search(rf"\b{key.rpartition('.')[2]}\b", documented), key


def test_the_files_that_the_readme_links_are_there():
    """Those of the other pages are looked at by scripts/site."""
    root = DOCS.parent
    for name in ("README.md", "CONTRIBUTING.md"):
        links = re.findall(r"\]\((?!https?:)([^)#]+)", (root / name).read_text(encoding="utf-8"))
        assert links
        assert all((root / link).exists() for link in links), name


def test_every_page_is_in_a_list_of_the_site():
    """As scripts/site asks for, said in milliseconds."""
    lists = (DOCS / "index.md").read_text(encoding="utf-8").splitlines()
    pages = {
        str(path.relative_to(DOCS).with_suffix(""))
        for folder in (".", "tutorials", "howto")
        for path in (DOCS / folder).glob("*.md")
    }
    assert pages - set(lists) == {"index"}
