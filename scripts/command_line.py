"""What the command lines of all scripts have in common."""

import argparse


def parser(name, text):
    """Return the parser of a script, whose help is its docstring; name : what `scripts/run` calls
    it.
    """
    return argparse.ArgumentParser(
        prog=f"scripts/run {name}",
        description=text,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
