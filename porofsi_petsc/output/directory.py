"""The result directory: what belongs to it, and when it may be written to."""

import os
from pathlib import Path

from ..errors import InputError
from .files import on_root

# Every file this program writes; --force removes these and nothing else.
WRITTEN = (
    "history.csv",
    "summary.json",
    "scene.toml",
    "run.log",
    "fields.xdmf",
    "fields/*.h5",
    "checkpoint*.h5",
    "pressure.png",
    "velocity.png",
    "displacement.png",
    "histories.png",
    "paths.png",
    "profiles.csv",
    "reference.png",
)


def prepare(directory, force, restart, comm):
    """Create the directory, or make sure that an existing one may be written to; collective.

    restart : a checkpoint of this directory keeps what is there, one from elsewhere does not excuse a directory with files;
    force removes the files of an earlier run (names in WRITTEN, and their .tmp).
    Raises InputError when the directory is not empty and neither is given, is a file, or cannot be written.
    """
    on_root(comm, _prepare, Path(directory), force, restart)


def _prepare(directory, force, restart):
    if directory.exists() and not directory.is_dir():
        raise InputError(f"{directory}: is a file, expected a directory for the results; give another one with --output")
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as failure:
        reason = failure.strerror
        raise InputError(f"{directory}: could not be created ({reason}); give another directory with --output") from failure
    if not os.access(directory, os.R_OK | os.W_OK | os.X_OK):
        raise InputError(f"{directory}: not writable; change its permissions or give another directory with --output")
    continued = restart is not None and Path(restart).resolve().parent == directory.resolve()
    if continued or not any(directory.iterdir()):
        return
    if not force:
        raise InputError(
            f"{directory}: already holds files, expected a new or empty directory; "
            "use --force to replace its results, --restart FILE to continue them, or --output for another directory"
        )
    _remove_written(directory)


def _remove_written(directory):
    for pattern in WRITTEN:
        for name in (pattern, pattern + ".tmp"):
            for path in directory.glob(name):
                path.unlink()
