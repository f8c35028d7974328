"""scripts/run: what it lists, refuses and is quoted with."""

import re
import subprocess
import sys
from pathlib import Path

import listing
import pytest

ROOT = Path(__file__).resolve().parents[1]
SCRIPTS = {
    (folder, name): path
    for folder, found in listing.scripts().items()
    for name, path in found.items()
}
OTHER_PROGRAMS = {("study", "selfweight_dolfinx")}  # runs without this package
QUOTING = [
    ROOT / "README.md",
    *ROOT.glob("docs/**/*.md"),
    *ROOT.glob("configs/**/*.toml"),
    *ROOT.glob("configs/**/*.md"),
    *ROOT.glob("porofsi_petsc/**/*.py"),
    *ROOT.glob("scripts/*/*.py"),
]


def test_every_script_is_listed_with_a_line():
    words = [sys.executable, listing.__file__, "--list"]
    listed = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    for folder, name in SCRIPTS:
        assert re.search(rf"^    {folder} {name} +\S+ \S+", listed, re.MULTILINE)


@pytest.mark.parametrize("words", [["bench", "speed"], ["bench"], ["benches"], ["--lists"]])
def test_a_name_of_no_script_is_refused(words, capsys):
    with pytest.raises(SystemExit) as end:
        listing.main(words)
    assert end.value.code == 2
    assert re.search(r"received '[\w-]+', choose from \w+, \w+", capsys.readouterr().err)


@pytest.mark.parametrize("folder, name", SCRIPTS)
def test_the_help_of_a_script_names_it_as_it_is_called(folder, name):
    text = SCRIPTS[folder, name].read_text(encoding="utf-8")
    called = rf'command_line\.parser\(\s*"{folder} {name}"|gmsh_file\.parse\("{name}"'
    assert re.search(called, text) or (folder, name) in OTHER_PROGRAMS


def test_only_scripts_that_exist_are_quoted():
    commands, files = set(), set()
    for path in QUOTING:
        text = path.read_text("utf-8")
        commands |= set(re.findall(r"scripts/run ([a-z]+) ([a-z]\w+)", text))
        files |= set(re.findall(r"\bscripts/[\w./]*\w", text))
    assert len(commands) > 20 and commands <= set(SCRIPTS)
    assert all((ROOT / name).exists() for name in files), files
