"""Entry from the console: signals and standard streams from the first moment to the last; the
commands are imported meanwhile.
"""

import os
import signal
import sys
import time
from contextlib import suppress

from .errors import Stopped
from .signals import Interrupted, answered_by, interrupt, note, noted
from .streams import drop_unread

TIME_OF_RANK_0 = 5.0  # [s] that another rank gives it to end the job after a signal


def _open_streams() -> None:
    """Give what was started without (>&-) a standard output and error: else the next file opened
    takes their place.
    """
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number
    sys.stdout, sys.stderr = (
        stream or open(os.devnull, "w") for stream in (sys.stdout, sys.stderr)
    )


def _close_streams() -> None:
    """Drop what standard output and error do not take (a full disk, a reader that has gone), of
    which Python would complain.

    PETSc, which ends later, would complain of a reader that has gone.
    """
    drop_unread()
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _end(text: object) -> int:
    """End the whole job after a signal: rank 0 says so at once, another rank when rank 0 has had
    its time and has not.
    """
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    mpi = sys.modules.get("mpi4py.MPI")
    world = mpi.COMM_WORLD if mpi and mpi.Is_initialized() and not mpi.Is_finalized() else None
    if world and world.rank:
        time.sleep(TIME_OF_RANK_0)
    with suppress(OSError):
        print(f"error: {text}", file=sys.stderr, flush=True)
    if world and world.size > 1:
        world.Abort(Stopped.exit_code)
    return Stopped.exit_code


def main() -> None:
    """Run the command of the console."""
    _open_streams()
    with answered_by(note):  # once the command has ended, nothing is left to be interrupted
        try:
            with answered_by(interrupt):
                from .commands import cli

                cli(prog_name="porofsi")
        except Interrupted as interrupted:
            sys.exit(_end(interrupted))
        except Exception as failure:
            if not noted():
                raise
            sys.exit(
                _end(f"{Interrupted(noted())} ({failure})")
            )  # somebody has made an error of his own of it
        finally:
            _close_streams()


if __name__ == "__main__":
    main()
