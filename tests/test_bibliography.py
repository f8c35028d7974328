"""docs/bibliography.md has every DOI, ISBN and address that is cited, and no work that is cited
nowhere.
"""

import re
import unicodedata
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "bibliography.md"
CITATION = ROOT / "CITATION.cff"
PACKAGE = ROOT / "porofsi_petsc"
CITING = [
    *PACKAGE.rglob("*.py"),
    *(path for path in ROOT.glob("docs/**/*.md") if path != PAGE),
    *ROOT.glob("configs/**/*.toml"),
    ROOT / "README.md",
]
IDENTIFIER = re.compile(r"doi:(10\.[^\s\"';,\]]+)|ISBN (\d{13})")
ADDRESS = re.compile(r"^source = .*(https://[^\s\"]+)", re.MULTILINE)
ENTRIES = [
    " ".join(entry.split())
    for entry in re.split(r"^- ", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
]


def text_of(path):
    """Return a text with every run of blanks, of ends of line and of comment signs as one blank."""
    return re.sub(r"\s+(# )?", " ", path.read_text(encoding="utf-8"))


def identifiers(text):
    return {doi or isbn for doi, isbn in IDENTIFIER.findall(text)}


def first_author(entry):
    """Return the family name that an entry begins with."""
    name = re.split(r",| & | et al\.", entry)[0]
    return re.sub(r"^.*[A-Z]\. ", "", name)


def cited_in(entry):
    """Return the files that an entry names behind its dash."""
    files = []
    for place in re.findall(r"`([^`]+)`", entry.rpartition(" — ")[2]):
        candidates = (
            [*ROOT.glob(f"configs/{place}.toml")],
            [*ROOT.glob(f"docs/{place}")],
            [*PACKAGE.glob(place)],
            [*ROOT.glob(place)],
        )
        found = next(filter(None, candidates), None)
        assert found, f"{place}: no such scene, page or file"
        files += found
    return files


def test_every_identifier_is_in_the_bibliography():
    known = identifiers(" ".join(ENTRIES))
    missing = {
        f"{path.relative_to(ROOT)}: {one}"
        for path in CITING
        for one in identifiers(path.read_text(encoding="utf-8")) - known
    }
    assert not missing


def test_every_address_of_a_source_is_in_the_bibliography():
    page = PAGE.read_text(encoding="utf-8")
    sources = [ADDRESS.findall(path.read_text(encoding="utf-8")) for path in CITING]
    addresses = [address for found in sources for address in found]
    assert addresses
    assert all(f"<{address}>" in page for address in addresses)


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry[:40])
def test_a_work_is_cited_where_the_bibliography_says(entry):
    files = cited_in(entry)
    assert files
    for path in files:
        assert first_author(entry) in text_of(path), path


def test_the_works_are_in_the_order_of_their_authors():
    names = [unicodedata.normalize("NFKD", first_author(entry)).casefold() for entry in ENTRIES]
    letters = [re.sub(r"[^a-z]", "", name) for name in names]
    assert letters == sorted(letters)


def test_a_doi_is_linked_to_itself():
    for text, link in re.findall(r"\[doi:(\S+)\]\(https://doi\.org/(\S+)\)", " ".join(ENTRIES)):
        assert text == link


def test_the_check_digit_of_an_isbn_is_right():
    isbns = re.findall(r"ISBN (\d+)", " ".join(ENTRIES))
    assert isbns
    for isbn in isbns:
        digits = [int(digit) for digit in isbn]
        assert len(digits) == 13
        assert (sum(digits[::2]) + 3 * sum(digits[1::2])) % 10 == 0, isbn


def test_the_citation_has_version_and_licence_of_the_project():
    citation = CITATION.read_text(encoding="utf-8")
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    for key in ("version", "license"):
        (wanted,) = re.findall(rf'^{key} = "(.+)"$', project, re.MULTILINE)
        (given,) = re.findall(rf"^{key}: (.+)$", citation, re.MULTILINE)
        assert given.strip('"') == wanted
