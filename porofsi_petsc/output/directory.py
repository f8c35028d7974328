"""The result directory: what belongs to it, when it may be written to, and when earlier results may
go.
"""

from __future__ import annotations

import os
import re
from contextlib import suppress
from pathlib import Path

from mpi4py import MPI

from ..errors import InputError
from ..log import logger
from .files import on_root
from .lock import NAME as LOCK
from .lock import Lock

# Every file that a run writes, as a regular expression of its path in the directory; each may have
# .tmp behind it.
WRITTEN = re.compile(
    r"(history\.csv|summary\.json|scene\.toml|run\.log|profiles\.csv|line_[A-Za-z_][A-Za-z0-9_\-]*\.(csv|png)|fields\.xdmf(\.next)?|fields\.vtkhdf(\.journal)?|checkpoint(\.next|\.previous)?\.h5|"
    r"(pressure|velocity|displacement|histories|paths|reference)\.png|fields/(mesh|\d{6,})\.h5)(\.tmp)?"
)
FIELDS = "fields"
# Folders in which --force puts earlier results aside.  At any moment their names say what belongs
# where, so that the next run finishes what a killed one has begun: UNSORTED belongs in the
# directory beside what is there; KEPT belongs there instead of what a run without an accepted step
# has written; GONE has been replaced.
UNSORTED = "porofsi.unsorted"
KEPT = "porofsi.kept"
GONE = "porofsi.gone"


def written_files(directory: Path) -> list[Path]:
    """Return the files of a run in its directory, sorted: by exact names, and not through links to
    folders.
    """
    fields = directory / FIELDS
    places = [directory] + ([fields] if fields.is_dir() and not fields.is_symlink() else [])
    found = [
        path for place in places for path in place.iterdir() if path.is_symlink() or path.is_file()
    ]
    return sorted(
        path for path in found if WRITTEN.fullmatch(path.relative_to(directory).as_posix())
    )


class Claim:
    """A directory held by one run, and what an earlier run has left there until the new one has
    done a step.

    As a context: with an error before `accept` earlier results come back.  All but the end is
    collective, rank 0 acts.
    """

    def __init__(self, directory: Path, force: bool, restart: Path | None, comm: MPI.Comm) -> None:
        """Create or take the directory, locked; finish what a killed run has begun there.

        restart : a checkpoint of this directory keeps what is there, one from elsewhere does not
        excuse a directory with files; with force the results of an earlier run (`written_files`)
        may be replaced. Raises InputError when the directory is not empty and neither is given, is
        a file, cannot be written, or is in use.
        """
        self._directory = Path(directory)
        self._comm = comm
        self._lock = None
        self._made: list[Path] = []
        on_root(comm, self._take, force, restart)

    def __enter__(self) -> Claim:
        return self

    def __exit__(self, *error: object) -> None:
        """End on rank 0 alone: other ranks may be elsewhere by now."""
        if self._comm.rank == 0:
            self._release()

    def put_aside(self) -> None:
        """Put the results of an earlier run aside when the new one does not continue them."""
        on_root(self._comm, self._put_aside)

    def accept(self) -> None:
        """Let earlier results go: the run has done a step, so its options and its scene are
        right.
        """
        on_root(self._comm, self._let_go)

    def _take(self, force, restart):
        self._create()
        try:
            self._lock = Lock(self._directory)
            recover(self._directory)
            self._continued = (
                restart is not None and Path(restart).resolve().parent == self._directory.resolve()
            )
            if not self._continued:
                _require_replaceable(self._directory, force)
        except BaseException:
            self._release()
            raise

    def _create(self):
        directory = self._directory
        if directory.exists() and not directory.is_dir():
            raise InputError(
                f"{directory}: is a file, expected a directory for the results; give another one"
                " with --output"
            )
        self._made = [folder for folder in (directory, *directory.parents) if not folder.exists()]
        try:
            directory.mkdir(parents=True, exist_ok=True)
        except OSError as failure:
            advice = "give another directory with --output"
            raise InputError(
                f"{directory}: could not be created ({failure.strerror}); {advice}"
            ) from failure
        if not os.access(directory, os.R_OK | os.W_OK | os.X_OK):
            raise InputError(
                f"{directory}: not writable; change its permissions or give another directory with"
                " --output"
            )

    def _put_aside(self):
        if not self._continued:
            _move(written_files(self._directory), self._directory, self._directory / UNSORTED)
            _rename(self._directory / UNSORTED, self._directory / KEPT)

    def _let_go(self):
        _rename(self._directory / KEPT, self._directory / GONE)
        recover(self._directory)

    def _release(self):
        """Bring back what was not replaced, unlock, and remove the folders made for nothing."""
        if self._lock is None:
            return
        try:
            recover(self._directory)
        finally:
            self._lock.release()
            _remove_empty(self._made)


def _require_replaceable(directory, force):
    if not force and any(path.name != LOCK for path in directory.iterdir()):
        raise InputError(
            f"{directory}: already holds files, expected a new or empty directory; use --force to"
            " replace its results, --restart FILE to continue them, or --output for another"
            " directory"
        )
    fields = directory / FIELDS
    if fields.is_symlink():
        raise InputError(
            f"{fields}: received a link, to {os.readlink(fields)}, expected a folder: --force"
            " replaces nothing elsewhere; remove the link, or give another directory with --output"
        )


def recover(directory: Path) -> None:
    """Bring earlier results back, or remove them, as the names of their folders say."""
    kept, unsorted, gone = (directory / name for name in (KEPT, UNSORTED, GONE))
    if kept.is_dir():
        _remove(written_files(directory))
        _remove_empty([directory / FIELDS])
        _rename(kept, unsorted)
        logger.warning("no step was done: the results that were in %s before are back", directory)
    if unsorted.is_dir():
        _move(written_files(unsorted), unsorted, directory)
        _remove_empty([unsorted / FIELDS, unsorted])
    if gone.is_dir():
        _remove(written_files(gone))
        _remove_empty([gone / FIELDS, gone])


def _move(paths, source, target):
    for path in paths:
        place = target / path.relative_to(source)
        place.parent.mkdir(parents=True, exist_ok=True)
        os.replace(path, place)


def _rename(folder, target):
    if folder.is_dir():
        os.rename(folder, target)


def _remove(paths):
    for path in paths:
        path.unlink()


def _remove_empty(folders):
    for folder in folders:
        with suppress(OSError):  # not there, or not empty
            folder.rmdir()
