"""A standard output whose reader has gone (| head)."""

import os
import select

OUTPUT = 1  # also of PETSc, whatever Python's is


def drop_unread() -> bool:
    """Let standard output go nowhere from now on when nobody is left to read it; return whether
    that was so.
    """
    poll = select.poll()
    poll.register(OUTPUT, 0)
    if not any(event & select.POLLERR for _, event in poll.poll(0)):
        return False
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, OUTPUT)
    os.close(nowhere)
    return True
