"""An error on one rank alone ends the job: the others wait for what this rank will not send."""

import sys
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from mpi4py import MPI

from ..errors import PorofsiError

AGREEMENT_TIME = 5.0  # [s] that a failing rank waits for the others to fail in the same way


class Agreement:
    """A private duplicate of a communicator, so that its barrier meets no other message."""

    def __init__(self, comm: MPI.Comm) -> None:
        """Duplicate a communicator of several ranks (collective)."""
        self._several = comm.size > 1
        self._comm = comm.Dup() if self._several else comm

    def free(self) -> None:
        """Give the duplicate back (collective)."""
        if self._several:
            self._comm.Free()

    def everyone_fails(self) -> bool:
        """Tell whether all ranks arrive here within the agreement time."""
        request = self._comm.Ibarrier()
        deadline = time.monotonic() + AGREEMENT_TIME
        while not (arrived := request.Test()) and time.monotonic() < deadline:
            time.sleep(0.01)
        return arrived

    @contextmanager
    def required(self) -> Iterator[None]:
        """Let an error pass that all ranks have; one of this rank alone is said, and ends the
        job.
        """
        try:
            yield
        except (Exception, SystemExit) as error:
            if self._several and not self.everyone_fails():
                self._end(error)
            raise

    def _end(self, error):
        """Say the error and end the job of all ranks with its exit code."""
        if isinstance(error, PorofsiError):
            text = f"error: {error}"
            code = error.exit_code
        elif isinstance(error, SystemExit):
            text = f"rank {self._comm.rank} of {self._comm.size} left alone: exit({error.code!r})"
            code = error.code if isinstance(error.code, int) and error.code else 1
        else:
            lines = "".join(traceback.format_exception(error))
            text = f"rank {self._comm.rank} of {self._comm.size} failed:\n{lines}"
            code = 1
        with suppress(OSError):
            print(text, file=sys.stderr, flush=True)
        self._comm.Abort(code)
