"""The tutorials and how-to guides are right: their blocks run in their order and print what the
pages show.
"""

import ast
import re
import subprocess
import sys

import pages
import pytest
from running import HELPERS, ROOT, environment

PAGES = sorted(
    path for folder in ("tutorials", "howto") for path in (ROOT / "docs" / folder).glob("*.md")
)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: f"{page.parent.name}/{page.stem}")
def test_the_blocks_of_a_page_run(page, tmp_path):
    done = subprocess.run(
        [sys.executable, str(HELPERS / "pages.py"), str(page)],
        cwd=tmp_path,
        env=environment(),
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("page", PAGES, ids=lambda page: f"{page.parent.name}/{page.stem}")
def test_a_block_that_is_not_run_says_why(page):
    for block in pages.blocks(page.read_text(encoding="utf-8")):
        assert block.mark is None or pages.MARK.fullmatch(block.mark), block


def test_a_shown_line_is_compared_by_its_numbers():
    assert pages.agree("u = -0.00661 m ...", "u = -0.0066106 m after 3 steps")
    assert not pages.agree("u = -0.00661 m", "u = -0.00671 m")
    assert not pages.agree("u = -0.00661 m", "p = -0.00661 m")


def test_what_is_shown_has_to_be_printed():
    block = pages.Block(None, "text", "first\n...\nthird\n", 1)
    pages.compare(block, "zeroth\nfirst\nsecond\nthird\n")
    with pytest.raises(AssertionError, match="third"):
        pages.compare(block, "third\nfirst\n")


def test_a_block_of_another_language_is_refused():
    with pytest.raises(ValueError, match="yaml"):
        pages.blocks("\n```yaml\na: 1\n```\n")


def quoted():
    """Return the messages that docs/howto/messages.md explains."""
    text = (ROOT / "docs" / "howto" / "messages.md").read_text(encoding="utf-8")
    return re.findall(r"^> `(.+)`$", text, re.MULTILINE)


def texts_of_the_source():
    """Return all texts of the package, the parts of a formatted one each for itself."""
    trees = (
        ast.parse(path.read_text(encoding="utf-8"))
        for path in (ROOT / "porofsi_petsc").rglob("*.py")
    )
    return {
        node.value
        for tree in trees
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    }


def test_the_messages_of_the_page_are_those_of_the_source():
    texts = texts_of_the_source()
    assert len(quoted()) > 15
    for message in quoted():
        for part in filter(None, message.split("...")):
            assert any(part in text for text in texts), (message, part)
