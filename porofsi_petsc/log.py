"""Logging: rank 0 writes plain lines to the terminal and to run.log, the other ranks are silent."""

import logging
import os
import sys
from pathlib import Path

logger = logging.getLogger("porofsi_petsc")


def start_log(directory: str | os.PathLike[str] | None, rank: int, quiet: bool = False) -> None:
    """Send INFO to standard output (with quiet only warnings) and, with times, to
    `directory`/run.log, which is appended to.

    directory : existing folder, or None for the terminal alone; rank : rank in the run's
    communicator. A second call replaces the first.
    """
    stop_log()
    logger.propagate = False
    logger.setLevel(logging.INFO)
    if rank != 0:
        logger.addHandler(logging.NullHandler())
        return
    terminal = _quiet_failure(logging.StreamHandler(sys.stdout))
    terminal.setLevel(logging.WARNING if quiet else logging.INFO)
    logger.addHandler(terminal)
    if directory is not None:
        file = _quiet_failure(logging.FileHandler(Path(directory) / "run.log", encoding="utf-8"))
        file.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s"))
        logger.addHandler(file)


def _quiet_failure(handler: logging.StreamHandler) -> logging.StreamHandler:
    """Let a handler drop lines that cannot be written (a full disk, a reader that has gone) instead
    of printing tracebacks.
    """
    handler.handleError = lambda record: None  # type: ignore[method-assign]
    return handler


def stop_log() -> None:
    """Close the handlers of `start_log`."""
    for handler in list(logger.handlers):
        logger.removeHandler(handler)
        handler.close()
