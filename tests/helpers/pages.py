"""Run the blocks of a page of docs in their order, as a reader would, in the working directory:

    python pages.py PAGE

A block that names a file in its first line, `# column.toml`, is written to it, with `, continued`
behind the name at its end. Others are run: bash in a shell of its own, in which `porofsi` and
`python` are those of this Python, python in one namespace for the page. What a text block shows has
to be in the output of the block before it: line by line in this order, numbers to 0.1 % or their
last digit, `...` for anything. A comment above a block says what else holds: `exit code 2`; or
`not run: WHY`, of a text `not compared: WHY`.
"""

import contextlib
import io
import os
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import launching

BLOCK = re.compile(r"^(?:<!-- (.*?) -->\n)?```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
NAMED = re.compile(r"(?:#!.*\n)?# ([\w.-]+\.\w+)(, continued)?\n")
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w])")
MARK = re.compile(r"exit code \d|not run: .+|not compared: .+")
LANGUAGES = ("toml", "python", "bash", "text", "csv")
CLOSE = 1e-3  # of a number: digits that other versions of the libraries give too


@dataclass(frozen=True)
class Block:
    """A fenced block: its mark (None without one), its language, its text, its line in the page."""

    mark: str | None
    language: str
    text: str
    line: int


def blocks(text):
    """Return the blocks of a page; raise where one would be passed over without a word."""
    found = [
        Block(match[1], match[2], match[3], text[: match.start()].count("\n") + 1)
        for match in BLOCK.finditer(text)
    ]
    for block in found:
        if block.language not in LANGUAGES:
            raise ValueError(f"line {block.line}: received the language '{block.language}'")
    if text.count("\n```") != 2 * len(found):
        raise ValueError("a block is indented or has no end")
    return found


def value(word):
    """Return a number and the size of its last digit."""
    digits, _, exponent = word.partition("e")
    return float(word), 10.0 ** (int(exponent or 0) - len(digits.partition(".")[2]))


def agree(shown, printed):
    """Tell whether a printed line is the one that is shown."""
    pattern = re.escape(NUMBER.sub("\0", shown.strip())).replace(re.escape("..."), ".*?")
    pattern = pattern.replace(re.escape("\0"), f"({NUMBER.pattern})")
    match = re.fullmatch(pattern, printed.strip())
    if match is None:
        return False
    pairs = zip(NUMBER.findall(shown), match.groups(), strict=True)
    for wanted, got in pairs:
        number, last = value(wanted)
        if abs(number - float(got)) > max(CLOSE * abs(number), last):
            return False
    return True


def compare(block, output):
    """Raise where a line that is shown is not in the output behind those above it."""
    left = iter(output.splitlines())
    for shown in filter(None, (line.strip() for line in block.text.splitlines())):
        if shown != "..." and not any(agree(shown, printed) for printed in left):
            raise AssertionError(f"line {block.line}: '{shown}' is not in the output:\n{output}")


def write(block):
    """Write a block to the file that it names; return whether it names one."""
    named = NAMED.match(block.text)
    if named is None:
        return False
    with open(named[1], "a" if named[2] else "w", encoding="utf-8") as file:
        file.write(block.text)
    return True


def in_shell(block, environment):
    """Return what a block of bash prints, errors too; raise where its exit code is not the one
    expected.
    """
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", block.text],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=environment,
    )
    wanted = int(block.mark.removeprefix("exit code ")) if block.mark else 0
    if done.returncode != wanted:
        raise AssertionError(
            f"line {block.line}: exit code {done.returncode}, not {wanted}:\n{done.stdout}"
        )
    return done.stdout


def in_namespace(block, names):
    """Return what a block of Python prints."""
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        exec(compile(block.text, f"line {block.line}", "exec"), names)
    return printed.getvalue()


def environment_of(folder):
    """Return the environment in which a shell finds `porofsi` and `python` of this Python first."""
    folder.mkdir()
    for name, arguments in {"python": "", "porofsi": " -m porofsi_petsc"}.items():
        program = folder / name
        program.write_text(f'#!/bin/sh\nexec "{sys.executable}"{arguments} "$@"\n')
        program.chmod(0o755)
    inherited = launching.environment()
    path = os.pathsep.join([str(folder), inherited["PATH"]])
    return inherited | {"PATH": path, "MPLBACKEND": "agg"}


def run(page):
    """Run a page."""
    sys.path.insert(0, str(Path.cwd()))
    names, output = {"__name__": "__main__"}, ""
    environment = environment_of(Path.cwd() / ".programs")
    for block in blocks(page.read_text(encoding="utf-8")):
        if block.mark and block.mark.startswith(("not run: ", "not compared: ")):
            continue
        if block.language == "text":
            compare(block, output)
        elif block.language == "bash" and NAMED.match(block.text) is None:
            output = in_shell(block, environment)
        elif block.language == "python" and NAMED.match(block.text) is None:
            output = in_namespace(block, names)
        elif not write(block):
            raise AssertionError(f"line {block.line}: names no file in its first line")


if __name__ == "__main__":
    run(Path(sys.argv[1]))
