"""What `scripts/run` can run: a line for each script, or the refusal of a name that is none."""

import ast
import re
import sys
from pathlib import Path

SCRIPTS = Path(__file__).resolve().parent


def summary(path):
    """Return the first clause of a file's docstring."""
    text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))
    return re.split(r"[.;:](?:\s|$)", " ".join(text.split()))[0]


def scripts():
    """Return folder -> name -> path of the scripts, which are the files with a main part."""
    return {
        folder.parent.name: {
            path.stem: path
            for path in sorted(folder.parent.glob("*.py"))
            if "__main__" in path.read_text(encoding="utf-8")
        }
        for folder in sorted(SCRIPTS.glob("*/__init__.py"))
    }


def main(words):
    """Print the list, or end with code 2 where the words name no script."""
    found = scripts()
    if words in ([], ["--list"], ["--help"], ["-h"]):
        print("usage: scripts/run FOLDER NAME [ARGUMENT...]     with --help: what it takes\n")
        for folder, paths in found.items():
            print(f"{folder}: {summary(SCRIPTS / folder / '__init__.py')}")
            for name, path in paths.items():
                print(f"    {f'{folder} {name}':26}{summary(path)}")
        return
    known = found.get(words[0], found)
    unknown = (words[1:] or ["nothing"])[0] if words[0] in found else words[0]
    print(f"scripts/run: received '{unknown}', choose from {', '.join(known)}", file=sys.stderr)
    sys.exit(2)


if __name__ == "__main__":
    main(sys.argv[1:])
